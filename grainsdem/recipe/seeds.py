"""``[seeds]``: where grains grow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self, get_args

from pydantic import Field, model_validator

from grainsdem import points
from grainsdem.points.fields.grade import STEEPEST, Axis, Grade
from grainsdem.recipe.base import Table
from grainsdem.values import Positive

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from grainsdem.model import Domain

Process = Literal["halton", "poisson", "cluster", "strauss", "strauss_process", "density", "noise", "image", "file"]
Count = Annotated[int, Field(ge=1)]
Unit = Annotated[float, Field(ge=0, le=1)]
Corner = tuple[float, float, float]


class GradeTable(Table):
    """``grade`` of ``[seeds]``: sizes of grains that go linearly along an axis.

    Parameters
    ----------
    ratio : float
        Size at the upper end of the domain over that at the lower end: below one the bed fines upward.
    along : {"x", "y", "z"}
        The axis.
    """

    ratio: Annotated[float, Field(ge=1 / STEEPEST, le=STEEPEST)]
    along: Axis = "z"

    def grade(self) -> Grade:
        """Return the grade."""
        return Grade(self.ratio, self.along)


class SeedsTable(Table):
    """``[seeds]``: where grains grow. Lengths are those of the domain: in metres unless the bed is scaled to a size.

    Parameters
    ----------
    process : str
        ``"halton"``, ``"poisson"``, ``"cluster"``, ``"strauss"`` (points that arrive in turn), ``"strauss_process"``
        (the process of that name), ``"density"`` (an array), ``"noise"``, ``"image"``, or ``"file"`` of your own
        points.
    count : int
        Number of seeds; without it, and with a size of grains, it follows from the domain's.
    relax : int
        Lloyd iterations: more make grains rounder and more alike.
    grade : table
        ``{ratio = 0.5, along = "z"}``: seeds of Halton, Poisson and Strauss are moved along an axis, and relaxed by the
        density of the paper's equation 3, so that the size of the grains goes linearly from one end to the other.
    path : str
        File of points (`points.read`), of a density (``.npy``, ``.npz``) or of an image, relative to the recipe.
    fit, bounds : bool, two corners
        Whether points of a file are scaled into the domain, and the box in their unit that becomes the domain; the
        bounds alone will do (`points.scaled`).
    bases, start, scramble : three ints, int, {"none", "shift"}
        Of Halton's sequence (`points.halton`): a base for each axis, two in a slab, and the number of the first point.
        It is the same at every ``rng`` unless it is shifted at random, as `points.halton` does where it gets one.
    exact : bool
        Whether Poisson's count is what is asked for, or so on the average.
    parents, children, spread, walls : int or str, float, float, {"clip", "reflect", "periodic"}
        Of clusters (`points.cluster_poisson`): the parents' number or a file of them, the mean number of children of
        each, their standard deviation about it along each axis, and what walls do to them. Two of count, parents and
        children.
    distance, inhibition : float
        Of Strauss's rule and process (`points.strauss`): δ and c.
    intensity, sweeps : float, int
        Of Strauss's process (`points.strauss_process`): points a volume, instead of a count, and steps a point.
    beta, resolution : float, int
        Of noise (`points.pink_noise`): the exponent of its spectrum, and voxels along the longest edge.
    region, low_pass, order, light : four ints, float, int, {"coarse", "fine"}
        Of an image (`points.image_density`).
    gain, cutoff, threshold, floor : float
        Contrast of noise or of an image, or what parts its light from its dark; the density of the sparsest places.
    along : {"x", "y", "z"}
        Axis along which an image, or a density of two axes, is extruded.

    Notes
    -----
    Keys of one process may stand in a table of its own, ``[seeds.cluster]``, which counts where that is the process: it
    may have a count and a number of relaxations, too, which go before those of ``[seeds]``. So the process alone can be
    varied.
    """

    process: Process = "halton"
    count: Count | None = None
    relax: Annotated[int, Field(ge=0)] = 0
    grade: GradeTable | None = None
    path: str | None = None
    fit: bool = False
    bounds: tuple[Corner, Corner] | None = None
    bases: Annotated[tuple[int, ...], Field(min_length=2, max_length=3)] = (2, 3, 5)
    start: Annotated[int, Field(ge=0)] = 1
    scramble: Literal["none", "shift"] = "none"
    exact: bool = True
    parents: Count | str | None = None
    children: Positive | None = None
    spread: Positive | None = None
    walls: Literal["clip", "reflect", "periodic"] = "clip"
    distance: Positive | None = None
    inhibition: Unit | None = None
    intensity: Positive | None = None
    sweeps: Count = 100
    beta: float = 1.0
    resolution: Annotated[int, Field(ge=2)] = 128
    region: tuple[int, int, int, int] | None = None
    low_pass: Annotated[float, Field(gt=0, le=0.5)] | None = None
    order: Count = 2
    light: Literal["coarse", "fine"] = "coarse"
    gain: Positive | None = None
    cutoff: Unit = 0.5
    threshold: Unit | None = None
    floor: Unit = 0.0
    along: Literal["x", "y", "z"] = "z"

    @model_validator(mode="before")
    @classmethod
    def _own_table_beside_the_rest(cls, value: Any) -> Any:
        """Put the keys of the process's own table beside the others, and leave out other processes' tables."""
        if not isinstance(value, dict):
            return value
        own = {name: value[name] for name in get_args(Process) if name in value}
        rest = {name: item for name, item in value.items() if name not in own}
        if own and "process" not in rest:
            raise ValueError(f"which process? There are tables of {', '.join(own)}, and no key process")
        for name, table in own.items():
            takes = ["count", "relax", *_KEYS[name].needed, *_KEYS[name].optional]
            foreign = [key for key in table if key not in takes] if isinstance(table, dict) else [repr(table)]
            if foreign:
                raise ValueError(f"the table of process {name!r} takes {', '.join(takes)}; got {', '.join(foreign)}")
        process = rest.get("process")
        return {**rest, **(own.get(process, {}) if isinstance(process, str) else {})}

    @model_validator(mode="after")
    def _keys_are_the_processs(self) -> Self:
        keys = _KEYS[self.process]
        given = [name for name in type(self).model_fields if getattr(self, name) != _DEFAULTS[name]]
        lacks = [name for name in keys.needed if name not in given]
        if lacks or (self.process == "file" and "count" in given):
            unwanted = ", and no count" if self.process == "file" else ""
            raise ValueError(f"process {self.process!r} needs {' and '.join(keys.needed)}{unwanted}")
        takes = ["count", *keys.needed, *keys.optional]
        foreign = [name for name in given if name not in (*takes, "process", "relax", "grade")]
        if foreign:
            raise ValueError(
                f"process {self.process!r} takes {', '.join(takes)}; got {', '.join(foreign)} (keys of another process "
                f"alone stand in a table of its own, such as [seeds.cluster])"
            )
        if self.grade is not None and self.process not in _EVEN:
            raise ValueError(f"seeds of {', '.join(_EVEN)} are graded, which lie evenly; got process {self.process!r}")
        numbers = [name for name in ("count", "parents", "children") if name in given]
        if self.process == "cluster" and len(numbers) > 2:
            raise ValueError("process 'cluster' takes two of count, parents and children; got all three")
        if self.process == "cluster" and "parents" not in given and "children" not in given:
            raise ValueError("process 'cluster' takes two of count, parents and children; give parents or children")
        if self.intensity is not None and self.count is not None:
            raise ValueError("process 'strauss_process' takes either count or intensity; got both")
        return self

    @property
    def wants_count(self) -> bool:
        """Whether the process takes a number of seeds; it is given, or follows from the grains' size."""
        is_left_to_chance = self.intensity is not None or (self.parents is not None and self.children is not None)
        return self.process != "file" and not is_left_to_chance

    @property
    def has_chance(self) -> bool:
        """Whether seeds differ from one rng to another: Halton's sequence and points of a file do not."""
        return self.process not in ("halton", "file") or self.scramble == "shift"

    def beside(self, folder: Path) -> Self:
        """Return the table with its files found in a folder."""
        files = {name: getattr(self, name) for name in ("path", "parents")}
        return self.model_copy(
            update={name: str(folder / file) for name, file in files.items() if isinstance(file, str)}
        )


class _Keys(NamedTuple):
    """What a process must be given, and what it may be given, besides a count."""

    needed: tuple[str, ...]
    optional: tuple[str, ...]


_EVEN = ("halton", "poisson", "strauss", "strauss_process")
"""Processes whose seeds are as many everywhere."""

_CONTRAST = ("gain", "cutoff", "threshold", "floor")
_DEFAULTS = {name: field.default for name, field in SeedsTable.model_fields.items()}
_KEYS: dict[str, _Keys] = {
    "halton": _Keys((), ("bases", "start", "scramble")),
    "poisson": _Keys((), ("exact",)),
    "cluster": _Keys(("spread",), ("parents", "children", "walls")),
    "strauss": _Keys(("distance", "inhibition"), ()),
    "strauss_process": _Keys(("distance", "inhibition"), ("intensity", "sweeps")),
    "density": _Keys(("path",), ("along",)),
    "noise": _Keys((), ("beta", "resolution", *_CONTRAST)),
    "image": _Keys(("path",), ("region", "low_pass", "order", "light", "along", *_CONTRAST)),
    "file": _Keys(("path",), ("fit", "bounds")),
}


def place(table: SeedsTable, domain: Domain, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the seeds [m], shape (n, 3), that a table describes, before relaxation."""
    keys = _KEYS[table.process]
    options = {name: getattr(table, name) for name in (*keys.needed, *keys.optional)}
    seeds = _PLACERS[table.process](domain, table.count, rng=rng, **options)
    return seeds if table.grade is None else table.grade.grade().moved(seeds, domain)


def _halton(domain: Domain, n: int, *, scramble: str, rng: np.random.Generator, **options: Any) -> NDArray[np.float64]:
    return points.halton(domain, n, **options, rng=rng if scramble == "shift" else None)


def _cluster(domain: Domain, n: int | None, *, parents: int | str | None, **options: Any) -> NDArray[np.float64]:
    where = points.read(parents) if isinstance(parents, str) else parents
    return points.cluster_poisson(domain, n, parents=where, **options)


def _density(domain: Domain, n: int, *, path: str, **options: Any) -> NDArray[np.float64]:
    return points.from_density(domain, n, points.read_density(path), **options)


def _image(domain: Domain, n: int, *, path: str, **options: Any) -> NDArray[np.float64]:
    return points.from_image(domain, n, path, **options)


def _file(domain: Domain, _n: None, *, path: str, fit: bool, bounds: Any, rng: Any) -> NDArray[np.float64]:  # noqa: ARG001  (as all are called)
    seeds = points.read(path)
    if fit or bounds is not None:
        return points.scaled(seeds, domain, bounds=bounds)
    return points.check_seeds(seeds, domain)


_PLACERS: dict[str, Callable[..., NDArray[np.float64]]] = {
    "halton": _halton,
    "poisson": points.poisson,
    "cluster": _cluster,
    "strauss": points.strauss,
    "strauss_process": points.strauss_process,
    "density": _density,
    "noise": points.pink_noise,
    "image": _image,
    "file": _file,
}
