"""What a survey varies: a recipe, the keys that take several values, and how often each case is repeated."""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from grainsdem import recipe as recipes
from grainsdem.errors import FileFormatError, InputError, MissingFileError, name_offenders
from grainsdem.foreign import refusing, toml
from grainsdem.gate import gated, gated_noun
from grainsdem.recipe.base import flat
from grainsdem.recipe.changing import put

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Mapping, Sequence

    from grainsdem.recipe import Recipe


MOST_BEDS = 1_000_000
"""Beds of a survey, or photographs of a set: to plan more of them takes hours before the first is grown."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A plan of many beds.

    Parameters
    ----------
    base : mapping
        Tables of a recipe, as its TOML file has them.
    vary : mapping of str to sequence
        Values of each key, such as ``{"seeds.count": [100, 200]}``. Processes have different keys: those of one alone
        stand in a table of its own, ``{"seeds": {"count": 100, "cluster": {"parents": 9, "spread": 0.1}}}``, which
        counts for that process. With ``rng`` each of its values is a bed's own.
    combine : {"product", "zip"}
        Every combination of the values, or the first of each, the second of each, and so on.
    repeats : int
        Beds for each case, each with an rng of its own.

    Raises
    ------
    InputError
        If a key has no values, the lists to be zipped differ in length, ``rng`` is varied and there are repeats
        besides, or there is nothing to do.
    """

    base: Mapping[str, Any]
    vary: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    combine: Literal["product", "zip"] = "product"
    repeats: int = 1

    def __post_init__(self) -> None:
        empty = [key for key, values in self.vary.items() if not isinstance(values, list | tuple) or len(values) == 0]
        if empty:
            raise InputError(f"each key that is varied needs a list of values; {name_offenders(empty)} has none")
        if self.combine not in ("product", "zip"):
            raise InputError(f"combine must be 'product' or 'zip'; got {self.combine!r}")
        if self.combine == "zip" and len({len(values) for values in self.vary.values()}) > 1:
            lengths = ", ".join(f"{key}: {len(values)}" for key, values in self.vary.items())
            raise InputError(f"lists that are zipped must be equally long; got {lengths}")
        if not isinstance(self.repeats, int) or self.repeats < 1:
            raise InputError(f"repeats must be a whole number, 1 or more; got {self.repeats!r}")
        sizes = [len(values) for values in self.vary.values()]
        n_beds = self.repeats * (math.prod(sizes) if self.combine == "product" else max(sizes, default=1))
        if n_beds > MOST_BEDS:
            raise InputError(f"a survey grows at most {MOST_BEDS} beds; got {n_beds:.4g}: give fewer values or repeats")
        if "rng" in self.vary and self.repeats > 1:
            raise InputError(f"each value of rng is one bed: repeats must be 1 beside them; got {self.repeats}")
        if "settle" in self.base or any(key.startswith("settle.") for key in self.vary):
            raise InputError("a survey grows beds and does not settle them; leave out the settle table")

    def __len__(self) -> int:
        return len(self._cases()) * self.repeats

    def jobs(self) -> Iterator[tuple[dict[str, Any], int, Recipe]]:
        """Yield the varied values, the number of the repeat, and the recipe of each bed.

        Raises
        ------
        InputError
            If a key is unknown or a value out of range, or two beds would be copies of one: because they are of the
            same recipe, or have no chance in them (Halton's sequence is the same at every rng unless it is shifted).

        Notes
        -----
        A bed's own ``rng`` follows from its whole recipe, the survey's ``rng`` and the number of the repeat: it is the
        same in whatever order the work is done, and beside whatever other cases. It is the one given where ``rng`` is
        varied, and the bed is then that of `grainsdem generate`; and zero where a bed has no chance in it.
        """
        known: dict[str, dict[str, Any]] = {}
        for case, tables in self._cases():
            wanted = recipes.make(**{**tables, "rng": 0})
            if wanted.grains.shapes is not None:
                raise InputError(
                    "a survey measures beds as they grow, and grains of shapes lie loose: leave out shapes"
                )
            if wanted.has_chance:
                wanted = recipes.make(**tables)
            elif self.repeats > 1 or "rng" in case:
                raise InputError(f"the beds of {_shown(case)} would be copies of one: {wanted.told_of_copies()}")
            text = json.dumps(wanted.model_dump(mode="json", exclude={"name", "images", "output"}), sort_keys=True)
            if text in known:
                raise InputError(f"{_shown(known[text])} and {_shown(case)} are the same bed; vary something else")
            known[text] = case
            for repeat in range(self.repeats):
                rng = wanted.rng
                if wanted.has_chance and "rng" not in case:
                    digest = hashlib.sha256(f"{text} {repeat}".encode()).digest()
                    # 53 bits: exact in every program that reads the table.
                    rng = int.from_bytes(digest[:8], "big") >> 11
                yield case, repeat, wanted.model_copy(update={"rng": rng})

    def _cases(self) -> list[tuple[dict[str, Any], dict[str, Any]]]:
        """Return the varied values of each case, and its tables.

        A key of one process's own table has no meaning for another: it is not a number there, and told once.
        """
        together = itertools.product if self.combine == "product" else zip
        cases: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {}
        for number, values in enumerate(together(*self.vary.values()) if self.vary else [()]):
            case = dict(zip(self.vary, values, strict=True))
            tables = copy.deepcopy(dict(self.base))
            for key, value in case.items():
                put(tables, key, value)
            foreign = _of_other_processes(case, tables)
            case |= dict.fromkeys(foreign, math.nan)
            cases.setdefault(repr(case) if foreign else str(number), (case, tables))
        return list(cases.values())


@gated
def read(
    path: str | os.PathLike[str], *, vary: Mapping[str, Sequence[Any]] | None = None, repeats: int | None = None
) -> Survey:
    """Read a survey: a recipe with a table ``[survey]`` of ``vary``, ``combine`` and ``repeats``.

    Parameters
    ----------
    path : str or path-like
        A ``.toml`` file.
    vary : mapping, optional
        Keys and values besides those of the file, or instead of them.
    repeats : int, optional
        Beds for each case, instead of what the file says.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is not TOML.
    InputError
        If the survey table has unknown keys or impossible values.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    with refusing(path, "not TOML"):
        tables = toml(path.read_text(encoding="utf-8-sig"))  # as Notepad saves it, too
    plan = tables.pop("survey", {})
    if not isinstance(plan, dict) or not set(plan) <= {"vary", "combine", "repeats"}:
        raise InputError(f"{path}: the survey table takes vary, combine and repeats; got {plan!r}")
    if not isinstance(plan.get("vary", {}), dict):
        raise InputError(f"{path}: survey.vary must be a table of keys and lists of values; got {plan['vary']!r}")
    _find_beside(path.parent, tables)
    varied = {**flat(plan.get("vary", {})), **(vary or {})}
    try:
        return Survey(tables, varied, plan.get("combine", "product"), repeats or plan.get("repeats", 1))
    except InputError as error:
        raise type(error)(f"{path}: {error}") from None


def _find_beside(folder: Path, tables: dict[str, Any]) -> None:
    """Put the files that tables name into a folder."""
    grains = tables.get("grains")
    seeds = tables.get("seeds")
    own = list(seeds.values()) if isinstance(seeds, dict) else []  # tables of processes are among them
    layers = grains.get("layer", []) if isinstance(grains, dict) else []
    holders = [holder for holder in (grains, *layers) if isinstance(holder, dict)]
    named = [holder.get(name) for holder in holders for name in ("sizes", "sieves")]
    for table in (seeds, *own, *named):
        if isinstance(table, dict):
            files = {key: table[key] for key in ("path", "parents") if isinstance(table.get(key), str)}
            table |= {key: str(folder / name) for key, name in files.items()}


@gated
def parse_vary(items: Sequence[str]) -> dict[str, list[Any]]:
    """Return the keys and values of texts such as ``"seeds.count=100,200"``; values are read as TOML, or as words.

    Raises
    ------
    InputError
        If a text has no equals sign.

    Examples
    --------
    >>> parse_vary(["seeds.count=100,200", "seeds.process=halton,poisson"])
    {'seeds.count': [100, 200], 'seeds.process': ['halton', 'poisson']}
    """
    varied: dict[str, list[Any]] = {}
    for item in items:
        key, equals, values = item.partition("=")
        if not (key and equals and values):
            raise InputError(f"what is varied is written as key=value,value; got {item!r}")
        try:
            varied[key.strip()] = toml(f"values = [{values}]")["values"]
        except FileFormatError:
            varied[key.strip()] = [value.strip() for value in values.split(",")]
    return varied


def _of_other_processes(case: Mapping[str, Any], tables: Mapping[str, Any]) -> list[str]:
    """Return the varied keys that stand in the table of a process that is not the case's."""
    seeds = tables.get("seeds")
    process = seeds.get("process") if isinstance(seeds, dict) else None
    paths = {key: key.split(".") for key in case}
    return [key for key, path in paths.items() if path[0] == "seeds" and len(path) == 3 and path[1] != process]


def _shown(case: Mapping[str, Any]) -> str:
    """Return the values of a case as text."""
    return ", ".join(f"{key} = {value}" for key, value in case.items()) or "the recipe"
