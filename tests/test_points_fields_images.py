from __future__ import annotations

import sys

import numpy as np
import pytest
import tifffile
from PIL import Image
from scipy.fft import dctn
from scipy.stats import chi2
from skimage.color import rgb2gray
from skimage.data import gravel
from skimage.exposure import adjust_sigmoid

from grainsdem.errors import FileFormatError, InputError, MissingFileError, MissingPackageError
from grainsdem.model import Domain
from grainsdem.points import from_image, image_density
from grainsdem.points.fields.tones import low_passed

pytestmark = pytest.mark.unit

SLAB = Domain.slab((2.0, 1.0), 0.1)
RAMP = np.linspace(0, 255, 64).astype(np.uint8)[None, :] * np.ones((32, 1), dtype=np.uint8)
"""Dark on the left, light on the right."""


@pytest.fixture(scope="module")
def photograph():
    """A real photograph of gravel, 512 pixels square."""
    return gravel()


def stretched(values):
    return (values - values.min()) / np.ptp(values)


@pytest.mark.statistical
@pytest.mark.parametrize("light", ["coarse", "fine"])
def test_seeds_on_a_photograph_are_as_dense_as_it_is_dark_or_light(photograph, light):
    n, k = 40_000, 16
    seeds = from_image(Domain.slab((1.0, 1.0), 0.1), n, photograph, light=light, rng=1)
    grey = stretched(photograph.astype(float))
    density = grey if light == "fine" else 1 - grey
    blocks = density.reshape(k, 512 // k, k, 512 // k).sum(axis=(1, 3))
    # Rows of the image run downwards, y upwards.
    expected = n * blocks[::-1].T / blocks.sum()
    found = np.histogram2d(seeds[:, 0], seeds[:, 1], bins=k, range=[(0, 1), (0, 1)])[0]
    low, high = chi2.ppf([1e-5, 1 - 1e-5], k**2 - 1)
    assert low < ((found - expected) ** 2 / expected).sum() < high


def test_the_top_of_an_image_is_the_upper_end():
    image = np.zeros((40, 20))
    image[:10, 15:] = 1.0
    seeds = from_image(SLAB, 200, image, light="fine", rng=1)
    assert (seeds[:, 0] >= 1.5).all()
    assert (seeds[:, 1] >= 0.75).all()


@pytest.mark.parametrize(("along", "right", "up"), [("z", 0, 1), ("y", 0, 2), ("x", 1, 2)])
def test_an_image_is_extruded_along_any_axis(along, right, up):
    image = np.zeros((4, 4))
    image[0, 3] = 1.0
    seeds = from_image(Domain.cube(), 400, image, light="fine", along=along, rng=1)
    assert seeds[:, right].min() >= 0.75
    assert seeds[:, up].min() >= 0.75
    (extruded,) = {0, 1, 2} - {right, up}
    assert np.ptp(seeds[:, extruded]) > 0.9


@pytest.mark.parametrize("suffix", [".png", ".tif", ".tiff", ".jpg", ".jpeg", ".PNG"])
@pytest.mark.parametrize("colours", [False, True])
def test_files_of_every_kind_are_read(tmp_path, suffix, colours):
    path = tmp_path / f"ramp{suffix}"
    Image.fromarray(np.stack([RAMP] * 3, axis=-1) if colours else RAMP).save(path)
    np.testing.assert_allclose(image_density(path), image_density(RAMP), atol=0.02 if "j" in suffix else 1e-12)


@pytest.mark.parametrize("mode", ["1", "L", "P", "LA", "RGB", "RGBA", "CMYK", "I;16", "I", "F"])
def test_pixels_of_every_kind_are_read(tmp_path, mode):
    path = tmp_path / "ramp.tif"
    Image.fromarray(RAMP).convert("I" if mode == "I;16" else mode).convert(mode).save(path)
    density = image_density(path)
    assert density.shape == (64, 32)
    if mode != "1":  # dithered: dark and light only
        np.testing.assert_allclose(density, image_density(RAMP), atol=0.03)
    assert density[:20].mean() > 0.75
    assert density[-20:].mean() < 0.25


def test_colours_are_as_light_as_they_look(photograph):
    generator = np.random.default_rng(1)
    colours = generator.random((30, 40, 3))
    np.testing.assert_allclose(image_density(colours, light="fine")[:, ::-1].T, stretched(rgb2gray(colours)), atol=1e-3)
    shades = photograph[:30, :40, None] * np.ones(3, dtype=np.uint8)
    np.testing.assert_allclose(image_density(shades), image_density(photograph[:30, :40]), atol=1e-12)


def test_what_is_clear_is_seen_before_white(tmp_path):
    clear = np.full((4, 4, 4), 255, dtype=np.uint8)
    clear[..., :3] = 0
    clear[:, :2, 3] = 0
    expected = np.repeat([[1.0, 0.0]], 2, axis=1).T * np.ones((1, 4))
    np.testing.assert_allclose(image_density(clear, light="fine"), expected, atol=1e-12)
    Image.fromarray(clear).save(tmp_path / "clear.png")
    np.testing.assert_allclose(image_density(tmp_path / "clear.png", light="fine"), expected, atol=1e-12)


CLEAR = np.stack([np.zeros_like(RAMP)] * 3 + [255 - RAMP], axis=-1)
"""Black that is less and less opaque to the right: before white the same as `RAMP`."""


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32, np.float32, np.float64])
@pytest.mark.parametrize("colours", [CLEAR, np.stack([RAMP] * 3 + [RAMP * 0 + 255], axis=-1)], ids=["clear", "opaque"])
def test_colours_with_an_opacity_are_seen_in_the_same_tone_whatever_their_numbers(kind, colours):
    white = np.iinfo(kind).max if np.issubdtype(kind, np.integer) else 1
    given = (colours.astype(np.float64) / 255 * white).astype(kind)
    np.testing.assert_allclose(image_density(given), image_density(RAMP), atol=1e-6)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int16, np.int64, np.uint16, np.uint32])
def test_colours_with_an_opacity_that_do_not_say_what_white_is_are_refused(kind):
    # As floats up to 255 they were seen before a white of 1, darker than nearly every colour.
    with pytest.raises(InputError, match=rf"got {np.dtype(kind).name} from 0 to 255: (divide by white|are they uint8)"):
        image_density(CLEAR.astype(kind))
    with pytest.raises(InputError, match="from -1 to 1: divide"):
        image_density(np.concatenate([CLEAR / 255, CLEAR / -255]))


@pytest.mark.parametrize("scale", [1, 255, -3.5])
def test_the_scale_of_greys_and_of_colours_without_opacity_does_not_matter(scale):
    light = "fine" if scale < 0 else "coarse"
    for given in (RAMP * (scale / 255), np.stack([RAMP] * 3, axis=-1) * (scale / 255)):
        np.testing.assert_allclose(image_density(given, light=light), image_density(RAMP), atol=1e-12)


def test_truth_values_are_an_image_and_complex_or_masked_numbers_are_none():
    np.testing.assert_array_equal(image_density(RAMP > 99), image_density(np.where(RAMP > 99, 7, 3)))
    for given, words in (
        (RAMP.astype(complex), "complex numbers"),
        (np.ma.masked_greater(RAMP, 200), "a masked array"),
    ):
        with pytest.raises(InputError, match=f"image must be a path or an array of numbers; got {words}"):
            image_density(given)


@pytest.mark.client
@pytest.mark.parametrize(
    ("photometric", "kind"),
    [("minisblack", k) for k in (np.uint8, np.int8, np.uint16, np.int16, np.uint32, np.int32, np.float32)]
    + [("miniswhite", k) for k in (np.uint8, np.uint16, np.float32)],  # all that Pillow reads
)
def test_light_is_light_in_tiffs_that_say_that_zero_is_black_or_white(tmp_path, kind, photometric):
    low, high = (np.iinfo(kind).min, np.iinfo(kind).max) if np.issubdtype(kind, np.integer) else (0.0, 1.0)
    values = RAMP / 255 if photometric == "minisblack" else 1 - RAMP / 255
    tifffile.imwrite(
        tmp_path / "a.tif", np.clip(low + values * (float(high) - low), low, high).astype(kind), photometric=photometric
    )
    np.testing.assert_allclose(image_density(tmp_path / "a.tif"), image_density(RAMP), atol=0.01)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_grey_of_a_png_that_is_clear_is_white(tmp_path, kind):
    Image.fromarray(RAMP.astype(kind)).save(tmp_path / "a.png", transparency=0)
    expected = np.where(RAMP == 0, float(np.iinfo(kind).max), RAMP)
    np.testing.assert_allclose(image_density(tmp_path / "a.png"), image_density(expected), atol=1e-12)


def test_a_camera_held_upright_is_turned(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6  # the first row is the right-hand side
    Image.fromarray(RAMP).save(tmp_path / "turned.png", exif=exif)
    turned = image_density(tmp_path / "turned.png")
    assert turned.shape == (32, 64)
    np.testing.assert_allclose(turned, image_density(np.rot90(RAMP, -1)))


def test_light_coarse_and_light_fine_are_one_together():
    together = image_density(RAMP, light="coarse") + image_density(RAMP, light="fine")
    np.testing.assert_allclose(together, 1.0)


def test_a_region_is_cut_out(photograph):
    np.testing.assert_array_equal(
        image_density(photograph, region=(100, 20, 180, 60)), image_density(photograph[20:60, 100:180])
    )


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("waves", [(2, 0), (0, 6), (3, 4)])
def test_the_low_pass_filter_weakens_waves_as_butterworths_does(waves, order):
    rows, columns = 64, 48
    y, x = np.meshgrid(np.arange(rows) + 0.5, np.arange(columns) + 0.5, indexing="ij")
    weak = np.cos(np.pi * waves[0] * x / columns) * np.cos(np.pi * waves[1] * y / rows)
    # A wave of frequency zero besides, for scale: the mean is let through.
    cutoff = 0.03
    frequency = np.hypot(waves[0] / (2 * columns), waves[1] / (2 * rows))
    passed = low_passed(3.0 + weak, cutoff, order)
    expected = 3.0 + weak / (1 + (frequency / cutoff) ** (2 * order))
    np.testing.assert_allclose(passed, expected, atol=1e-12)


def test_the_low_pass_filter_keeps_the_beds_and_loses_the_grains(photograph):
    smooth = image_density(photograph, low_pass=0.01)
    fine = np.hypot(*np.meshgrid(np.arange(512), np.arange(512))) / 1024 > 0.03
    before, after = (dctn(values - values.mean()) ** 2 for values in (image_density(photograph), smooth))
    assert before[fine].sum() > 0.3 * before.sum()
    assert after[fine].sum() < 0.01 * after.sum()


def test_no_edge_bleeds_into_the_opposite_one():
    density = image_density(RAMP, low_pass=0.05, light="fine")
    assert density[0].mean() < 0.03
    assert density[-1].mean() > 0.97


@pytest.mark.parametrize(("gain", "cutoff"), [(5.0, 0.5), (12.0, 0.3), (1e6, 0.7)])
def test_contrast_is_that_of_scikit_image(photograph, gain, cutoff):
    grey = stretched(photograph.astype(float))
    with np.errstate(over="ignore"):  # theirs overflows at a large gain
        theirs = stretched(adjust_sigmoid(grey, cutoff=cutoff, gain=gain))
    np.testing.assert_allclose(image_density(photograph, light="fine", gain=gain, cutoff=cutoff)[:, ::-1].T, theirs)
    coarse = image_density(photograph, light="coarse", gain=gain, cutoff=cutoff)[:, ::-1].T
    np.testing.assert_allclose(coarse, 1 - theirs, atol=1e-12)


@pytest.mark.parametrize("light", ["coarse", "fine"])
def test_a_threshold_parts_light_from_dark_and_a_floor_fills_the_coarse(light):
    density = image_density(RAMP, threshold=0.75, floor=0.1, light=light)
    is_light = stretched(RAMP.astype(float))[::-1].T > 0.75
    np.testing.assert_array_equal(density, np.where(is_light == (light == "fine"), 1.0, 0.1))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"light": "dark"}, "'coarse' or 'fine'; got 'dark'"),
        ({"region": (0, 0, 65, 10)}, r"64 columns and 32 rows; got \(0, 0, 65, 10\)"),
        ({"region": (10, 10, 10, 20)}, "a region is"),
        ({"low_pass": 0.7}, "1e-09 to 0.5 cycles a pixel; got 0.7"),
        ({"low_pass": 0.1, "order": 0}, "order must be 1 or more; got 0"),
        ({"gain": 3.0, "threshold": 0.5}, "either a gain or a threshold"),
        ({"region": (5, 0, 6, 20)}, "no light and shade to place seeds by: all values are 20"),
    ],
)
def test_numbers_out_of_range_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        from_image(SLAB, 5, RAMP, **options)


@pytest.mark.parametrize("image", [np.ones(4), np.ones((4, 4, 2)), np.empty((0, 4)), [["a"]]])
def test_arrays_that_are_no_image_are_refused(image):
    with pytest.raises(InputError, match="image"):
        image_density(image)


def test_pixels_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="1 values are not"):
        image_density([[1.0, np.nan]])


def test_files_that_are_no_images_get_one_clear_error(tmp_path):
    with pytest.raises(MissingFileError, match="no such file"):
        image_density(tmp_path / "none.png")
    with pytest.raises(FileFormatError, match=r"\.tiff; got '\.gif'"):
        image_density(tmp_path / "a.gif")
    Image.fromarray(RAMP).save(tmp_path / "a.tif")
    for name in ("a.png", "a.jpg", "a.tif"):
        Image.fromarray(RAMP).save(tmp_path / name)
        whole = (tmp_path / name).read_bytes()
        for cut in (0, 10, len(whole) // 3, len(whole) // 2):
            (tmp_path / name).write_bytes(whole[:cut])
            with pytest.raises(FileFormatError, match=f"{name}: cannot be read as an image"):
                image_density(tmp_path / name)
    pages = [Image.fromarray(RAMP), Image.fromarray(RAMP)]
    pages[0].save(tmp_path / "stack.tif", save_all=True, append_images=pages[1:])
    with pytest.raises(FileFormatError, match="one page; got 2"):
        image_density(tmp_path / "stack.tif")


def test_a_missing_pillow_says_how_to_get_it(tmp_path, monkeypatch):
    Image.fromarray(RAMP).save(tmp_path / "a.png")
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(MissingPackageError, match=r"pip install 'grainsdem\[images\]'"):
        image_density(tmp_path / "a.png")
    assert image_density(RAMP).shape == (64, 32)
