"""Commands and recipes with values that they cannot take, from their own options and keys: new ones are covered.

``python tests/fuzzing_commands.py`` tries them all and prints what was wrong and a table; with words, commands of those
names, or keys of recipes that hold one; with a number, so many of each door; with ``--every 5 --first 2`` each fifth
case from the third on. Each call has a process and an empty folder of its own.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import importlib
import inspect
import json
import math
import os
import random
import re
import signal
import sys
import tempfile
import time
from itertools import chain, islice
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from fuzzing import outcome, sort_of, tell
from pydantic import BaseModel
from typer.main import get_command

import grainsdem as gd
from grainsdem.__main__ import main
from grainsdem.cli import app
from grainsdem.cli.guard import Written
from grainsdem.recipe.experiments.tables import experiment_tables
from grainsdem.recipe.tables import VIEWS, recipe_model

PATIENCE = 20
"""Seconds after which a call counts as hung, if it had a processor for so long."""

LONGEST = 60
"""Seconds after which a call counts as hung even if others had the processors."""

NUMBERS = (
    "", "abc", "nan", "inf", "-inf", "-1", "0", "0.5", "1e-308", "1e308", "-1e308", "1e-9", "1e9", "10000000",
    "9999999999999999999999", "99999999999999999999999", "9" * 4401, "1,2", "true", "[/bold]",
)  # fmt: skip

TEXTS = (
    "", "abc", "nan", "-1", "1e308", "=", "a=1", "a=[1", "seeds.count=0", "x,y", "z=nan", "1,1,0,inf", "[/bold]",
    "[bold]a", "\n", "µ—é", "x" * 300, ".", "/dev/full", "9" * 4401, "a=" + "[" * 1000,
)  # fmt: skip

PLACES = (
    "",
    ".",
    "nowhere/out{}",
    "out.odd",
    "out",
    "/dev/full",
    "/dev/null/out{}",
    "x" * 300 + "{}",
    "[/bold]{}",
    "µ—é{}",
)
"""Where something is to be written; braces stand for the suffix that is right."""

SOURCES = (
    "", ".", "nowhere{}", "x" * 300 + "{}", "/dev/full", "{folder}/empty{}", "{folder}/junk{}", "{folder}/text{}",
    "{folder}/[bold]{}", "{folder}/words.txt",
)  # fmt: skip
"""What something is to be read from."""

VALUES = {
    "true": "true", "text": '"abc"', "empty": '""', "nan": "nan", "inf": "inf", "-inf": "-inf", "-1": "-1", "0": "0",
    "1.5": "1.5", "1e-308": "1e-308", "1e308": "1e308", "-1e308": "-1e308", "10000000": "10000000",
    "10**22": "1" + "0" * 22, "digits": "9" * 4401, "list": "[]", "list of one": "[1]", "three": "[0, 0, 0]",
    "numbers": "[1e-308, 1e308, nan]", "deep list": "[" * 500 + "]" * 500, "table": "{}", "table of one": "{a = 1}",
    "date": "1979-05-27", "path": '"nowhere.csv"', "folder": '"."', "markup": '"[/bold]"', "lines": '"a\\nb"',
    "zero byte": '"\\u0000"', "texts": '["a", "b"]', "deep table": "{a = " * 900 + "1" + "}" * 900,
}  # fmt: skip
"""Values of keys, as they stand in a recipe."""

SUFFIXES = {
    "grainsdem.storage:check_suffix": ".h5",
    "grainsdem.measures.grains.files:check_table": ".csv",
    "grainsdem.measures.grains.files:check_csv": ".csv",
    "grainsdem.measures.graph.edges:check_edges": ".csv",
    "grainsdem.figures.frame:check_suffix": ".png",
    "grainsdem.figures.motion.replaying:check_motion": ".pvd",
    "grainsdem.measures.voxels.files:check_suffix": ".npy",
    "grainsdem.points.files:check_written": ".csv",
    "grainsdem.recipe.experiments:check_forces": ".csv",
    "": "",
}
"""A right suffix for each check of what is written."""

HOURS = "0.002"
"""What a run may take by its own estimate: what takes longer is refused."""

RECIPE = """
[domain]
side = 3e-3
[seeds]
count = 27
process = "poisson"
[grains]
porosity = 0.4
keep = "all"
[output]
formats = []
figures = false
"""


class Case(NamedTuple):
    """One call: what it is called by, what is odd in it, and its words; or the recipe that is run."""

    name: str
    argument: str
    value: str
    words: tuple[str, ...]


def prepare(folder):
    """Write what right calls read, in a process of its own: one that has started threads cannot be forked."""

    def make():
        import numpy as np

        import exporters
        import grainsdem as gd

        domain = gd.Domain.cube(3e-3)
        seeds = gd.points.poisson(domain, 27, rng=1)
        packing = gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.4)
        gd.save(packing, folder / "bed.h5")
        few = gd.shrink(gd.carve(gd.tessellate(seeds[:4], domain), keep="all"), porosity=0.6)
        gd.save(few, folder / "few.h5")
        gd.settle(few, history_path=folder / "history.h5", rng=1)
        np.savetxt(folder / "seeds.csv", seeds, delimiter=",", header="x,y,z", comments="")
        np.savetxt(folder / "sections.csv", np.random.default_rng(1).uniform(1e-4, 1e-3, 80))
        exporters.write(packing, folder / "bed.stl")
        # Compiled here, once.
        gd.validate(packing)
        gd.sieve_diameters(packing)

    (folder / "recipe.toml").write_text(RECIPE)
    (folder / "sheet.csv").write_text("opening mm,passing %\n0.5,5\n1,30\n2,80\n4,100\n")
    (folder / "part.xml").write_text("<mujoco/>")
    (folder / "case").mkdir()
    (folder / "case" / "case.json").write_text("{}")
    (folder / "words.txt").write_text("these are words\n")
    for suffix in (".h5", ".toml", ".csv", ".txt", ".npy", ".xml", ".stl", ""):
        (folder / f"empty{suffix}").touch()
        (folder / f"junk{suffix}").write_bytes(bytes(range(256)) * 4)
        (folder / f"text{suffix}").write_text("[/bold]\n")
        (folder / f"[bold]{suffix}").write_text("1\n")
    child = os.fork()
    if not child:
        try:
            make()
            os._exit(0)
        finally:
            os._exit(1)
    assert os.waitpid(child, 0)[1] == 0, "what right calls read cannot be made"


def preload():
    """Import what calls import, once for all; nothing of it starts a thread."""
    for name in (
        "h5py", "scipy.spatial", "scipy.stats", "scipy.optimize", "scipy.ndimage", "matplotlib.figure", "mujoco",
        "pxr.Usd", "exporters", "grainsdem.figures", "grainsdem.survey", "grainsdem.validation", "rich.table", "csv",
    ):  # fmt: skip
        importlib.import_module(name)
    for name in ("settle", "tilt", "voxelize", "planform", "unfold", "read_sieves", "contacts", "pack", "ensemble"):
        getattr(gd, name, None)


def commands():
    """Return every command by its name."""
    group = get_command(app)
    return {name: group.get_command(None, name) for name in group.list_commands(None)}


READ = {
    "bed": "bed.h5", "recipe": "recipe.toml", "source": "seeds.csv", "sheet": "sheet.csv", "sections": "sections.csv",
    "case": "case", "history": "history.h5", "against": "bed.h5", "kernel": "bed.h5", "seeds": "seeds.csv",
    "sieves": "sheet.csv", "model": "part.xml",
}  # fmt: skip
"""What is read, by the name of its option."""

GIVEN = {"experiment": ["tilt"], "options": ["max_hours=0.002"], "name": ["tilt"]}
"""Arguments that are no paths."""

RIGHT = {
    "generate": ["--count", "27", "--side", "3e-3", "--process", "poisson", "--porosity", "0.4", "--keep", "all"],
    "survey": ["--vary", "seeds.count=20,27", "--workers", "1"],
    "images": ["--count", "1", "--set", "size=[32,32]", "--workers", "1"],
    "pack": ["--shape", "cube", "--count", "8", "--diameter", "1e-3"],
    "seeds": ["--lengths", "3e-3", "3e-3", "3e-3"],
    "voxels": ["--per-diameter", "4"],
    "phases": ["--per-diameter", "4"],
    "planform": ["--per-diameter", "4"],
    "replay": ["--pictures", "2"],
    "settle": ["--max-hours", HOURS, "--start", "place"],
    "ring-shear": ["--inner-radius", "1e-3", "--outer-radius", "3.8e-3"],
    "direct-shear": ["--aspect", "1"],
    "discharge": ["--opening", "2.5e-3"],
    "own-part": ["--model", "{folder}/part.xml"],
}
"""What else a right call needs; experiments also need to be short."""

BED = {"replay": "few.h5", "settle": "few.h5"}
"""Beds other than the usual one."""


class Parameter(NamedTuple):
    """An option or argument: its words, what it is, how many values it takes, and where it stands in the call."""

    name: str
    flag: str
    kind: Any
    n: int
    written: Written | None
    is_argument: bool


def parameters(command):
    """Return what a command takes."""
    hints = get_type_hints(inspect.unwrap(command.callback), include_extras=True)
    found = []
    for parameter in command.params:
        hint = hints.get(parameter.name)
        if hint is None:
            continue
        notes = getattr(hint, "__metadata__", ())
        written = next((note for note in notes if isinstance(note, Written)), None)
        flag = "" if parameter.param_type_name == "argument" else parameter.opts[0]
        found.append(Parameter(parameter.name, flag, plain(hint), max(parameter.nargs, 1), written, not flag))
    return found


def plain(hint):
    """Return a type without notes, None and lists about it."""
    if get_origin(hint) is Annotated:
        return plain(hint.__origin__)
    if get_origin(hint) in (Union, UnionType):
        return next(plain(part) for part in get_args(hint) if part is not type(None))
    if get_origin(hint) in (list, tuple):
        return plain(get_args(hint)[0])
    return str if get_origin(hint) is Literal else hint


def right_call(name, taken, folder):
    """Return the words of a right call: for each argument its own, and the options."""
    arguments = {}
    for one in taken:
        if not one.is_argument:
            continue
        if one.written is not None:
            suffix = ".stl" if name == "export" else SUFFIXES[one.written.check]
            arguments[one.name] = [f"out{suffix}"]
        elif one.name == "bed" and name in BED:
            arguments[one.name] = [str(folder / BED[name])]
        else:
            arguments[one.name] = [str(folder / READ[one.name])] if one.name in READ else GIVEN[one.name]
    options = [word.format(folder=folder) for word in RIGHT.get(name, [])]
    if any(one.flag == "--max-hours" for one in taken) and "--max-hours" not in options:
        options += ["--max-hours", HOURS]
    return arguments, options


def values_of(one, folder):
    """Return odd values of an option."""
    if one.kind is bool:
        return ()
    if one.written is not None:
        suffix = SUFFIXES[one.written.check]
        return tuple(place.format(suffix) for place in PLACES)
    if one.kind is Path or one.name in READ:
        suffix = Path(READ.get(one.name, "x.h5")).suffix
        return tuple(place.format(suffix, folder=folder) for place in SOURCES)
    return NUMBERS if one.kind in (int, float) else TEXTS


def command_cases(folder, words=()):
    """Yield every call: the right one of each command, and those with one odd value."""
    for name, command in commands().items():
        if words and name not in words:
            continue
        taken = parameters(command)
        arguments, options = right_call(name, taken, folder)
        if name != "demo":  # which takes minutes
            yield Case(name, "", "right", (name, *chain(*arguments.values()), *options))
        for one in taken:
            for value in values_of(one, folder):
                # Who allows a run so many hours gets it.
                if one.name == "max_hours" and value in ("inf", "1e9", "10000000", "9" * 22, "9" * 23, "9" * 4401):
                    continue
                if name == "demo" and value in ("", ".", "out", "out.odd", "nowhere/out", "[/bold]", "µ—é"):
                    continue
                given, more = dict(arguments), list(options)
                if one.is_argument:
                    given[one.name] = [value]
                else:
                    while one.flag in more:
                        place = more.index(one.flag)
                        del more[place : place + 1 + one.n]
                    # By its equals sign where it could be taken for an option.
                    more += [f"{one.flag}={value}"] if one.n == 1 else [one.flag, *(one.n - 1) * ["0.001"], value]
                # Behind two dashes nothing is an option.
                call = (name, *more, "--", *chain(*given.values()))
                yield Case(name, one.name, value, call)


def keys(model=None, path=()):
    """Yield the path of every key of a recipe, tables before their keys."""
    for name, field in (model or recipe_model()).model_fields.items():
        yield (*path, name)
        for inner in models(field.annotation):
            if len(path) < 3:
                yield from keys(inner, (*path, name))


def models(annotation):
    """Yield the models in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models(part)


BESIDE = {
    ("seeds", "cluster"): {"process": '"cluster"'},
    ("voxels",): {"per_diameter": "4"},
    ("planform",): {"per_diameter": "4"},
    ("settle",): {"max_time": "0.01", "overlap": "0.5"},
}
"""Keys that stand beside the odd one."""


def recipe_text(path, value):
    """Return a recipe of which one key has another value."""
    lines = [line for line in RECIPE.splitlines() if "=" in line or "[" in line]
    tables, table = {(): {}}, ()
    for line in lines:
        if line.startswith("["):
            table = tuple(line.strip("[]").split("."))
            tables[table] = {}
        else:
            key, _, told = line.partition(" = ")
            tables[table][key] = told
    for known, beside in BESIDE.items():
        if path[: len(known)] == known:
            tables.setdefault(known[:1], {}).update(beside)
    if path[0] in experiment_tables() and len(path) == 2:
        tables[path[:1]] = {"max_hours": HOURS}
    *where, key = path
    tables.pop(path, None)
    tables.setdefault(tuple(where), {})[key] = value
    told = [f"{key} = {text}" for key, text in tables.pop(()).items()]
    for table, rows in tables.items():
        if path[: len(table)] == table and len(path) == len(table):
            continue
        told += [f"[{'.'.join(table)}]", *(f"{key} = {text}" for key, text in rows.items())]
    return "\n".join(told) + "\n"


SURVEY_VALUES = {
    "vary": [
        "1", "[]", '{"seeds.count" = 1}', '{"seeds.count" = []}', '{"nothing" = [1]}', '{"seeds.count" = [1e308]}',
        '{"seeds.count" = [10000000000000000000000]}', '{"seeds.count.x" = [1]}', '{"" = [1]}', '{"settle.x" = [1]}',
    ],
    "combine": ["1", '"all"', '""', "[]", "true", "nan"],
    "repeats": ["0", "-1", "true", '"a"', "1.5", "nan", "1" + "0" * 22, "[1]", "{}"],
    "else": ["1"],
}  # fmt: skip


def recipe_cases(words=()):
    """Yield recipes with one odd value; a table of the survey, too."""
    for path in keys():
        name = ".".join(path)
        if words and not any(word in name for word in words):
            continue
        for told, value in VALUES.items():
            # Who asks for an experiment as it is, or allows it so many hours, gets it.
            if (name in experiment_tables() and told == "table") or (
                path[-1] == "max_hours" and told in ("1.5", "10000000")
            ):
                continue
            yield Case("run", name, told, ("run", recipe_text(path, value)))
    for key, values in SURVEY_VALUES.items():
        for value in values:
            if not words or "survey" in words:
                told = {"vary": '{"seeds.count" = [20, 27]}', "combine": '"product"', "repeats": "1", key: value}
                table = "\n".join(f"{name} = {text}" for name, text in told.items())
                yield Case("survey", f"survey.{key}", value, ("survey", f"{RECIPE}\n[survey]\n{table}\n"))
    for told, text in {
        "empty": "", "no table": "[seeds", "junk": "\x00\xff", "twice": "[seeds]\n[seeds]\n",
        "deep": "a = " + "[" * 5000, "deep keys": ".".join("a" * 900) + " = 1", "digits": "rng = " + "9" * 4401,
        "deep tables": "[" + ".".join("a" * 900) + "]",
    }.items():  # fmt: skip
        if not words:
            yield Case("run", "text", told, ("run", text))
            yield Case("survey", "text", told, ("survey", text))


def parsed(cases, folder):
    """Read recipes in one process; return those that are let through, and what was wrong with others."""
    told = folder / "parsed.json"
    child = os.fork()
    if not child:
        passed, faults = [], []
        for number, case in enumerate(cases):

            def parse(text, number=number):
                gd.recipe.parse(text)
                passed.append(number)

            fault = outcome(parse, {"text": case.words[1]})
            if fault:
                faults.append((number, fault))
        told.write_text(json.dumps([passed, faults]))
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0, "a recipe ended the interpreter"
    passed, faults = json.loads(told.read_text())
    return [cases[k] for k in passed], [(cases[k], fault) for k, fault in faults]


def called(case, folder, work):
    """Run one case in a process of its own, in an empty folder; return its status, what it told, and what it left."""
    words = list(case.words)
    if case.argument and words[0] in ("run", "survey") and len(words) == 2:
        (work.parent / "recipe.toml").write_text(words[1], errors="surrogateescape")
        words = [
            words[0],
            "--folder=out" if words[0] == "run" else "--workers=1",
            "--",
            str(work.parent / "recipe.toml"),
        ]
        words += ["out.csv"] if words[0] == "survey" else []
    told = work.parent / "told.txt"
    child = os.fork()
    if not child:
        status = 99
        try:
            os.setsid()
            with told.open("wb") as sink, Path(os.devnull).open("r+b") as nowhere:
                os.dup2(nowhere.fileno(), 0)
                os.dup2(nowhere.fileno(), 1)
                os.dup2(sink.fileno(), 2)
            os.chdir(work)
            sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
            sys.argv = ["grainsdem", *words]
            try:
                main()
                status = 0
            except SystemExit as ended:
                status = ended.code if isinstance(ended.code, int) else 1
            sys.stdout.flush()
            sys.stderr.flush()
        except BaseException:  # noqa: BLE001  (it is told as Python tells it)
            import traceback

            traceback.print_exc()
            sys.stderr.flush()
        finally:
            os._exit(status)
    status = waited(child)
    left = sorted(str(path.relative_to(work)) for path in work.rglob("*"))
    return status, told.read_text(errors="replace"), left


def waited(child):
    """Return the exit status of a child, negative for a signal, or None where it hung and was ended."""
    begun = time.monotonic()
    pause = 0.002
    while (waits := time.monotonic() - begun) < LONGEST and min(waits, worked(child)) < PATIENCE:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(pause)
        pause = min(0.05, 1.5 * pause)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def worked(child):
    """Return the seconds that a process has had a processor for; without end where the system does not tell."""
    try:
        spent = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[11:13]
    except OSError:
        return math.inf
    return sum(map(int, spent)) / os.sysconf("SC_CLK_TCK")


TOLD = ("error: ", "refused: ", "check failed: ")


def wrong(case, status, told, left):
    """Return the kind of fault and a few words, or nothing where a call ended as it should."""
    lines = [line for line in told.splitlines() if line.strip()]
    # What a run will take, and what is compiled first, is told before it.
    mine = [line for line in lines if not re.match(r"warning: |compiling kernels|\d+ grains: about ", line)]
    below = next((line for line in lines if re.search(r"\w+Warning: ", line)), "")
    hidden = [name for name in left if Path(name).name.startswith(".")]
    is_refused = case.value == "right" and status and "max_hours" not in told and case.name not in NEVER
    is_bad = bool(status)
    left = [name for name in left if f"it is kept in {name}" not in told]
    is_later = case.name == "run" and case.argument.partition(".")[0] in (*experiment_tables(), "settle", *VIEWS)
    faults = [
        (status is None, "hang", f"{PATIENCE} s"),
        ((status or 0) < 0, "crash", f"signal {status}"),
        ("Traceback (most recent call last)" in told, "traceback", " ".join(lines[-1:])),
        (below, "warning from below", below),
        (status not in (0, 1, 2), "bare error", f"exit code {status}: {mine[:1]}"),
        (is_refused, "right call refused", " ".join(mine)),
        (hidden, "left-over", ", ".join(hidden)),
        (is_bad and len(mine) > 1, "several lines", " / ".join(mine)),
        (is_bad and not " ".join(mine).startswith(TOLD), "bare error", " ".join(mine) or "nothing was told"),
        # A recipe whose bed is whole keeps it where an experiment on it is refused.
        (status == 2 and left and not is_later, "left-over", ", ".join(left)),
    ]
    return next(((kind, words[:200]) for is_so, kind, words in faults if is_so), None)


NEVER = ("permeability", "own-part")
"""Commands that no file of ours is enough for."""


def tried(cases, folder):
    """Yield each case with what was wrong with it, or nothing."""
    for case in cases:
        with tempfile.TemporaryDirectory() as place:
            work = Path(place) / "work"
            work.mkdir()
            status, told, left = called(case, folder, work)
        yield case, wrong(case, status, told, left), status


def sample(cases, n):
    """Return n of the cases, the same ones each time."""
    cases = list(cases)
    return random.Random(19).sample(cases, min(n, len(cases)))  # noqa: S311  (the same ones each time)


def counted(door, cases, folder):
    """Try the cases of a door, print what was wrong, and return the row of its table."""
    row = collections.Counter()
    begun = time.monotonic()
    before = ""
    for case, fault, status in tried(cases, folder):
        if case.name != before:
            print(f"{row['tried']} calls before {case.name}", file=sys.stderr, flush=True)  # noqa: T201
            before = case.name
        row["tried"] += 1
        row[f"exit {status}"] += 1
        if fault:
            row[fault[0]] += 1
            shown = case.value if len(case.value) < 40 else f"{case.value[:40]}…"
            print(f"{case.name} | {case.argument} = {shown!r} | {fault[0]}: {fault[1]}", flush=True)  # noqa: T201
    row["seconds"] = round(time.monotonic() - begun)
    print(f"{door}: {dict(row)}", flush=True)  # noqa: T201
    return row


def doors_of(only, words, folder):
    """Return the cases of each door by its name."""
    movers = moving()
    doors = {}
    if only != "recipes" and (not words or set(words) & set(commands())):
        for case in command_cases(folder, words):
            door = "commands that move" if case.name in movers else "commands that grow and measure"
            doors.setdefault(door, []).append(case)
    if only != "commands" and (not words or not set(words) <= set(commands())):
        doors["recipes and surveys"] = list(recipe_cases(words))
    return doors


def moving():
    """Return the names of commands that move grains: those that may be allowed hours."""
    return {name for name, one in commands().items() if any(option.name == "max_hours" for option in one.params)}


def let_through(recipes, folder):
    """Read recipes, print what was wrong, and return those to run and the row of those that reading refused."""
    passed, faults = parsed([case for case in recipes if case.name == "run"], folder)
    for case, fault in faults:
        print(f"recipe | {case.argument} = {case.value} | {fault}", flush=True)  # noqa: T201
    runs = [*passed, *(case for case in recipes if case.name != "run")]
    row = collections.Counter(sort_of(fault) for _, fault in faults)
    row["tried"] = len(recipes) - len(runs)
    print(f"recipes read: {len(recipes)}, wrong: {len(faults)}, to be run: {len(runs)}", flush=True)  # noqa: T201
    return runs, row


def all_of_it(given):
    """Try what is asked for and print a table."""
    most = next((int(word) for word in given.words if word.isdigit()), None)
    words = [word for word in given.words if not word.isdigit()]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        prepare(folder)
        preload()
        rows = {}
        for door, cases in doors_of(given.only, words, folder).items():
            chosen = cases
            if door == "recipes and surveys":
                chosen = cases if most is None else sample(cases, 3 * most)
                chosen, rows["recipes refused when read"] = let_through(chosen, folder)
            chosen = chosen if most is None else sample(chosen, most)
            rows[door] = counted(door, islice(chosen, given.first, None, given.every), folder)
        tell(rows)


def main_of_it():
    """Read what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--only", choices=("commands", "recipes"))
    parser.add_argument("--every", type=int, default=1, help="take one case of so many")
    parser.add_argument("--first", type=int, default=0, help="cases left out before it")
    all_of_it(parser.parse_args())


if __name__ == "__main__":
    main_of_it()
