from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from PIL import Image
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem.cli import app
from grainsdem.errors import InputError
from grainsdem.geometry.raster.above import shadows
from grainsdem.measures.planform.camera.colors import LUMINANCE, STONES, drawn_colors, mixture
from grainsdem.measures.planform.camera.lens import CameraLens, vignetting
from grainsdem.measures.planform.camera.textures import texture
from grainsdem.measures.planform.camera.wetting import INDEX, MIRRORED, wet_reflectance
from grainsdem.measures.planform.files import labels_content
from grainsdem.model import Domain
from grainsdem.recipe.views import PlanformTable

PLAIN = {"variety": 0.0, "brightness": 0.2, "ambient": 0.0, "light": (0.0, 0.0, 1.0)}


@pytest.fixture(scope="module")
def bed():
    """Grains of a bed that is periodic in x and y, with gaps between them."""
    domain = Domain.box((1.0, 0.8, 0.4), periodic=(True, True, False))
    cells = gd.tessellate(gd.points.poisson(domain, 150, rng=4), domain)
    return gd.shrink(gd.carve(cells, keep="all"), scale=0.8)


@pytest.fixture(scope="module")
def seen(bed):
    return gd.planform(bed, pixel=0.01)


@pytest.fixture(scope="module")
def plain():
    """Nothing but a level floor, with its packing."""
    packing = cube_packing([[50, 50, 5]])
    return gd.planform(packing, pixel=0.1, region=([0, 0], [6, 4])), packing


def places(view):
    x, y = view.places()
    return x - 0.5 * (x[0] + x[-1]), (y - 0.5 * (y[0] + y[-1]))[:, None]


@pytest.mark.unit
@pytest.mark.parametrize("light", [(0.0, 0.0, 1.0), (1.0, -0.5, 1.2)])
def test_a_lamps_light_falls_with_the_square_of_its_distance_and_by_lamberts_law(plain, light):
    x, y = places(plain[0])
    lamp = 5.0 * np.array(light) / np.linalg.norm(light)
    far = np.sqrt((lamp[0] - x) ** 2 + (lamp[1] - y) ** 2 + lamp[2] ** 2)
    grey = gd.photograph(*plain, **{**PLAIN, "light": light}, lamp=5.0)
    # On a level plane the cosine falls as the distance grows: in all, with its cube.
    np.testing.assert_allclose(grey, 0.2 * (5.0 / far) ** 3, rtol=1e-12)


@pytest.mark.property
def test_a_lamp_far_away_is_the_sun(bed, seen):
    sun = gd.photograph(seen, bed, rng=1)
    lamp = gd.photograph(seen, bed, rng=1, lamp=1e7)
    # But for pixels on the very edge of a shadow.
    assert (np.abs(sun - lamp) < 1e-6).mean() > 0.999


@pytest.mark.unit
def test_under_a_lamp_shadows_are_as_long_as_similar_triangles_say():
    heights = np.zeros((5, 120))
    heights[:, 40:42] = 2.0
    dark = shadows(heights, 0.5, np.array([0.0, 0.0, 1.0]), lamp=(20.0, 2.0, 4.0))
    # The far edge, 21.5 pixels from the lamp's foot and half as high as it, casts as much again.
    np.testing.assert_array_equal(np.flatnonzero(dark[2]), np.arange(42, 62))
    assert not dark[2, :40].any()


@pytest.mark.property
@pytest.mark.parametrize(("k1", "k2"), [(-0.3, 0.0), (-0.2, 0.05), (0.4, 0.0), (0.3, -0.1), (-0.25, -0.01), (0.0, 0.2)])
@pytest.mark.parametrize("shape", [(60, 100), (80, 80)])
def test_a_lens_and_its_inverse_round_trip_and_show_nothing_beyond_the_view(k1, k2, shape):
    lens = CameraLens(k1, k2, shape)
    r = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(lens.inward(lens.outward(r)), r, rtol=0, atol=1e-12)
    rows, columns = lens.places()
    for place, n in zip((rows, columns), shape, strict=True):
        assert place.min() >= -0.5
        assert place.max() <= n - 0.5
    # OpenCV's model, from its matrix and k1, k2: the place that is seen is drawn at the pixel.
    (focal, _, cx), (_, _, cy), _ = lens.camera_matrix()
    straight = np.stack([columns - cx, rows - cy]) / lens.half_diagonal
    w = (straight**2).sum(axis=0)
    bent = focal * straight * (1 + k1 * w + k2 * w * w) + np.array([cx, cy])[:, None, None]
    v, u = np.indices(shape)
    np.testing.assert_allclose(bent, [u, v], rtol=0, atol=1e-9)


@pytest.mark.unit
def test_lines_stay_straight_without_distortion_and_bow_as_the_formula_says_with_it():
    picture = np.tile(np.arange(101.0), (101, 1))  # what is drawn is the column that is seen
    assert CameraLens(0.0, 0.0, (101, 101)).drawn(picture) is picture
    for k1 in (-0.2, 0.2):
        lens = CameraLens(k1, 0.0, (101, 101))
        drawn = lens.drawn(picture)
        for row, column in ((50, 80), (10, 80), (3, 20)):
            photo = np.array([column - 50, row - 50]) / lens.half_diagonal
            # A line that is seen at x = c r cos θ / ... : the root of r (1 + k1 r²) = scale × photo, by its own solver.
            target = lens.scale * np.hypot(*photo)
            r = next(x.real for x in np.roots([k1, 0, 1, -target]) if abs(x.imag) < 1e-9 and 0 <= x.real <= 1)
            assert drawn[row, column] == pytest.approx(50 + lens.half_diagonal * photo[0] / np.hypot(*photo) * r)
        # A barrel bows lines outward in their middle: they cross a column of the photograph nearer to the middle there.
        assert (drawn[0, 80] > drawn[50, 80]) == (k1 < 0)


@pytest.mark.property
def test_labels_match_the_photograph_pixel_by_pixel_through_a_lens(bed, seen, tmp_path):
    options = {"lens": (-0.2, 0.02), "rng": 3, "ambient": 0.6}
    gd.write_planform(seen, bed, tmp_path, formats=["npy"], **options)
    image, labels = np.load(tmp_path / "image.npy"), np.load(tmp_path / "labels.npy")
    straight = gd.photograph(seen, bed, ambient=0.6, rng=3)
    told = json.loads((tmp_path / "planform.json").read_text())["lens"]
    rows, columns = CameraLens(-0.2, 0.02, seen.labels.shape).places()
    assert told["pixel_in_the_middle"] == pytest.approx(0.01 * (columns[40, 51] - columns[40, 50]), rel=1e-3)
    assert (labels != seen.labels).mean() > 0.1
    # Inside one face the photograph has that face's grey, and the label is its grain's.
    r, c = np.rint(rows).astype(int), np.rint(columns).astype(int)
    inner = np.zeros(labels.shape, dtype=bool)
    inner[1:-1, 1:-1] = True
    around = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)]
    for dr, dc in around:
        near = seen.faces[np.clip(r + dr, 0, 79), np.clip(c + dc, 0, 99)]
        grey = straight[np.clip(r + dr, 0, 79), np.clip(c + dc, 0, 99)]
        inner &= (near == seen.faces[r, c]) & (np.abs(grey - straight[r, c]) < 1e-12)
    assert inner.sum() > 50
    np.testing.assert_allclose(image[inner], straight[r, c][inner], atol=1e-6)
    np.testing.assert_array_equal(labels, seen.labels[r, c])


@pytest.mark.unit
def test_corners_lose_what_the_vignette_says_by_cos_to_the_fourth(plain):
    view, packing = plain
    grey = gd.photograph(view, packing, **PLAIN, vignette=0.4)
    radii = CameraLens(0.0, 0.0, view.labels.shape).radii()
    assert vignetting(np.array([0.0, 1.0]), 0.4) == pytest.approx([1.0, 0.6])
    slope = np.tan(np.arccos(0.6**0.25))
    np.testing.assert_allclose(grey, 0.2 * np.cos(np.arctan(slope * radii)) ** 4, rtol=1e-12)


@pytest.mark.unit
def test_a_gradient_is_the_change_across_the_picture(plain):
    x, y = places(plain[0])
    grey = gd.photograph(*plain, **PLAIN, gradient=[0.5, -0.3])
    np.testing.assert_allclose(grey, 0.2 * (1 + 0.5 * x / 6 - 0.3 * y / 4), rtol=1e-12)


@pytest.mark.unit
def test_a_cast_shadow_takes_the_beam_and_leaves_the_sky(plain):
    options = {**PLAIN, "ambient": 0.25, "shadow": 0.3, "shadow_side": np.pi}
    hard = gd.photograph(*plain, **options, shadow_edge=0.0)
    # From the left, 0.3 of six metres.
    np.testing.assert_allclose(hard, np.tile(np.where(np.arange(60) < 18, 0.05, 0.2), (40, 1)), rtol=1e-12)
    soft = gd.photograph(*plain, **options, shadow_edge=0.2)
    t = np.clip(((np.arange(60) + 0.5) / 60 - 0.3) / 0.1, -1, 1)
    # A disc cut by a line at t: its two segments by the angle that they span.
    angle = 2 * np.arccos(-t)
    np.testing.assert_allclose(soft[7], 0.05 + 0.15 * (angle - np.sin(angle)) / (2 * np.pi), rtol=1e-9)
    bar = gd.photograph(*plain, **options, shadow_width=0.1, shadow_edge=0.0)
    np.testing.assert_array_equal(bar[0] < 0.1, [12 <= k < 18 for k in range(60)])


@pytest.mark.unit
def test_a_cast_shadow_falls_along_the_light():
    packing = cube_packing([[5, 2, 1]], half=1.0, domain=Domain.box((10.0, 4.0, 4.0)))
    view = gd.planform(packing, pixel=0.1)
    options = {"variety": 0.0, "ambient": 0.0, "shadow": 0.5, "shadow_side": 0.0, "shadow_edge": 0.0}
    lit = gd.photograph(view, packing, light=(0.0, 1.0, 1.0), **{**options, "shadow": 0.0}) > 0
    dark = lit & (gd.photograph(view, packing, light=(0.0, 1.0, 1.0), **options) == 0)
    slanted = gd.photograph(view, packing, light=(-1.0, 0.0, 1.0), **options)
    assert dark[20, 50:].all()
    assert not dark[20, :50].any()
    # On the cube, two metres higher than the floor, light from the left shifts the edge two metres to the left.
    on_floor, on_top = np.flatnonzero(slanted[2] == 0)[0], np.flatnonzero(slanted[20, 40:60] == 0)
    assert on_floor == pytest.approx(50 + 10 * view_mean(view), abs=1)
    assert on_top.size == 20


def view_mean(view):
    """Mean height of what is seen [m]: where the shadow's edge is where it was asked for."""
    return np.where(view.labels > 0, view.heights, view.floor).mean()


@pytest.mark.unit
def test_water_darkens_by_angstroms_formula_and_mirrors_by_fresnels(plain):
    assert wet_reflectance(1.0) == pytest.approx(1 - MIRRORED)
    assert wet_reflectance(1e-9) / 1e-9 == pytest.approx((1 - MIRRORED) / INDEX**2)
    # Sum the orders of scattering: what leaves the film is 1 / n² of each.
    a, orders = 0.3, np.arange(200)
    total = (1 - MIRRORED) * a / INDEX**2 * ((a * (1 - 1 / INDEX**2)) ** orders).sum()
    assert wet_reflectance(a) == pytest.approx(total)
    under_sky = gd.photograph(*plain, **{**PLAIN, "ambient": 1.0}, wet=True)
    np.testing.assert_allclose(under_sky, wet_reflectance(0.2), rtol=1e-12)
    # Straight above: the whole lobe of a level face, at normal incidence.
    shining = gd.photograph(*plain, **PLAIN, wet=True, gloss=40.0)
    np.testing.assert_allclose(shining, wet_reflectance(0.2) + 6 * MIRRORED, rtol=1e-9)
    aside = gd.photograph(*plain, **{**PLAIN, "light": (1.0, 0.0, 1.0)}, wet=True, gloss=40.0)
    mirrored = MIRRORED + (1 - MIRRORED) * (1 - np.cos(np.pi / 8)) ** 5
    np.testing.assert_allclose(aside, wet_reflectance(0.2) + 6 * mirrored * np.cos(np.pi / 8) ** 40, rtol=1e-9)


@pytest.mark.statistical
def test_texture_leaves_the_mean_and_has_the_contrast_that_is_asked(bed, seen):
    options = {"ambient": 1.0, "rng": 5, "brightness": 0.2}
    bare, varied = (gd.photograph(seen, bed, **options, texture=value, texture_size=0.15) for value in (0.0, 0.2))
    ratio = (varied / bare)[(seen.labels > 0) & (bare > 0)]
    # Neighbouring pixels share a wavelength: a pixel in thirty counts on its own, and means are of that many.
    error = 0.2 / np.sqrt(ratio.size / 30)
    assert ratio.mean() == pytest.approx(1, abs=5 * error)
    assert ratio.std() == pytest.approx(0.2, abs=5 * error)
    values = texture(seen, bed, size=0.03, bands=0.0, seed=7)
    assert (values[seen.labels == 0] == 0).all()


@pytest.mark.property
def test_texture_is_fixed_to_the_grain(bed, seen):
    options = {"size": 0.05, "bands": 0.5, "seed": 7}
    values = texture(seen, bed, **options)
    part = gd.planform(bed, pixel=0.01, region=([0.2, 0.1], [0.7, 0.6]))
    np.testing.assert_allclose(texture(part, bed, **options), values[20:70, 20:70], atol=1e-9)
    # Moved by half a metre in the periodic bed, grains keep their looks.
    moved = replace(bed, positions=bed.positions + np.array([0.5, 0.0, 0.0]))
    view = gd.planform(moved, pixel=0.01)
    same = view.labels == np.roll(seen.labels, 50, axis=1)
    assert same.mean() > 0.99
    np.testing.assert_allclose(texture(view, moved, **options)[same], np.roll(values, 50, axis=1)[same], atol=1e-9)


@pytest.mark.unit
def test_bands_are_planes_and_no_wave_is_shorter_than_asked():
    packing = cube_packing([[4, 4, 4]], half=4.0, domain=Domain.cube(8.0))
    view = gd.planform(packing, pixel=1 / 32)
    found = {}
    for bands in (0.0, 1.0):
        values = texture(view, packing, size=0.5, bands=bands, seed=3)
        rows, columns = np.gradient(values, 1 / 32)
        found[bands] = np.linalg.eigvalsh(np.cov(rows.ravel(), columns.ravel()))
        window = np.hanning(256)[:, None] * np.hanning(256)
        power = np.abs(np.fft.fft2(values * window)) ** 2
        f = np.hypot(np.fft.fftfreq(256, 1 / 32)[:, None], np.fft.fftfreq(256, 1 / 32))
        # Wavelengths are half a metre over √2 at least, as seen from above.
        assert power[f > 1.1 * np.sqrt(2) / 0.5].sum() < 1e-4 * power.sum()
    assert found[1.0][0] < 1e-3 * found[1.0][1]
    assert found[0.0][0] > 0.2 * found[0.0][1]


@pytest.mark.statistical
def test_colours_are_in_the_mean_those_of_the_mixture():
    n, shares = 40_000, {"quartz": 3.0, "basalt": 1.0, "chert": 1.0}
    drawn = drawn_colors(shares, n, np.random.default_rng(2))
    mean = sum(share / 5 * np.array(STONES[name].color) for name, share in shares.items())
    np.testing.assert_allclose(drawn[0], mean / (mean @ LUMINANCE), rtol=1e-12)
    error = drawn[1:].std(axis=0) / np.sqrt(n)
    assert (np.abs(drawn[1:].mean(axis=0) - drawn[0]) < 5 * error).all()
    rows = mixture([[0.4, 0.3, 0.2, 1], [0.2, 0.3, 0.4, 3]])
    own = drawn_colors(rows, n, np.random.default_rng(2))[1:]
    kinds, counts = np.unique(own.round(9), axis=0, return_counts=True)
    assert len(kinds) == 2
    assert counts.max() / n == pytest.approx(0.75, abs=5 * np.sqrt(0.75 * 0.25 / n))


@pytest.mark.unit
def test_each_grain_has_one_colour_and_the_picture_is_rgb(bed, seen, tmp_path):
    import tifffile

    options = {"ambient": 1.0, "brightness": 0.3, "colors": "limestone:1,red_sandstone:1", "rng": 2}
    image = gd.photograph(seen, bed, **options)
    assert image.shape == (*seen.labels.shape, 3)
    ratio = image[..., 0] / image[..., 2]
    for grain in np.unique(seen.labels):
        assert np.ptp(ratio[seen.labels == grain]) < 1e-9
    gd.write_planform(seen, bed, tmp_path, formats=["png", "tif", "npy"], **options)
    with Image.open(tmp_path / "image.png") as picture:
        assert picture.mode == "RGB"
        np.testing.assert_allclose(np.asarray(picture) / 255, image, atol=0.5 / 255 + 1e-9)
    np.testing.assert_allclose(tifffile.imread(tmp_path / "image.tif") / 65535, image, atol=1e-5)
    assert np.load(tmp_path / "image.npy").shape == image.shape
    gd.figures.planform_figure(seen, bed, image, tmp_path / "figure.png")


@pytest.mark.unit
def test_blur_and_noise_come_behind_colours_and_lens(bed, seen):
    colored = gd.photograph(seen, bed, colors="slate", blur=1.0, noise=0.01, vignette=0.2, lens=(0.1, 0.0), rng=1)
    assert colored.shape == (80, 100, 3)
    assert np.abs(np.diff(colored[..., 0] - colored[..., 1], axis=0)).max() > 0  # noise of each channel


@pytest.mark.unit
def test_options_that_do_nothing_change_nothing(bed, seen):
    neutral = {"lamp": None, "texture": 0.0, "bands": 1.0, "wet": False, "gloss": 3.0, "gradient": np.zeros(2)}
    neutral |= {"shadow": 0.0, "shadow_width": 0.1, "vignette": 0.0, "lens": [0, 0], "colors": None}
    options = {"blur": 0.6, "noise": 0.01, "rng": 8}
    np.testing.assert_array_equal(gd.photograph(seen, bed, **neutral, **options), gd.photograph(seen, bed, **options))


@pytest.mark.unit
def test_labels_fit_into_16_bits_or_are_refused(tmp_path):
    labels = np.array([[0, 1], [65535, 258]], dtype=np.int32)
    (tmp_path / "l.png").write_bytes(labels_content(labels, "png"))
    with Image.open(tmp_path / "l.png") as picture:
        np.testing.assert_array_equal(np.asarray(picture), labels)
    with pytest.raises(InputError, match="16 bits, for 65535 grains; got grain 65535"):
        labels_content(labels + 1, "png")


@pytest.mark.unit
def test_tables_and_the_command_have_the_options_of_the_photograph(bed, tmp_path):
    table = PlanformTable(colors="quartz:2,basalt:1", lens=[-0.1, 0], wet=True)
    assert table.camera()["colors"] == {"quartz": 2.0, "basalt": 1.0}
    with pytest.raises(ValueError, match="vignette"):
        PlanformTable(vignette=1.5)
    gd.save(bed, tmp_path / "bed.h5")
    words = ["planform", tmp_path / "bed.h5", tmp_path / "a", "--pixel", 0.02, "--wet", "--colors", "granite:1,slate:1"]
    words += ["--lens", -0.1, 0.0, "--gradient", 0.2, -0.2, "--lamp", 3.0, "--texture", 0.2, "--quiet"]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    told = json.loads((tmp_path / "a" / "planform.json").read_text())
    assert told["photograph"]["colors"] == {"granite": 1.0, "slate": 1.0}
    assert told["lens"]["k1"] == -0.1
    result = CliRunner().invoke(app, [*map(str, words[:5]), "--colors", "gold"])
    assert result.exit_code == 2
    assert "stones must be among quartz" in result.output
