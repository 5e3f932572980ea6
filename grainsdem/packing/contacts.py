"""Who touches whom."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from grainsdem.model import ContactGraph, Packing


def contacts(packing: Packing, *, within: float | None = None) -> ContactGraph:
    """Return the pairs nearer than ``within``."""
    raise NotImplementedError
