from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from scipy.spatial import ConvexHull
from solids import blob, centred, place, polyhedra, solid
from typer.testing import CliRunner

import grainsdem
from grainsdem.cli import app
from grainsdem.errors import InputError, MissingPackageError, ShapeError, WriteError
from grainsdem.figures import planform_figure
from grainsdem.geometry.raster.above import shadows, sky
from grainsdem.geometry.rotations import random_quaternions, world_vertices
from grainsdem.measures.planform import photograph, planform, planform_bias, planform_table, write_planform
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate


@pytest.fixture(scope="module")
def bed():
    """Grains of a bed that is periodic in x and y, loose enough to see into."""
    domain = Domain.box((1.0, 0.8, 0.5), periodic=(True, True, False))
    return shrink(carve(tessellate(poisson(domain, 300, rng=4), domain), keep="all"), scale=0.75)


@pytest.fixture(scope="module")
def seen(bed):
    return planform(bed, pixel=0.005)


def rotated_tops(angle):
    """Return a square prism whose top is tilted about y by an angle, towards +x."""
    top = [[x, y, 1 - x * np.tan(angle)] for x in (-1, 1) for y in (-1, 1)]
    return polyhedra(np.array([*top, *[[x, y, -2] for x in (-1, 1) for y in (-1, 1)]]))


@pytest.mark.unit
def test_a_cube_from_above_is_a_square_of_its_height():
    packing = cube_packing([[3.0, 2.0, 1.5]], half=0.5, domain=Domain.box((5.0, 4.0, 4.0)))
    view = planform(packing, pixel=0.25)
    assert view.labels.shape == (16, 20)
    expected = np.zeros((16, 20), dtype=np.int32)
    expected[6:10, 10:14] = 1  # y from 1.5 to 2.5: rows count from y = 4 down
    np.testing.assert_array_equal(view.labels, expected)
    np.testing.assert_allclose(view.heights[6:10, 10:14], 2.0, rtol=1e-12)
    assert np.isnan(view.heights[expected == 0]).all()
    np.testing.assert_array_equal(view.depths()[6:10, 10:14], 0)
    x, y = view.places()
    assert (x[10], y[6]) == pytest.approx((2.625, 2.375))
    (row,) = planform_table(view, packing)
    assert row["n_pixels"] == 16
    assert row["visible_area"] == pytest.approx(1)
    assert row["projected_area"] == pytest.approx(1)
    assert row["apparent_diameter"] == pytest.approx(np.sqrt(4 / np.pi))
    # Pixels are squares: their moments add up to those of the whole square, s⁴/12.
    assert row["apparent_a"] == row["apparent_b"] == pytest.approx(4 / np.sqrt(12))
    assert row["a"] == row["c"] == pytest.approx(np.sqrt(5 / 3))
    assert not row["is_cut"]


@pytest.mark.unit
def test_a_grain_under_another_is_hidden_and_one_half_under_it_is_half_seen():
    packing = cube_packing([[2, 2, 1], [2, 2, 3.5], [4, 2, 1.2]], domain=Domain.cube(6.0))
    shifted = replace(packing, positions=[[2, 2, 1], [3, 2, 3.5], [4, 2, 1.2]])
    rows = planform_table(planform(packing, pixel=0.1), packing)
    np.testing.assert_array_equal(rows["id"], [1, 2])
    rows = planform_table(planform(shifted, pixel=0.1), shifted)
    np.testing.assert_array_equal(rows["id"], [0, 1, 2])
    np.testing.assert_allclose(rows["visible_share"], [0.5, 1, 0.5])
    np.testing.assert_allclose(rows["apparent_a"][0] / rows["apparent_b"][0], 2)


@pytest.mark.property
def test_every_pixel_sees_what_a_ray_against_qhulls_half_spaces_meets_first():
    rng = np.random.default_rng(6)
    n = 12
    shapes = centred(polyhedra(*(blob(rng) for _ in range(n))))
    packing = place(shapes, rng.uniform(0, 2, (n, 3)), quaternions=random_quaternions(n, rng), domain=Domain.cube(2.0))
    view = planform(packing, pixel=0.02, region=([-0.3, 0.1], [1.5, 2.1]))
    x, y = (grid.ravel() for grid in np.meshgrid(*view.places()))
    tops = np.full((n, x.size), -np.inf)
    vertices = world_vertices(packing)
    for i in range(n):
        hull = ConvexHull(vertices[shapes.vertex_offsets[i] : shapes.vertex_offsets[i + 1]]).equations
        a, b = hull[:, 2:3], -hull[:, :2] @ np.stack([x, y]) - hull[:, 3:4]
        upper = np.where(a > 0, b / np.where(a > 0, a, 1), np.inf).min(axis=0)
        lower = np.where(a < 0, b / np.where(a < 0, a, 1), -np.inf).max(axis=0)
        tops[i] = np.where(upper >= lower, upper, -np.inf)
    expected = np.where(tops.max(axis=0) > -np.inf, tops.argmax(axis=0) + 1, 0)
    np.testing.assert_array_equal(view.labels.ravel(), expected)
    np.testing.assert_allclose(view.heights.ravel()[expected > 0], tops.max(axis=0)[expected > 0], rtol=1e-9)
    assert len(np.unique(expected)) > 8


@pytest.mark.property
def test_faces_that_are_seen_are_those_of_the_grain_and_pass_through_the_surface(bed, seen):
    owner = np.repeat(np.arange(len(bed)), np.diff(bed.grains.face_offsets))
    visible = seen.labels > 0
    np.testing.assert_array_equal(owner[seen.faces[visible]], seen.labels[visible] - 1)
    assert (seen.faces[~visible] == -1).all()
    assert visible.mean() > 0.9


@pytest.mark.property
def test_a_view_does_not_depend_on_the_order_of_grains_or_on_threads(bed, seen):
    import numba

    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = planform(bed, pixel=0.005)
    finally:
        numba.set_num_threads(before)
    for name in ("labels", "heights", "faces"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(seen, name))
    rolled = replace(bed, positions=bed.positions + np.array([0.25, -0.1, 0]))
    moved = planform(rolled, pixel=0.005)
    # 50 and 20 pixels around the periodic bed; middles on an edge may be rounded to either side.
    assert (np.roll(seen.labels, (20, 50), axis=(0, 1)) != moved.labels).mean() < 1e-3


@pytest.mark.property
def test_visible_areas_tile_the_picture_and_none_exceeds_its_grains_projection(bed, seen):
    rows = planform_table(seen, bed)
    floor = np.count_nonzero(seen.labels == 0) * seen.pixel.prod()
    assert rows["visible_area"].sum() + floor == pytest.approx(0.8, rel=1e-12)
    assert not rows["is_cut"].any()
    # Counting pixels gives an area to within 0.27 h^1.5 √B, B the perimeter: five of those.
    h, perimeter = 0.005, np.pi * np.sqrt(4 / np.pi * rows["projected_area"]) * 1.5
    assert (rows["visible_area"] <= rows["projected_area"] + 5 * 0.27 * h**1.5 * np.sqrt(perimeter)).all()
    assert rows["visible_share"].min() < 0.1
    assert (rows["apparent_a"] >= rows["apparent_b"]).all()
    assert (rows["a"] >= rows["b"]).all()


@pytest.mark.client
def test_scikit_image_measures_the_same_regions_on_the_label_map(tmp_path):
    from skimage.measure import regionprops_table

    domain = Domain.cube(1.0)
    packing = shrink(carve(tessellate(poisson(domain, 120, rng=7), domain)), scale=0.85)
    view = planform(packing, pixel=0.004)
    write_planform(view, packing, tmp_path / "a", formats=["npy"])
    names = ("label", "area", "axis_major_length", "axis_minor_length", "equivalent_diameter_area")
    theirs = regionprops_table(np.load(tmp_path / "a" / "labels.npy"), properties=names)
    ours = planform_table(view, packing)
    np.testing.assert_array_equal(theirs["label"] - 1, ours["id"])
    np.testing.assert_array_equal(theirs["area"], ours["n_pixels"])
    h = view.pixel[0]
    for name, column in (("axis_major_length", "apparent_a"), ("axis_minor_length", "apparent_b")):
        # It takes pixels for points; a square has a second moment of its own, h²/12.
        np.testing.assert_allclose(np.sqrt((theirs[name] * h) ** 2 + 16 * h**2 / 12), ours[column], rtol=1e-9)
    np.testing.assert_allclose(theirs["equivalent_diameter_area"] * h, ours["apparent_diameter"], rtol=1e-12)


@pytest.mark.statistical
def test_in_a_planar_bed_grains_seem_as_large_as_they_are():
    domain = Domain.slab([1.0, 1.0], 0.1)
    packing = shrink(carve(tessellate(poisson(domain, 80, rng=3), domain)), scale=0.9)
    rows = planform_table(planform(packing, pixel=0.002), packing)
    np.testing.assert_array_equal(rows["id"], np.arange(len(packing)))
    for name in ("diameter", "a", "b"):
        assert np.mean(rows[f"apparent_{name}"] / rows[name]) == pytest.approx(1, abs=2e-3)
        np.testing.assert_allclose(rows[f"apparent_{name}"], rows[name], rtol=0.03)
    assert np.isnan(rows["c"]).all()
    bias = planform_bias(rows, packing)
    np.testing.assert_allclose(bias["number_bias"], 1, rtol=0.02)
    np.testing.assert_allclose(bias["area_bias"], 1, rtol=0.02)
    assert bias["statistic"].tolist() == ["d5", "d16", "d25", "d50", "d75", "d84", "d95", "mean", "sd"]


@pytest.mark.unit
def test_bias_weighs_what_is_seen_by_number_and_by_area_and_the_bed_by_mass():
    small = cube_packing([[1, 1, 1], [3, 1, 1], [5, 1, 1]], half=0.5)
    large = cube_packing([[3, 5, 2]], half=1.0)
    shapes = Polyhedra(
        np.vstack([small.grains.vertices, large.grains.vertices]),
        8 * np.arange(5),
        6 * np.arange(5),
        np.tile(large.grains.face_vertices, 4),
        4 * np.arange(25),
    )
    positions = [*small.positions, *large.positions]
    packing = Packing(shapes, positions, np.tile([1.0, 0, 0, 0], (4, 1)), np.ones(4), Domain.cube(8.0))
    rows = planform_table(planform(packing, pixel=0.125), packing)
    mean = {row["statistic"]: row for row in planform_bias(rows, packing)}["mean"]
    b, b_seen = np.sqrt(5 / 3), 4 / np.sqrt(12)
    assert mean["bed_by_number"] == pytest.approx(b * (3 + 2) / 4)
    assert mean["bed_by_mass"] == pytest.approx(b * (3 * 1 + 8 * 2) / 11)
    assert mean["seen_by_number"] == pytest.approx(b * 5 / 4)
    assert mean["apparent_by_number"] == pytest.approx(b_seen * 5 / 4)
    assert mean["apparent_by_area"] == pytest.approx(b_seen * (3 * 1 + 4 * 2) / 7)
    assert mean["number_bias"] == pytest.approx(b_seen / b)
    only_large = planform_bias(rows, packing, least_pixels=65)
    assert only_large["apparent_by_number"][-2] == pytest.approx(2 * b_seen)
    with pytest.raises(InputError, match="no whole grain is seen through 1000 pixels or more"):
        planform_bias(rows, packing, least_pixels=1000)


@pytest.mark.unit
def test_grains_are_cut_where_the_bed_goes_on_beyond_the_picture_and_not_at_its_walls(bed):
    walled = cube_packing([[1, 2, 1], [3, 2, 1]], domain=Domain.cube(4.0))
    whole = planform(walled, pixel=0.1)
    assert not whole.ends.any()
    assert not planform_table(whole, walled)["is_cut"].any()
    part = planform_table(planform(walled, pixel=0.1, region=([0, 0], [3, 4])), walled)
    np.testing.assert_array_equal(part["is_cut"], [False, True])
    view = planform(bed, pixel=0.01, region=([0, 0], [1.0, 0.3]))
    np.testing.assert_array_equal(view.periodic, [True, False])
    np.testing.assert_array_equal(view.ends, [[False, False], [True, True]])


@pytest.mark.unit
def test_grey_follows_lamberts_law():
    options = {"ambient": 0.0, "variety": 0.0, "brightness": 0.5}
    light = np.array([1.0, 0.0, 1.0])
    for angle in (-0.5, 0.0, 0.3, 0.7):
        packing = place(rotated_tops(angle), [[4, 4, 3]], domain=Domain.cube(8.0))
        view = planform(packing, pixel=0.1)
        grey = photograph(view, packing, light=light, **options)[view.labels == 1]
        # Tilted towards the light by an angle, a face is lit by cos(45° - angle) over that of a level one.
        assert grey == pytest.approx(0.5 * np.cos(np.pi / 4 - angle) / np.cos(np.pi / 4), rel=1e-9)
    assert photograph(view, packing, light=[-1, 0, 0.5], **options)[view.labels == 1] == pytest.approx(0)


@pytest.mark.unit
def test_a_tower_casts_a_shadow_as_long_as_the_light_says():
    heights = np.zeros((9, 60))
    heights[:, 10:12] = 5.0
    lit = ~shadows(heights, 0.5, np.array([-1.0, 0.0, 0.5]) / np.linalg.norm([1, 0.5]))
    # 5 m at a slope of one half: 10 m, 20 pixels, beyond the tower's edge.
    np.testing.assert_array_equal(lit[4], [k < 12 or k >= 31 for k in range(60)])
    assert not shadows(heights, 0.5, np.array([0.0, 0.0, 1.0])).any()
    wrapped = shadows(heights, 0.5, np.array([1.0, 0.0, 0.5]) / np.linalg.norm([1, 0.5]), wraps=(True, False))
    assert wrapped[4, 55]
    assert not shadows(heights, 0.5, np.array([1.0, 0.0, 0.5]) / np.linalg.norm([1, 0.5]))[4, 55]


@pytest.mark.unit
def test_a_plain_sees_all_the_sky_and_the_foot_of_a_long_wall_half_of_it():
    assert (sky(np.zeros((20, 20)), 1.0, 5.0) == 1).all()
    wall = np.zeros((201, 201))
    wall[:, 120:] = 1e6
    # Five or more of sixteen directions look into the wall, two run along it.
    assert sky(wall, 1.0, 60.0)[100, 119] == pytest.approx(9 / 16, abs=0.01)
    assert sky(wall, 1.0, 60.0)[100, 50] == 1


@pytest.mark.statistical
def test_noise_and_blur_are_as_large_as_asked(bed, seen):
    plain = photograph(seen, bed, brightness=0.4, rng=1)
    noisy = photograph(seen, bed, brightness=0.4, noise=0.01, rng=1)
    inside = (plain > 0.06) & (plain < 0.94)
    error = (noisy - plain)[inside]
    assert error.std() == pytest.approx(0.01, rel=5 / np.sqrt(2 * error.size))
    assert error.mean() == pytest.approx(0, abs=5 * 0.01 / np.sqrt(error.size))
    blurred = photograph(seen, bed, brightness=0.4, blur=2.0, rng=1)
    assert blurred.mean() == pytest.approx(plain.mean(), rel=1e-3)
    # A Gaussian leaves exp(-(2π f σ)²) of the power at f cycles a pixel.
    power = [np.abs(np.fft.fft2(image))[3:6, 5:10] for image in (blurred, plain)]
    f = np.hypot(np.fft.fftfreq(seen.labels.shape[0])[3:6, None], np.fft.fftfreq(seen.labels.shape[1])[None, 5:10])
    np.testing.assert_allclose(power[0] / power[1], np.exp(-0.5 * (2 * np.pi * f * 2.0) ** 2), rtol=0.05)


@pytest.mark.golden
def test_the_same_seed_writes_the_same_bytes_and_another_does_not(bed, seen, tmp_path):
    import tifffile
    from matplotlib.image import imread

    formats = ("png", "npy", "tif")
    first, second, other = (
        write_planform(seen, bed, tmp_path / name, formats=formats, noise=0.02, blur=0.5, rng=rng)
        for name, rng in (("a", 3), ("b", 3), ("c", 4))
    )
    assert [path.name for path in first] == [
        *("image.png", "labels.npy", "depth.npy", "image.npy", "labels.tif", "depth.tif", "image.tif"),
        *("truth.csv", "bias.csv", "planform.json"),
    ]
    for a, b in zip(first, second, strict=True):
        assert a.read_bytes() == b.read_bytes()
    assert first[0].read_bytes() != other[0].read_bytes()
    image = np.load(tmp_path / "a" / "image.npy")
    np.testing.assert_allclose(imread(tmp_path / "a" / "image.png"), image, atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(tifffile.imread(tmp_path / "a" / "image.tif") / 65535, image, atol=1e-5)
    for name in ("labels", "depth"):
        np.testing.assert_array_equal(
            tifffile.imread(tmp_path / "a" / f"{name}.tif"), np.load(tmp_path / "a" / f"{name}.npy")
        )
    np.testing.assert_array_equal(np.load(tmp_path / "a" / "labels.npy"), seen.labels)
    rows = np.genfromtxt(tmp_path / "a" / "truth.csv", delimiter=",", names=True, dtype=None, encoding=None)
    np.testing.assert_array_equal(rows["apparent_b"], planform_table(seen, bed)["apparent_b"])
    told = json.loads((tmp_path / "a" / "planform.json").read_text())
    assert (told["width"], told["height"]) == (200, 160)
    assert told["pixel"] == pytest.approx([0.005, 0.005])
    assert told["photograph"] == {"blur": 0.5, "noise": 0.02, "rng": 3}


@pytest.mark.unit
def test_files_are_not_replaced_unasked_and_nothing_is_left_behind(bed, seen, tmp_path, monkeypatch):
    write_planform(seen, bed, tmp_path / "a", formats=["png"])
    with pytest.raises(WriteError, match="exists already"):
        write_planform(seen, bed, tmp_path / "a", formats=["png"])
    write_planform(seen, bed, tmp_path / "a", formats=["png"], overwrite=True)
    with pytest.raises(InputError, match="formats must be among png, npy, tif; got jpg"):
        write_planform(seen, bed, tmp_path / "b", formats=["jpg"])
    monkeypatch.setitem(sys.modules, "tifffile", None)
    with pytest.raises(MissingPackageError, match=r'pip install "grainsdem\[images\]"'):
        write_planform(seen, bed, tmp_path / "b", formats=["tif"])
    assert not (tmp_path / "b").exists()


@pytest.mark.unit
def test_an_empty_view_is_a_floor(tmp_path):
    packing = cube_packing([[5, 5, 5]])
    view = planform(packing, pixel=0.5, region=([0, 0], [2, 2]))
    assert not view.labels.any()
    assert np.isnan(view.depths()).all()
    assert photograph(view, packing, variety=0) == pytest.approx(0.6)
    assert len(planform_table(view, packing)) == 0
    names = [path.name for path in write_planform(view, packing, tmp_path / "a")]
    assert "bias.csv" not in names
    with pytest.raises(InputError, match="no grain is seen"):
        planform_figure(view, packing, photograph(view, packing), tmp_path / "a.png")


@pytest.mark.unit
def test_odd_requests_are_refused(bed, seen, cube, tmp_path):
    for options, match in (
        ({"pixel": 0.1, "per_diameter": 9}, "pixel or per_diameter, not both"),
        ({"pixel": 0.0}, r"pixel must be 1e-30 to 1e.30 m; got 0\.0"),
        ({"per_diameter": np.inf}, "per_diameter must be positive"),
        ({"pixel": 1e-6}, "at most 1073741824 pixels; got 1000000 × 800000"),
        ({"region": ([0, 0], [0, 1])}, "corners of a rectangle"),
        ({"region": ([0, 0, 0], [1, 1, 1])}, "corners of a rectangle"),
        ({"region": "all"}, "region must be 2 values, each an array of numbers or None; got 'all'"),
    ):
        with pytest.raises(InputError, match=match):
            planform(bed, **options)
    for options, match in (
        ({"light": [0, 0, -1]}, "above the horizon"),
        ({"light": [1, 0, 0]}, "above the horizon"),
        ({"light": [1, 0]}, "3 values, each a number"),
        ({"ambient": 1.5}, r"ambient: .*less than or equal to 1; got 1\.5"),
        ({"brightness": 0}, "brightness: .*greater than 0"),
        ({"noise": -1}, "noise: .*greater than or equal to 0"),
        ({"blur": np.nan}, "blur: .*finite number; got nan"),
        ({"lamp": 0.01}, r"the lamp must hang above the grains, whose highest is at z = .* it is at z ="),
        ({"lamp": np.inf}, "lamp: .*finite number"),
        ({"gradient": [1.5, -1.0]}, "no light may be below zero"),
        ({"vignette": 1.0}, "vignette: .*less than 1"),
        ({"lens": [-0.4, 0.0]}, r"farther out farther out.*got k1 = -0\.4"),
        ({"lens": [0.1, np.nan]}, r"lens\.1: .*finite number"),
        ({"texture": 1.0}, "texture: .*less than 1"),
        ({"wet": "yes"}, "wet must be true or false; got 'yes'"),
        ({"colors": "kryptonite"}, "stones must be among quartz, .*; got kryptonite"),
        ({"colors": "quartz:much"}, "share is a number"),
        ({"colors": [[0.5, 0.4, 1.2, 1.0]]}, "reflectances above 0, at most 1"),
        ({"colors": {"quartz": 0}}, "shares must be zero or more"),
    ):
        with pytest.raises(InputError, match=match):
            photograph(seen, bed, **options)
    with pytest.raises(InputError, match="view must be of this packing of 1 grains"):
        photograph(seen, cube)
    with pytest.raises(InputError, match="view must be of this packing"):
        planform_table(seen, cube)
    with pytest.raises(InputError, match="table must be of this packing"):
        planform_bias(planform_table(seen, bed), cube)
    with pytest.raises(ShapeError, match="the image must have the view's shape"):
        planform_figure(seen, bed, np.zeros((2, 2)), tmp_path / "a.png")


@pytest.mark.unit
def test_a_regular_octahedron_on_its_tip_shows_its_four_upper_faces():
    packing = place(solid("octahedron", edge=np.sqrt(2)), [[2.0037, 1.9971, 2]], domain=Domain.cube(4.0))
    view = planform(packing, pixel=0.01)
    assert np.unique(view.faces).size == 5
    (row,) = planform_table(view, packing)
    assert row["projected_area"] == pytest.approx(2)
    assert row["visible_area"] == pytest.approx(2, rel=1e-3)
    assert np.nanmax(view.heights) == pytest.approx(3, abs=0.011)


@pytest.mark.unit
def test_the_command_line_photographs_a_bed(bed, tmp_path):
    path, folder = tmp_path / "bed.h5", tmp_path / "image"
    grainsdem.save(bed, path)

    def call(*words):
        return CliRunner().invoke(app, [str(word) for word in words])

    words = ["--pixel", 0.01, "--blur", 0.5, "--noise", 0.01, "--least-pixels", 5, "--rng", 2]
    told = json.loads(call("planform", path, folder, *words, "--figure", tmp_path / "f.png", "--json").stdout)
    assert {"image.png", "labels.npy", "truth.csv"} <= {p.name for p in folder.iterdir()}
    assert set(told["bias"]) == {"d5", "d16", "d25", "d50", "d75", "d84", "d95", "mean", "sd"}
    assert told["bias"]["d50"]["apparent_by_number"] < told["bias"]["d50"]["apparent_by_area"]
    assert (tmp_path / "f.png").stat().st_size > 20_000
    again = call("planform", path, folder, "--pixel", 0.01)
    assert again.exit_code == 2
    assert "exists already" in again.stderr
    shown = call("planform", path, folder, "--pixel", 0.02, "--region", 0, 0, 0.5, 0.5, "--format", "png", "--force")
    assert "seen, by area" in shown.output
    assert call("planform", path, tmp_path / "b", "--light", 0, 0, 0).exit_code == 2
    assert not (tmp_path / "b").exists()


def test_one_grain_has_no_spread_to_compare_and_nothing_warns(cube):
    bias = planform_bias(planform_table(planform(cube, per_diameter=8), cube), cube)
    assert np.isnan(bias["number_bias"][bias["statistic"] == "sd"]).all()
