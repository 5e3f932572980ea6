from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import cube_packing
from solids import SOLIDS, blob, centred, place, polyhedra, solid
from typer.testing import CliRunner

import grainsdem
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, ShapeError
from grainsdem.figures import section_figure
from grainsdem.geometry.integrals import integrate, volumes
from grainsdem.geometry.rotations import random_quaternions, world_vertices
from grainsdem.measures.sections import (
    Section,
    expected_section,
    mean_widths,
    section,
    section_profile,
    section_summary,
    section_table,
    widths,
)
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate


@pytest.fixture(scope="module")
def tiled():
    """The cells of a periodic Poisson tessellation, without any void."""
    domain = Domain.box((1.0, 0.9, 0.8), periodic=True)
    return carve(tessellate(poisson(domain, 300, rng=4), domain))


@pytest.fixture(scope="module")
def loose(tiled):
    return shrink(tiled, porosity=0.45)


def directions(n):
    """Return unit vectors spread evenly over the sphere: a golden spiral."""
    k = np.arange(n) + 0.5
    z, angle = 1 - 2 * k / n, np.pi * (1 + np.sqrt(5)) * k
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z])


@pytest.mark.unit
def test_a_level_plane_cuts_a_cube_in_a_square_at_its_place(cube):
    found = section(cube, z=1.5)
    np.testing.assert_array_equal(found.ids, [0])
    corners = {tuple(np.round(p, 12)) for p in found.polygon(0)}
    assert corners == {(1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0)}
    (row,) = section_table(found)
    assert row["area"] == row["area_inside"] == pytest.approx(4)
    assert (row["u"], row["v"], row["perimeter"]) == pytest.approx((2, 2, 8))
    assert row["diameter"] == pytest.approx(np.sqrt(16 / np.pi))
    # The second moment of a square of side s is s⁴/12; of an ellipse of full axis a it is area · a²/16.
    assert row["a"] == row["b"] == pytest.approx(4 * 2 / np.sqrt(12))
    np.testing.assert_allclose(np.sort(found.outline, axis=0), [[0, 0], [0, 0], [4, 4], [4, 4]], atol=1e-14)


@pytest.mark.unit
def test_x_runs_to_the_right_and_z_upward_in_sections_of_constant_x_or_y():
    packing = cube_packing([[3.0, 6.0, 8.0]])
    for options, middle in (({"x": 3.2}, (6, 8)), ({"y": 6.2}, (3, 8)), ({"z": 8.2}, (3, 6))):
        found = section(packing, **options)
        (row,) = section_table(found)
        assert (row["u"], row["v"]) == pytest.approx(middle)
        np.testing.assert_allclose(np.cross(found.frame[0], found.frame[1]), found.frame[2], atol=1e-15)
        ((axis, place_),) = options.items()
        np.testing.assert_allclose(found.world_points()[:, "xyz".index(axis)], place_)


@pytest.mark.unit
def test_the_plane_across_a_cubes_diagonal_cuts_a_regular_hexagon(cube):
    (row,) = section_table(section(cube, plane=[1, 1, 1, 6]))
    assert row["n_corners"] == 6
    assert row["area"] == pytest.approx(3 * np.sqrt(3))
    assert row["perimeter"] == pytest.approx(6 * np.sqrt(2))
    # Through three corners the hexagon has become a triangle of side 2 √2.
    (row,) = section_table(section(cube, plane=[1, 1, 1, 5]))
    assert row["n_corners"] == 3
    assert row["area"] == pytest.approx(2 * np.sqrt(3))


@pytest.mark.unit
def test_a_plane_through_the_domains_own_corners_has_a_clean_outline():
    packing = cube_packing([[2, 2, 2], [0.5, 2.5, 2.5]], half=0.5, domain=Domain.cube(4.0))
    for plane, corners in (([1, 1, 1, 4], 3), ([1, 1, 1, 6], 6), ([1, -1, 0, 0], 4), ([1, 2, 3, 12], 4)):
        found = section(packing, plane=plane)
        assert len(found.outline) == corners
        assert np.isfinite(section_table(found)["area_inside"]).all()
    (whole, _) = section_table(section(packing, plane=[1, 1, 1, 5.6]))
    assert whole["area_inside"] == pytest.approx(whole["area"], rel=1e-12)


@pytest.mark.unit
def test_a_plane_through_corners_and_edges_cuts_clean_polygons():
    octahedron = place(solid("octahedron", edge=np.sqrt(2)), [[2, 2, 2]], domain=Domain.cube(4.0))
    (row,) = section_table(section(octahedron, z=2.0))
    assert (row["n_corners"], row["area"]) == (4, pytest.approx(2))
    (row,) = section_table(section(octahedron, plane=[1, 1, 0, 4]))  # along two edges' middles and two corners
    assert row["area"] == pytest.approx(np.sqrt(2))
    assert len(section(octahedron, z=3.0)) == 0
    assert len(section(octahedron, z=1.0)) == 0


@pytest.mark.unit
def test_of_two_grains_on_top_of_each_other_the_plane_between_cuts_one():
    packing = cube_packing([[2, 2, 1], [2, 2, 3]], domain=Domain.cube(4.0))
    np.testing.assert_array_equal(section(packing, z=2.0).ids, [1])
    assert section_summary(section(packing, z=2.0))["area_fraction"] == pytest.approx(0.25)


@pytest.mark.property
def test_the_volume_of_a_grain_is_the_integral_of_its_sections():
    rng = np.random.default_rng(2)
    packing = place(
        centred(polyhedra(blob(rng))), [[1, 1, 1]], quaternions=random_quaternions(1, rng), domain=Domain.cube(2.0)
    )
    heights = np.sort(world_vertices(packing)[:, 2])
    total = 0.0
    # Between two vertices the area is a parabola, which Gauss's rule of two points integrates exactly.
    for low, high in pairwise(heights):
        for place_ in (0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)):
            table = section_table(section(packing, z=low + place_ * (high - low)))
            total += 0.5 * (high - low) * table["area"].sum()
    assert total == pytest.approx(volumes(packing.grains)[0], rel=1e-12)


@pytest.mark.property
def test_cells_without_void_fill_every_section_across_periodic_faces(tiled):
    rng = np.random.default_rng(5)
    for normal in rng.standard_normal((5, 3)):
        plane = np.append(normal, normal @ (tiled.domain.lengths * rng.uniform(0.3, 0.7, 3)))
        assert section_summary(section(tiled, plane=plane))["area_fraction"] == pytest.approx(1, rel=1e-9)
    level = section(tiled, z=0.33)
    table = section_table(level)
    counted = table[table["is_counted"]]
    # A level plane wraps as the bed does: whole polygons that count fill it, too, each grain once an image in z.
    assert counted["area"].sum() == pytest.approx(0.9, rel=1e-9)
    assert len(counted) < len(table)
    assert np.unique(counted["id"]).size == len(counted)


@pytest.mark.property
def test_moving_the_plane_by_a_period_changes_nothing_but_images(loose):
    # The same grains cross the lower and the upper face of a periodic domain.
    low, high = section(loose, z=0.0), section(loose, z=0.8)
    np.testing.assert_array_equal(low.ids, high.ids)
    np.testing.assert_allclose(low.points, high.points, atol=1e-12)
    np.testing.assert_array_equal(high.shifts - low.shifts, np.tile([0, 0, 1], (len(low), 1)))


@pytest.mark.statistical
def test_sections_by_depth_follow_delesse_and_the_number_of_widths(loose):
    n = 60
    profile = section_profile(loose, n)
    expected = expected_section(loose, normal=[0, 0, 1])
    w, step = widths(loose, [0, 0, 1]), 0.8 / n
    # A grain is met by w / step planes, rounded up or down at random by its place.
    share = (w / step) % 1
    error = np.sqrt((share * (1 - share)).sum()) / n / 0.9
    assert profile["n_per_area"].mean() == pytest.approx(expected["n_per_area"], abs=5 * error)
    assert profile["area_fraction"].mean() == pytest.approx(0.55, abs=1e-3)
    assert expected["area_fraction"] == pytest.approx(0.55, rel=1e-12)
    np.testing.assert_allclose(profile["z"], (np.arange(n) + 0.5) * step)
    assert profile["n_sections"].sum() == pytest.approx(profile["n_per_area"].sum() * 0.9)


@pytest.mark.statistical
def test_planes_of_all_directions_meet_grains_by_their_mean_width(loose):
    rng = np.random.default_rng(9)
    expected = expected_section(loose)
    sums = []
    for normal in directions(150):
        # Through a point of the periodic bed taken at random, within the outline of a disc: planes weighted by area.
        corners = np.array(list(np.ndindex(2, 2, 2))) * loose.domain.lengths
        low, high = (corners @ normal).min(), (corners @ normal).max()
        found = section_summary(section(loose, plane=[*normal, rng.uniform(low, high)]))
        sums.append([found["area"], found["area"] * found["area_fraction"], found["n_sections"]])
    area, solid_area, number = np.transpose(sums)
    for total, mean in ((solid_area, expected["area_fraction"]), (number, expected["n_per_area"])):
        ratio = total.sum() / area.sum()
        error = np.sqrt(np.sum((total - ratio * area) ** 2)) / area.sum()
        assert ratio == pytest.approx(mean, abs=5 * error)
        assert error < 0.02 * mean
    assert expected["mean_area"] == pytest.approx(expected["area_fraction"] / expected["n_per_area"])


@pytest.mark.unit
def test_mean_widths_are_those_of_the_named_solids_and_of_all_directions():
    cube = cube_packing([[5, 5, 5]])
    assert mean_widths(cube)[0] == pytest.approx(3)
    tetrahedron = place(solid("tetrahedron", edge=2.0), [[5, 5, 5]])
    assert mean_widths(tetrahedron)[0] == pytest.approx(6 * 2 * (np.pi - np.arccos(1 / 3)) / (4 * np.pi))
    rng = np.random.default_rng(1)
    packing = place(polyhedra(*(blob(rng) for _ in range(3))), rng.uniform(0, 9, (3, 3)))
    over_all = np.mean([widths(packing, n) for n in directions(4000)], axis=0)
    np.testing.assert_allclose(mean_widths(packing), over_all, rtol=1e-3)
    assert widths(cube, [0, 3, 4])[0] == pytest.approx(2 * (0.6 + 0.8))


@pytest.mark.unit
def test_a_planar_bed_is_its_own_section():
    domain = Domain.slab([1.0, 1.2], 0.1)
    packing = shrink(carve(tessellate(poisson(domain, 60, rng=3), domain), keep="all"), porosity=0.3)
    found = section(packing, z=0.08)
    table = section_table(found)
    np.testing.assert_array_equal(found.ids, np.arange(60))
    np.testing.assert_allclose(table["area"], integrate(packing.grains).volumes / 0.1, rtol=1e-9)
    assert section_summary(found)["area_fraction"] == pytest.approx(0.7)
    assert section_profile(packing, 40, axis="y")["area_fraction"].mean() == pytest.approx(0.7, abs=0.02)


@pytest.mark.unit
def test_the_outline_of_a_cylinder_is_its_polygon_and_walls_bound_what_counts():
    domain = Domain.cylinder(1.0, 2.0, sides=12)
    packing = cube_packing([[0, 0, 1.0], [0.9, 0, 1.0]], half=0.25, domain=domain)
    found = section_summary(section(packing, z=1.0))
    assert found["area"] == pytest.approx(np.pi)
    (whole, cut) = section_table(section(packing, z=1.0))
    assert whole["area_inside"] == pytest.approx(0.25)
    apothem = np.sqrt(np.pi / (12 * np.tan(np.pi / 12)))
    assert cut["area_inside"] == pytest.approx((apothem - 0.65) * 0.5, rel=0.03)  # the flat facet cuts it
    assert cut["area"] == pytest.approx(0.25)
    wall = section_summary(section(packing, x=apothem))
    assert wall["area"] == pytest.approx(2 * 2 * apothem * np.tan(np.pi / 12))


@pytest.mark.unit
def test_odd_planes_are_refused(cube, tmp_path):
    for options, match in (
        ({}, "give one plane, by x, y, z or plane; got none"),
        ({"x": 1.0, "plane": [1, 0, 0, 1]}, "got x, plane"),
        ({"z": np.nan}, "four finite numbers"),
        ({"plane": [0, 0, 0, 1]}, "with a normal"),
        ({"plane": [1, 0, 0]}, r"shape \(4,\); got shape \(3,\)"),
        ({"z": 4.1}, r"the plane \(0, 0, 1\) · x = 4\.1 m misses the domain"),
    ):
        with pytest.raises(InputError, match=match):
            section(cube, **options)
    for call, match in (
        (lambda: section_profile(cube, 0), "from one to 100000 levels; got 0"),
        (lambda: section_profile(cube, axis="w"), "'x', 'y' or 'z'; got 'w'"),
        (lambda: section_profile(cube, [[1.0]]), r"shape \(m,\); got shape \(1, 1\)"),
        (lambda: section_profile(cube, [5.0]), "misses the domain"),
        (lambda: widths(cube, [0, 0, 0]), "not all zero"),
        (lambda: section_figure([], tmp_path / "a.png"), "no section is given"),
        (lambda: section_figure(section(cube, z=2), tmp_path / "a.png", titles=["a", "b"]), "as many as the 1"),
        (lambda: section_figure(section(cube, z=2), tmp_path / "a.png", color_by="mood"), "color_by must be"),
        (lambda: section_figure(section(cube, z=2), tmp_path / "a.png", columns=0), "columns must be one"),
    ):
        with pytest.raises(InputError, match=match):
            call()
    with pytest.raises(ShapeError, match=r"shape \(k, 3\); got shape \(2,\)"):
        section_figure(section(cube, z=2), tmp_path / "a.png", marks=[1.0, 2.0])
    with pytest.raises(FileFormatError, match=r"written as \.png"):
        section_figure(section(cube, z=2), tmp_path / "a.svg")
    found = section(cube, z=2.0)
    with pytest.raises(ShapeError, match="one more than the 1 ids"):
        replace(found, offsets=[0, 2, 4])
    empty = section(cube, z=0.5)
    assert len(empty) == len(section_table(empty)) == 0
    assert section_summary(empty)["mean_area"] is None
    assert isinstance(empty, Section)


@pytest.mark.golden
def test_figures_of_sections_repeat_to_the_byte(loose, tmp_path):
    from matplotlib.image import imread

    cuts = [section(loose, z=0.4), section(loose, plane=[1, 1, 1, 1.2])]
    for color_by in (None, "diameter"):
        a, b = (
            section_figure(cuts, tmp_path / f"{k}{color_by}.png", titles=["a", "b"], color_by=color_by) for k in "ab"
        )
        assert a.read_bytes() == b.read_bytes()
    image = imread(tmp_path / "aNone.png")[..., :3]
    sand = (np.abs(image - np.array([0xD8, 0xC4, 0x9A]) / 255) < 0.02).all(axis=-1)
    assert 0.2 < sand.mean() < 0.55


@pytest.mark.unit
def test_marks_stand_where_they_are_seen_and_every_panel_has_a_scale(loose, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    drawn = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: (drawn.append(self), save(self, *a, **k)))
    marks = np.array([[0.2, 0.3, 0.4], [0.7, 0.1, 0.9]])
    cuts = [section(loose, z=0.4), section(loose, x=0.5)]
    section_figure(cuts, tmp_path / "a.png", marks=marks, note="cells at the walls are kept")
    (figure,) = drawn
    # Seen along z, x is to the right and y up; along x, y to the right and z up.
    for axes, columns in zip(figure.axes, ([0, 1], [1, 2]), strict=True):
        crosses = axes.collections[-1]
        np.testing.assert_allclose(crosses.get_offsets(), marks[:, columns], atol=1e-12)
        (bar,) = axes.lines
        assert [text.get_text() for text in axes.texts] == [f"{np.ptp(bar.get_xdata()):g} m"]
    near, far = figure.axes[0].collections[-1].get_sizes()
    assert near > far
    assert figure.get_supxlabel() == "cells at the walls are kept"


@pytest.mark.unit
def test_the_command_line_cuts_a_bed_and_writes_picture_table_and_profile(loose, tmp_path):
    bed = tmp_path / "bed.h5"
    grainsdem.save(loose, bed)

    def call(*words):
        return CliRunner().invoke(app, [str(word) for word in words])

    words = ["--table", tmp_path / "t.csv", "--profile", tmp_path / "p.csv", "--levels", 5, "--axis", "y", "--json"]
    told = json.loads(call("section", bed, tmp_path / "a.png", "--plane", "y=0.2", *words).stdout)
    table = np.genfromtxt(tmp_path / "t.csv", delimiter=",", names=True)
    assert told["section"]["area_fraction"] == pytest.approx(table["area_inside"].sum() / 0.8)
    assert told["expected"]["area_fraction"] == pytest.approx(0.55)
    np.testing.assert_allclose(
        np.genfromtxt(tmp_path / "p.csv", delimiter=",", names=True)["y"], 0.18 * (np.arange(5) + 0.5)
    )
    assert "in the mean over the bed" in call("section", bed, tmp_path / "a.png", "--color-by", "none").output
    assert call("section", bed, tmp_path / "a.png", "--plane", "1,1,0,0.9", "--quiet").output == ""
    for plane, match in (
        ("w=3", "written as z=0.01"),
        ("1,2", "shape (4,); got shape (2,)"),
        ("z=7", "misses the domain"),
    ):
        result = call("section", bed, tmp_path / "b.png", "--plane", plane)
        assert result.exit_code == 2
        assert match in result.stderr
    assert not (tmp_path / "b.png").exists()


@pytest.mark.property
@pytest.mark.parametrize("name", SOLIDS)
def test_the_mean_section_of_a_solid_is_its_volume_over_its_width(name):
    shape = solid(name)
    packing = place(shape, [[2, 2, 2]], domain=Domain.cube(4.0))
    normal = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    (width,) = widths(packing, normal)
    steps = (world_vertices(packing) @ normal).min() + width * (np.arange(80) + 0.5) / 80
    areas = [section_table(section(packing, plane=[*normal, d]))["area"].sum() for d in steps]
    assert np.mean(areas) == pytest.approx(volumes(shape)[0] / width, rel=1e-3)
