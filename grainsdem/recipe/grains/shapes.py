"""``[grains.shapes]``: grains that do not come from cells, laid out loose in a mixture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from grainsdem import shapes
from grainsdem.memory import A_CELL, allow_memory
from grainsdem.recipe.base import Table
from grainsdem.recipe.grains.sieves import SievesTable
from grainsdem.values import Positive

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.model import Domain, Packing
    from grainsdem.recipe.grains.sizes import SizesTable

Count = Annotated[int, Field(ge=1)]
Ratio = Annotated[float, Field(gt=0, le=1)]
Name = Literal[
    "tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron", "box", "prism", "ellipsoid", "superellipsoid",
    "rock",
]  # fmt: skip

DIFFERENT = 200
"""Rocks of a kind that differ, by default: more take longer to make, and no one tells them apart."""


class KindTable(Table):
    """One of ``kinds``: a named shape, or one or more of a file or folder.

    Parameters
    ----------
    shape : str
        A Platonic solid by its name, ``"box"``, ``"prism"``, ``"ellipsoid"``, ``"superellipsoid"`` or ``"rock"``.
    path : str
        File (.stl, .obj, .ply) or folder of such, relative to the recipe. One of shape and path is given.
    share : float
        Share of the kind, relative to those of the others.
    density : float
        Density [kg/m³], where the kind has one of its own.
    elongation, flatness : float
        b/a and c/b of boxes, ellipsoids, superellipsoids and rocks, in (0, 1].
    roundness : float
        Wadell's, of rocks; by default they are as they break.
    n_vertices : int
        Corners at most, of rocks, round shapes and shapes of files.
    different : int
        How many different rocks there are.
    sides, aspect : int, float
        Of a prism: corners of its base, and its height over the base's diameter.
    exponents : two numbers
        Of a superellipsoid, see `grainsdem.shapes.superellipsoid`.
    concave : {"refuse", "hull"}
        What is done with shapes of files that are not convex.
    """

    shape: Name | None = None
    path: str | None = None
    share: Positive = 1.0
    density: Positive | None = None
    elongation: Ratio | None = None
    flatness: Ratio | None = None
    roundness: Annotated[float, Field(ge=0, le=1)] | None = None
    n_vertices: Annotated[int, Field(ge=4)] | None = None
    different: Count | None = None
    sides: Annotated[int, Field(ge=3)] | None = None
    aspect: Positive | None = None
    exponents: tuple[float, float] | None = None
    concave: Literal["refuse", "hull"] | None = None

    @model_validator(mode="after")
    def _keys_are_the_shapes(self) -> Self:
        if (self.shape is None) == (self.path is None):
            raise ValueError("a kind has either a shape or a path")
        known = self._makers().takes
        given = [name for name in _OWN if getattr(self, name) is not None]
        foreign = [name for name in given if name not in known]
        if foreign:
            takes = ", ".join(["share", "density", *known])
            raise ValueError(f"{self.shape or 'a path'} takes {takes}; got {', '.join(foreign)}")
        if self.shape == "prism" and self.sides is None:
            raise ValueError("a prism needs sides")
        return self

    def _makers(self) -> _Maker:
        return _MAKERS.get(self.shape or "path", _Maker((), _platonic))

    def make(self, rng: np.random.Generator) -> shapes.Scans | Any:
        """Return the shapes of the kind, of any size."""
        return self._makers().make(self, rng)


class ShapesTable(Table):
    """``[grains.shapes]``: grains of given shapes, loose and ready to settle, instead of grains grown from ``[seeds]``.

    Their sizes are those of ``[grains.sizes]`` or ``[grains.sieves]``, or of one ``diameter``. They fill the domain
    from its floor, or a box of their own where it has no lengths.

    Parameters
    ----------
    kinds : list of tables
        What they are of: see `KindTable`.
    count : int
        Number of grains, where ``[grains.sizes]`` is no list.
    diameter : float
        Diameter [m] of the sphere of equal volume, where all grains have the same.
    by : {"number", "mass"}
        What shares are of.
    solid_fraction : float
        Of the part of the domain that is filled, at most.
    higher : bool
        Whether the domain may be made higher than it is.
    """

    kinds: Annotated[tuple[KindTable, ...], Field(min_length=1)]
    count: Count | None = None
    diameter: Positive | None = None
    by: Literal["number", "mass"] = "number"
    solid_fraction: Annotated[float, Field(gt=0, lt=0.6)] | None = None
    higher: bool = True

    def refuse_without_sizes(self, sizes: SizesTable | None, sieves: SievesTable | None) -> None:
        """Raise `ValueError` unless number and sizes of the grains are known."""
        if sum(source is not None for source in (sizes, sieves, self.diameter)) != 1:
            raise ValueError("the grains of shapes have sizes, sieves, or all one shapes.diameter: give one of them")
        is_counted = sizes is not None and sizes.is_list
        if is_counted == (self.count is not None):
            told = "the list of sizes tells how many grains there are: leave out" if is_counted else "give"
            raise ValueError(f"{told} shapes.count")

    def beside(self, folder: Path) -> Self:
        """Return the table with its files found in a folder."""
        kinds = [
            kind if kind.path is None else kind.model_copy(update={"path": str(folder / kind.path)})
            for kind in self.kinds
        ]
        return self.model_copy(update={"kinds": tuple(kinds)})


def laid_out(
    table: ShapesTable,
    sizes: SizesTable | SievesTable | None,
    density: float,
    domain: Domain | None,
    *,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
) -> Packing:
    """Return the grains that a table describes, loose in a domain, or in a box of their own."""
    allow_memory(table.count or 0, A_CELL, "grains")
    kinds = [kind.make(rng) for kind in table.kinds]
    options: dict[str, Any] = {} if table.solid_fraction is None else {"solid_fraction": table.solid_fraction}
    return shapes.pack(
        kinds,
        sizes.curve() if isinstance(sizes, SievesTable) else _diameters(table, sizes, rng),
        domain,
        n=table.count if isinstance(sizes, SievesTable) else None,
        shares=[kind.share for kind in table.kinds],
        by=table.by,
        density=[kind.density or density for kind in table.kinds],
        higher=table.higher,
        rng=rng,
        progress=progress,
        **options,
    )


def _diameters(table: ShapesTable, sizes: SizesTable | None, rng: np.random.Generator) -> NDArray[np.float64]:
    if sizes is None:
        return np.full(table.count or 1, table.diameter or 1.0)
    return sizes.draw(len(sizes.listed()) if table.count is None else table.count, rng)


class _Maker(NamedTuple):
    """The keys of a shape besides share and density, and what makes it."""

    takes: tuple[str, ...]
    make: Callable[[KindTable, np.random.Generator], Any]


_OWN = ("elongation", "flatness", "roundness", "n_vertices", "different", "sides", "aspect", "exponents", "concave")


def _given(kind: KindTable, *names: str) -> dict[str, Any]:
    return {name: getattr(kind, name) for name in names if getattr(kind, name) is not None}


def _axes(kind: KindTable) -> tuple[float, float, float]:
    b = kind.elongation or 1.0
    return 1.0, b, b * (kind.flatness or 1.0)


def _platonic(kind: KindTable, _rng: np.random.Generator) -> Any:
    return shapes.platonic(str(kind.shape))


def _box(kind: KindTable, _rng: np.random.Generator) -> Any:
    return shapes.box(*_axes(kind))


def _prism(kind: KindTable, _rng: np.random.Generator) -> Any:
    return shapes.prism(kind.sides or 3, **_given(kind, "aspect"))


def _ellipsoid(kind: KindTable, _rng: np.random.Generator) -> Any:
    return shapes.ellipsoid(*_axes(kind), **_given(kind, "n_vertices"))


def _superellipsoid(kind: KindTable, _rng: np.random.Generator) -> Any:
    return shapes.superellipsoid(*_axes(kind), **_given(kind, "n_vertices", "exponents"))


def _rock(kind: KindTable, rng: np.random.Generator) -> Any:
    return shapes.rock(
        kind.different or DIFFERENT, **_given(kind, "elongation", "flatness", "roundness", "n_vertices"), rng=rng
    )


def _file(kind: KindTable, _rng: np.random.Generator) -> Any:
    # Only proportions count: in the smallest of units no file is taken for one of houses.
    return shapes.read(str(kind.path), unit=1e-6, **_given(kind, "n_vertices", "concave"))


_MAKERS = {
    "box": _Maker(("elongation", "flatness"), _box),
    "prism": _Maker(("sides", "aspect"), _prism),
    "ellipsoid": _Maker(("elongation", "flatness", "n_vertices"), _ellipsoid),
    "superellipsoid": _Maker(("elongation", "flatness", "exponents", "n_vertices"), _superellipsoid),
    "rock": _Maker(("elongation", "flatness", "roundness", "n_vertices", "different"), _rock),
    "path": _Maker(("n_vertices", "concave"), _file),
}
