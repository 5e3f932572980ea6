"""A layer of USD described: prims with attributes, and bodies of which there are many alike."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

KINDS: dict[str, tuple[int, str, int]] = {
    "bool": (1, "<u4", 1),
    "int": (3, "<i4", 1),
    "uint": (4, "<u4", 1),
    "float": (8, "<f4", 1),
    "double": (9, "<f8", 1),
    "string": (10, "<u4", 1),
    "token": (11, "<u4", 1),
    "quatd": (16, "<f8", 4),
    "quatf": (17, "<f4", 4),
    "double3": (23, "<f8", 3),
    "float3": (24, "<f4", 3),
    "color3f": (24, "<f4", 3),
    "normal3f": (24, "<f4", 3),
    "point3f": (24, "<f4", 3),
    "vector3f": (24, "<f4", 3),
}
"""Name of a type to its number in a crate, the type of its numbers and how many there are. A list adds ``[]``."""


class Column(NamedTuple):
    """An attribute's values for many prims, made a stretch at a time.

    Parameters
    ----------
    rows : callable
        ``rows(first, last)`` returns the numbers of the prims from ``first`` to before ``last``: shape
        (last - first, width), or all elements of their lists one after another.
    counts : ndarray of int, shape (n,), optional
        Elements in the list of each prim, where the type is a list.
    times : ndarray, shape (t,), optional
        Times of samples; ``rows`` then returns shape (last - first, t, width).
    """

    rows: Callable[[int, int], NDArray[Any]]
    counts: NDArray[np.int64] | None = None
    times: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, values: NDArray[Any]) -> Column:
        """Return a column of values that are there already, shape (n, width)."""
        return cls(lambda first, last: values[first:last])


class Attribute(NamedTuple):
    """An attribute of a prim.

    Parameters
    ----------
    kind : str
        Its type, one of `KINDS`; a list's ends in ``[]``.
    value : object
        Numbers, words, or a `Column` in a prim of `Many`. Quaternions are (w, x, y, z).
    interpolation : str, optional
        How a primvar spreads over its mesh.
    is_fixed : bool
        Whether its schema says that it cannot change in time.
    """

    kind: str
    value: Any
    interpolation: str | None = None
    is_fixed: bool = False

    @property
    def is_uniform(self) -> bool:
        """Whether it cannot change in time: so is every token."""
        return self.is_fixed or self.kind.startswith("token")


@dataclass(frozen=True, slots=True, kw_only=True)
class Prim:
    """A prim, its attributes, what it points at and its children.

    Parameters
    ----------
    name, kind : str
        Name, and type; no type where it only speaks over a prim of another layer.
    schemas : tuple of str
        Applied API schemas.
    attributes : dict
        Name to attribute.
    targets : dict
        Name of a relationship to the path that it points at, of a prim that comes earlier.
    children : tuple of Prim
        Prims below.
    many : Many, optional
        After them, many alike.
    model : str
        What it is among models, such as ``component``; empty for none.
    """

    name: str
    kind: str = ""
    schemas: tuple[str, ...] = ()
    attributes: dict[str, Attribute] = field(default_factory=dict)
    targets: dict[str, str] = field(default_factory=dict)
    children: tuple[Prim, ...] = ()
    many: Many | None = None
    model: str = ""


@dataclass(frozen=True, slots=True)
class Many:
    """Prims alike but for their names and the values of columns.

    Parameters
    ----------
    names : list of str
        One a prim.
    prim : Prim
        What they all are; its own name means nothing.
    """

    names: list[str]
    prim: Prim
