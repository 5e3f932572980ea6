"""What a measure is given: a packing, or its grains alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grainsdem.errors import InputError
from grainsdem.model.packing import Packing
from grainsdem.model.shapes import Polyhedra

if TYPE_CHECKING:
    from typing import TypeAlias

    Grains: TypeAlias = Packing | Polyhedra


def grains_of(given: object) -> Polyhedra:
    """Return the grains of a packing, or grains as they are.

    Raises
    ------
    InputError
        If it is neither.
    """
    if isinstance(given, Packing):
        return given.grains
    if isinstance(given, Polyhedra):
        return given
    raise InputError(f"this is measured of a packing or of its grains, Polyhedra; got {type(given).__name__}")


def require_packing(given: object) -> None:
    """Raise `InputError` unless it is a packing, whose poses, densities and domain a measure needs."""
    if not isinstance(given, Packing):
        raise InputError(
            f"this is measured of a packing, with its places, densities and domain; got {type(given).__name__} alone"
        )
