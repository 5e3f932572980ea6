"""What would not fit in this machine's memory is refused before any of it is made."""

from __future__ import annotations

import os

from grainsdem.errors import InputError, shown

SHARE = 0.8
"""Of the memory that the machine has: what one call may take."""

VARIABLE = "GRAINSDEM_MEMORY"
"""Name of the environment variable that holds another limit, in GB."""

A_SEED = 100
"""Bytes that a seed takes while seeds are made: its place, the numbers that it is drawn from, and copies."""

A_CELL = 3100
"""Bytes that a cell takes while it is grown, measured on a million of them."""

A_VOXEL = 48
"""Bytes that a voxel of a field takes, its waves included."""


def allowed_memory() -> float:
    """Return how many bytes one call may take: `SHARE` of the machine's, or what `VARIABLE` says.

    Raises
    ------
    InputError
        If the variable holds no positive number.
    """
    told = os.environ.get(VARIABLE)
    if told is None:
        if not hasattr(os, "sysconf") or "SC_PHYS_PAGES" not in os.sysconf_names:
            return float("inf")
        return SHARE * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        limit = float(told)
    except ValueError:
        limit = float("nan")
    if not limit > 0:
        raise InputError(f"{VARIABLE} must be a number of GB above 0; got {told!r}")
    return limit * 1e9


def allow_cells(n: int) -> None:
    """Raise `InputError` unless a number of cells to be grown is one or more, and so many fit in memory."""
    if n < 1:
        raise InputError(f"the number of cells must be 1 or more; got {shown(n)}")
    allow_memory(n, A_CELL, "cells")


def allow_memory(n: float, each: float, what: str) -> None:
    """Raise `InputError` where so many things of so many bytes each are more than one call may take.

    Parameters
    ----------
    n : float
        How many.
    each : float
        Bytes of each.
    what : str
        Their name, in the plural.

    Raises
    ------
    InputError
        With both numbers, how many would fit, and how the limit is raised.
    """
    limit = allowed_memory()
    if not n * each <= limit:
        raise InputError(
            f"{n:.4g} {what} would take {n * each / 1e9:.3g} GB, and {limit / 1e9:.3g} GB may be taken here, which is "
            f"enough for {limit / each:.3g}; {VARIABLE}, in GB, raises the limit"
        )
