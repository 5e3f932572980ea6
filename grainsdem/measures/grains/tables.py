"""Every grain's measures as one table, and a bed's in one dictionary."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError, InputError, ShapeError
from grainsdem.geometry.integrals import integrate
from grainsdem.measures.grains.shapes import wadell
from grainsdem.measures.grains.sizes import percentiles
from grainsdem.measures.porosity import core_box, porosity

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.model import ContactGraph, Packing

COLUMNS = np.dtype(
    [
        ("id", np.int32),
        ("x", np.float64),
        ("y", np.float64),
        ("z", np.float64),
        ("volume", np.float64),
        ("area", np.float64),
        ("diameter", np.float64),
        ("sphericity", np.float64),
        ("n_faces", np.int32),
        ("n_vertices", np.int32),
        ("mass", np.float64),
    ]
)
"""Columns of `table`: centroid x, y, z [m], volume [m³], area [m²], equal-volume diameter [m], mass [kg]."""


def table(packing: Packing) -> NDArray[np.void]:
    """Return one row a grain, in the order of the grains.

    Parameters
    ----------
    packing : Packing
        Any packing.

    Returns
    -------
    structured ndarray, shape (n,)
        Columns as in `COLUMNS`, SI units.
    """
    measured = integrate(packing.grains)
    rows = np.zeros(len(packing), dtype=COLUMNS)
    rows["id"] = np.arange(len(packing))
    for k, axis in enumerate("xyz"):
        rows[axis] = packing.positions[:, k]
    rows["volume"] = measured.volumes
    rows["area"] = measured.areas
    rows["diameter"] = np.cbrt(6 * measured.volumes / np.pi)
    rows["sphericity"] = wadell(measured.volumes, measured.areas)
    rows["n_faces"] = np.diff(packing.grains.face_offsets)
    rows["n_vertices"] = np.diff(packing.grains.vertex_offsets)
    rows["mass"] = packing.densities * measured.volumes
    return rows


def summary(packing: Packing, graph: ContactGraph | None = None) -> dict[str, Any]:
    """Return what one says about a bed in one line, as JSON values in SI units.

    Parameters
    ----------
    packing : Packing
        A bed of at least one grain.
    graph : ContactGraph
        Its contacts, for the mean coordination number; None without them.

    Returns
    -------
    dict
        ``n_grains``; ``porosity`` and the ``porosity_region`` it is of: ``"cells"`` while the grains are in
        the cells they grew in, else ``"core"`` with its corners as ``porosity_box`` [m] (see `core_box`),
        and None for all three where the bed is too small for one; ``d10``, ``d50``, ``d90`` by mass and
        ``mean_diameter`` by number, equal-volume [m]; ``mean_sphericity``; ``mean_neighbors``,
        grains across the faces of a grain, or None where the links are gone; ``mean_coordination``, contacts a
        grain; ``total_mass`` [kg]; ``solid_volume`` [m³].

    Raises
    ------
    InputError
        If there is no grain.
    ShapeError
        If the graph is of another number of grains.
    """
    if len(packing) == 0:
        raise InputError("a summary needs at least one grain; the packing has none")
    if graph is not None and graph.n_grains != len(packing):
        raise ShapeError(f"the contacts must be those of the packing's {len(packing)} grains; got {graph.n_grains}")
    rows = table(packing)
    links = packing.links
    d10, d50, d90 = percentiles(rows["diameter"], (10, 50, 90), weights=rows["mass"]).tolist()
    return {
        "n_grains": len(packing),
        **_void(packing),
        "d10": d10,
        "d50": d50,
        "d90": d90,
        "mean_diameter": float(rows["diameter"].mean()),
        "mean_sphericity": float(rows["sphericity"].mean()),
        "mean_neighbors": None if links is None else float(np.count_nonzero(links.neighbors >= 0) / len(packing)),
        "mean_coordination": None if graph is None else float(graph.coordination().mean()),
        "total_mass": float(rows["mass"].sum()),
        "solid_volume": float(rows["volume"].sum()),
    }


def write_csv(rows: NDArray[np.void], path: str | os.PathLike[str]) -> Path:
    """Write a table, or any structured array, as CSV: a header of column names, then one line a row.

    Parameters
    ----------
    rows : structured ndarray, shape (n,)
        What `table` returns.
    path : str or path-like
        Ends in ``.csv``.

    Returns
    -------
    pathlib.Path
        The file. Numbers keep every digit.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    WriteError
        If it cannot be written.
    """
    from pathlib import Path  # noqa: PLC0415  (a type elsewhere in this module)

    target = Path(path)
    if target.suffix.lower() != ".csv":
        raise FileFormatError(f"{target}: a table is written as .csv; got {target.suffix or 'no suffix'!r}")
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows.dtype.names or ())
    writer.writerows(rows.tolist())
    with replacing(target) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8", newline="")
    return target


def _void(packing: Packing) -> dict[str, Any]:
    if packing.links is not None:
        return {"porosity": porosity(packing), "porosity_region": "cells", "porosity_box": None}
    try:
        lower, upper = core_box(packing)
    except InputError:
        return {"porosity": None, "porosity_region": None, "porosity_box": None}
    box = [lower.tolist(), upper.tolist()]
    return {
        "porosity": porosity(packing, region=(lower, upper)),
        "porosity_region": "core",
        "porosity_box": box,
    }
