"""How large the grains of a planform seem, beside how large they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import grain_diameters, weighted_percentiles
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.geometry.raster.copies import turned_normals
from grainsdem.geometry.rotations import to_matrices
from grainsdem.measures.grains.shapes import ellipsoid_axes
from grainsdem.measures.sections.tables import ellipse_axes
from grainsdem.ragged import sum_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.measures.planform.views import Planform
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

PERCENTS = (5, 16, 25, 50, 75, 84, 95)
"""Percentiles of `planform_bias`."""

STATISTICS = (*(f"d{q}" for q in PERCENTS), "mean", "sd")
"""Rows of `planform_bias`."""

SAMPLES = ("bed_by_number", "bed_by_mass", "seen_by_number", "apparent_by_number", "apparent_by_area")
"""What they are of."""

BIASES = ("number_bias", "area_bias")
"""Ratios of these."""

_SIZES = ("apparent_diameter", "apparent_a", "apparent_b", "diameter", "a", "b", "c")

COLUMNS = np.dtype(
    [
        ("id", np.int32),
        ("n_pixels", np.int64),
        ("visible_area", np.float64),
        ("projected_area", np.float64),
        ("visible_share", np.float64),
        *((name, np.float64) for name in _SIZES),
        ("is_cut", np.bool_),
    ]
)
"""Columns of `planform_table`."""


@gated
def planform_table(view: Planform, packing: Packing) -> NDArray[np.void]:
    """Return one row for each grain that is seen, by rising id: how large it seems, and how large it is.

    Parameters
    ----------
    view : Planform
        What is seen of the packing.
    packing : Packing
        The same packing.

    Returns
    -------
    structured ndarray, shape (k,)
        ``id``; ``n_pixels``; ``visible_area`` [m²] of those and ``projected_area`` [m²] of the whole grain, exact, and
        their ratio ``visible_share``, a little over 1 at times since pixels are counted; ``apparent_diameter`` of the
        circle of the visible area, ``apparent_a`` and ``apparent_b``, the axes of the ellipse of its second moments
        [m]; the truth: ``diameter`` of equal volume, and the axes ``a``, ``b`` and ``c`` of the ellipsoid of equal
        inertia [m] (in a planar bed those in the plane, and c is NaN); ``is_cut``: the grain is seen at a border of the
        picture beyond which the bed goes on.

    Raises
    ------
    InputError
        If the packing is another than the view's.
    """
    if view.labels.max(initial=0) > len(packing):
        raise InputError(
            f"the view must be of this packing of {len(packing)} grains; it shows grain {view.labels.max() - 1}"
        )
    measured = integrate(packing.grains)
    counts, moments, at_border = _visible(view, packing)
    ids = np.flatnonzero(counts)
    rows = np.zeros(ids.size, dtype=COLUMNS)
    rows["id"], rows["n_pixels"], rows["is_cut"] = ids, counts[ids], at_border[ids]
    rows["visible_area"] = counts[ids] * view.pixel.prod()
    rows["projected_area"] = projected_areas(packing)[ids]
    rows["visible_share"] = rows["visible_area"] / rows["projected_area"]
    rows["apparent_diameter"] = np.sqrt(4 / np.pi * rows["visible_area"])
    rows["apparent_a"], rows["apparent_b"] = ellipse_axes(*moments[ids].T)
    for name, values in true_sizes(packing, measured).items():
        rows[name] = values[ids]
    return rows


def check_rows(rows: NDArray[np.void], packing: Packing) -> None:
    """Raise `InputError` unless they are those that `planform_table` returns of a packing."""
    lacking = {"id", "is_cut", "n_pixels", "b", "apparent_b", "visible_area"} - set(rows.dtype.names or ())
    if lacking:
        raise InputError(f"rows must be what planform_table returns; they lack {name_offenders(sorted(lacking))}")
    if rows["id"].max(initial=-1) >= len(packing):
        raise InputError(f"the table must be of this packing of {len(packing)} grains; it has grain {rows['id'].max()}")


@gated
def planform_bias(rows: NDArray[np.void], packing: Packing, *, least_pixels: int = 1) -> NDArray[np.void]:
    """Return what is read off a planform beside the truth, one row a statistic of the intermediate axis b.

    Parameters
    ----------
    rows : structured ndarray, shape (k,)
        What `planform_table` returns.
    packing : Packing
        The packing that is seen.
    least_pixels : int
        Grains of which fewer are seen are left out, as whoever measures grains on images leaves out specks.

    Returns
    -------
    structured ndarray, shape (9,)
        ``statistic``: ``d5`` to ``d95``, ``mean`` and ``sd``. Then, all in metres: the bed's own ``bed_by_number`` and
        ``bed_by_mass``; of the true axes of the grains that are seen, ``seen_by_number``; of their apparent axes,
        ``apparent_by_number`` and ``apparent_by_area``, which is what points of a regular grid on the image find; and
        the ratios that correct them, ``number_bias``, apparent over bed by number, and ``area_bias``, apparent by area
        over bed by mass. Grains that the border of the picture cuts do not count as seen.

    Raises
    ------
    InputError
        If the packing is another than the table's, or no whole grain is seen.

    Notes
    -----
    Points of a grid meet grains in proportion to their area, and a sample by number along a grid is equivalent to one
    by mass from the volume, for grains that do not hide one another (Kellerhals and Bray 1971). What hides them makes
    up the rest of ``area_bias``.
    """
    check_rows(rows, packing)
    rows = rows[~rows["is_cut"] & (rows["n_pixels"] >= least_pixels)]
    if rows.size == 0:
        raise InputError(f"no whole grain is seen through {least_pixels} pixels or more: there is no bias to report")
    measured = integrate(packing.grains)
    b = true_sizes(packing, measured)["b"]
    one = np.ones
    samples = (
        (b, one(b.size)),
        (b, measured.volumes * packing.densities),
        (rows["b"], one(rows.size)),
        (rows["apparent_b"], one(rows.size)),
        (rows["apparent_b"], rows["visible_area"]),
    )
    kinds = [("statistic", "U4"), *((name, np.float64) for name in (*SAMPLES, *BIASES))]
    result = np.zeros(len(STATISTICS), dtype=kinds)
    result["statistic"] = STATISTICS
    for name, (sizes, weights) in zip(SAMPLES, samples, strict=True):
        result[name] = _statistics(sizes, weights)
    with np.errstate(invalid="ignore", divide="ignore"):  # equal grains have no spread to compare with
        result["number_bias"] = result["apparent_by_number"] / result["bed_by_number"]
        result["area_bias"] = result["apparent_by_area"] / result["bed_by_mass"]
    return result


def projected_areas(packing: Packing) -> Floats:
    """Return the area [m²] of each grain's outline from above, whatever hides it, shape (n,)."""
    planes = face_planes(packing.grains)
    upward = np.maximum(turned_normals(packing, planes.normals)[:, 2], 0.0) * planes.areas
    return np.asarray(sum_rows(upward, packing.grains.face_offsets))


def _visible(view: Planform, packing: Packing) -> tuple[NDArray[np.int64], Floats, NDArray[np.bool_]]:
    """Return pixels, central second moments (xx, xy, yy) [m²], and whether it is seen at a border, of every grain."""
    n = len(packing)
    row, column = np.nonzero(view.labels)
    ids = view.labels[row, column].astype(np.int64) - 1
    x_all, y_all = view.places()
    periods = packing.domain.lengths[:2]
    # About the grain's own place, to its nearest image: visible parts may lie at both sides of a periodic picture.
    arms = []
    for axis, place in enumerate((x_all[column], y_all[row])):
        arm = place - packing.positions[ids, axis]
        arms.append(arm - periods[axis] * np.rint(arm / periods[axis]) if packing.domain.periodic[axis] else arm)
    x, y = arms
    counts = np.bincount(ids, minlength=n)
    share = 1 / np.maximum(counts, 1)
    mx, my, xx, xy, yy = (np.bincount(ids, weights=w, minlength=n) * share for w in (x, y, x * x, x * y, y * y))
    # A pixel is a square, not a point.
    own = view.pixel**2 / 12
    moments = np.stack([xx - mx * mx + own[0], xy - mx * my, yy - my * my + own[1]], axis=1)
    borders = [view.labels[:, 0], view.labels[:, -1], view.labels[-1], view.labels[0]]
    at_border = np.zeros(n + 1, dtype=bool)
    for labels, goes_on in zip(borders, view.ends.ravel(), strict=True):
        if goes_on:
            at_border[labels] = True
    return counts, moments, at_border[1:]


def true_sizes(packing: Packing, measured: Integrals | None = None) -> dict[str, Floats]:
    """Return ``diameter`` and axes ``a``, ``b`` and ``c`` [m] of every grain, as `planform_table` has them."""
    measured = measured or integrate(packing.grains)
    diameter = grain_diameters(packing, measured)
    if not packing.domain.is_planar:
        a, b, c = ellipsoid_axes(packing.grains, measured=measured).T
        return {"diameter": diameter, "a": a, "b": b, "c": c}
    # A prism's base has the second moments in the plane that the prism has.
    turns = to_matrices(packing.quaternions)
    inertia = turns @ measured.inertias @ turns.swapaxes(1, 2) / measured.volumes[:, None, None]
    total = 0.5 * np.trace(inertia, axis1=1, axis2=2)
    a, b = ellipse_axes(total - inertia[:, 0, 0], -inertia[:, 0, 1], total - inertia[:, 1, 1])
    return {"diameter": diameter, "a": a, "b": b, "c": np.full(len(packing), np.nan)}


def _statistics(sizes: Floats, weights: Floats) -> Floats:
    """Return the percentiles, mean and standard deviation [m] of weighted sizes."""
    mean = np.average(sizes, weights=weights)
    spread = np.sqrt(np.average((sizes - mean) ** 2, weights=weights))
    return np.append(weighted_percentiles(sizes, np.array(PERCENTS, dtype=np.float64), weights), [mean, spread])
