"""What a case that has run says of the packing: its permeability."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, Field, ValidationError

from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.options import explained, number

if TYPE_CHECKING:
    import os

Number = Annotated[float, Field(allow_inf_nan=False), BeforeValidator(number)]

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
    rates = _rates(folder)
    axis = "xyz".index(case.axis)
    length = case.upper[axis] - case.lower[axis]
    velocity = float(rates[-1]) / (case.volume / length)
    permeability = velocity * case.viscosity * length / case.kinematic_pressure_drop
    late = rates[-max(len(rates) // 10, 2) :]
    return Flow(
        velocity=velocity,
        permeability=permeability,
        kozeny_carman=kozeny_carman(case.mean_diameter, case.porosity),
        reynolds=velocity * case.mean_diameter / case.viscosity,
        is_steady=bool(len(rates) > 1 and np.ptp(late) <= STEADY * abs(late[-1])),
    )


class _Case(BaseModel):
    """What is needed of ``case.json``."""

    axis: Literal["x", "y", "z"]
    lower: tuple[Number, Number, Number]
    upper: tuple[Number, Number, Number]
    volume: Annotated[Number, Field(gt=0)]
    viscosity: Annotated[Number, Field(gt=0)]
    kinematic_pressure_drop: Annotated[Number, Field(gt=0)]
    mean_diameter: Annotated[Number, Field(gt=0)]
    porosity: Annotated[Number, Field(gt=0, lt=1)]


def _case(path: Path) -> _Case:
    """Return what a case says of itself, or raise `FileFormatError` where it is none of ours."""
    try:
        case = _Case.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        raise FileFormatError(f"{path}: not the case of an export: {explained(error, lambda _: _Case)}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: not the case of an export: {' '.join(str(error).split())}") from error
    axis = "xyz".index(case.axis)
    if not case.upper[axis] > case.lower[axis]:
        raise FileFormatError(f"{path}: not the case of an export: its upper corner is not above its lower one")
    return case


def _rates(folder: Path) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the flow rate [m³/s] through the outlet after each iteration."""
    found = sorted(
        (folder / "postProcessing").glob("flowRate/*/surfaceFieldValue*.dat"), key=lambda path: path.stat().st_mtime
    )
    if not found:
        raise MissingFileError(f"{folder / 'postProcessing'}: holds no flow rate; run the case's Allrun first")
    try:
        lines = [line for line in found[-1].read_text(encoding="utf-8").splitlines() if line.partition("#")[0].strip()]
        rates = np.loadtxt(lines or ["none"], comments="#", ndmin=2)[:, 1]
        if not np.isfinite(rates).all():
            raise ValueError("a rate is not finite")  # noqa: TRY301  (told below, like all)
    except (OSError, ValueError, IndexError) as error:
        raise FileFormatError(f"{found[-1]}: not a table of flow rates: {error}") from error
    return np.asarray(rates, dtype=np.float64)
