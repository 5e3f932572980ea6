"""Seeds from an image: light and shade of a photograph as a density.

References
----------
.. [1] D. Buscombe and D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted granular
   material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001, figure 11.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from grainsdem.errors import FileFormatError, InputError, MissingFileError, MissingPackageError, ShapeError
from grainsdem.foreign import refusing
from grainsdem.gate import gated
from grainsdem.memory import allow_memory
from grainsdem.points.fields.density import (
    Axis,
    from_density,
)
from grainsdem.points.fields.tones import low_passed, spread, tone

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain

Image: TypeAlias = "str | os.PathLike[str] | ArrayLike"

Light = Literal["coarse", "fine"]
Region = tuple[int, int, int, int]

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")

MOST_PIXELS = 100_000_000
"""Most pixels of an image: a few bytes may claim many more, which take minutes to unpack."""

_A_PIXEL = 100
"""Bytes that a pixel takes while it is read and toned: colours as they are, as numbers, and copies of greys."""

_BITS, _PHOTOMETRIC, _SAMPLE_FORMAT = 258, 262, 339
_WHITE_IS_ZERO, _UNSIGNED, _SIGNED = 0, 1, 2
"""Tags of TIFF 6.0 and values of theirs."""

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Shares of red, green and blue in grey, by ITU-R recommendation BT.709."""


@gated
def from_image(
    domain: Domain,
    n: int,
    image: Image,
    *,
    region: Region | None = None,
    low_pass: float | None = None,
    order: int = 2,
    gain: float | None = None,
    cutoff: float = 0.5,
    threshold: float | None = None,
    floor: float = 0.0,
    light: Light = "coarse",
    along: Axis = "z",
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.float64]:
    """Return independent seeds that are dense where an image is dark, or where it is light.

    Parameters
    ----------
    domain : Domain
        Where the seeds lie; the image is stretched over its box, its top edge at the upper end.
    n : int
        Number of seeds, at least 1.
    image, region, low_pass, order, gain, cutoff, threshold, floor, light
        As for `image_density`.
    along : {"x", "y", "z"}
        Axis along which the image is extruded: what is seen along z is a bed from above, along y a section with x to
        the right and z upwards, along x one with y to the right. In a planar domain always z.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m]; in the mid-plane where the domain is planar.

    Raises
    ------
    MissingFileError, FileFormatError, MissingPackageError, ShapeError, InputError
        As `image_density` and `from_density`.
    """
    density = image_density(
        image,
        region=region,
        low_pass=low_pass,
        order=order,
        gain=gain,
        cutoff=cutoff,
        threshold=threshold,
        floor=floor,
        light=light,
    )
    return from_density(domain, n, density, along=along, rng=rng)


@gated
def image_density(
    image: Image,
    *,
    region: Region | None = None,
    low_pass: float | None = None,
    order: int = 2,
    gain: float | None = None,
    cutoff: float = 0.5,
    threshold: float | None = None,
    floor: float = 0.0,
    light: Light = "coarse",
) -> NDArray[np.float64]:
    """Return the density of seeds that an image stands for.

    Parameters
    ----------
    image : str, path-like or array_like, shape (rows, columns) or (rows, columns, 3 or 4)
        ``.png``, ``.jpg`` or ``.tif`` file, or grey values of any range, or red, green and blue of any range, or these
        and opacity: unsigned integers that fill the range of their type, or numbers in [0, 1]. The first row is the
        top. What is not opaque is seen before white.
    region : four ints, optional
        First column, first row, and the column and row after the last, of the part that counts.
    low_pass : float, optional
        Frequency [cycles a pixel], at most 0.5, above which detail is lost: 0.02 keeps what is larger than 50 pixels.
    order : int
        Sharpness of the low-pass filter, 1 or more.
    gain, cutoff : float
        Contrast, once the greys are stretched to run from 0 to 1: steepness, and the grey about which it parts light
        and dark. Straight without a gain.
    threshold : float, optional
        Grey in [0, 1] that parts light from dark, with nothing between; instead of a gain.
    floor : float
        Density of the coarsest places, if that of the finest is 1.
    light : {"coarse", "fine"}
        What light places are: sparse seeds make coarse grains.

    Returns
    -------
    ndarray of float64, shape (columns, rows)
        Between 0 and 1, along x and y: the last row of the image is at the lower end of y.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is no image of those kinds, or holds several pages.
    MissingPackageError
        If a file is to be read, and Pillow is not installed.
    ShapeError
        If an array has another shape.
    InputError
        If a number is out of range, the region outside the image, all of it of one grey, or colours with an opacity
        are not in their range: they would be seen before a white that is none of theirs.
    """
    if light not in ("coarse", "fine"):
        raise InputError(f"light must be 'coarse' or 'fine'; got {light!r}")
    grey = _cropped(_grey(_read(image) if isinstance(image, str | os.PathLike) else image), region)
    if low_pass is not None:
        grey = low_passed(grey, low_pass, order)
    grey = spread(grey)
    toned = tone(
        grey if light == "fine" else 1.0 - grey, gain=gain, **_seen_from(light, cutoff, threshold), floor=floor
    )
    return np.ascontiguousarray(toned[::-1].T)


def _seen_from(light: Light, cutoff: float, threshold: float | None) -> dict[str, Any]:
    """Return cut-off and threshold for greys that are turned over where light is coarse."""
    if light == "fine":
        return {"cutoff": cutoff, "threshold": threshold}
    return {"cutoff": 1.0 - cutoff, "threshold": None if threshold is None else 1.0 - threshold}


def _read(path: str | os.PathLike[str]) -> NDArray[Any]:
    """Return the pixels of a file, turned as its camera says."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(f"{path}: images are read from {', '.join(SUFFIXES)}; got {path.suffix or 'no suffix'!r}")
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    try:
        from PIL import Image, ImageOps  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise MissingPackageError("reading images needs Pillow: pip install 'grainsdem[images]'") from error
    with refusing(path, "cannot be read as an image"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of damage and of sizes, which are told as errors
        return _pixels(Image.open(path), ImageOps.exif_transpose)


def _pixels(opened: Any, upright: Callable[[Any], Any]) -> NDArray[np.float64]:
    """Return the values of an opened file's pixels: grey as they are, colours between 0 and 1."""
    with opened:
        pages = getattr(opened, "n_frames", 1)
        if pages != 1:
            raise FileFormatError(f"an image has one page; got {pages} (a stack is read from .npy)")
        if opened.width * opened.height > MOST_PIXELS:
            raise FileFormatError(f"an image has at most {MOST_PIXELS} pixels; got {opened.width} × {opened.height}")
        allow_memory(opened.width * opened.height, _A_PIXEL, "pixels")
        tags = getattr(opened, "tag_v2", {})
        turned = upright(opened)
        if turned.mode in ("L", "F") or turned.mode.startswith("I"):
            return _greys(np.asarray(turned), turned.mode, tags, turned.info.get("transparency"))
        is_clear = turned.mode in ("LA", "PA", "RGBA") or "transparency" in turned.info
        return np.asarray(turned.convert("RGBA" if is_clear else "RGB"), dtype=np.float64) / 255


def _greys(values: NDArray[Any], mode: str, tags: Any, clear: int | None) -> NDArray[np.float64]:
    """Return the grey values of a file: Pillow leaves some of what a TIFF or PNG says of them to its caller."""
    kind, bits = tags.get(_SAMPLE_FORMAT, (_UNSIGNED,))[0], tags.get(_BITS, (0,))[0]
    if kind == _UNSIGNED and bits == 32 and values.dtype == np.int32:
        values = values.view(np.uint32)
    if kind == _SIGNED and bits == 8:
        values = values.astype(np.uint8).view(np.int8)
    greys = values.astype(np.float64)
    if clear is not None:  # one grey of a PNG is clear: white lies behind
        greys[values == clear] = 255 if mode == "L" else 65535
    # Greys of 8 bits are turned by Pillow.
    return -greys if tags.get(_PHOTOMETRIC) == _WHITE_IS_ZERO and mode != "L" else greys


def _grey(pixels: ArrayLike) -> NDArray[np.float64]:
    """Return the grey values, shape (rows, columns), of pixels."""
    kind = np.asarray(pixels).dtype
    if kind.kind == "c" or np.ma.is_masked(pixels):
        raise ShapeError("an image is an array of real numbers, none of them masked")
    try:
        values = np.asarray(pixels, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"an image is an array of numbers; {error}") from error
    if values.ndim not in (2, 3) or not values.size or (values.ndim == 3 and values.shape[2] not in (3, 4)):
        raise ShapeError(f"an image has shape (rows, columns), or with 3 or 4 colours besides; got {values.shape}")
    if not np.isfinite(values).all():
        raise InputError(f"an image must be finite; {int((~np.isfinite(values)).sum())} values are not")
    if values.ndim == 2:
        return values
    is_clear = values.shape[2] == 4
    if is_clear:
        values = _unit(values, kind)
    # Not a matrix product: BLAS rounds as the processor's vectors are wide.
    grey = np.asarray((values[..., :3] * np.array(LUMINANCE)).sum(axis=-1), dtype=np.float64)
    return grey * values[..., 3] + (1.0 - values[..., 3]) if is_clear else grey


def _unit(values: NDArray[np.float64], kind: np.dtype[Any]) -> NDArray[np.float64]:
    """Return colours and opacity in [0, 1], on which depends what white lies behind, or raise one clear error."""
    low, high = values.min(), values.max()
    given = f"got {kind} from {low:g} to {high:g}"
    if kind.kind == "u":
        if kind.itemsize > 1 and 1 < high <= 255:
            raise InputError(f"colours and opacity of {kind} fill its range; {given}: are they uint8?")
        return values / np.iinfo(kind).max
    if low < 0 or high > 1:
        raise InputError(
            f"colours with an opacity are unsigned integers, or numbers in [0, 1]; {given}: divide by white's value"
        )
    return values


def _cropped(grey: NDArray[np.float64], region: Region | None) -> NDArray[np.float64]:
    """Return the part of an image that counts."""
    if region is None:
        return grey
    rows, columns = grey.shape
    left, top, right, bottom = region
    if not (0 <= left < right <= columns and 0 <= top < bottom <= rows):
        raise InputError(
            f"a region is (left, top, right, bottom), within the image's {columns} columns and {rows} rows; "
            f"got {tuple(region)}"
        )
    return grey[top:bottom, left:right]
