"""What a case that has run says of the packing: its permeability."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import FileFormatError, InputError, MissingFileError, shown
from grainsdem.foreign import json_object, refusing
from grainsdem.model.arrays import LONGEST, SHORTEST

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

STEADY = 1e-3
"""Largest relative change of the flow rate over the last tenth of the iterations of a flow that is steady."""


@dataclass(frozen=True, slots=True)
class Flow:
    """Steady flow through a packing.

    Parameters
    ----------
    velocity : float
        Seepage (Darcy) velocity [m/s]: flow rate over the region's whole (mean) section.
    permeability : float
        Permeability [m²].
    kozeny_carman : float
        What Kozeny and Carman give for the porosity and the mean equal-volume diameter [m²].
    reynolds : float
        Reynolds number of the seepage velocity and the mean diameter.
    is_steady : bool
        Whether the flow rate had stopped changing.
    """

    velocity: float
    permeability: float
    kozeny_carman: float
    reynolds: float
    is_steady: bool


def kozeny_carman(diameter: float, porosity: float) -> float:
    """Return the permeability [m²] of grains of a diameter [m], d² φ³ / (180 (1 - φ)²).

    Raises
    ------
    InputError
        If the diameter is not positive, or the porosity is not between 0 and 1.

    References
    ----------
    .. [1] P. C. Carman, "Fluid flow through granular beds", Transactions of the Institution of Chemical Engineers 15
       (1937), 150-166.

    Examples
    --------
    >>> round(kozeny_carman(1e-3, 0.4) * 1e12)
    988
    """
    if not (diameter > 0 and 0 < porosity < 1):
        raise InputError(f"a diameter above 0 and a porosity between 0 and 1 are needed; got {diameter} and {porosity}")
    return diameter**2 * porosity**3 / (180 * (1 - porosity) ** 2)


def flow(folder: str | os.PathLike[str]) -> Flow:
    """Return what a case that was run gives.

    Parameters
    ----------
    folder : str or path-like
        The case: its ``case.json``, and what ``Allrun`` wrote to ``postProcessing``.

    Raises
    ------
    MissingFileError
        If it was not exported by us, or was not run.
    FileFormatError
        If ``case.json`` is not of an export, or the flow rates are not numbers.

    Notes
    -----
    Darcy's law, U = k Δp / (ν L) with Δp the kinematic pressure drop over the region's length L.
    """
    folder = Path(folder)
    for path in (folder / "case.json", folder / "postProcessing"):
        if not path.exists():
            raise MissingFileError(f"{path}: not there; export a case and run its Allrun first")
    case = _case(folder / "case.json")
    axis = "xyz".index(case["axis"])
    length = float(case["upper"][axis] - case["lower"][axis])
    # What drifts through a periodic cell: the integral of velocity, which is the flow rate times the length.
    rates = _drifts(folder)[:, axis] / length if case.get("periodic") else _rates(folder)
    velocity = float(rates[-1]) / (case["volume"] / length)
    permeability = velocity * case["viscosity"] * length / case["kinematic_pressure_drop"]
    late = rates[-max(len(rates) // 10, 2) :]
    return Flow(
        velocity=velocity,
        permeability=permeability,
        kozeny_carman=kozeny_carman(case["mean_diameter"], case["porosity"]),
        reynolds=velocity * case["mean_diameter"] / case["viscosity"],
        is_steady=bool(len(rates) > 1 and np.ptp(late) <= STEADY * abs(late[-1])),
    )


def _case(path: Path) -> dict[str, Any]:
    """Return what our exporter noted of a case, or raise `FileFormatError` where it is not what that notes."""
    with refusing(path, "not the notes of a case"):
        case = json_object(path.read_text(encoding="utf-8"))
        if case.get("axis") not in ("x", "y", "z"):
            raise FileFormatError(f"axis must be 'x', 'y' or 'z'; got {shown(case.get('axis'))}")
        for name in ("lower", "upper"):
            if not (isinstance(case.get(name), list) and len(case[name]) == 3 and all(map(_is_number, case[name]))):
                raise FileFormatError(f"{name} must be three numbers; got {shown(case.get(name))}")
        for name in ("volume", "viscosity", "kinematic_pressure_drop", "mean_diameter", "porosity"):
            if not (_is_number(case.get(name)) and case[name] > SHORTEST):
                raise FileFormatError(f"{name} must be a number above 0; got {shown(case.get(name))}")
        if not case["porosity"] < 1:
            raise FileFormatError(f"porosity must be below 1; got {case['porosity']}")
        axis = "xyz".index(case["axis"])
        if not case["upper"][axis] - case["lower"][axis] > SHORTEST:
            raise FileFormatError(f"upper must be above lower along {case['axis']}")
    return case


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LONGEST


def _rates(folder: Path) -> Floats:
    """Return the flow rate [m³/s] through the outlet after each iteration."""
    return _table(folder, "flowRate/*/surfaceFieldValue*.dat")[:, 1]


def _drifts(folder: Path) -> Floats:
    """Return the integral of velocity [m⁴/s] over the void after each iteration, shape (n, 3)."""
    return _table(folder, "drift/*/volFieldValue*.dat")[:, 1:4]


def _table(folder: Path, pattern: str) -> Floats:
    """Return the newest table of a name, of a row an iteration; vectors stand in brackets."""
    found = sorted((folder / "postProcessing").glob(pattern), key=lambda path: path.stat().st_mtime)
    if not found:
        raise MissingFileError(f"{folder / 'postProcessing'}: holds no flow rate; run the case's Allrun first")
    with refusing(found[-1], "not a table of flow rates"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a table without rows
        lines = found[-1].read_text(encoding="utf-8").replace("(", " ").replace(")", " ").splitlines()
        rows = np.loadtxt([line for line in lines if not line.startswith("#")], ndmin=2)
        if not (rows.size and np.isfinite(rows).all() and rows.shape[1] == (4 if "drift" in pattern else 2)):
            raise FileFormatError("it must hold a flow rate or more, all finite")
    return np.asarray(rows, dtype=np.float64)
