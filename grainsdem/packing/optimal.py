"""The scale at which void ratio and mean sphericity, or sorting, of a bed lie on a relation found in natural sand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated, gated_noun
from grainsdem.geometry.forms.sizes import grain_diameters, grain_sphericities, weighted_percentiles
from grainsdem.geometry.integrals import integrate
from grainsdem.packing.shrink import About, Region, shrink

if TYPE_CHECKING:
    from collections.abc import Callable

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import Packing


@gated_noun
@dataclass(frozen=True, slots=True)
class VoidRelation:
    """A linear relation e = intercept + slope · S of void ratio to mean sphericity.

    Parameters
    ----------
    intercept, slope : float
        Its constants.
    source : str
        Where they are from.
    """

    intercept: float
    slope: float
    source: str

    def __call__(self, sphericity: float) -> float:
        """Return the void ratio at a mean sphericity."""
        return self.intercept + self.slope * sphericity


@gated_noun
@dataclass(frozen=True, slots=True)
class SortingRelation:
    """A relation of void ratio to graphic sorting: lines between the classes that have one, and level beyond them.

    Parameters
    ----------
    sortings : tuple of float
        Folk and Ward's sorting [φ], rising.
    ratios : tuple of float
        Void ratio at each.
    source : str
        Where they are from.
    """

    sortings: tuple[float, ...]
    ratios: tuple[float, ...]
    source: str

    def __call__(self, sorting: float) -> float:
        """Return the void ratio at a sorting [φ]."""
        return float(np.interp(sorting, self.sortings, self.ratios))


_CHO = (
    "G.-C. Cho, J. Dodds and J. C. Santamarina, Particle shape effects on packing density, stiffness, and strength: "
    "natural and crushed sands, J. Geotech. Geoenviron. Eng. 132 (2006) 591-602"
)

VOID_RELATIONS: dict[str, VoidRelation | SortingRelation] = {
    "cho_2006_max": VoidRelation(1.6, -0.86, f"{_CHO}: the loosest state, e_max"),
    "cho_2006_min": VoidRelation(1.0, -0.51, f"{_CHO}: the densest state, e_min"),
    # Well sorted 0.35 to 0.5 φ, moderately sorted 0.71 to 1 φ, both at their middles; extremely poorly sorted from 4 φ.
    "terzaghi_1996": SortingRelation(
        (0.425, 0.855, 4.0),
        (0.85, 0.67, 0.25),
        "K. Terzaghi, R. B. Peck and G. Mesri, Soil Mechanics in Engineering Practice, 3rd ed., Wiley (1996), as cited "
        "by Buscombe and Rubin (2012): uncompacted sediment, well, moderately and extremely poorly sorted",
    ),
}
"""Named relations. At the paper's mean sphericity of 0.87 the loosest state has e = 0.85, as the paper says."""


@gated
def fit_void_ratio(
    packing: Packing,
    *,
    relation: str | Callable[[float], float] = "cho_2006_max",
    about: About = "centroid",
    region: Region = "cells",
) -> Packing:
    """Return the grains shrunk until their void ratio lies on a relation (the paper's optimal F).

    Parameters
    ----------
    packing : Packing
        Grains in place, as `carve` returns them.
    relation : str or callable
        One of `VOID_RELATIONS`, a `SortingRelation`, or any function from the mean sphericity to a void ratio.
    about, region
        See `shrink`.

    Returns
    -------
    Packing
        The last step of its provenance holds ``scale``, the optimal F.

    Raises
    ------
    InputError
        If the relation is not known, gives no void ratio, or one that only larger grains could have.

    Notes
    -----
    Scaling keeps every shape, so the mean sphericity S is known before F is: e(S) is asked of `shrink`, which reaches
    it exactly. In a planar bed S is that of the outlines, and e of their areas. Sorting is Folk and Ward's, of
    equal-volume diameters by mass, and does not change with the scale either.
    """
    law = relation
    if isinstance(law, str):
        if law not in VOID_RELATIONS:
            raise InputError(f"relation must be a function or one of {', '.join(VOID_RELATIONS)}; got {law!r}")
        law = VOID_RELATIONS[law]
    if len(packing) == 0:
        raise InputError("a mean sphericity needs at least one grain; the packing has none")
    measured = integrate(packing.grains)
    if isinstance(law, SortingRelation):
        name, value = "a sorting", _sorting(packing, measured)
    else:
        name, value = "S", float(grain_sphericities(packing, measured).mean())
    ratio = float(law(value))
    if not ratio >= 0:
        raise InputError(f"the relation must give a void ratio of zero or more; at {name} = {value:.4g} it is {ratio}")
    return shrink(packing, void_ratio=ratio, about=about, region=region)


def _sorting(packing: Packing, measured: Integrals) -> float:
    """Return Folk and Ward's graphic sorting [φ] of equal-volume diameters by mass."""
    weights = packing.densities * measured.volumes
    logarithms = np.log2(grain_diameters(packing, measured))
    p5, p16, p84, p95 = weighted_percentiles(logarithms, np.array([5.0, 16.0, 84.0, 95.0]), weights).tolist()
    # Nine digits: those of a logarithm that all processors have.
    return float(round((p84 - p16) / 4 + (p95 - p5) / 6.6, 9))
