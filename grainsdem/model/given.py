"""What a measure is given: a packing, or its grains alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grainsdem.model.packing import Packing

if TYPE_CHECKING:
    from typing import TypeAlias

    from grainsdem.model.shapes import Polyhedra

    Grains: TypeAlias = Packing | Polyhedra


def grains_of(given: Grains) -> Polyhedra:
    """Return the grains of a packing, or grains as they are."""
    return given.grains if isinstance(given, Packing) else given
