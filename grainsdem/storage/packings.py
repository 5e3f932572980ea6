"""Packings in HDF5: written whole or not at all, and the same packing gives the same bytes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from grainsdem.atomic import replacing
from grainsdem.errors import shown
from grainsdem.gate import gated
from grainsdem.model import CellLinks, Domain, Packing, Polyhedra
from grainsdem.storage.hdf5 import check_suffix, describe, read_datasets, reading, to_text
from grainsdem.storage.seals import seal
from grainsdem.storage.sink import created

if TYPE_CHECKING:
    import os
    from pathlib import Path

    import h5py
    from numpy.typing import NDArray

SCHEMA = "grainsdem.packing"

_DOMAIN = ("lower", "upper", "periodic", "planes")
_GRAINS = ("vertices", "vertex_offsets", "face_offsets", "face_vertices", "face_vertex_offsets")
_POSES = ("positions", "quaternions", "densities")
_LINKS = ("neighbors", "shifts", "cell_volumes", "sites", "heights", "rooms")


@gated
def save(packing: Packing, path: str | os.PathLike[str]) -> Path:
    """Write a packing to HDF5.

    Parameters
    ----------
    packing : Packing
        Any packing.
    path : str or path-like
        Ends in ``.h5`` or ``.hdf5``; replaced if it exists.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    WriteError
        If it cannot be written; nothing is left behind.

    Notes
    -----
    Arrays keep the names they have in the nouns: ``grains/vertices``, ``positions``, ``links/neighbors``, …,
    in SI units. The file holds no clock and no path: the same packing gives the same bytes.
    """
    target = check_suffix(path)
    with replacing(target) as temporary:
        with created(temporary) as file:
            describe(file, SCHEMA)
            file.attrs["units"] = "SI: m, kg, s, rad; quaternions (w, x, y, z)"
            write_packing(file, packing)
        seal(temporary)
    return target


@gated
def load(path: str | os.PathLike[str]) -> Packing:
    """Read a packing that `save` wrote.

    Parameters
    ----------
    path : str or path-like
        Ends in ``.h5`` or ``.hdf5``.

    Returns
    -------
    Packing
        Equal to what was saved, bit for bit.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is unknown, the file is truncated or damaged, is not a packing of grainsdem, is of an
        unknown major version, or lacks a dataset.
    """
    with reading(path, SCHEMA) as file:
        return read_packing(file)


def write_packing(group: h5py.Group, packing: Packing) -> None:
    """Write a packing into a file, or a group of one."""
    group.attrs["provenance"] = json.dumps(packing.provenance, ensure_ascii=False)
    for name, array in packed_arrays(packing).items():
        _write(group, name, array)
    group["domain"].attrs["is_planar"] = packing.domain.is_planar


def packed_arrays(packing: Packing) -> dict[str, NDArray[Any]]:
    """Return what is stored of a packing, by its name in the file."""
    grains, domain, links = packing.grains, packing.domain, packing.links
    result = {
        "domain/lower": domain.lower,
        "domain/upper": domain.upper,
        "domain/periodic": domain.periodic,
        "domain/planes": domain.planes,
        "grains/vertices": grains.vertices,
        "grains/vertex_offsets": grains.vertex_offsets,
        "grains/face_offsets": grains.face_offsets,
        "grains/face_vertices": grains.face_vertices,
        "grains/face_vertex_offsets": grains.face_vertex_offsets,
        "positions": packing.positions,
        "quaternions": packing.quaternions,
        "densities": packing.densities,
    }
    if packing.frictions is not None:
        result["frictions"] = packing.frictions
    if packing.classes is not None:
        result["classes"] = packing.classes
    if links is not None:
        known = {name: getattr(links, name) for name in _LINKS}
        result |= {f"links/{name}": array for name, array in known.items() if array is not None}
    return result


def read_packing(file: h5py.Group) -> Packing:
    """Read what `write_packing` wrote."""
    # Seeds and heights of the cells came later: a file of before has the first three alone.
    held = () if "links" not in file else _LINKS if "sites" in file["links"] else _LINKS[:3]
    # Most packings have no friction and no classes of their own, and files of before never have.
    more = [name for name in ("frictions", "classes") if name in file]
    names = [*(f"domain/{name}" for name in _DOMAIN), *(f"grains/{name}" for name in _GRAINS), *_POSES]
    arrays = read_datasets(file, [*names, *(f"links/{name}" for name in held), *more])
    lower, upper, periodic, planes = (arrays[f"domain/{name}"] for name in _DOMAIN)
    return Packing(
        Polyhedra(*(arrays[f"grains/{name}"] for name in _GRAINS)),
        arrays["positions"],
        arrays["quaternions"],
        arrays["densities"],
        Domain(lower, upper, periodic, is_planar=bool(file["domain"].attrs["is_planar"]), planes=planes),
        CellLinks(*(arrays[f"links/{name}"] for name in held)) if held else None,
        _steps(to_text(file.attrs["provenance"])),
        arrays.get("frictions"),
        arrays.get("classes"),
    )


def _steps(text: str) -> tuple[str, ...]:
    """Return the steps of a provenance, or raise `ValueError` where they are not what every reader takes them for."""
    try:
        steps = json.loads(text)
        told = [json.loads(step) for step in steps] if isinstance(steps, list) else [None]
    except (ValueError, TypeError, RecursionError):
        told = [None]
    if not all(isinstance(step, dict) and isinstance(step.get("step"), str) for step in told):
        raise ValueError(f"provenance must be a list of JSON texts, each an object with its step; got {shown(text)}")
    return tuple(steps)


def _write(file: h5py.Group, name: str, array: NDArray[Any]) -> None:
    """Write one array: byte-shuffled, gently compressed, each chunk with a checksum; small ones plain."""
    if array.nbytes < 1024:
        file.create_dataset(name, data=array, track_times=False)
        return
    # A chunk of about 256 kB: a part can be read without the whole.
    rows = max(1, min(len(array), 262_144 * len(array) // array.nbytes))
    chunks = (rows, *array.shape[1:])
    file.create_dataset(
        name,
        data=array,
        chunks=chunks,
        compression="gzip",
        compression_opts=1,
        shuffle=True,
        fletcher32=True,
        track_times=False,
    )
