"""Every command on disks that refuse: what it tells is one line, and what is there is whole or absent.

Two ways: disks in memory that are read-only, without inodes or small; and calls of the system that fail from the first,
the second, the third … on, as far as a command gets.

``python tests/failing_disks.py`` tries all and prints what was wrong and counts; with words, those commands; with
``calls``, the second way only. Disks are mounted where ``unshare --map-root-user --mount`` gives leave to.
"""

from __future__ import annotations

import builtins
import collections
import errno
import io
import os
import shutil
import subprocess
import sys
import tempfile
from itertools import chain
from pathlib import Path

import fuzzing_commands

DISKS = {
    "read-only": "ro",
    "no inodes": "nr_inodes=1",
    "one inode": "nr_inodes=2",
    "two inodes": "nr_inodes=3",
    "three inodes": "nr_inodes=4",
    "4 kB": "size=4k",
    "16 kB": "size=16k",
    "64 kB": "size=64k",
}
"""Options with which a disk in memory is mounted; its own folder takes the first inode."""

MOST = 40
"""Calls after which it is enough."""

GROWING = ("history.h5", ".state.npz", ".before.h5")
"""Ends of names of what is written bit by bit."""


def cases(folder, words=()):
    """Yield the right call of every command, and one more for each option that is written."""
    for name, command in fuzzing_commands.commands().items():
        if name in ("demo", *fuzzing_commands.NEVER) or (words and name not in words):
            continue
        taken = fuzzing_commands.parameters(command)
        arguments, options = fuzzing_commands.right_call(name, taken, folder)
        call = (name, *chain(*arguments.values()), *options)
        if any(one.written is not None and one.is_argument for one in taken):
            yield fuzzing_commands.Case(name, "", "right", call)
        for one in taken:
            if one.written is not None and not one.is_argument:
                place = f"{one.name}{fuzzing_commands.SUFFIXES[one.written.check]}"
                yield fuzzing_commands.Case(name, one.name, "right", (*call, one.flag, place))


def contents(work):
    """Return the bytes of every file in a folder, by its name."""
    return {str(path.relative_to(work)): path.read_bytes() for path in sorted(work.rglob("*")) if path.is_file()}


def mounted(work, options):
    """Mount a disk in memory at a folder."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", work], check=True)


def on(disk, case, folder, whole):
    """Run a case on a disk and return its status and what was wrong, or nothing."""
    with tempfile.TemporaryDirectory() as place:
        work = Path(place) / "work"
        work.mkdir()
        mounted(work, DISKS[disk])
        try:
            status, told, left = fuzzing_commands.called(case, folder, work)
            found = contents(work)
        finally:
            subprocess.run(["umount", work], check=True)
    return status, judged(case, status, told, left, (found, whole))


def judged(case, status, told, left, contents):
    """Return what was wrong with how a case ended and what it left, or nothing."""
    found, whole = contents
    fault = fuzzing_commands.wrong(case._replace(value="a disk"), status, told, [])
    hidden = [name for name in left if Path(name).name.startswith(".")]
    half = [name for name, content in found.items() if content != whole.get(name) and not name.endswith(GROWING)]
    lacking = sorted(whole.keys() - found.keys())
    for is_so, kind, words in (
        (hidden, "left-over", ", ".join(hidden)),
        (half, "half written", ", ".join(half)),
        (status == 0 and lacking, "silent", f"{', '.join(lacking)} not written"),
    ):
        if is_so and fault is None:
            fault = kind, words
    return fault


class Faults:
    """Calls that make, open for writing, move or change what is in a folder, of which those from one on fail.

    Parameters
    ----------
    folder : Path
        Elsewhere nothing fails.
    code : int
        Number of the error.
    first : int
        How many calls still succeed.
    """

    def __init__(self, folder, code, first):
        self.folder, self.code, self.first, self.calls = os.path.realpath(folder), code, first, 0

    def meet(self, path):
        """Count a call, and raise an error if it is one that fails."""
        if isinstance(path, int) or not os.path.realpath(path).startswith(self.folder):
            return
        self.calls += 1
        if self.calls > self.first:
            raise OSError(self.code, os.strerror(self.code), str(path))

    def __enter__(self):
        def changing(call):
            def change(path, *args, **kwargs):
                self.meet(path)
                return call(path, *args, **kwargs)

            return change

        def opening(path, flags, *args, **kwargs):
            if flags & (os.O_CREAT | os.O_WRONLY | os.O_RDWR):
                self.meet(path)
            return self.kept[os, "open"](path, flags, *args, **kwargs)

        def streaming(path, mode="r", *args, **kwargs):
            if set(mode) & set("wax+"):
                self.meet(path)
            return self.kept[io, "open"](path, mode, *args, **kwargs)

        new = {(os, name): changing(getattr(os, name)) for name in ("mkdir", "rename", "replace", "chmod", "truncate")}
        new |= {(os, "open"): opening, (io, "open"): streaming, (builtins, "open"): streaming}
        self.kept = {(module, name): getattr(module, name) for module, name in new}
        for (module, name), call in new.items():
            setattr(module, name, call)
        return self

    def __exit__(self, *_):
        for (module, name), call in self.kept.items():
            setattr(module, name, call)


def under(code, first, case, folder, whole):
    """Run a case whose calls fail from one on; return its status and what was wrong."""
    with tempfile.TemporaryDirectory() as place:
        work = Path(place) / "work"
        work.mkdir()
        with Faults(work, code, first):
            status, told, left = fuzzing_commands.called(case, folder, work)
        found = contents(work)
    return status, judged(case, status, told, left, (found, whole))


def tried(folder, words=(), *, mounting=True):
    """Yield each case, what failed, its status and what was wrong."""
    for case in cases(folder, words):
        with tempfile.TemporaryDirectory() as place:
            work = Path(place) / "work"
            work.mkdir()
            status, told, _ = fuzzing_commands.called(case, folder, work)
            whole = contents(work)
        if status not in (0, 1):
            if "max_hours" not in told:
                yield case, "nothing", status, ("right call refused", told)
            continue
        for disk in DISKS if mounting else ():
            yield case, disk, *on(disk, case, folder, whole)
        for code in (errno.EROFS, errno.ENOSPC):
            for first in range(MOST):
                ended, fault = under(code, first, case, folder, whole)
                yield case, f"{errno.errorcode[code]} from call {first + 1}", ended, fault
                if ended == status and not fault:
                    break


def main(words):
    fuzzing_commands.PATIENCE = 120  # an experiment goes on to its end, where its disk refuses
    words, mounting = [word for word in words if word != "calls"], "MOUNTING" in os.environ
    counts, wrong = collections.Counter(), 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        fuzzing_commands.prepare(folder)
        fuzzing_commands.preload()
        for case, disk, status, fault in tried(folder, words, mounting=mounting):
            counts[f"{disk.partition(' from')[0]}: exit {status}"] += 1
            if fault:
                wrong += 1
                sys.stdout.write(f"{case.name} {case.argument} | {disk} | {fault[0]}: {fault[1]}\n")
                sys.stdout.flush()
    sys.stdout.write(f"{sum(counts.values())} calls, {wrong} wrong: {dict(sorted(counts.items()))}\n")
    return wrong > 0


def entered():
    """Return the command that gives leave to mount to what follows it, or None where the system does not give it."""
    command = ["unshare", "--map-root-user", "--mount"]
    if shutil.which(command[0]) is None:
        return None
    probe = [*command, "mount", "-t", "tmpfs", "tmpfs", tempfile.gettempdir()]
    return None if subprocess.run(probe, capture_output=True, check=False).returncode else command


if __name__ == "__main__":
    leave = None if "MOUNTING" in os.environ or "calls" in sys.argv else entered()
    if leave is None:
        sys.exit(main(sys.argv[1:]))
    done = subprocess.run([*leave, sys.executable, *sys.argv], env={**os.environ, "MOUNTING": "1"}, check=False)
    sys.exit(done.returncode)
