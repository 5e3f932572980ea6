"""The checks of a packing, one after another, gathered in a report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.ahead import compiled
from grainsdem.geometry.bounds import boxes
from grainsdem.geometry.defects import find_defects
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.model import Check, Packing, Polyhedra, Report
from grainsdem.validation.overlaps import check_overlaps, take

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]

SHAPE = 1e-9
"""Default tolerance of convexity, relative to d: far above rounding, far below what any solver resolves."""

MOST_VERTICES = 64
"""PhysX builds convex hulls of at most 64 vertices on the GPU."""


@gated
def validate(
    packing: Packing,
    *,
    overlap: float = 1e-9,
    depth: float | None = None,
    shape: float = SHAPE,
    method: Literal["planes", "manifold3d"] = "planes",
    progress: Callable[[int, int], None] | None = None,
) -> Report:
    """Return what is right and wrong with a packing.

    Parameters
    ----------
    packing : Packing
        Any packing. Lengths are compared relative to d, its mean equal-volume diameter.
    overlap : float
        Largest volume that two grains may share, as a fraction of the smaller one's. The soft contacts of a settled
        packing need more than the default, such as 1e-3.
    depth : float, optional
        Deepest overlap allowed, relative to d. By default ``overlap`` where that was raised above 1e-9, else 1e-10.
    shape : float
        How far, relative to d, corners may lie from where they would make a grain convex.
    method : {"planes", "manifold3d"}
        ``"planes"`` proves most pairs apart by a separating plane with an error bound, and sends only the rest
        through manifold3d; ``"manifold3d"`` sends every pair whose boxes meet.
    progress : callable, optional
        Called with the number of pairs that manifold3d has done and that it will do.

    Returns
    -------
    Report
        Checks named ``finite``, ``unit quaternions``, ``closed``, ``outward``, ``convex``, ``positive volume``,
        ``inside the domain``, ``distinct``, ``overlaps`` and ``overlap depth``; then for information
        ``smallest gap``, ``shortest edge``, ``smallest face`` and ``vertices a grain``, which never fail.

    Raises
    ------
    InputError
        If a tolerance is negative or not a number, or the method is unknown.

    Notes
    -----
    Grains that are not finite, closed, outward and of positive volume are left out of the search for overlaps, and
    the note of that check says so.
    """
    if method not in ("planes", "manifold3d"):
        raise InputError(f"method must be 'planes' or 'manifold3d'; got {method!r}")
    depth = (1e-10 if overlap <= 1e-9 else overlap) if depth is None else depth
    for name, value in (("overlap", overlap), ("depth", depth), ("shape", shape)):
        if not value >= 0:
            raise InputError(f"{name} must be zero or more; got {value}")
    compiled("proof")
    is_finite, checks = _check_numbers(packing)
    sizes = np.full(len(packing), np.nan)
    sound = is_finite.copy()
    rows = np.flatnonzero(is_finite)
    shapes = take(packing, rows).grains
    found = volumes(shapes)
    sizes[rows] = np.cbrt(6 / np.pi * np.abs(found))
    d = float(sizes[rows].mean()) if rows.size and sizes[rows].any() else 1.0
    shape_checks, is_sound, details = _check_shapes(shapes, rows, found, d, shape)
    sound[rows] = is_sound
    checks += [*shape_checks, _check_inside(packing, is_finite, d, max(1e-9, depth))]
    checks += check_overlaps(packing, sound, d, overlap=overlap, depth=depth, method=method, progress=progress)
    return Report((*checks, *details))


def _check_numbers(packing: Packing) -> tuple[Mask, list[Check]]:
    """Check that every number is finite and every rotation one."""
    n = len(packing)
    grains = packing.grains
    is_finite = np.isfinite(packing.positions).all(axis=1) & np.isfinite(packing.quaternions).all(axis=1)
    is_finite &= np.isfinite(packing.densities)
    bad = np.flatnonzero(~np.isfinite(grains.vertices).all(axis=1))
    is_finite[np.searchsorted(grains.vertex_offsets, bad, side="right") - 1] = False
    norms = np.linalg.norm(packing.quaternions, axis=1)
    errors = np.where(np.isfinite(norms), np.abs(norms - 1), 0.0)
    # 1e-9: a rotation this far from unity changes a grain by less than any tolerance here.
    is_unit = errors <= 1e-9
    return is_finite & is_unit, [
        Check("finite", bool(is_finite.all()), float(n - is_finite.sum()), 0.0, "grains", _ids(~is_finite)),
        Check("unit quaternions", bool(is_unit.all()), float(errors.max(initial=0.0)), 1e-9, "", _ids(~is_unit)),
    ]


def _check_shapes(
    shapes: Polyhedra, rows: NDArray[np.int64], found: Floats, d: float, shape: float
) -> tuple[list[Check], Mask, list[Check]]:
    """Check the grains' shapes; return also which can be searched for overlaps, and the details for information."""
    defects = find_defects(shapes)
    is_open = defects.open_edges > 0
    is_inward = defects.inward_faces > 0
    is_dented = defects.dents > shape * d
    is_hollow = ~(found > 0)
    counts = np.diff(shapes.vertex_offsets)
    checks = [
        Check("closed", not is_open.any(), float(defects.open_edges.max(initial=0)), 0.0, "open edges in a grain",
              _ids(is_open, rows)),
        Check("outward", not is_inward.any(), float(defects.inward_faces.max(initial=0)), 0.0,
              "inward faces in a grain", _ids(is_inward, rows)),
        Check("convex", not is_dented.any(), float(defects.dents.max(initial=0.0)) / d, shape, "d",
              _ids(is_dented, rows)),
        Check("positive volume", not is_hollow.any(), float(found.min(initial=d**3)) / d**3, 0.0, "d³",
              _ids(is_hollow, rows), "the smallest volume; must be above"),
    ]  # fmt: skip
    above = counts > MOST_VERTICES
    edges, faces = defects.shortest_edges, defects.smallest_faces
    edge = edges[np.isfinite(edges)].min(initial=d)
    face = faces[np.isfinite(faces)].min(initial=d * d)
    details = [
        Check("shortest edge", True, float(edge) / d, 0.0, "d", (), "for information"),
        Check("smallest face", True, float(face) / d**2, 0.0, "d²", (), "for information"),
        Check("vertices a grain", True, float(counts.max(initial=0)), float(MOST_VERTICES), "", _ids(above, rows),
              f"for information: {int(above.sum())} grains are above what PhysX takes on the GPU"),
    ]  # fmt: skip
    return checks, ~(is_open | is_inward | is_hollow), details


def _check_inside(packing: Packing, is_finite: Mask, d: float, tolerance: float) -> Check:
    """Check that no grain reaches through a wall or a plane of the domain; periodic axes have none."""
    domain = packing.domain
    worst = np.zeros(len(packing))
    rows = np.flatnonzero(is_finite)
    finite = take(packing, rows)
    lower, upper = boxes(finite)
    out = np.maximum(domain.lower - lower, upper - domain.upper)
    worst[rows] = np.where(domain.periodic, 0.0, out).max(axis=1, initial=0.0)
    if len(domain.planes):
        # About the centroids, so that a domain far from the origin loses no digits.
        arms = np.repeat(finite.positions, np.diff(finite.grains.vertex_offsets), axis=0) - world_vertices(finite)
        for plane in domain.planes:
            reach = np.maximum.reduceat(-arms @ plane[:3], finite.grains.vertex_offsets[:-1]) if rows.size else 0.0
            worst[rows] = np.maximum(worst[rows], reach + finite.positions @ plane[:3] - plane[3])
    is_out = worst > tolerance * d
    note = "how far the worst grain reaches through a wall"
    return Check(
        "inside the domain", not is_out.any(), float(worst.max(initial=0.0)) / d, tolerance, "d", _ids(is_out), note
    )


def _ids(mask: Mask, rows: NDArray[np.int64] | None = None) -> tuple[int, ...]:
    """Return the ids of the marked grains."""
    marked = np.flatnonzero(mask)
    return tuple((marked if rows is None else rows[marked]).tolist())
