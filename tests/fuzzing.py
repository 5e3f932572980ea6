"""Calls of every public function and method with what it cannot take, from its own signature: a new name is covered.

``python tests/fuzzing.py`` tries them all and prints a table; with words, those whose names hold one of them.
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import inspect
import io
import itertools
import os
import re
import signal
import sys
import tempfile
import time
import types
import warnings
from functools import cache
from pathlib import Path

import numpy as np
from scipy import stats

import exporters
import grainsdem as gd
from grainsdem.errors import GrainsDEMError
from grainsdem.gate.types import checks_of

PATIENCE = 20
"""Seconds after which a call counts as hung."""

KINDS = {
    "None": None,
    "text": "abc",
    "empty text": "",
    "bytes": b"abc",
    "true": True,
    "complex": 1 + 2j,
    "object": object(),
    "list of None": [None, None],
    "ragged": [[1.0, 2.0], [3.0]],
    "list of text": ["a", "b"],
    "mapping": {"a": 1},
    "set": {1, 2},
    "function": len,
    "class": int,
    "object array": np.array([None, 1], dtype=object),
    "complex array": np.ones(3, dtype=complex),
    "text array": np.array(["a", "b"]),
    "digits": 10**4400,
}
"""Values of every kind."""

NUMBERS = {
    "nan": float("nan"),
    "inf": float("inf"),
    "-inf": float("-inf"),
    "zero": 0,
    "0.0": 0.0,
    "-1": -1,
    "-1.0": -1.0,
    "half": 0.5,
    "1e-308": 1e-308,
    "1e308": 1e308,
    "2**62": 2**62,
    "10**22": 10**22,
    "-2**63": -(2**63),
    "float32": np.float32(0.3),
    "int8": np.int8(3),
    "decimal text": "1e308",
}
"""Numbers that are often out of range."""

ARRAYS = {
    "empty": np.empty(0),
    "empty list": [],
    "no rows": np.empty((0, 3)),
    "no columns": np.empty((3, 0)),
    "one": np.ones(1),
    "nan rows": np.full((3, 3), np.nan),
    "inf rows": np.full((3, 3), np.inf),
    "huge": np.full((3, 3), 1e308),
    "tiny": np.full((3, 3), 1e-308),
    "alike": np.zeros((3, 3)),
    "deep": np.zeros((2, 2, 2, 2)),
    "scalar": np.float64(2.0),
    "negative": -np.ones((3, 3)),
    "bool": np.ones(3, dtype=bool),
    "unsigned": np.full(3, 2**64 - 1, dtype=np.uint64),
    "large ids": np.array([2**62, -(2**62), 0]),
}
"""Arrays of odd shapes and values."""

BAD = {**KINDS, **NUMBERS, **ARRAYS}


@cache
def pool(folder):
    """Return valid values by the name or the type of an argument, nouns by theirs; the folder is where paths lead."""
    domain = gd.Domain.cube(3e-3)
    seeds = gd.points.poisson(domain, 27, rng=1)
    cells = gd.tessellate(seeds, domain)
    packing = gd.shrink(gd.carve(cells, keep="all"), porosity=0.4)
    n = len(packing)
    graph = gd.contacts(packing, within=1e-4)
    bed = Path(folder) / "bed.h5"
    gd.save(packing, bed)
    recipe = gd.recipe.make(domain={"side": 3e-3}, seeds={"count": 8}, grains={"porosity": 0.4, "keep": "all"})
    forms = gd.Forms(elongation=0.7)
    view = gd.planform(packing, per_diameter=4)
    voxels = gd.voxelize(packing, per_diameter=4)
    return {
        "packing": packing,
        "Packing": packing,
        "Grains": packing.grains,
        "Polyhedra": packing.grains,
        "Domain": domain,
        "Tessellation": cells,
        "ContactGraph": graph,
        "seeds": seeds,
        "points": seeds,
        "Planform": view,
        "Voxels": voxels,
        "Section": gd.section(packing, z=1.5e-3),
        "sections": gd.section(packing, z=1.5e-3),
        "Recipe": recipe,
        "Survey": gd.survey.Survey({"seeds": {"count": 8}}, {"seeds.relax": [0, 1]}),
        "path": Path(folder) / "out.csv",
        "folder": Path(folder) / "out",
        "int": 8,
        "float": 0.3,
        "str": "x",
        "bool": True,
        "shapes": gd.shapes.platonic("cube"),
        "sizes": np.linspace(1e-3, 2e-3, 27),
        "diameters": np.linspace(1e-3, 2e-3, 27),
        "values": np.linspace(1.0, 2.0, 27),
        "q": [16.0, 50.0, 84.0],
        "bounds": np.array([1e-3, 2e-3, 4e-3, 8e-3]),
        "counts": np.array([3, 9, 2]),
        "weights": np.array([3.0, 9.0, 2.0]),
        "axes": np.array([[3.0, 2.0, 1.0]]),
        "directions": np.eye(3),
        "tensor": np.eye(3) / 3,
        "radii": np.array([1e-4, 5e-4]),
        "rows": gd.table(packing),
        "times": np.array([0.0, 1.0]),
        "positions": np.stack([packing.positions] * 2),
        "quaternions": np.stack([packing.quaternions] * 2),
        "shape": (4, 4, 4),
        "gd.shaped_cells.shape": gd.Shape(0.7, 0.7),
        "Shape": gd.Shape(0.7, 0.7),
        "density": np.ones((3, 3, 3)),
        "image": np.linspace(0, 1, 64).reshape(8, 8),
        "curve": gd.Grading([1e-3, 2e-3, 3e-3], [0.0, 0.5, 1.0]),
        "suffix": ".stl",
        "word": "stl",
        "text": "[seeds]\ncount = 8\n",
        "rows of ids": np.array([0, 1]),
        "distance": 1e-5,
        "tolerance": 1e-3,
        "gap": 1e-5,
        "factor": 2.0,
        "name": "x",
        "items": ["seeds.count=1,2"],
        "options": {},
        "words": ["a=1"],
        "relation": "cho_2006_max",
        "original": packing,
        "correlation": gd.two_point_correlation(voxels),
        "chords": gd.chord_lengths(voxels),
        "roundness": 0.3,
        "stones": gd.pebble_count(view, packing, 10, rng=1),
        "gd.pebble_count.stones": 10,
        "forms": forms,
        "pictures": [np.zeros((4, 4))],
        "layers": [gd.Layer(gd.Grading([1e-3, 2e-3], [0.0, 1.0]))],
        "gd.placed_cells.size": lambda x, *_: np.full(len(x), 1e-3),
        "gd.Domain.hopper.top": [2e-3, 2e-3],
        "gd.Domain.hopper.bottom": [1e-3, 1e-3],
        "gd.Metric.along.ratios": (0.7, 0.7),
        "gd.CameraLens.of.view": view,
        "gd.CameraLens.of.distortion": [0.01, 0.0],
        "lens": gd.CameraLens(0.01, 0.0, (8, 8)),
        "lengths": [3e-3, 3e-3],
        "gd.Domain.box.lengths": [3e-3, 3e-3, 3e-3],
        "openings": [1e-3, 2e-3, 4e-3],
        "passing": [10.0, 50.0, 100.0],
        "retained": [1.0, 2.0, 0.0],
        "distribution": stats.lognorm(0.3, scale=1e-3),
        "law": gd.LogHyperbolic(2.0, 0.5, 0.3, -7.0),
        "metric": gd.Metric(np.eye(3)),
        "sheet": gd.SieveSheet.from_passing([1e-3, 2e-3], [10.0, 90.0]),
        "grade": gd.points.Grade(2.0),
        "kernel": gd.SectionKernel.ball(),
        "ellipse": gd.Lens((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),
        "links": packing.links,
        "report": gd.validate(packing),
        "unfolded": gd.unfold(np.linspace(1e-3, 2e-3, 80)),
        "ensemble": gd.Ensemble((0, 1), (_outcome(), _outcome()), "batch"),
        "Drawn": forms.draw(27, np.random.default_rng(1)),
        "np.random.Generator": np.random.default_rng(1),
        "other": gd.Grading([1e-3, 2e-3, 4e-3], [0.0, 0.5, 1.0]),
        "others": (),
        "percent": [16.0, 84.0],
        "masses": np.ones(27),
        "kept": np.ones(27, dtype=bool),
        "found": np.zeros(27, dtype=int),
        "shares": np.ones(1),
        "ratios": np.full((27, 2), 0.7),
        "units": np.full((27, 3), 0.5),
        "r": [0.0, 0.5],
        "picture": np.zeros((8, 8)),
        "gd.CameraLens.inward.drawn": [0.0, 0.5],
        "gd.SectionKernel.cdf.ratios": [0.5, 1.0],
        "gd.Ensemble.curve.over": "time",
        "gd.Ensemble.curve.of": "energy",
        "gd.Packing": dataclasses.replace(packing, frictions=np.full(n, 0.5), classes=np.zeros(n, dtype=int)),
        "gd.Forms": gd.Forms({"blade": 0.5, "rod": 0.5}),
        "gd.Forms.dealt.shares": np.full(2, 0.5),
        "gd.Grading.draw.n": 3,
        "gd.recipe.Silent": gd.recipe.Silent(),
        "gd.ContactGraph.select.rows": np.array([0, 1]),
        "gd.Packing.classes_of.rows": np.array([0, 1]),
        "gd.Packing.frictions_of.rows": np.array([0, 1]),
        "gd.Polyhedra.vertices_of.i": 0,
        "gd.Polyhedra.faces_of.i": 0,
        "gd.Section.polygon.j": 0,
        "gd.recipe.varied.changes": {"seeds.count": 8},
        "gd.survey.means.table": gd.table(packing),
        "gd.widths.direction": [0.0, 0.0, 1.0],
        "experiment": gd.tilt,
        "friction": 0.5,
        "tell": print,
        "grow": lambda *_: cells,
        "history": {"time": np.arange(3.0), "energy": np.ones(3)},
        "gd.figures.replay.history": bed,
        "gd.load.path": bed,
        "gd.load_moved.path": bed,
        "exporters.read.path": bed,
        "exporters.opening.name": "yade",
    }


def _outcome():
    """Return what an ensemble needs of a run."""
    return types.SimpleNamespace(history={"time": np.arange(3.0), "energy": np.ones(3)})


@cache
def public():
    """Return every public function and class by the name that users call it by."""
    found = {}

    def enter(module, prefix, depth):
        for name in module.__all__:
            value = getattr(module, name)
            if isinstance(value, types.ModuleType):
                if depth < 2 and hasattr(value, "__all__"):
                    enter(value, f"{prefix}.{name}", depth + 1)
            elif inspect.isfunction(value) or inspect.isclass(value):
                found.setdefault(value, f"{prefix}.{name}")

    enter(gd, "gd", 0)
    enter(exporters, "exporters", 0)
    return {name: value for value, name in found.items()}


def functions():
    """Return every public function by the name that users call it by."""
    return {name: value for name, value in public().items() if inspect.isfunction(value)}


def nouns():
    """Return every public class by the name that users call it by, save errors and what users write themselves."""
    return {
        name: kind
        for name, kind in public().items()
        if inspect.isclass(kind) and not issubclass(kind, Exception) and not getattr(kind, "_is_protocol", False)
    }


def constructors():
    """Return what makes public nouns: their classes, and their class methods."""
    made = {}
    for name, kind in nouns().items():
        made[name] = kind
        made |= {f"{name}.{method}": getattr(kind, method) for method in own(kind, classmethod)}
    return made


def own(kind, sort):
    """Yield the names of the public methods of a sort that a class has from this project, not from what it is built on.

    Those without a docstring, and those of the classes below it that are not public, are nobody's but the project's.
    """
    for name in dir(kind):
        holder = next((one for one in kind.__mro__ if name in vars(one)), object)
        method = vars(holder).get(name)
        is_ours = holder.__module__.partition(".")[0] in ("grainsdem", "exporters") and holder in nouns().values()
        if not name.startswith("_") and is_ours and isinstance(method, sort) and inspect.getdoc(method):
            yield name


def methods(folder):
    """Return the public methods of nouns that take something, of a right noun; None where the pool has no such noun."""
    found = {}
    for name, kind in nouns().items():
        likely = pool(folder)
        noun = likely.get(name, next((one for one in likely.values() if type(one) is kind), None))
        for method in own(kind, types.FunctionType):
            if len(inspect.signature(getattr(kind, method)).parameters) > 1:
                found[f"{name}.{method}"] = None if noun is None else getattr(noun, method)
    return found


def valid(name, function, folder):
    """Return arguments by name that a function should take, as far as the pool has them."""
    from_pool = pool(folder)
    alike = next(
        (one for one in from_pool.values() if type(one) is function and dataclasses.is_dataclass(function)), None
    )
    if alike is not None:
        return {field.name: getattr(alike, field.name) for field in dataclasses.fields(alike) if field.init}
    given = {}
    for parameter in inspect.signature(function).parameters.values():
        if parameter.default is not parameter.empty or parameter.kind in (
            parameter.VAR_KEYWORD,
            parameter.VAR_POSITIONAL,
        ):
            continue
        kind = str(parameter.annotation).removesuffix(" | None")
        for key in (f"{name}.{parameter.name}", parameter.name, kind, kind.rpartition(".")[2].rstrip("'>")):
            if key in from_pool:
                given[parameter.name] = from_pool[key]
                break
    return given


def lacking(function, given):
    """Return the arguments that a call lacks."""
    found = inspect.signature(function).parameters.values()
    needed = [one for one in found if one.kind not in (one.VAR_KEYWORD, one.VAR_POSITIONAL)]
    return [one.name for one in needed if one.default is one.empty and one.name not in given]


class HungError(Exception):
    """A call took longer than anyone waits."""


@contextlib.contextmanager
def patience(seconds):
    """Raise `HungError` in what takes longer."""

    def ring(*_):
        raise HungError

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def outcome(function, arguments, seconds=PATIENCE):
    """Return nothing where a call has a result or an error of ours in one line, else what was wrong with it."""
    told = io.StringIO()
    with warnings.catch_warnings(record=True) as heard, contextlib.redirect_stderr(told):
        warnings.simplefilter("always")
        try:
            with patience(seconds):
                result = function(**arguments)
                if inspect.isgenerator(result):
                    next(result, None)
        except GrainsDEMError as error:
            text = str(error)
            if "\n" in text or not text:
                return f"{type(error).__name__} of {text.count(chr(10)) + 1} lines: {text[:80]!r}"
        except HungError:
            return f"hung for {seconds} s"
        except BaseException as error:  # noqa: BLE001  (whatever it is, it is a finding)
            return f"{type(error).__name__}: {str(error)[:120]}"
    foreign = [str(one.message)[:80] for one in heard if not str(one.filename).endswith("fuzzing.py")]
    return f"a warning from below: {foreign[0]}" if foreign else None


LONG = {
    "settle", "collapse", "direct_shear", "discharge", "drum", "compact", "feed", "own_part", "penetration",
    "ring_shear", "tap", "tilt", "triaxial", "ensemble", "gd.recipe.run",
}  # fmt: skip
"""Functions whose right calls take minutes: they are tried with wrong kinds alone."""

OF_USERS = ("Callable", "PerGrain", "Strength", "Density", "Monitor")
"""Types that functions of users are among."""

PATIENT = {"None", "true", "function", "class"}
"""Kinds that some of their arguments take."""


def tried(folder, words, found=None, every=1):
    """Yield the name, the argument, the value and what was wrong, or nothing, of every call, or of one of so many."""
    number = itertools.count()
    if found is None:
        found = {**functions(), **constructors(), **methods(folder)}
    for name, function in found.items():
        if words and not any(word in name for word in words):
            continue
        is_long = name in LONG or name.rpartition(".")[2] in LONG
        right = valid(name, function, folder)
        if inspect.isclass(function) and lacking(function, right):  # made by functions, by nobody else
            continue
        for argument in inspect.signature(function).parameters.values():
            is_free = argument.kind is argument.VAR_KEYWORD
            # Options that functions pass on have names, of which Python itself tells a wrong one.
            if argument.kind is argument.VAR_POSITIONAL or (is_free and not inspect.ismethod(function)):
                continue
            key = "odd" if is_free else argument.name
            allowed = checks_of(function).get(argument.name, ("", None))[0]
            for word, value in (KINDS if is_long else BAD).items():
                if is_long and (word in PATIENT or argument.name in ("max_hours", "max_time", "resume", "rng")):
                    continue
                if is_long and word == "text" and "a path" in allowed:  # which is right: it would run for minutes
                    continue
                # A function of the user's own may raise what it likes.
                if word in ("function", "class") and any(name in str(argument.annotation) for name in OF_USERS):
                    continue
                if next(number) % every == 0:
                    yield name, argument.name, word, outcome(function, {**right, key: value})


FAULTS = {
    "traceback": "",
    "crash": "ended the process",
    "hang": "hung |took ",
    "bare error": "",
    "several lines": r"\w+ of \d+ lines",
    "warning from below": "a warning|printed ",
    "left-over": "left-over",
    "right call refused": "",
}
"""Columns of the table, and how words for what was wrong begin."""


def sort_of(wrong):
    """Return the column for what was wrong: where no other is meant, an error of another's kind."""
    return next((sort for sort, begin in FAULTS.items() if begin and re.match(begin, wrong)), "bare error")


def tell(rows):
    """Print a table with a row of counts for each door."""
    print("| door | tried | " + " | ".join(FAULTS) + " |")  # noqa: T201
    print("|---" * (len(FAULTS) + 2) + "|")  # noqa: T201
    for door, row in rows.items():
        print(f"| {door} | {row['tried']} | " + " | ".join(str(row[sort]) for sort in FAULTS) + " |")  # noqa: T201


def main():
    """Print what was wrong, call by call, and how many calls there were of each kind."""
    folder = tempfile.mkdtemp()
    os.chdir(folder)
    row, n, begun = collections.Counter(), 0, time.monotonic()
    before = ""
    for name, argument, word, wrong in tried(folder, sys.argv[1:]):
        n += 1
        if name != before:
            print(f"{n} calls before {name}", file=sys.stderr, flush=True)  # noqa: T201
            before = name
        if wrong:
            row[sort_of(wrong)] += 1
            print(f"{name} | {argument} = {word} | {wrong}", flush=True)  # noqa: T201  (what it is run for)
    hidden = [path.name for path in Path(folder).rglob(".*")]
    if hidden:
        print(f"left-over: {', '.join(hidden)}")  # noqa: T201
    print(f"{n} calls in {time.monotonic() - begun:.0f} s")  # noqa: T201
    tell({"functions, constructors and methods": row + collections.Counter({"tried": n, "left-over": len(hidden)})})


if __name__ == "__main__":
    main()
