from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import SOLIDS, place, polyhedra

from grainsdem.errors import InputError, ValidationError
from grainsdem.geometry.rotations import multiply
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import carve, shrink
from grainsdem.packing.contacts import mean_diameter
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate
from grainsdem.validation import validate

D = np.cbrt(6 / np.pi * 8)  # the diameter of the sphere of a cube's volume, edge 2


def check(report, name):
    return next(c for c in report.checks if c.name == name)


def with_faces(packing, grain, faces):
    """Return the packing with other faces for one grain."""
    rings = [packing.grains.faces_of(i) if i != grain else faces for i in range(len(packing))]
    grains = packing.grains
    flat = [np.asarray(ring) for ring_list in rings for ring in ring_list]
    return replace(
        packing,
        grains=Polyhedra(
            grains.vertices,
            grains.vertex_offsets,
            np.cumsum([0] + [len(r) for r in rings]),
            np.concatenate(flat),
            np.cumsum([0] + [len(r) for r in flat]),
        ),
        links=None,
    )


def with_vertices(packing, vertices):
    g = packing.grains
    grains = Polyhedra(vertices, g.vertex_offsets, g.face_offsets, g.face_vertices, g.face_vertex_offsets)
    return replace(packing, grains=grains)


def row_of_cubes():
    return cube_packing([[1.5, 5, 5], [4, 5, 5], [6.5, 5, 5], [8.9, 5, 5]])


@pytest.mark.unit
@pytest.mark.parametrize("method", ["planes", "manifold3d"])
def test_grains_shrunk_in_place_pass_every_check(fresh, method):
    report = validate(fresh, method=method)
    assert report.ok, report.failed
    assert report.raise_if_failed() is report
    assert check(report, "overlaps").worst == 0
    assert check(report, "convex").worst < 1e-12
    assert check(report, "smallest gap").worst > 0


@pytest.mark.unit
@pytest.mark.parametrize("method", ["planes", "manifold3d"])
def test_cells_that_touch_everywhere_do_not_overlap(cells, method):
    report = validate(carve(cells, keep="all"), method=method)
    assert report.ok, report.failed
    assert check(report, "overlaps").worst < 1e-12
    assert abs(check(report, "smallest gap").worst) < 1e-12


@pytest.mark.unit
@pytest.mark.parametrize("method", ["planes", "manifold3d"])
@pytest.mark.parametrize("fraction", [1e-3, 1e-6, 1e-8])
def test_a_planted_overlap_is_found_with_its_two_ids_its_volume_and_its_depth(method, fraction):
    packing = cube_packing([[1.5, 5, 5], [4, 5, 5], [6 - 2 * fraction, 5, 5], [8.9, 5, 5]])
    report = validate(packing, method=method)
    assert check(report, "overlaps").offenders == ((1, 2),)
    assert check(report, "overlaps").worst == pytest.approx(fraction, rel=1e-6)
    assert check(report, "overlap depth").offenders == ((1, 2),)
    assert check(report, "overlap depth").worst == pytest.approx(2 * fraction / D, rel=1e-6)
    assert [c.name for c in report.failed] == ["overlaps", "overlap depth"]
    with pytest.raises(ValidationError, match=r"overlaps.*1–2"):
        report.raise_if_failed()


@pytest.mark.unit
@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("kind", ["corner", "edge", "face"])
def test_a_planted_depth_is_found_even_where_it_has_next_to_no_volume(kind, depth):
    shapes = polyhedra(SOLIDS["cube"][0], SOLIDS["octahedron"][0] if kind == "corner" else SOLIDS["cube"][0])
    turn = Rotation.from_euler("x", 45 if kind == "edge" else 0, degrees=True).as_quat()
    q = np.array([[1.0, 0, 0, 0], np.roll(turn, 1)])
    height = {"corner": 2.0, "edge": 1 + np.sqrt(2), "face": 2.0}[kind]
    apart = place(shapes, [[5.0, 5, 2], [5, 5, 2 + height]], quaternions=q)
    d = mean_diameter(apart)
    assert validate(apart).ok
    pressed = replace(apart, positions=apart.positions - [[0, 0, 0], [0, 0, depth * d]])
    found = check(validate(pressed), "overlap depth")
    assert not found.ok
    assert found.offenders == ((0, 1),)
    assert found.worst == pytest.approx(depth, abs=1e-14)


@pytest.mark.unit
@pytest.mark.parametrize("miss", [0.0, 1e-12, -1e-12])
def test_touching_to_within_rounding_is_no_overlap(miss):
    packing = cube_packing([[2.0, 5, 5], [4 + miss * D, 5, 5], [4, 7 + miss * D, 5.5]])
    assert validate(packing).ok
    assert validate(packing, method="manifold3d").ok


@pytest.mark.unit
@pytest.mark.parametrize("offset", [2.0**21, -(2.0**21)])
@pytest.mark.parametrize("depth", [0.0, 2.0**-20, 2.0**-30])
def test_a_packing_far_from_the_origin_is_judged_as_it_is_near_it(offset, depth):
    near = cube_packing([[2.0, 5, 5], [4 - depth, 5, 5.5]])
    far = replace(near, positions=near.positions + offset, domain=Domain(np.full(3, offset), np.full(3, offset + 10)))
    for name in ("overlaps", "overlap depth", "smallest gap"):
        here, there = check(validate(near), name), check(validate(far), name)
        assert (here.ok, here.offenders) == (there.ok, there.offenders)
        expected = name == "smallest gap" or depth == 0 or (name == "overlaps" and depth < 1e-9)
        assert here.ok == expected
        assert there.worst == pytest.approx(here.worst, rel=1e-9, abs=1e-14)


@pytest.mark.property
@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 1e-6, 1e-3]))
def test_a_rigid_motion_of_a_packing_does_not_change_what_is_found(seed, depth):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng)
    packing = cube_packing([[0, 0, 0], [2 - depth * D + 1e-13, 0.3, 0.2], [0, 2.5, 0]])
    q = np.roll(turn.as_quat(), 1)
    moved = replace(
        packing,
        positions=turn.apply(packing.positions.copy()) + rng.uniform(-50, 50, 3),
        quaternions=multiply(np.broadcast_to(q, (3, 4)), packing.quaternions),
        domain=Domain(np.full(3, -100), np.full(3, 100)),
    )
    found = check(validate(moved), "overlap depth")
    assert found.worst == pytest.approx(depth, abs=1e-13)
    assert found.offenders == (((0, 1),) if depth else ())


@pytest.mark.unit
def test_soft_contacts_pass_with_a_larger_overlap_and_the_note_says_so():
    packing = cube_packing([[2.0, 5, 5], [4 - 2e-4, 5, 5]])
    tight = validate(packing)
    assert "such as 1e-3" in check(tight, "overlaps").note
    assert "such as 1e-3" in check(tight, "overlap depth").note
    assert validate(packing, overlap=1e-3).ok
    assert not validate(packing, overlap=1e-3, depth=1e-5).ok


@pytest.mark.unit
def test_an_overlap_across_a_periodic_boundary_counts():
    domain = Domain.cube(8.0, periodic=True)
    packing = cube_packing([[0.5, 4, 4], [6.375, 4, 4]], domain=domain)
    assert check(validate(packing), "overlaps").offenders == ()
    packing = replace(packing, positions=[[0.5, 4, 4], [6.625, 4, 4]])
    report = validate(packing)
    assert check(report, "overlaps").offenders == ((0, 1),)
    assert check(report, "overlaps").worst == pytest.approx(0.125 / 2)
    assert check(report, "inside the domain").ok


@pytest.mark.unit
def test_a_periodic_packing_passes():
    domain = Domain.cube(1.0, periodic=True)
    packing = shrink(carve(tessellate(poisson(domain, 80, rng=3), domain)), scale=0.95)
    assert validate(packing).ok
    assert validate(packing, method="manifold3d").ok


@pytest.mark.unit
def test_a_flipped_face_is_named():
    packing = row_of_cubes()
    faces = packing.grains.faces_of(2)
    report = validate(with_faces(packing, 2, [faces[0][::-1], *faces[1:]]))
    assert check(report, "outward").offenders == (2,)
    assert [c.name for c in report.failed] == ["outward"]


@pytest.mark.unit
def test_a_grain_turned_inside_out_is_named():
    packing = row_of_cubes()
    report = validate(with_faces(packing, 1, [face[::-1] for face in packing.grains.faces_of(1)]))
    assert check(report, "outward").offenders == (1,)
    assert check(report, "positive volume").offenders == (1,)
    assert check(report, "positive volume").worst == pytest.approx(-8 / D**3)


@pytest.mark.unit
def test_a_missing_triangle_is_named():
    packing = row_of_cubes()
    faces = packing.grains.faces_of(3)
    report = validate(with_faces(packing, 3, [faces[0][:3], *faces[1:]]))
    assert check(report, "closed").offenders == (3,)
    assert "1 unsound grains left out" in check(report, "overlaps").note


@pytest.mark.unit
@pytest.mark.parametrize("dent", [1e-2, 1e-6])
def test_a_grain_that_is_not_convex_is_named_with_the_depth_of_its_dent(dent):
    packing = row_of_cubes()
    # A cube whose upper face is a pyramid of four triangles, its tip below the rim.
    corners = np.vstack([packing.grains.vertices_of(1), [[0, 0, 1 - dent * D]]])
    counts = np.array([8, 9, 8, 8])
    vertices = np.vstack([packing.grains.vertices_of(0), corners, *(packing.grains.vertices_of(i) for i in (2, 3))])
    faces = [f for f in packing.grains.faces_of(0) if not (packing.grains.vertices_of(0)[f, 2] > 0).all()]
    top = next(f for f in packing.grains.faces_of(0) if (packing.grains.vertices_of(0)[f, 2] > 0).all())
    rings = [packing.grains.faces_of(i) for i in range(4)]
    rings[1] = [*faces, *([top[k], top[(k + 1) % 4], 8] for k in range(4))]
    flat = [np.asarray(ring) for ring_list in rings for ring in ring_list]
    grains = Polyhedra(
        vertices,
        np.cumsum([0, *counts]),
        np.cumsum([0] + [len(r) for r in rings]),
        np.concatenate(flat),
        np.cumsum([0] + [len(r) for r in flat]),
    )
    report = validate(replace(packing, grains=grains))
    assert [c.name for c in report.failed] == ["convex"]
    assert check(report, "convex").offenders == (1,)
    # The corner across lies twice the dent beyond each triangle's plane; the triangle is half as wide as that is far.
    assert dent / 2 < check(report, "convex").worst < 2 * dent


@pytest.mark.unit
@pytest.mark.parametrize("where", ["vertices", "positions", "quaternions", "densities"])
def test_a_number_that_is_none_is_refused_with_its_grain(where):
    packing = row_of_cubes()
    if where == "vertices":
        vertices = packing.grains.vertices.copy()
        vertices[9, 1] = np.nan
        packing = with_vertices(packing, vertices)
    else:
        values = getattr(packing, where).copy()
        values[1, ...] = np.inf
        packing = replace(packing, **{where: values})
    report = validate(packing)
    assert check(report, "finite").offenders == (1,)
    assert {c.name for c in report.failed} <= {"finite", "unit quaternions"}
    assert all(np.isfinite(c.worst) for c in report.checks)


@pytest.mark.unit
def test_a_quaternion_that_is_no_rotation_is_named():
    packing = row_of_cubes()
    quaternions = packing.quaternions.copy()
    quaternions[2] *= 1 + 1e-6
    report = validate(replace(packing, quaternions=quaternions))
    assert check(report, "unit quaternions").offenders == (2,)
    assert check(report, "unit quaternions").worst == pytest.approx(1e-6)


@pytest.mark.unit
def test_a_grain_through_a_wall_is_named_and_one_that_touches_it_is_not():
    packing = cube_packing([[1.0, 1, 1], [9.01, 5, 5]])
    report = validate(packing)
    assert check(report, "inside the domain").offenders == (1,)
    assert check(report, "inside the domain").worst == pytest.approx(0.01 / D)


@pytest.mark.unit
@pytest.mark.parametrize("offset", [0.0, 2.0**20])
def test_a_grain_through_the_slope_of_a_hopper_is_named_with_how_far(offset):
    hopper = Domain.hopper(6.0, 2.0, 2.0)
    domain = Domain(
        hopper.lower + offset,
        hopper.upper + offset,
        planes=np.column_stack([hopper.planes[:, :3], hopper.planes[:, 3] + hopper.planes[:, :3].sum(axis=1) * offset]),
    )
    # The lower edge of the second cube, at x = 2.5 and z = 1.25, lies beyond the plane x - z = 1.
    packing = cube_packing([[0.0, 0, 1], [2.25, 0, 1.5]], half=0.25, domain=domain)
    packing = replace(packing, positions=packing.positions + offset)
    found = check(validate(packing), "inside the domain")
    assert found.offenders == (1,)
    assert found.worst == pytest.approx((2.5 - 1.25 - 1) / np.sqrt(2) / mean_diameter(packing), rel=1e-8)
    assert validate(replace(packing, positions=packing.positions - [[0, 0, 0], [0.3, 0, 0]])).ok


@pytest.mark.unit
def test_two_grains_in_one_place_are_named_as_that_and_as_an_overlap():
    report = validate(cube_packing([[5.0, 5, 5], [5, 5, 5]]))
    assert check(report, "distinct").offenders == ((0, 1),)
    assert check(report, "overlaps").worst == pytest.approx(1)


@pytest.mark.unit
def test_the_smallest_parts_are_told_and_never_fail():
    report = validate(cube_packing([[2.0, 5, 5], [4.03, 5, 5], [8, 5, 5]]))
    assert check(report, "smallest gap").worst == pytest.approx(0.03 / D)
    assert check(report, "shortest edge").worst == pytest.approx(2 / D)
    assert check(report, "smallest face").worst == pytest.approx(4 / D**2)
    assert check(report, "vertices a grain").worst == 8


@pytest.mark.unit
def test_a_grain_of_more_vertices_than_physx_takes_is_listed_but_no_failure():
    rng = np.random.default_rng(0)
    points = rng.standard_normal((80, 3))
    packing = place(polyhedra(points / np.linalg.norm(points, axis=1, keepdims=True)), [[5.0, 5, 5]])
    found = check(validate(packing), "vertices a grain")
    assert found.ok
    assert found.worst == 80
    assert found.offenders == (0,)


@pytest.mark.unit
def test_no_grain_at_all_is_a_sound_packing():
    empty = Packing(Polyhedra(np.empty((0, 3)), [0], [0], [], [0]), np.empty((0, 3)), np.empty((0, 4)), [], Domain())
    assert validate(empty).ok


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "message"),
    [({"overlap": -1.0}, "overlap must be"), ({"depth": np.nan}, "depth must be"), ({"method": "fast"}, "got 'fast'")],
)
def test_options_that_mean_nothing_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        validate(cube_packing([[5.0, 5, 5]]), **options)
