"""The sizes of the polygons of a section, one by one and in sum."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import weighted_percentiles
from grainsdem.geometry.raster.slicing import areas_inside
from grainsdem.ragged import sum_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.measures.sections.planes import Section

    Floats = NDArray[np.float64]

COLUMNS = np.dtype(
    [
        ("id", np.int32),
        ("u", np.float64),
        ("v", np.float64),
        ("area", np.float64),
        ("area_inside", np.float64),
        ("perimeter", np.float64),
        ("diameter", np.float64),
        ("a", np.float64),
        ("b", np.float64),
        ("n_corners", np.int32),
        ("is_counted", np.bool_),
    ]
)
"""Columns of `section_table`."""


@gated
def section_table(section: Section) -> NDArray[np.void]:
    """Return one row a polygon, in their order.

    Parameters
    ----------
    section : Section
        Any section.

    Returns
    -------
    structured ndarray, shape (k,)
        ``id`` of the grain; centroid ``u``, ``v`` [m] in the plane; ``area`` of the whole polygon and ``area_inside``
        the outline [m²]; ``perimeter`` [m]; ``diameter`` of the circle of equal area, ``a`` and ``b``, the axes of the
        ellipse of equal second moments [m]; ``n_corners``; ``is_counted``: the centroid lies in the outline. Across
        periodic faces a polygon stands in the section once for each of its images: sizes are unbiased where only
        those are taken that count.
    """
    rows = np.zeros(len(section), dtype=COLUMNS)
    rows["id"] = section.ids
    rows["n_corners"] = np.diff(section.offsets)
    area, middle, moments, rows["perimeter"] = _integrals(section.points, section.offsets)
    rows["area"], rows["u"], rows["v"] = area, middle[:, 0], middle[:, 1]
    rows["area_inside"] = areas_inside(section.points, section.offsets, section.outline)
    rows["diameter"] = np.sqrt(4 / np.pi * area)
    rows["a"], rows["b"] = ellipse_axes(*moments.T)
    rows["is_counted"] = _contains(section.outline, middle)
    return rows


@gated
def section_summary(section: Section) -> dict[str, Any]:
    """Return what one says about a section in one line, as JSON values in SI units.

    Returns
    -------
    dict
        ``area`` of the domain's section [m²]; ``area_fraction``, the part of it that lies in grains; ``n_sections``,
        polygons that count, and ``n_per_area`` [m⁻²]; of those ``mean_area`` [m²], ``mean_diameter``, and ``d10``,
        ``d50``, ``d90`` by number [m]: diameters of equal area; None where none counts.
    """
    rows = section_table(section)
    (total,) = _integrals(section.outline, np.array([0, len(section.outline)]))[0].tolist()
    counted = rows[rows["is_counted"]]
    sizes: dict[str, float | None] = dict.fromkeys(("mean_area", "mean_diameter", "d10", "d50", "d90"))
    if counted.size:
        d = counted["diameter"]
        q = weighted_percentiles(d, np.array([10.0, 50.0, 90.0]), np.ones(d.size))
        values = [counted["area"].mean(), d.mean(), *q]
        sizes = dict(zip(sizes, map(float, values), strict=True))
    return {
        "area": total,
        "area_fraction": float(rows["area_inside"].sum() / total),
        "n_sections": int(counted.size),
        "n_per_area": counted.size / total,
        **sizes,
    }


def ellipse_axes(xx: Floats, xy: Floats, yy: Floats) -> tuple[Floats, Floats]:
    """Return the long and short axis [m] of the ellipses with the given central second moments over area [m²]."""
    mean, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    return 4 * np.sqrt(mean + half), 4 * np.sqrt(np.maximum(mean - half, 0.0))


def _integrals(points: Floats, offsets: NDArray[np.int64]) -> tuple[Floats, Floats, Floats, Floats]:
    """Return area, centroid, central second moments over area (xx, xy, yy), and perimeter of each polygon."""
    counts = np.diff(offsets)
    following = np.arange(1, len(points) + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    # About each polygon's first corner, so that one far from the origin loses no digits.
    origin = points[offsets[:-1]]
    p = points - np.repeat(origin, counts, axis=0)
    q = p[following]
    cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    area = 0.5 * sum_rows(cross, offsets)
    middle = sum_rows(cross[:, None] * (p + q), offsets) / (6 * area[:, None])
    (px, py), (qx, qy) = p.T, q.T
    products = (
        px * px + px * qx + qx * qx,
        px * py + 0.5 * (px * qy + qx * py) + qx * qy,
        py * py + py * qy + qy * qy,
    )
    second = sum_rows(cross[:, None] * np.stack(products, axis=1), offsets) / (12 * area[:, None])
    x, y = middle.T
    central = second - np.stack([x * x, x * y, y * y], axis=1)
    return area, middle + origin, central, sum_rows(np.hypot(qx - px, qy - py), offsets)


def _contains(outline: Floats, points: Floats) -> NDArray[np.bool_]:
    """Return which points lie in a convex polygon; of two sides across the domain one is in, the other is not."""
    inside = np.ones(len(points), dtype=bool)
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        d = b - a
        side = d[0] * (points[:, 1] - a[1]) - d[1] * (points[:, 0] - a[0])
        inside &= side >= 0 if (d[0], d[1]) > (0.0, 0.0) else side > 0
    return inside
