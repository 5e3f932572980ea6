"""Every grain's measures as one table, its neighbours as another, and a bed's in one dictionary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.geometry.forms.boxes import rectangles
from grainsdem.geometry.forms.sizes import grain_diameters, grain_sphericities
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.geometry.rotations import to_matrices, world_vertices
from grainsdem.measures.grains.directions import principal_axes, trend_and_plunge
from grainsdem.measures.grains.shapes import box_axes, ellipsoid_axes, krumbein, roundness, zingg
from grainsdem.measures.grains.sizes import percentiles, sieve_diameters
from grainsdem.measures.porosity import core_box, porosity
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import CellLinks, ContactGraph, Packing

    Columns = dict[str, NDArray[Any]]

UNITS = {
    **dict.fromkeys(("x", "y", "z", "diameter", "a", "b", "c", "box_a", "box_b", "box_c", "sieve_diameter"), "m"),
    **dict.fromkeys(("mean_distance", "min_distance", "distance"), "m"),
    **dict.fromkeys(("a_trend", "a_plunge", "c_trend", "c_plunge"), "rad"),
    "area": "m2",
    "volume": "m3",
    "mass": "kg",
}
"""Unit of each column of `table` and `neighbor_table` that has one."""


@gated
def table(packing: Packing, *, sieves: bool = True) -> NDArray[np.void]:
    """Return one row a grain, in the order of the grains.

    Parameters
    ----------
    packing : Packing
        Any packing.
    sieves : bool
        With the column ``sieve_diameter``: searching a grain's smallest hole takes ten times as long as all else.

    Returns
    -------
    structured ndarray, shape (n,)
        ``id``; centroid ``x``, ``y``, ``z`` [m]; ``volume`` [m³]; ``area`` [m²]; ``diameter`` [m] of the sphere of
        equal volume; Wadell's ``sphericity`` and ``roundness``; ``n_faces``; ``n_vertices``; ``mass`` [kg]; axes ``a``,
        ``b``, ``c`` [m] of the ellipsoid of equal inertia (`ellipsoid_axes`), ``a_trend``, ``a_plunge``, ``c_trend``,
        ``c_plunge``
        [rad], where its long and its short axis point (`trend_and_plunge`); ``box_a``, ``box_b``, ``box_c`` [m] of the
        smallest box on a face (`box_axes`); from that box Krumbein's sphericity ``krumbein``, ``elongation`` b/a,
        ``flatness`` c/b and the class ``zingg``; and ``sieve_diameter`` [m], the smallest square hole
        (`sieve_diameters`).

        While a packing knows its cells also ``n_neighbors``, the grains across its faces, and ``mean_distance`` and
        ``min_distance`` [m] from centroid to centroid of those, NaN without any; and ``class`` where grains have
        classes. Else these columns are missing.

        In a planar bed ``diameter`` is that of the circle of equal area, ``sphericity`` that circle's perimeter over
        the grain's own, the axes a and b are those in the plane, what needs a third is missing, and ``sieve_diameter``
        is the grain's least width: that of the narrowest slit.

    Raises
    ------
    InputError
        If a grain's volume is not above zero: it is empty, or wound inside out.
    """
    measured = integrate(packing.grains)
    columns: Columns = {"id": np.arange(len(packing), dtype=np.int32)}
    columns |= {axis: packing.positions[:, k] for k, axis in enumerate("xyz")}
    columns["volume"] = measured.volumes
    columns["area"] = measured.areas
    columns["diameter"] = grain_diameters(packing, measured)
    columns["sphericity"] = grain_sphericities(packing, measured)
    columns["roundness"] = roundness(packing)
    columns["n_faces"] = np.diff(packing.grains.face_offsets).astype(np.int32)
    columns["n_vertices"] = np.diff(packing.grains.vertex_offsets).astype(np.int32)
    columns["mass"] = packing.densities * measured.volumes
    columns |= _axes(packing, measured, sieves=sieves)
    if packing.classes is not None:
        columns["class"] = packing.classes
    if packing.links is not None:
        columns |= _neighborhood(packing, packing.links)
    return _joined(columns)


@gated
def neighbor_table(packing: Packing) -> NDArray[np.void]:
    """Return one row for each grain across a face of each grain: who grew beside whom, and how far they are.

    Parameters
    ----------
    packing : Packing
        Grains that know their cells.

    Returns
    -------
    structured ndarray, shape (m,)
        ``i`` and its neighbour ``j``; ``distance`` [m] from centroid to centroid; ``area`` [m²] of the face of i;
        ``shift_x``, ``shift_y``, ``shift_z``, the periodic image of j that is meant, in whole domain lengths. Rows are
        in the order of the grains and of their faces; each pair stands there twice, once from either side.

    Raises
    ------
    InputError
        If the packing has lost its cells, as one does that was shuffled or settled.
    """
    if packing.links is None:
        raise InputError("the packing has lost the cells that it grew in, and with them its neighbours; see contacts")
    faces, i, j, distances = _across(packing, packing.links)
    columns: Columns = {"i": i, "j": j, "distance": distances}
    columns["area"] = face_planes(packing.grains).areas[faces]
    columns |= {f"shift_{axis}": packing.links.shifts[faces, k] for k, axis in enumerate("xyz")}
    return _joined(columns)


@gated
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
        grain; ``total_mass`` [kg]; ``solid_volume`` [m³]. In a planar bed diameters are those of circles of equal
        area and the sphericity is that of the outlines, as in `table`.

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
    measured = integrate(packing.grains)
    diameters, masses = grain_diameters(packing, measured), packing.densities * measured.volumes
    links = packing.links
    d10, d50, d90 = percentiles(diameters, (10, 50, 90), weights=masses).tolist()
    return {
        "n_grains": len(packing),
        **_void(packing),
        "d10": d10,
        "d50": d50,
        "d90": d90,
        "mean_diameter": float(diameters.mean()),
        "mean_sphericity": float(grain_sphericities(packing, measured).mean()),
        "mean_neighbors": None if links is None else float(np.count_nonzero(links.neighbors >= 0) / len(packing)),
        "mean_coordination": None if graph is None else float(graph.coordination().mean()),
        "total_mass": float(masses.sum()),
        "solid_volume": float(measured.volumes.sum()),
    }


def _axes(packing: Packing, measured: Integrals, *, sieves: bool) -> Columns:
    """Return the columns of axes and what follows from their proportions."""
    if packing.domain.is_planar:
        columns = _axes_in_plane(packing, measured)
        return columns if sieves else {name: column for name, column in columns.items() if name != "sieve_diameter"}
    columns = dict(zip("abc", ellipsoid_axes(packing.grains, measured=measured).T, strict=True))
    axes = principal_axes(packing, measured=measured)
    for name, row in (("a", 0), ("c", 2)):
        columns[f"{name}_trend"], columns[f"{name}_plunge"] = trend_and_plunge(axes[:, row])
    box = box_axes(packing.grains)
    a, b, c = box.T
    columns |= {"box_a": a, "box_b": b, "box_c": c}
    if sieves:
        columns["sieve_diameter"] = sieve_diameters(packing)
    columns["krumbein"] = krumbein(box)
    return columns | {"elongation": b / a, "flatness": c / b, "zingg": zingg(box)}


def _axes_in_plane(packing: Packing, measured: Integrals) -> Columns:
    """Return the axes of the ellipse of equal inertia and of the smallest rectangle, in a planar bed."""
    turns = to_matrices(packing.quaternions)
    inertias = turns @ measured.inertias @ turns.swapaxes(1, 2)
    # ∫ p_i p_j dV from the inertia tensor, for the two axes of the plane.
    half = 0.5 * np.trace(inertias, axis1=1, axis2=2)
    seconds = half[:, None, None] * np.eye(2) - inertias[:, :2, :2]
    squares, vectors = np.linalg.eigh(seconds)
    squares = squares[:, ::-1]
    trend, _ = trend_and_plunge(np.column_stack([vectors[:, :, 1], np.zeros(len(packing))]))
    a, b = 4 * np.sqrt(np.maximum(squares, 0.0) / measured.volumes[:, None]).T
    box_a, box_b, least = rectangles(world_vertices(packing)[:, :2], packing.grains.vertex_offsets).T
    return {
        "a": a,
        "b": b,
        "a_trend": trend,
        "box_a": box_a,
        "box_b": box_b,
        "sieve_diameter": least,
        "elongation": box_b / box_a,
    }


def _across(
    packing: Packing, links: CellLinks
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
    """Return the faces that another grain lies behind, whose they are, which grain it is, and its distance [m]."""
    faces = np.flatnonzero(links.neighbors >= 0)
    i, j = owners(packing.grains.face_offsets)[faces].astype(np.int32), links.neighbors[faces]
    apart = packing.positions[j] - packing.positions[i] + links.shifts[faces] * packing.domain.lengths
    return faces, i, j, np.asarray(np.sqrt(np.einsum("mk,mk->m", apart, apart)))


def _neighborhood(packing: Packing, links: CellLinks) -> Columns:
    """Return how many neighbours each grain has, and how far they are."""
    _, i, _, distances = _across(packing, links)
    counts = np.bincount(i, minlength=len(packing))
    has_any = counts > 0
    mean, least = np.full((2, len(packing)), np.nan)
    if distances.size:
        starts = np.searchsorted(i, np.flatnonzero(has_any))
        least[has_any] = np.minimum.reduceat(distances, starts)
        mean[has_any] = np.add.reduceat(distances, starts) / counts[has_any]
    return {"n_neighbors": counts.astype(np.int32), "mean_distance": mean, "min_distance": least}


def _joined(columns: Columns) -> NDArray[np.void]:
    """Return columns of equal length as one structured array."""
    n = len(next(iter(columns.values())))
    rows = np.empty(n, dtype=[(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    return rows


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
