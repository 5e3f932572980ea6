"""One family of errors, each also the built-in error that a caller would expect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


class GrainsDEMError(Exception):
    """Base of every error that grainsdem raises on purpose; its words are one line, whatever it was given."""

    def __str__(self) -> str:
        text = super().__str__()
        return " ".join(text.split()) if len(text.splitlines()) > 1 else text


class InputError(GrainsDEMError, ValueError):
    """A value is outside what is allowed; the message gives both."""


class ArgumentError(InputError, TypeError):
    """An argument is of another kind than its function takes; the message gives both."""


class ShapeError(InputError):
    """An array has the wrong shape, type or offsets; the message gives both."""


class FileFormatError(GrainsDEMError, ValueError):
    """A file is not what its name says, is damaged, or is of an unknown version."""


class MissingFileError(GrainsDEMError, FileNotFoundError):
    """A file that was to be read does not exist."""

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class WriteError(GrainsDEMError, OSError):
    """A file could not be written; nothing was left behind."""

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class MissingPackageError(GrainsDEMError, ImportError):
    """An optional package is needed; the message says how to install it."""


class RefusedError(InputError):
    """One or more of several formats could not take a packing; what the others made of it is written.

    Attributes
    ----------
    refused : dict of str to str
        Why, by the name of the format or file.
    made : Any
        What was written all the same: a list of paths, or the result of a recipe.
    """

    def __init__(self, refused: Mapping[str, str], made: Any = None) -> None:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in refused.items())
        super().__init__(f"all but {len(refused)} of the files are written; {reasons}")
        self.refused = dict(refused)
        self.made = made


class ValidationError(GrainsDEMError, RuntimeError):
    """A packing failed a check of validation."""


class ConvergenceError(GrainsDEMError, RuntimeError):
    """An iteration did not come as close as was asked; the message says how close it came."""


class UnstableError(GrainsDEMError, RuntimeError):
    """A simulation went wrong and a smaller time step did not help.

    Attributes
    ----------
    last_good : Any
        The packing at the last state that passed the checks.
    """

    def __init__(self, message: str, last_good: Any = None) -> None:
        super().__init__(message)
        self.last_good = last_good


_SHOWN = 60
"""Characters of a value that an error repeats."""

_REPEATED = (bool, str, bytes, int, float, complex, list, tuple, dict, set)
"""What it repeats; of all else it tells the type."""


def shown(value: object) -> str:
    """Return a value as an error repeats it: short, and of one line.

    Examples
    --------
    >>> shown("0.4"), shown([1, 2]), shown(10**5000), shown(object())
    ("'0.4'", '[1, 2]', 'a number of thousands of digits', 'something of type object')
    """
    if getattr(value, "ndim", None) == 0 and hasattr(value, "item"):
        value = value.item()
    if value is not None and not isinstance(value, _REPEATED):
        return f"something of type {type(value).__name__}"
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # Python turns no more than thousands of digits into text
        return "a number of thousands of digits"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def printable(text: str) -> str:
    r"""Return a text whose signs a terminal shows and none of which it obeys.

    Examples
    --------
    >>> printable("a\x1b[2Jb")
    'a�[2Jb'
    """
    return text if text.isprintable() else "".join(c if c.isprintable() or c == "\n" else "�" for c in text)


def name_offenders(ids: Iterable[Any], *, most: int = 5) -> str:
    """Return the first offenders as text, and how many more there are.

    Examples
    --------
    >>> name_offenders([3, 8, 9, 12, 40, 41, 77])
    '3, 8, 9, 12, 40 and 2 more'
    """
    listed = [str(i) for i in ids]
    text = ", ".join(listed[:most])
    return f"{text} and {len(listed) - most} more" if len(listed) > most else text
