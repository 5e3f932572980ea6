"""Voxels as files, written layer by layer: NumPy arrays, TIFF stacks, NRRD, bare bytes, and image data for ParaView.

References
----------
.. [1] Teem, "Definition of NRRD file format": attached (.nrrd) and detached (.nhdr) headers, version 4.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError, InputError, MissingPackageError
from grainsdem.gate import gated
from grainsdem.geometry.raster.lattice import OUTSIDE, VOID, label_blocks
from grainsdem.measures.voxels.labels import fit_lattice, spans
from grainsdem.measures.voxels.surfaces import CrossingTally, has_surface
from grainsdem.memory import allow_disk, allow_memory

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator
    from typing import Any

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.geometry.raster.lattice import Lattice
    from grainsdem.model import Packing

SUFFIXES = (".npy", ".nrrd", ".raw", ".tif", ".tiff", ".vti")
"""What `write_voxels` writes."""


class VoxelFile(NamedTuple):
    """Voxels that were written.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    counts : tuple of int
        Numbers of voxels along x, y and z.
    spacing : tuple of float
        Edges [m] of a voxel along x, y and z.
    porosity : float
        Share of void among the voxels of the domain; NaN where none is in it.
    specific_surface : float
        Surface [m⁻¹] that the voxels have, by crossings, as `specific_surface` finds it; NaN where it was not asked
        for, or there are fewer than three voxels along an axis.
    """

    path: Path
    counts: tuple[int, int, int]
    spacing: tuple[float, float, float]
    porosity: float
    specific_surface: float = float("nan")


@gated
def write_voxels(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    size: float | None = None,
    per_diameter: float | None = None,
    region: tuple[ArrayLike, ArrayLike] | None = None,
    phase: bool = False,
    surface: bool = False,
    progress: Callable[[float], None] | None = None,
) -> VoxelFile:
    """Write which grain each voxel of a box lies in, without ever holding more than a few layers.

    Parameters
    ----------
    packing : Packing
        Convex grains.
    path : str or path-like
        ``.npy``: an array of shape (nz, ny, nx). ``.tif``: a page a layer, from below, row 0 at the smallest y.
        ``.vti``: image data for ParaView, a cell a voxel. ``.nrrd``: a header of numbers and edges, and the voxels.
        ``.raw``: the voxels alone, x fastest, then y and z, little-endian, as lattice-Boltzmann codes read them, and
        such a header beside them, ``.nhdr``.
    size, per_diameter, region
        As for `voxelize`.
    phase : bool
        Whether I(x) is written, 1 in grains and 0 elsewhere, as uint8; else labels, as int32: grain id + 1, 0 in the
        void, -1 outside the domain.
    surface : bool
        Whether the surface that the voxels have is found too, which takes two thirds longer.
    progress : callable, optional
        Told the share that is written.

    Returns
    -------
    VoxelFile
        Path, numbers, edges, and the porosity and the surface that the voxels have.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    InputError
        As `voxelize` does.
    MissingPackageError
        Where a TIFF is asked for and tifffile is not installed.
    WriteError
        If the file cannot be written; nothing is left behind.
    """
    target = check_suffix(path)
    lattice = fit_lattice(packing, size=size, per_diameter=per_diameter, region=region)
    dtype = np.dtype(np.uint8 if phase else np.int32)
    _allow(target, lattice, dtype)
    tally = np.zeros(2, dtype=np.int64)
    is_layer = lattice.shape[0] == 1
    is_counted = surface and has_surface(lattice.shape)
    crossings = CrossingTally(lattice.spacing, spans(packing, lattice), is_layer=is_layer) if is_counted else None

    def blocks() -> Iterator[NDArray[np.generic]]:
        written = 0
        for labels in label_blocks(packing, lattice):
            solid = labels > VOID
            tally[:] += np.count_nonzero(solid), np.count_nonzero(labels != OUTSIDE)
            if crossings is not None:
                crossings.add(labels)
            yield solid.astype(np.uint8) if phase else labels
            written += len(labels)
            if progress is not None:
                progress(written / lattice.shape[0])

    writers = {".npy": _write_npy, ".vti": _write_vti, ".nrrd": _write_nrrd, ".raw": _write_raw}
    with ExitStack() as besides:
        if target.suffix.lower() == ".raw":  # which says nothing without its header
            header = besides.enter_context(replacing(target.with_suffix(".nhdr")))
            header.write_bytes(_nrrd_header(lattice, dtype, target.name))
        with replacing(target) as temporary:
            writers.get(target.suffix.lower(), _write_tiff)(temporary, lattice, dtype, blocks())
    solid, inside = tally.tolist()
    sx, sy, sz = lattice.spacing.tolist()
    share = 1 - solid / inside if inside else float("nan")
    seen = crossings.specific_surface() if crossings is not None and inside else float("nan")
    return VoxelFile(target, lattice.counts, (sx, sy, sz), share, seen)


def _allow(target: Path, lattice: Lattice, dtype: np.dtype[Any]) -> None:
    """Raise an error of ours where the voxels have no room on the disk, or a layer of them none in memory."""
    _, ny, nx = lattice.shape
    allow_memory(float(nx) * ny, 64, "voxels of a layer")
    if target.parent.is_dir():
        n = float(nx) * ny * lattice.shape[0]
        allow_disk(target.parent, n * dtype.itemsize, f"{n:.4g} voxels")


def check_suffix(path: str | os.PathLike[str]) -> Path:
    """Return the path, or raise unless it ends in one of `SUFFIXES` that can be written here."""
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileFormatError(f"{target}: voxels are written as {', '.join(SUFFIXES)}; got {suffix or 'no suffix'!r}")
    if suffix.startswith(".tif"):
        try:
            import tifffile  # noqa: F401, PLC0415  (optional)
        except ImportError as error:
            raise MissingPackageError('TIFF stacks need tifffile: pip install "grainsdem[images]"') from error
    return target


def _write_npy(
    path: Path, lattice: Lattice, dtype: np.dtype[np.generic], blocks: Iterator[NDArray[np.generic]]
) -> None:
    header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": lattice.shape}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        for block in blocks:
            file.write(block.data)


def _write_tiff(
    path: Path, lattice: Lattice, dtype: np.dtype[np.generic], blocks: Iterator[NDArray[np.generic]]
) -> None:
    import tifffile  # noqa: PLC0415  (optional)

    if max(lattice.counts[:2]) > 65535:  # what many readers allow
        raise InputError(f"a page of a TIFF stack is at most 65535 wide and high; got {lattice.counts[:2]}")
    size = np.prod(lattice.shape, dtype=float) * dtype.itemsize
    tifffile.imwrite(
        path,
        (page for block in blocks for page in block),
        shape=lattice.shape,
        dtype=dtype,
        bigtiff=bool(size > 3.9e9),  # a plain TIFF counts its bytes in 32 bits
        photometric="minisblack",
        metadata={"axes": "ZYX", "spacing": lattice.spacing.tolist(), "lower": lattice.lower.tolist(), "unit": "m"},
        software=False,
    )


def _write_vti(
    path: Path, lattice: Lattice, dtype: np.dtype[np.generic], blocks: Iterator[NDArray[np.generic]]
) -> None:
    nx, ny, nz = lattice.counts
    extent = f"0 {nx} 0 {ny} 0 {nz}"
    origin, spacing = (" ".join(map(repr, row.tolist())) for row in (lattice.lower, lattice.spacing))
    name, kind = ("phase", "UInt8") if dtype == np.uint8 else ("label", "Int32")
    head = f"""<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">
<Piece Extent="{extent}">
<CellData Scalars="{name}">
<DataArray type="{kind}" Name="{name}" format="appended" offset="0"/>
</CellData>
</Piece>
</ImageData>
<AppendedData encoding="raw">
_"""
    with path.open("wb") as file:
        file.write(head.encode("ascii"))
        file.write(np.uint64(nx * ny * nz * dtype.itemsize).tobytes())
        for block in blocks:
            file.write(block.astype(dtype.newbyteorder("<"), copy=False).data)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def _write_raw(
    path: Path, lattice: Lattice, dtype: np.dtype[np.generic], blocks: Iterator[NDArray[np.generic]]
) -> None:
    del lattice  # its header stands in a file of its own
    with path.open("wb") as file:
        for block in blocks:
            file.write(block.astype(dtype.newbyteorder("<"), copy=False).data)


def _write_nrrd(
    path: Path, lattice: Lattice, dtype: np.dtype[np.generic], blocks: Iterator[NDArray[np.generic]]
) -> None:
    with path.open("wb") as file:
        file.write(_nrrd_header(lattice, dtype, None))
        for block in blocks:
            file.write(block.astype(dtype.newbyteorder("<"), copy=False).data)


def _nrrd_header(lattice: Lattice, dtype: np.dtype[np.generic], data: str | None) -> bytes:
    """Return the header of NRRD, with the name of the file that has the data where that is another."""
    sx, sy, sz = lattice.spacing.tolist()
    origin = ",".join(map(repr, (lattice.lower + 0.5 * lattice.spacing).tolist()))
    meaning = "1 in grains, 0 elsewhere" if dtype == np.uint8 else "grain id + 1, 0 in the void, -1 outside the domain"
    lines = [
        "NRRD0004",
        "# x fastest, then y, then z; the origin is the centre of the first voxel",
        f"content: {meaning}",
        f"type: {dtype.name}",
        "dimension: 3",
        "space dimension: 3",
        f"sizes: {' '.join(map(str, lattice.counts))}",
        f"space directions: ({sx!r},0,0) (0,{sy!r},0) (0,0,{sz!r})",
        f"space origin: ({origin})",
        'space units: "m" "m" "m"',
        "kinds: domain domain domain",
        "endian: little",
        "encoding: raw",
        *([] if data is None else [f"data file: {data}"]),
    ]
    return ("\n".join(lines) + ("\n\n" if data is None else "\n")).encode("utf-8")
