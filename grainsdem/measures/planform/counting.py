"""Stones counted by a grid on the picture, as in the field, and the percentiles that a set of images tells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, name_offenders, shown
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import weighted_percentiles
from grainsdem.geometry.integrals import integrate
from grainsdem.measures.planform.truth import check_rows, planform_table, projected_areas, true_sizes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.measures.planform.views import Planform
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

PERCENTS = (16, 50, 84)
"""Percentiles of `size_percentiles`: the median, and one standard deviation about it of a normal distribution."""

SAMPLES = (
    *(f"{of}_by_{basis}" for of in ("bed", "seen", "apparent") for basis in ("number", "area", "mass")),
    "counted",
    "counted_apparent",
)
"""What they are percentiles of."""

STONE = np.dtype(
    [("id", np.int32), *((name, np.float64) for name in ("x", "y", "b", "apparent_b")), ("is_cut", np.bool_)]
)
"""Columns of `pebble_count`."""


@gated
def pebble_count(
    view: Planform,
    packing: Packing,
    stones: int = 100,
    *,
    rows: NDArray[np.void] | None = None,
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.void]:
    """Return the stones under the points of a regular grid on the picture: a sample by number along a grid.

    Parameters
    ----------
    view : Planform
        What is seen of the packing.
    packing : Packing
        The same packing.
    stones : int
        Points of the grid; as near to it as whole rows and columns of nearly square meshes come.
    rows : structured ndarray, optional
        What `planform_table` returns of both, where it is known already.
    rng : Generator, int or None
        Source of where the grid begins, anywhere within its first mesh.

    Returns
    -------
    structured ndarray, shape (k,)
        One row a point under which a grain lies: ``id``; ``x`` and ``y`` [m]; the intermediate axis ``b`` [m] of the
        grain, as whoever takes it up measures it, and ``apparent_b`` [m] of what is seen of it; ``is_cut``, whether the
        border of the picture cuts it. A grain under several points counts as often.

    Raises
    ------
    InputError
        If fewer than one stone is asked for, or the packing is another than the view's.

    References
    ----------
    Wolman, M. G. (1954). A method of sampling coarse river-bed material. Eos 35, 951-956.
    Kellerhals, R. and Bray, D. I. (1971). Sampling procedures for coarse fluvial sediments. J. Hydraul. Div. 97, 1165.
    """
    if not 1 <= stones <= view.labels.size:
        raise InputError(f"stones must be 1 to {view.labels.size}, a point in each pixel; got {shown(stones)}")
    rows = planform_table(view, packing) if rows is None else rows
    check_rows(rows, packing)
    generator = np.random.default_rng(rng)
    ny, nx = view.labels.shape
    size = view.pixel * [nx, ny]
    down = max(1, round(np.sqrt(stones * size[1] / size[0])))
    across = max(1, round(stones / down))
    start = generator.random(2)
    column = ((np.arange(across) + start[0]) * nx / across).astype(np.int64)
    row = ((np.arange(down) + start[1]) * ny / down).astype(np.int64)
    met = view.labels[row[:, None], column]
    k, j = np.nonzero(met)
    ids = met[k, j] - 1
    found = rows[np.searchsorted(rows["id"], ids)]
    x, y = view.places()
    counted = np.zeros(ids.size, dtype=STONE)
    counted["x"], counted["y"] = x[column[j]], y[row[k]]
    for name in ("id", "b", "apparent_b", "is_cut"):
        counted[name] = found[name]
    return counted


@gated
def size_percentiles(
    rows: NDArray[np.void], packing: Packing, stones: NDArray[np.void], *, least_pixels: int = 1
) -> dict[str, float]:
    """Return d16, d50 and d84 of the intermediate axis b [m]: of the bed, of what is seen of it, and of stones counted.

    Parameters
    ----------
    rows : structured ndarray, shape (k,)
        What `planform_table` returns.
    packing : Packing
        The packing that is seen.
    stones : structured ndarray, shape (n,)
        What `pebble_count` returns.
    least_pixels : int
        Grains of which fewer are seen are left out of those seen.

    Returns
    -------
    dict of str to float
        ``d50_bed_by_number``, ``_by_area`` (of outlines from above, whatever hides them) and ``_by_mass``, of all;
        ``d50_seen_…``, true axes of the grains that are seen whole, and ``d50_apparent_…``, those of what is seen of
        them, by number, visible area and the grains' mass; ``d50_counted``, true axes of the stones counted, and
        ``d50_counted_apparent``, apparent ones of those that the border does not cut. NaN where there is none.
    """
    check_rows(rows, packing)
    lacking = set(STONE.names or ()) - set(stones.dtype.names or ())
    if lacking:
        raise InputError(f"stones must be what pebble_count returns; they lack {name_offenders(sorted(lacking))}")
    measured = integrate(packing.grains)
    masses = measured.volumes * packing.densities
    whole = rows[~rows["is_cut"] & (rows["n_pixels"] >= least_pixels)]
    b = true_sizes(packing, measured)["b"]
    of_all = {"number": np.ones(b.size), "area": projected_areas(packing), "mass": masses}
    of_whole = {"number": np.ones(whole.size), "area": whole["visible_area"], "mass": masses[whole["id"]]}
    uncut = stones["apparent_b"][~stones["is_cut"]]
    samples = [
        *((b, weights) for weights in of_all.values()),
        *((whole["b"], weights) for weights in of_whole.values()),
        *((whole["apparent_b"], weights) for weights in of_whole.values()),
        (stones["b"], np.ones(stones.size)),
        (uncut, np.ones(uncut.size)),
    ]
    q = np.array(PERCENTS, dtype=np.float64)
    values = [
        weighted_percentiles(sample[0], q, sample[1]) if sample[0].size else np.full(3, np.nan) for sample in samples
    ]
    return dict(zip(names_of_percentiles(), np.concatenate(values).tolist(), strict=True))


def names_of_percentiles() -> list[str]:
    """Return the names of what `size_percentiles` returns, in its order."""
    return [f"d{q}_{sample}" for sample in SAMPLES for q in PERCENTS]
