"""What every writer asks of a packing and of a name before it begins, and how it goes through the grains."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import InputError, name_offenders, shown
from grainsdem.geometry.integrals import Integrals, integrate
from grainsdem.model import Packing, Polyhedra
from grainsdem.ragged import owners
from grainsdem.values import coefficients

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

_PREFIX = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")

STRETCH = 4096
"""Grains that are written at once: a few megabytes."""


def measured(packing: Packing) -> Integrals:
    """Return the integrals of the grains of a packing that can be written.

    Raises
    ------
    InputError
        If there is no grain, a number is not finite, a density is not positive, a quaternion is not of unit
        length, or a grain has no positive volume (its faces are wound inward, or it is flat).
    """
    if len(packing) == 0:
        raise InputError("a packing to be written must hold at least one grain; got 0")
    _refuse_not_finite(packing)
    norms = np.linalg.norm(packing.quaternions, axis=1)
    # 1e-6: a quaternion kept in single precision is let through; every program makes it one again.
    refuse("the quaternions of grains must be of unit length", np.abs(norms - 1.0) > 1e-6)
    refuse("the densities of grains must be positive", packing.densities <= 0)
    integrals = integrate(packing.grains)
    refuse("grains must have positive volume, their faces wound outward", integrals.volumes <= 0)
    return integrals


def stretches(packing: Packing) -> Iterator[tuple[int, Packing]]:
    """Yield the grains a stretch at a time: the number of the first, and a packing of at most `STRETCH` of them.

    What is made of a stretch before the next begins takes little memory, however many grains there are.
    """
    for first in range(0, len(packing), STRETCH):
        last = min(first + STRETCH, len(packing))
        yield (
            first,
            Packing(
                shapes_of(packing.grains, first, last),
                packing.positions[first:last],
                packing.quaternions[first:last],
                packing.densities[first:last],
                packing.domain,
                frictions=packing.frictions_of(slice(first, last)),
                classes=packing.classes_of(slice(first, last)),
            ),
        )


def shapes_of(grains: Polyhedra, first: int, last: int) -> Polyhedra:
    """Return the grains from number ``first`` to before ``last``."""
    v0, v1 = grains.vertex_offsets[[first, last]]
    f0, f1 = grains.face_offsets[[first, last]]
    c0, c1 = grains.face_vertex_offsets[[f0, f1]]
    return Polyhedra(
        grains.vertices[v0:v1],
        grains.vertex_offsets[first : last + 1] - v0,
        grains.face_offsets[first : last + 1] - f0,
        grains.face_vertices[c0:c1],
        grains.face_vertex_offsets[f0 : f1 + 1] - c0,
    )


def grain_names(packing: Packing) -> list[str]:
    """Return the names of the grains in their order, from g000000."""
    return [f"g{i:06d}" for i in range(len(packing))]


def class_texts(packing: Packing, pattern: str) -> list[str]:
    """Return the pattern filled with the class of each grain, or nothing for each where grains have no classes."""
    return [""] * len(packing) if packing.classes is None else [pattern % number for number in packing.classes.tolist()]


def check_positive(name: str, value: float, *, or_zero: bool = False) -> None:
    """Raise `InputError` unless ``value`` is a finite number above zero (or zero)."""
    is_number = isinstance(value, (int, float, np.number))
    if not (is_number and value <= sys.float_info.max and (value > 0 or (or_zero and value == 0))):
        raise InputError(f"{name} must be {'zero or more' if or_zero else 'positive'} and finite; got {shown(value)}")


def checked_coefficients(name: str, given: float | Mapping[str, float] | str | None) -> Any:
    """Return one coefficient or several by name, texts read, or raise `InputError`; see `grainsdem.options`."""
    try:
        return coefficients(given)
    except ValueError as error:
        got = "" if isinstance(given, Mapping) else f"; got {shown(given)}"
        raise InputError(f"{name} {error}{got}") from None


def check_prefix(prefix: str) -> None:
    """Raise `InputError` unless names of any program may begin with a prefix; an empty one does no harm."""
    if prefix and not _PREFIX.fullmatch(prefix):
        raise InputError(
            "prefix must begin with a letter or _ and hold letters, digits and _ - . / only, so that it can stand in "
            f"names; got {shown(prefix)}"
        )


def check_name(name: str) -> None:
    """Raise `InputError` unless ``name`` can be the name of a file without its suffix."""
    if not name or not name.isprintable() or any(sign in name for sign in "/\\"):
        raise InputError(f"name must be the name of a file without folder and suffix; got {name!r}")


def check_choice(name: str, value: str, allowed: Iterable[str]) -> None:
    """Raise `InputError` unless ``value`` is one of ``allowed``."""
    if value not in allowed:
        raise InputError(f"{name} must be one of {', '.join(allowed)}; got {value!r}")


def _refuse_not_finite(packing: Packing) -> None:
    """Raise `InputError` where a coordinate, pose or density is not finite."""
    bad = ~np.isfinite(packing.positions).all(axis=1)
    bad |= ~np.isfinite(packing.quaternions).all(axis=1)
    bad |= ~np.isfinite(packing.densities)
    bad[owners(packing.grains.vertex_offsets)[~np.isfinite(packing.grains.vertices).all(axis=1)]] = True
    refuse("the vertices, positions, quaternions and densities of grains must be finite", bad)


def refuse(rule: str, bad: NDArray[np.bool_]) -> None:
    """Raise `InputError` with the rule and the first grains that break it."""
    if bad.any():
        raise InputError(f"{rule}; not so: {name_offenders(np.flatnonzero(bad))}")
