"""A planform as a folder: the image, and everything that is true of it."""

from __future__ import annotations

import io
import json
import struct
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import write_all
from grainsdem.errors import InputError, MissingPackageError, name_offenders
from grainsdem.gate import gated
from grainsdem.measures.grains.files import table_content
from grainsdem.measures.planform.camera.lens import CameraLens
from grainsdem.measures.planform.photographs import photograph
from grainsdem.measures.planform.truth import planform_bias, planform_table

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.measures.planform.views import Planform
    from grainsdem.model import Packing

FORMATS = ("png", "npy", "tif")
"""What images are written as."""


@gated
def write_planform(
    view: Planform,
    packing: Packing,
    folder: str | os.PathLike[str],
    *,
    formats: Sequence[str] = ("png", "npy"),
    least_pixels: int = 1,
    rng: int | None = 0,
    overwrite: bool = False,
    **options: Any,
) -> list[Path]:
    """Write a photograph of a bed from above, and the truth about it, into a folder that is made if need be.

    Parameters
    ----------
    view : Planform
        What is seen of the packing.
    packing : Packing
        The same packing.
    folder : str or path-like
        Where the files go.
    formats : sequence of {"png", "npy", "tif"}
        ``png``: ``image.png``, 8-bit grey, or RGB with colours. ``npy``: ``labels.npy`` (int32, grain id + 1, 0 where
        no grain is), ``depth.npy`` (float32, metres below the highest thing seen, NaN where no grain is) and
        ``image.npy`` (float32, 0 to 1). ``tif``: the same three, the image in 16 bits. Labels and depths are those of
        the photograph's pixels, also where a lens bends it.
    least_pixels : int
        Of `planform_bias`.
    rng : int or None
        Seed of reflectances and noise.
    overwrite : bool
        Whether files that exist are replaced.
    **options
        Of `photograph`: light, grains, lens and sensor.

    Returns
    -------
    list of pathlib.Path
        The files, with ``truth.csv`` (`planform_table`), ``bias.csv`` (`planform_bias`; left out where no whole grain
        is seen) and ``planform.json``, which says what was asked for and where the pixels are. The same packing,
        options and seed give the same bytes on the same processor.

    Raises
    ------
    InputError
        If a format is another, or as `photograph` does.
    MissingPackageError
        Where a TIFF is asked for and tifffile is not installed.
    WriteError
        If a file exists and ``overwrite`` is false, or cannot be written; nothing is left behind.
    """
    unknown = [name for name in formats if name not in FORMATS]
    if unknown:
        raise InputError(f"formats must be among {', '.join(FORMATS)}; got {name_offenders(unknown)}")
    image = photograph(view, packing, rng=rng, **options)
    glass = CameraLens.of(view, options.get("lens", (0.0, 0.0)))
    depths = glass.nearest(view.depths().astype(np.float32))
    files: dict[str, bytes] = {}
    for suffix in formats:
        if suffix != "png":
            files[f"labels.{suffix}"] = labels_content(glass.nearest(view.labels), suffix)
            files[f"depth.{suffix}"] = _WRITERS[suffix](depths)
        files[f"image.{suffix}"] = image_content(image, suffix)
    rows = planform_table(view, packing)
    files["truth.csv"] = table_content(rows, ".csv")
    if (~rows["is_cut"] & (rows["n_pixels"] >= least_pixels)).any():
        files["bias.csv"] = table_content(planform_bias(rows, packing, least_pixels=least_pixels), ".csv")
    asked = {**{name: np.asarray(value).tolist() for name, value in options.items()}, "rng": rng}
    files["planform.json"] = _described(view, asked, glass)
    return write_all(folder, files, overwrite=overwrite, make_folder=True)


def image_content(image: NDArray[np.float64], suffix: str) -> bytes:
    """Return an image within [0, 1] as a file: 8 bits as ``png``, 16 as ``tif``, single precision as ``npy``."""
    if suffix == "npy":
        return _npy(image.astype(np.float32))
    most, kind = (255, np.uint8) if suffix == "png" else (65535, np.uint16)
    return _WRITERS[suffix](np.rint(most * image).astype(kind))


def labels_content(labels: NDArray[np.int32], suffix: str) -> bytes:
    """Return labels as a file: int32, and 16 bits as ``png``.

    Raises
    ------
    InputError
        If there are too many grains for 16 bits.
    """
    if suffix != "png":
        return _WRITERS[suffix](labels)
    if labels.max(initial=0) > np.iinfo(np.uint16).max:
        raise InputError(f"labels as png have 16 bits, for 65535 grains; got grain {labels.max() - 1}: use npy or tif")
    return _png(labels.astype(np.uint16))


def _described(view: Planform, asked: dict[str, Any], glass: CameraLens) -> bytes:
    """Return where the pixels are, and how the image was made, as JSON."""
    ny, nx = view.labels.shape
    seen = view.labels > 0
    facts = {
        "width": nx,
        "height": ny,
        "pixel": view.pixel.tolist(),
        "lower": view.corner.tolist(),
        "upper": (view.corner + view.pixel * [nx, ny]).tolist(),
        "first_row_at": "largest y",
        "highest": float(np.nanmax(view.heights)) if seen.any() else None,
        "floor": view.floor,
        "periodic": view.periodic.tolist(),
        "photograph": asked,
        **({} if glass.is_plain else {"lens": lens_told(glass, view)}),
        "labels": "grain id + 1, 0 where no grain is seen",
        "unit": "m",
    }
    return (json.dumps(facts, indent=2) + "\n").encode()


def lens_told(glass: CameraLens, view: Planform) -> dict[str, Any]:
    """Return what photogrammetry needs to straighten a photograph, and the edge [m] of a pixel in its middle."""
    return {
        "k1": glass.k1,
        "k2": glass.k2,
        "camera_matrix": glass.camera_matrix(),
        "pixel_in_the_middle": float(view.pixel.mean()) * glass.scale,
    }


def _npy(array: NDArray[Any]) -> bytes:
    content = io.BytesIO()
    np.save(content, array, allow_pickle=False)
    return content.getvalue()


def _tiff(array: NDArray[Any]) -> bytes:
    try:
        import tifffile  # noqa: PLC0415  (optional)
    except ImportError as error:
        raise MissingPackageError('TIFF needs tifffile: pip install "grainsdem[images]"') from error
    content = io.BytesIO()
    kind = "rgb" if array.ndim == 3 else "minisblack"
    tifffile.imwrite(content, array, photometric=kind, metadata=None, software=False)
    return content.getvalue()


def _png(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Return a grey or RGB image of 8 or 16 bits as PNG (ISO/IEC 15948)."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    height, width, bits = *image.shape[:2], 8 * image.itemsize
    content = image.astype(image.dtype.newbyteorder(">")).reshape(height, -1).view(np.uint8)
    rows = np.zeros((height, content.shape[1] + 1), dtype=np.uint8)  # a leading zero a row: no filter
    rows[:, 1:] = content
    head = struct.pack(">IIBBBBB", width, height, bits, 2 if image.ndim == 3 else 0, 0, 0, 0)
    body = zlib.compress(rows.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


_WRITERS: dict[str, Callable[[NDArray[Any]], bytes]] = {"png": _png, "npy": _npy, "tif": _tiff}
