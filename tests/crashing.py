"""Commands killed at random moments: what is on disk is whole or absent, and what goes on ends in the same bits.

``python tests/crashing.py 50`` kills each of them fifty times and prints how often, and what was found; with names,
those alone; with ``--stop TERM`` or ``INT`` they are told to end, which they do with one line and nothing half made.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import csv
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import NamedTuple

import fuzzing_commands

from grainsdem.__main__ import main

RECIPE = (
    fuzzing_commands.RECIPE.replace("formats = []", 'formats = ["xml", "stl"]')
    + """
[settle]
max_time = 0.05
overlap = 0.1
"""
)


STOPS = {
    signal.SIGKILL: (-signal.SIGKILL,),
    signal.SIGTERM: (143, -signal.SIGTERM),
    signal.SIGINT: (130, -signal.SIGINT),
}
"""How commands end that are stopped; by the signal itself where they had not begun."""


class Job(NamedTuple):
    """What is killed: its words, what goes on from what it left, and how often it is killed before it may end."""

    words: tuple[str, ...]
    again: tuple[str, ...]
    kills: int = 1
    growing: tuple[str, ...] = ()
    """Files that are written bit by bit: they are to be readable, not whole."""


def jobs(folder):
    """Return the jobs by name; they run in a folder of their own."""
    bed, recipe = str(folder / "bed.h5"), str(folder / "slow.toml")
    settle = ("settle", bed, "out.h5", "--history", "history.h5", "--max-time", "0.1", "-q")
    tilt = ("tilt", bed, "out.h5", "--history", "history.h5", "--max-angle", "0.3", "--rate", "0.05", "-q")
    survey = ("survey", str(folder / "recipe.toml"), "out.csv", "--vary", "rng=0,1,2,3,4,5,6,7", "--workers", "1", "-q")
    images = (
        "images",
        str(folder / "recipe.toml"),
        "out",
        "--count",
        "6",
        "--set",
        "size=[48,48]",
        "--workers",
        "1",
        "-q",
    )
    export = ("export", bed, "out", "--to", "stl", "--to", "mjcf", "--to", "usd", "-q")
    grown = ("generate", "out.h5", "--count", "20000", "--scale", "0.9", "-q")
    return {
        "save": Job(grown, grown),
        "export": Job(export, (*export, "--force")),
        "survey": Job(survey, survey),
        "images": Job(images, images),
        "run": Job(
            ("run", recipe, "--folder", "out", "-q"),
            ("run", recipe, "--folder", "out", "-q"),
            growing=("out/history.h5",),
        ),
        "settle": Job(settle, (*settle, "--resume"), kills=3, growing=("history.h5",)),
        "tilt": Job(tilt, (*tilt, "--resume"), kills=2, growing=("history.h5",)),
    }


def start(words, work):
    """Start a command in a folder and return its process."""
    child = os.fork()
    if child:
        return child
    status = 99
    try:
        os.chdir(work)
        with (work.parent / "told.txt").open("wb") as sink:
            os.dup2(sink.fileno(), 2)
        sys.argv = ["grainsdem", *words]
        main()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 1
    except BaseException:  # noqa: BLE001  (it is told as Python tells it)
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(status)


def end(child):
    """Wait for a process and return its exit status."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def contents(work):
    """Return the bytes of every file that is not hidden, by its name."""
    found = {str(path.relative_to(work)): path for path in sorted(work.rglob("*")) if path.is_file()}
    return {
        name: path.read_bytes() for name, path in found.items() if not any(p.startswith(".") for p in Path(name).parts)
    }


def readable(name, path):
    """Raise an error of ours where a file that grows cannot be read."""
    from grainsdem.storage import load_history

    load_history(path / name)


def look(job, work, whole):
    """Return what is wrong with what a killed command left, or nothing."""
    for name, content in contents(work).items():
        if name in job.growing:
            try:
                readable(name, work)
            except Exception as error:  # noqa: BLE001  (it is told)
                return f"{name} cannot be read: {error}"
        elif name.endswith(".csv") and job.words[0] in ("survey", "images"):
            rows, all_rows = (list(csv.reader(text.decode().splitlines())) for text in (content, whole[name]))
            if any(row not in all_rows for row in rows):
                return f"{name} holds a row that is not one of the whole table"
        elif not name.endswith((".state.npz", ".before.h5")) and content != whole.get(name):
            return f"{name} is neither whole nor absent"
    return None


def ill_ended(ended, stop, work):
    """Return what is wrong with how a command ended that was told to, or nothing."""
    if stop is signal.SIGKILL or ended == 0:
        return None
    told = (work.parent / "told.txt").read_text()
    if ended not in STOPS[stop]:
        return f"ended with {ended}: {told[-800:]}"
    lines = [line for line in told.splitlines() if not line.startswith(("warning: ", "compiling kernels"))]
    if len(lines) > 1:
        return f"told in {len(lines)} lines: {' / '.join(lines)[-900:]}"
    left = [str(path.relative_to(work)) for path in work.rglob(".*")]
    return f"left at once: {', '.join(left)}" if left else None


def killed(job, work, whole, duration, rng, row, stop):
    """Kill a job at random moments, look at what it left, let it go on, and return what was wrong, or nothing."""
    words = job.words
    for _ in range(job.kills):
        child = start(words, work)
        time.sleep(duration * rng.random())
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, stop)
        ended = end(child)
        row["killed" if ended in STOPS[stop] else "had ended"] += 1
        wrong = look(job, work, whole) or ill_ended(ended, stop, work)
        if wrong:
            return wrong
        words = job.again
    status = end(start(words, work))
    if status:
        return f"what went on ended with {status}: {(work.parent / 'told.txt').read_text()[:200]}"
    after = contents(work)
    for name in whole.keys() | after.keys():
        if name not in job.growing and after.get(name) != whole.get(name):
            return f"{name} is not that of the undisturbed run"
    left = [str(path.relative_to(work)) for path in work.rglob(".*")]
    return f"left: {', '.join(left)}" if left else None


def crashed(n, names=(), stop=signal.SIGKILL):
    """Kill every job n times and return the counts by its name; what was wrong is in ``wrong``."""
    found = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        fuzzing_commands.prepare(folder)
        (folder / "slow.toml").write_text(RECIPE)
        fuzzing_commands.preload()
        for name, job in jobs(folder).items():
            if names and name not in names:
                continue
            row = found[name] = collections.Counter()
            work = folder / "work"
            for attempt in range(2):  # the first one compiles
                shutil.rmtree(work, ignore_errors=True)
                work.mkdir()
                begun = time.monotonic()
                status = end(start(job.words, work))
                assert not status, f"{name} {attempt}: {status} {(folder / 'told.txt').read_text()}"
                duration = time.monotonic() - begun
            whole, rng = contents(work), random.Random(f"{name} 19")  # noqa: S311  (the same moments each time)
            for _ in range(n):
                shutil.rmtree(work)
                work.mkdir()
                wrong = killed(job, work, whole, duration, rng, row, stop)
                row["tried"] += 1
                if wrong:
                    row[f"wrong: {wrong}"] += 1
            print(f"{name}, of {duration:.2f} s: {dict(row)}", flush=True)  # noqa: T201
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("times", type=int, nargs="?", default=50)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--stop", choices=("KILL", "TERM", "INT"), default="KILL")
    given = parser.parse_args()
    crashed(given.times, given.names, signal.Signals[f"SIG{given.stop}"])
