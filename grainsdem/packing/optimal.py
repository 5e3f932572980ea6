"""The scale at which void ratio and mean sphericity of a bed lie on a relation found in natural sand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from grainsdem.errors import InputError
from grainsdem.geometry.forms.sizes import grain_sphericities
from grainsdem.geometry.integrals import integrate
from grainsdem.packing.shrink import shrink

if TYPE_CHECKING:
    from collections.abc import Callable

    from grainsdem.model import Packing
    from grainsdem.packing.shrink import About, Region


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


_CHO = (
    "G.-C. Cho, J. Dodds and J. C. Santamarina, Particle shape effects on packing density, stiffness, and strength: "
    "natural and crushed sands, J. Geotech. Geoenviron. Eng. 132 (2006) 591-602"
)

VOID_RELATIONS = {
    "cho_2006_max": VoidRelation(1.6, -0.86, f"{_CHO}: the loosest state, e_max"),
    "cho_2006_min": VoidRelation(1.0, -0.51, f"{_CHO}: the densest state, e_min"),
}
"""Named relations. At the paper's mean sphericity of 0.87 the loosest state has e = 0.85, as the paper says."""


def fit_void_ratio(
    packing: Packing,
    *,
    relation: str | Callable[[float], float] = "cho_2006_max",
    about: About = "centroid",
    region: Region = "cells",
) -> Packing:
    """Return the grains shrunk until void ratio and mean sphericity lie on a relation (the paper's optimal F).

    Parameters
    ----------
    packing : Packing
        Grains in place, as `carve` returns them.
    relation : str or callable
        One of `VOID_RELATIONS`, or any function from the mean sphericity to a void ratio.
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
    it exactly. In a planar bed S is that of the outlines, and e of their areas.
    """
    law = relation
    if isinstance(law, str):
        if law not in VOID_RELATIONS:
            raise InputError(f"relation must be a function or one of {', '.join(VOID_RELATIONS)}; got {law!r}")
        law = VOID_RELATIONS[law]
    if len(packing) == 0:
        raise InputError("a mean sphericity needs at least one grain; the packing has none")
    measured = integrate(packing.grains)
    sphericity = float(grain_sphericities(packing, measured).mean())
    ratio = float(law(sphericity))
    if not ratio >= 0:
        raise InputError(f"the relation must give a void ratio of zero or more; at S = {sphericity:.4g} it is {ratio}")
    return shrink(packing, void_ratio=ratio, about=about, region=region)
