"""How well two kinds of grains are mixed: Lacey's index."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def lacey_index(points: ArrayLike, is_second: ArrayLike, *, width: float) -> float:
    """Return Lacey's mixing index of two kinds of grains: 0 where they are apart, 1 where they are mixed at random.

    Parameters
    ----------
    points : array_like, shape (n, k)
        Where the grains are, along the axes that cells are made of.
    is_second : array_like of bool, shape (n,)
        Which of the two kinds each one is.
    width : float
        Of the cells, in the unit of the points: some grains are to be in each.

    Returns
    -------
    float
        NaN where there is only one kind, or one grain a cell. Above one by chance.

    Notes
    -----
    With p the share of the second kind and p_c that in a cell of n_c grains, S² is the mean of (p_c - p)² over the
    grains, S₀² = p (1 - p) that of kinds that are apart, and S_R² = p (1 - p) (K - 1) / (N - 1) that of a random
    mixture of N grains in K cells. The index is (S₀² - S²) / (S₀² - S_R²) [1]_.

    .. [1] P. M. C. Lacey, Developments in the theory of particle mixing, J. Appl. Chem. 4, 257-268 (1954).

    Examples
    --------
    >>> import numpy as np
    >>> points = np.arange(40.0)[:, None]
    >>> lacey_index(points, points[:, 0] >= 20, width=10.0)
    0.0
    """
    kinds = np.asarray(is_second, dtype=np.float64)
    cells = np.floor((np.asarray(points, np.float64) - np.min(points, axis=0)) / width).astype(np.int64)
    _, owner = np.unique(cells, axis=0, return_inverse=True)
    counts = np.bincount(owner.ravel())
    share, shares = kinds.mean(), np.bincount(owner.ravel(), weights=kinds) / counts
    variance = float(counts @ np.square(shares - share)) / len(kinds)
    apart = share * (1 - share)
    random = apart * (len(counts) - 1) / max(len(kinds) - 1, 1)
    return float((apart - variance) / (apart - random)) if apart > random else float("nan")
