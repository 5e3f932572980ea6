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
from grainsdem.measures.planform.photographs import photograph
from grainsdem.measures.planform.truth import planform_bias, planform_table

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
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
        ``png``: ``image.png``, 8-bit grey. ``npy``: ``labels.npy`` (int32, grain id + 1, 0 where no grain is),
        ``depth.npy`` (float32, metres below the highest thing seen, NaN where no grain is) and ``image.npy`` (float32,
        0 to 1). ``tif``: the same three, the image in 16-bit grey.
    least_pixels : int
        Of `planform_bias`.
    rng : int or None
        Seed of reflectances and noise.
    overwrite : bool
        Whether files that exist are replaced.
    **options
        Of `photograph`: ``light``, ``ambient``, ``brightness``, ``variety``, ``blur``, ``noise``.

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
    files: dict[str, bytes] = {}
    if "png" in formats:
        files["image.png"] = _png(np.rint(255 * image).astype(np.uint8))
    arrays = {"labels": view.labels, "depth": view.depths().astype(np.float32), "image": image.astype(np.float32)}
    if "npy" in formats:
        files |= {f"{name}.npy": _npy(array) for name, array in arrays.items()}
    if "tif" in formats:
        arrays["image"] = np.rint(65535 * image).astype(np.uint16)
        files |= {f"{name}.tif": _tiff(array) for name, array in arrays.items()}
    rows = planform_table(view, packing)
    files["truth.csv"] = table_content(rows, ".csv")
    if (~rows["is_cut"] & (rows["n_pixels"] >= least_pixels)).any():
        files["bias.csv"] = table_content(planform_bias(rows, packing, least_pixels=least_pixels), ".csv")
    asked = {**{name: np.asarray(value).tolist() for name, value in options.items()}, "rng": rng}
    files["planform.json"] = _described(view, asked)
    return write_all(folder, files, overwrite=overwrite, make_folder=True)


def _described(view: Planform, asked: dict[str, Any]) -> bytes:
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
        "labels": "grain id + 1, 0 where no grain is seen",
        "unit": "m",
    }
    return (json.dumps(facts, indent=2) + "\n").encode()


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
    tifffile.imwrite(content, array, photometric="minisblack", metadata=None, software=False)
    return content.getvalue()


def _png(grey: NDArray[np.uint8]) -> bytes:
    """Return an 8-bit grey image as PNG (ISO/IEC 15948)."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    height, width = grey.shape
    rows = np.zeros((height, width + 1), dtype=np.uint8)  # a leading zero a row: no filter
    rows[:, 1:] = grey
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = zlib.compress(rows.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")
