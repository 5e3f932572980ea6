"""The door of every command: where it writes is looked at before it does anything, and errors become one line.

What is written by a command says so in its annotation, `Written`; nothing else checks places and suffixes there.
"""

from __future__ import annotations

import errno
import functools
import logging
import math
import os
import signal
import sys
import threading
from contextlib import contextmanager, suppress
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, NamedTuple, get_type_hints

import typer
from rich.console import Console

from grainsdem.atomic import check_place
from grainsdem.errors import GrainsDEMError, InputError, RefusedError, ValidationError, printable
from grainsdem.values import LARGEST, SMALLEST

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

FAILED, BAD, INTERRUPTED, CLOSED, TERMINATED = 1, 2, 130, 141, 143
"""Exit codes: a check failed, bad input, Ctrl-C, nobody reads what is printed, told to end."""


class TerminatedError(KeyboardInterrupt):
    """The system tells the program to end: it goes as it does at Ctrl-C."""


class Written(NamedTuple):
    """What a command says of a path that it writes.

    Parameters
    ----------
    check : str
        Module and function, parted by a colon, that raises an error of ours where the suffix is none that is written.
    is_folder : bool or None
        Whether the path is a folder, made where it is not there; None where that hangs on other options: a path with a
        suffix counts as a file, unless it is a folder already.
    """

    check: str = ""
    is_folder: bool | None = False


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Leave it to the door: rich would end the program as if a check had failed."""
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


# What is printed comes from files as well as from us, and nothing of it is to be obeyed.
out = _Console(soft_wrap=True, markup=False, emoji=False)
err = _Console(stderr=True, soft_wrap=True, markup=False, emoji=False)


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Look at where a command will write, and turn errors on purpose into one line and an exit code."""

    @functools.wraps(command)
    def run_guarded(*args: Any, **kwargs: Any) -> None:
        try:
            with heeding(), warning():
                _check_numbers(kwargs)
                _check_places(command, kwargs)
                command(*args, **kwargs)
                if sys.stdout is not None:
                    sys.stdout.flush()  # what cannot be printed is to be told here
        except (GrainsDEMError, OSError, MemoryError, KeyboardInterrupt) as error:
            code, line = _ending(error)
            if isinstance(error, BrokenPipeError) or (type(error) is OSError and error.filename is None):
                silence()
            if line:
                complain(line)
            raise typer.Exit(code) from None

    return run_guarded


@contextmanager
def heeding() -> Iterator[None]:
    """Make exceptions of signals that would end the process while the block runs, so that it tidies up."""

    def end(*_: object) -> None:
        raise TerminatedError

    handlers: dict[int, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: end}
    is_main = threading.current_thread() is threading.main_thread()
    mine = {number: handler for number, handler in handlers.items() if is_main and _is_deadly(number)}
    try:
        for number, handler in mine.items():
            signal.signal(number, handler)
        yield
    finally:
        for number in mine:
            signal.signal(number, signal.SIG_DFL)


def _is_deadly(number: int) -> bool:
    return signal.getsignal(number) is signal.SIG_DFL


def _ending(error: BaseException) -> tuple[int, str]:
    """Return the exit code and the line of an error; none where nobody reads what is printed."""
    if isinstance(error, BrokenPipeError):
        return CLOSED, ""
    if isinstance(error, KeyboardInterrupt):
        is_told = isinstance(error, TerminatedError)
        words = ["terminated" if is_told else "interrupted", *getattr(error, "__notes__", [])]
        return TERMINATED if is_told else INTERRUPTED, "; ".join(words)
    if isinstance(error, MemoryError):
        return BAD, "error: what was asked for does not fit in this machine's memory"
    if isinstance(error, OSError) and not isinstance(error, GrainsDEMError):
        where = "what is printed cannot be written" if error.filename is None else str(error.filename)
        return BAD, f"error: {where}: {error.strerror or error}"
    kinds = {ValidationError: (FAILED, "check failed"), RefusedError: (FAILED, "refused")}
    code, word = next((told for kind, told in kinds.items() if isinstance(error, kind)), (BAD, "error"))
    return code, f"{word}: {error}"


def tell_usage(error: Any) -> None:
    """Print what is wrong with what was typed, and how to read what may be; where nothing was, the help alone."""
    command = getattr(getattr(error, "ctx", None), "command_path", "")
    if type(error).__name__ == "NoArgsIsHelpError":
        error.show()
        return
    text = " ".join(error.format_message().split()).rstrip(".")
    complain(f"error: {text[:1].lower()}{text[1:]}" + (f"; {command} --help tells what is allowed" if command else ""))


def complain(line: str) -> None:
    """Print one line to the error stream."""
    with suppress(OSError):
        err.print(printable(" ".join(line.split())), highlight=False, style="red" if err.is_terminal else None)


def silence() -> None:
    """Let nothing more be printed, nor be complained of by the interpreter when it ends."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _check_numbers(given: Mapping[str, Any]) -> None:
    """Raise `InputError` where an option is a number that arithmetic does not survive."""
    for name, value in given.items():
        for part in value if isinstance(value, list | tuple) else [value]:
            if isinstance(part, float) and part and math.isfinite(part) and not SMALLEST <= abs(part) <= LARGEST:
                told = f"--{name.rstrip('_').replace('_', '-')}"
                raise InputError(f"{told} must be 0, or between {SMALLEST:g} and {LARGEST:g} in size; got {part:g}")


def _check_places(command: Callable[..., None], given: Mapping[str, Any]) -> None:
    """Raise an error of ours where something cannot be written as it is asked for."""
    seen: set[Path] = set()
    for name, kind in get_type_hints(command, include_extras=True).items():
        written = next((note for note in getattr(kind, "__metadata__", ()) if isinstance(note, Written)), None)
        value = given.get(name)
        if written is None or value is None:
            continue
        for path in [value] if isinstance(value, Path) else value:
            if written.check:
                resolve_name(written.check)(path)
            is_folder = written.is_folder
            check_place(path, is_folder=path.is_dir() or not path.suffix if is_folder is None else is_folder)
            if path.absolute() in seen:
                raise InputError(f"{path}: is given as the place of two things to be written")
            seen.add(path.absolute())


@contextmanager
def warning() -> Iterator[None]:
    """Print warnings that the library logs while the block runs, such as of what is left out, each as one line."""
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: complain(f"warning: {record.getMessage()}")  # type: ignore[method-assign]
    loggers = [logging.getLogger(name) for name in ("grainsdem", "exporters")]
    for logger in loggers:
        logger.addHandler(handler)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeHandler(handler)
