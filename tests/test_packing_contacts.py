from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from solids import SOLIDS, blob, centred, place, polyhedra

from grainsdem.dynamics import settle
from grainsdem.errors import InputError
from grainsdem.geometry import separation
from grainsdem.geometry.bounds import near_pairs
from grainsdem.model import Domain
from grainsdem.packing import carve, contacts, shrink, shuffle
from grainsdem.packing.contacts import NEAR, mean_diameter, neighbor_contacts
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate


def _rows(graph):
    return graph.pairs.tolist(), graph.shifts.tolist(), graph.gaps.tolist()


def row_of(graph, i, j):
    return int(np.flatnonzero((graph.pairs == [i, j]).all(axis=1))[0])


@pytest.mark.unit
def test_a_row_of_cubes_touches_face_to_face_and_the_gap_of_one_is_the_other_ones_too():
    packing = cube_packing([[1.0, 5, 5], [3, 5, 5], [5.25, 5.5, 5], [9, 9, 9]])
    graph = contacts(packing, within=0.5)
    assert graph.pairs.tolist() == [[0, 1], [1, 2]]
    np.testing.assert_allclose(graph.gaps, [0, 0.25], atol=1e-15)
    np.testing.assert_allclose(graph.areas, [4, 3], rtol=1e-14)
    np.testing.assert_allclose(graph.points, [[2, 5, 5], [4.125, 5.25, 5]], rtol=1e-14)
    np.testing.assert_allclose(graph.normals, [[1, 0, 0], [1, 0, 0]], atol=1e-12)
    assert graph.coordination().tolist() == [1, 2, 1, 0]


@pytest.mark.unit
def test_the_default_threshold_is_a_thousandth_of_the_mean_diameter():
    d = np.cbrt(6 / np.pi * 8)
    step = 2 + NEAR * d
    assert len(contacts(cube_packing([[2.0, 5, 5], [2 + step * (1 - 1e-9), 5, 5]]))) == 1
    assert len(contacts(cube_packing([[2.0, 5, 5], [2 + step * (1 + 1e-6), 5, 5]]))) == 0


@pytest.mark.unit
@pytest.mark.parametrize("within", [-1.0, np.nan, np.inf])
def test_a_threshold_that_is_no_length_is_refused(within):
    with pytest.raises(InputError, match="within must be zero or more"):
        contacts(cube_packing([[5.0, 5, 5]]), within=within)


@pytest.mark.unit
def test_no_grain_and_one_grain_have_no_contact():
    alone = cube_packing([[5.0, 5, 5]])
    assert len(contacts(alone, within=1.0)) == 0
    nobody = place(polyhedra(SOLIDS["cube"][0]), [[5.0, 5, 5]])
    assert contacts(nobody).n_grains == 1


@pytest.mark.unit
def test_grains_in_place_have_the_gaps_and_normals_that_the_tessellation_gives_in_closed_form(fresh):
    closed = neighbor_contacts(fresh)
    d = mean_diameter(fresh)
    searched = contacts(fresh, within=float(closed.gaps.max()))
    index = {tuple(pair): row for row, pair in enumerate(searched.pairs.tolist())}
    rows = np.array([index[tuple(pair)] for pair in closed.pairs.tolist() if tuple(pair) in index])
    known = np.array([tuple(pair) in index for pair in closed.pairs.tolist()])
    assert known.mean() > 0.9
    excess = searched.gaps[rows] - closed.gaps[known]
    # Planes bound the distance from below; where the shrunk faces still face each other they are the distance.
    assert excess.min() > -1e-12 * d
    facing = searched.areas[rows] > 0
    assert facing.mean() > 0.8
    assert np.abs(excess[facing]).max() < 1e-12 * d
    np.testing.assert_allclose(searched.normals[rows[facing]], closed.normals[known][facing], atol=1e-9)


@pytest.mark.unit
def test_cells_that_touch_share_their_whole_face_with_each_neighbour(cells):
    grains = carve(cells, keep="all")
    closed = neighbor_contacts(grains)
    searched = contacts(grains, within=1e-9 * mean_diameter(grains))
    d = mean_diameter(grains)
    assert np.abs(closed.gaps).max() < 1e-12 * d
    assert np.abs(searched.gaps).max() < 1e-12 * d
    large = closed.areas > 1e-3 * d**2
    for row in np.flatnonzero(large):
        other = row_of(searched, *closed.pairs[row])
        assert searched.areas[other] == pytest.approx(closed.areas[row], rel=1e-6)
        np.testing.assert_allclose(searched.points[other], closed.points[row], atol=0.5 * d)
    assert (closed.coordination() <= np.diff(grains.grains.face_offsets)).all()


@pytest.mark.unit
def test_neighbours_are_known_only_while_grains_are_in_their_cells(poured):
    with pytest.raises(InputError, match="no links"):
        neighbor_contacts(poured)


@pytest.mark.unit
def test_contacts_across_a_periodic_boundary_are_those_inside_shifted():
    domain = Domain.cube(8.0, periodic=True)
    packing = cube_packing([[0.5, 4, 4], [6.25, 4, 4]], domain=domain)
    graph = contacts(packing, within=0.5)
    assert graph.pairs.tolist() == [[0, 1]]
    assert graph.gaps[0] == pytest.approx(0.25)
    np.testing.assert_allclose(graph.normals[0], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(graph.points[0], [-0.625, 4, 4], atol=1e-12)


@pytest.mark.unit
def test_a_grain_in_a_narrow_periodic_domain_touches_its_own_image():
    graph = contacts(cube_packing([[1.0, 5, 5]], domain=Domain.box((2.0, 9, 9), periodic=True)))
    assert graph.pairs.tolist() == [[0, 0]]
    assert graph.areas[0] == pytest.approx(4)


@pytest.mark.unit
def test_a_periodic_tessellation_knows_its_neighbours_across_the_boundary():
    domain = Domain.cube(1.0, periodic=True)
    grains = shrink(carve(tessellate(poisson(domain, 60, rng=2), domain)), scale=0.9)
    closed = neighbor_contacts(grains)
    searched = contacts(grains, within=float(closed.gaps.max()))
    assert len(closed) == grains.grains.n_faces / 2
    assert closed.gaps.min() > 0
    d = mean_diameter(grains)
    known = {(*pair, *shift): gap for pair, shift, gap in zip(*_rows(closed), strict=True)}
    facing = [
        abs(gap - known[(*pair, *shift)])
        for pair, shift, gap, area in zip(*_rows(searched), searched.areas, strict=True)
        if area > 0
    ]
    # Where shrunk faces still face each other, the planes' distance is the grains'.
    assert len(facing) > 0.8 * len(closed)
    assert max(facing) < 1e-12 * d


@pytest.mark.property
def test_contacts_of_random_grains_are_those_of_a_search_of_every_pair_with_fcl():
    import fcl

    rng = np.random.default_rng(8)
    shapes = centred(polyhedra(*[blob(rng) for _ in range(60)]))
    packing = place(shapes, rng.random((60, 3)) * 4, domain=Domain.cube(4.0))
    within = 0.2
    graph = contacts(packing, within=within)
    solids = []
    for i in range(60):
        faces = np.concatenate([[len(face), *face] for face in shapes.faces_of(i)])
        convex = fcl.Convex(shapes.vertices_of(i), len(shapes.faces_of(i)), faces)
        solids.append(fcl.CollisionObject(convex, fcl.Transform(np.eye(3), packing.positions[i])))
    everything = near_pairs(np.zeros((60, 3)), np.ones((60, 3)))
    assert len(everything) == 60 * 59 / 2
    wanted = {}
    for i, j in everything.tolist():
        distance = fcl.distance(solids[i], solids[j], fcl.DistanceRequest(), fcl.DistanceResult())
        if distance <= within:
            wanted[i, j] = distance
    assert [tuple(pair) for pair in graph.pairs.tolist()] == sorted(wanted)
    apart = np.array([wanted[tuple(pair)] for pair in graph.pairs.tolist()])
    np.testing.assert_allclose(graph.gaps[apart > 0], apart[apart > 0], atol=1e-6)
    # fcl says -1 for what overlaps.
    np.testing.assert_array_equal(graph.gaps <= 0, apart <= 0)


@pytest.mark.client
def test_manifold3d_measures_the_same_gaps(fresh):
    import manifold3d

    from grainsdem.geometry.triangles import triangles

    d = mean_diameter(fresh)
    graph = contacts(fresh, within=0.2 * d)
    mesh = triangles(fresh.grains)
    solids = []
    for i in range(len(fresh)):
        corners = mesh.indices[mesh.offsets[i] : mesh.offsets[i + 1]].astype(np.uint64)
        vertices = (fresh.grains.vertices_of(i) + fresh.positions[i]) / d
        solids.append(manifold3d.Manifold(manifold3d.Mesh64(np.ascontiguousarray(vertices), corners)))
    for (i, j), gap in list(zip(graph.pairs.tolist(), graph.gaps, strict=True))[::4]:
        assert solids[i].min_gap(solids[j], 1.0) == pytest.approx(gap / d, abs=1e-9)


@pytest.mark.unit
def test_walls_count_as_grains_where_asked():
    packing = cube_packing([[1.0, 5, 5], [3, 1.2, 5]])
    assert contacts(packing, within=0.3).pairs.tolist() == []
    graph = contacts(packing, within=0.3, walls=True)
    assert graph.pairs.tolist() == [[-3, 1], [-1, 0]]
    np.testing.assert_allclose(graph.gaps, [0.2, 0], atol=1e-15)
    np.testing.assert_allclose(graph.normals, [[0, 1, 0], [1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(graph.points, [[3, 0.1, 5], [0, 5, 5]], atol=1e-14)
    np.testing.assert_allclose(graph.areas, [4, 4])
    np.testing.assert_allclose(graph.ends[0, 1] - graph.ends[0, 0], [0, 0.2, 0], atol=1e-15)
    assert graph.among_grains().pairs.tolist() == []
    assert graph.to_scipy().nnz == 0


@pytest.mark.unit
def test_an_octahedron_stands_on_the_floor_with_its_tip_and_reaches_through_the_upper_wall():
    packing = place(polyhedra(SOLIDS["octahedron"][0]), [[5.0, 5, 1.25]], domain=Domain.box((10, 10, 2)))
    graph = contacts(packing, within=0.5, walls=True)
    assert graph.pairs.tolist() == [[-6, 0], [-5, 0]]
    np.testing.assert_allclose(graph.gaps, [-0.25, 0.25])
    assert graph.kinds() == ["vertex-face", "vertex-face"]
    np.testing.assert_allclose(graph.points, [[5, 5, 2.125], [5, 5, 0.125]], atol=1e-14)


@pytest.mark.unit
def test_the_planes_of_a_hopper_are_walls_too():
    # Its sides slope by 45 degrees: x - z <= 1 and so on around.
    cube = cube_packing([[0.0, 0, 1]], half=0.25, domain=Domain.hopper(6.0, 2.0, 2.0))
    graph = contacts(cube, within=2.0, walls=True)
    assert graph.pairs[:, 0].tolist() == [-10, -9, -8, -7, -6, -5]
    # The lower edges of the cube, at 0.25 from its axis and at a height of 0.75.
    np.testing.assert_allclose(graph.gaps[:4], (1 - 0.25 + 0.75) / np.sqrt(2), rtol=1e-14)
    assert graph.kinds()[:4] == ["edge-face"] * 4
    np.testing.assert_allclose(graph.normals[:4, 2], np.sqrt(0.5), rtol=1e-14)
    np.testing.assert_allclose(graph.gaps[4:], 0.75)


@pytest.mark.unit
def test_a_cube_leans_with_its_face_on_the_plane_of_a_wedge():
    half = 0.5
    turn = np.array([np.cos(np.pi / 8), 0, -np.sin(np.pi / 8), 0])
    wedge = Domain(np.zeros(3), np.full(3, 10.0), planes=np.array([[1.0, 0, -1, 3]]))
    n = np.array([1, 0, -1]) / np.sqrt(2)
    foot = np.array([5.0, 5, 2])
    packing = replace(cube_packing([foot - n * (half + 0.1)], half=half, domain=wedge), quaternions=[turn])
    graph = contacts(packing, within=0.2, walls=True)
    assert graph.pairs.tolist() == [[-7, 0]]
    assert graph.kinds() == ["face-face"]
    np.testing.assert_allclose((graph.gaps[0], graph.areas[0]), (0.1, 1.0), rtol=1e-12)
    np.testing.assert_allclose(graph.ends[0, 0] @ n, foot @ n, rtol=1e-14)


@pytest.mark.unit
def test_periodic_axes_have_no_walls():
    packing = cube_packing([[1.0, 1, 1]], domain=Domain.box((5.0, 5, 5), periodic=(False, True, True)))
    assert contacts(packing, within=0.3, walls=True).pairs.tolist() == [[-1, 0]]
    everywhere = cube_packing([[1.0, 1, 1]], domain=Domain.cube(5.0, periodic=True))
    assert len(contacts(everywhere, within=0.3, walls=True)) == 0


@pytest.mark.unit
def test_contacts_know_their_kind_their_ends_and_their_image():
    domain = Domain.cube(8.0, periodic=True)
    graph = contacts(cube_packing([[0.5, 4, 4], [6.25, 4, 4]], domain=domain), within=0.5)
    assert graph.kinds() == ["face-face"]
    assert graph.shifts.tolist() == [[-1, 0, 0]]
    np.testing.assert_allclose(graph.ends[0, :, 0], [-0.5, -0.75], atol=1e-14)
    assert graph.select([0]).kinds() == ["face-face"]


@pytest.mark.client
def test_the_contacts_of_a_settled_bed_are_those_that_mujoco_lists_at_the_same_state():
    domain = Domain.box((4e-3, 4e-3, 5e-3))
    seeds = relax(poisson(domain, 150, rng=11), domain, iterations=2)
    done = settle(shuffle(shrink(carve(tessellate(seeds, domain)), porosity=0.4), rng=5))
    d = mean_diameter(done.packing)
    ours, theirs = contacts(done.packing, within=1e-3 * d), done.contacts
    gaps = {tuple(pair): gap / d for pair, gap in zip(ours.pairs.tolist(), ours.gaps, strict=True)}
    listed = {tuple(pair): gap / d for pair, gap in zip(theirs.pairs.tolist(), theirs.gaps, strict=True)}
    assert len(listed) > 20  # of 6 runs of it: 61 ± 4
    # MuJoCo keeps vertices as float32 and stops its search at 1e-6: nearer than 1e-5 d to zero either may be right.
    assert {pair for pair, gap in gaps.items() if gap < -1e-5} <= set(listed)
    assert {pair for pair, gap in listed.items() if gap < -1e-5} <= set(gaps)
    for pair, gap in listed.items():
        assert gaps[pair] == pytest.approx(gap, abs=1e-5)


@pytest.mark.unit
def test_pairs_taken_in_turns_are_the_pairs_taken_at_once(fresh, monkeypatch):
    whole = contacts(fresh, within=0.1 * mean_diameter(fresh))
    monkeypatch.setattr(separation, "TURN", 100)
    parts = contacts(fresh, within=0.1 * mean_diameter(fresh))
    for name in ("pairs", "gaps", "normals", "points", "areas", "features", "ends", "shifts"):
        assert getattr(whole, name).tobytes() == getattr(parts, name).tobytes()
