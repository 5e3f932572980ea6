"""How the joints of a user's own part are driven: by a table over time, or by a function."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from grainsdem.errors import FileFormatError, InputError, MissingFileError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

Control = Literal["position", "speed", "force"]


class PartState(NamedTuple):
    """What a function that drives a part is told of it, in SI.

    Parameters
    ----------
    positions, speeds : mapping of str to float
        Of each sliding [m, m/s] or turning [rad, rad/s] joint.
    forces : mapping of str to float
        Force [N], or torque [N m], of contacts along each joint in the last step, off by a tenth. A run that goes on
        after a kill has solved its first step anew: a function that looks at forces does not lead to the same bits.
    """

    positions: Mapping[str, float]
    speeds: Mapping[str, float]
    forces: Mapping[str, float]


Drive = Callable[[float, PartState], Mapping[str, float]]
"""Given the time [s] since the bed was at rest, and the part's state, what each joint is to do, by its name."""


class Driver:
    """What says, for each driven joint, its position, its speed or the force on it, in SI.

    Parameters
    ----------
    controls : mapping of str to {"position", "speed", "force"}
        What is said of each joint.
    ask : callable
        Given time [s] and state, returns the numbers by joint.
    end : float
        Time [s] at which it has no more to say; NaN where it never ends.
    digest : str
        What tells it from others, as far as that can be told.
    """

    def __init__(self, controls: Mapping[str, Control], ask: Drive, end: float, digest: str) -> None:
        self.controls, self.ask, self.end, self.digest = dict(controls), ask, end, digest


def parted(name: str, control: Control, where: str) -> tuple[str, Control]:
    """Return joint and control of a name such as ``lift`` or ``lift:speed``.

    Raises
    ------
    InputError
        If what stands behind the colon is no control.
    """
    joint, _, asked = name.strip().partition(":")
    if asked and asked not in get_args(Control):
        raise InputError(f"{where}: {name!r} must end in :position, :speed or :force, or in none")
    return joint, asked or control  # type: ignore[return-value]  # one of the three


def table_driver(path: str, control: Control) -> Driver:
    """Return what drives by a table: a column ``time`` [s] and one for each joint, interpolated between rows.

    Raises
    ------
    MissingFileError, FileFormatError, InputError
        If there is no such file, it is no table of numbers, or time does not grow.
    """
    file = Path(path)
    if not file.is_file():
        raise MissingFileError(f"{file}: no such file")
    content = file.read_bytes()
    try:
        rows = [row for row in csv.reader(content.decode("utf-8-sig").splitlines()) if any(map(str.strip, row))]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(f"{file}: not a table: {error}") from error
    head = [name.strip() for name in rows[0]] if rows else []
    if len(head) < 2 or head[0] != "time" or len(set(head)) < len(head):
        raise FileFormatError(
            f"{file}: the first line must be 'time' and the names of joints, each once; got "
            f"{', '.join(head) or 'nothing'}"
        )
    numbers = np.array([_numbers(file, line, row, len(head)) for line, row in enumerate(rows[1:], 2)])
    if len(numbers) < 2 or numbers[0, 0] != 0 or not np.all(np.diff(numbers[:, 0]) > 0):
        raise FileFormatError(f"{file}: time must begin at 0 and grow from row to row, two or more of them")
    columns = [parted(name, control, str(file)) for name in head[1:]]
    if len(dict(columns)) < len(columns):
        raise FileFormatError(f"{file}: a joint has one column; got {', '.join(head[1:])}")

    def ask(time: float, state: PartState) -> dict[str, float]:
        del state
        return {joint: float(np.interp(time, numbers[:, 0], numbers[:, k])) for k, (joint, _) in enumerate(columns, 1)}

    return Driver(dict(columns), ask, float(numbers[-1, 0]), hashlib.sha256(content).hexdigest())


def _numbers(file: Path, line: int, row: Sequence[str], n: int) -> list[float]:
    """Return a row's numbers."""
    try:
        values = [float(word) for word in row]
    except ValueError as error:
        raise FileFormatError(f"{file}:{line}: {error}") from error
    if len(values) != n or not np.isfinite(values).all():
        raise FileFormatError(f"{file}:{line}: {n} finite numbers are needed; got {', '.join(row)}")
    return values


def function_driver(drive: Drive, control: Control, state: PartState) -> Driver:
    """Return what drives by a function, which is asked once to learn what joints it drives.

    Raises
    ------
    InputError
        If it returns something else than numbers by name.
    """
    name = getattr(drive, "__qualname__", type(drive).__qualname__)
    first = _checked(drive(0.0, state), name)
    columns = {key: parted(key, control, f"drive {name}") for key in first}

    def ask(time: float, now: PartState) -> dict[str, float]:
        values = _checked(drive(time, now), name)
        if values.keys() != columns.keys():
            raise InputError(
                f"drive {name} must drive the same joints at every time: {', '.join(columns)}; got "
                f"{', '.join(values)} at {time:.4g} s"
            )
        return {columns[key][0]: value for key, value in values.items()}

    return Driver(dict(columns.values()), ask, float("nan"), name)


def _checked(values: Any, name: str) -> dict[str, float]:
    """Return what a function said, or raise `InputError`."""
    if not isinstance(values, Mapping):
        raise InputError(f"drive {name} must return a mapping of joints to numbers; got {values!r}")
    try:
        found = {str(key): float(value) for key, value in values.items()}
    except (TypeError, ValueError) as error:
        raise InputError(f"drive {name} must return a mapping of joints to numbers; got {values!r}") from error
    if not np.isfinite(list(found.values())).all():
        raise InputError(f"drive {name} must return finite numbers; got {values!r}")
    return found


def nothing() -> Driver:
    """Return what drives no joint."""
    return Driver({}, lambda _time, _state: {}, float("nan"), "")
