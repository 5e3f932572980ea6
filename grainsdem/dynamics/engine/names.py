"""What a compiled model's shapes and coordinates belong to: grains by number, parts of the apparatus by name."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


_GRAIN = re.compile(r"g\d{6,}")


def grain_numbers(bodies: list[str]) -> NDArray[np.int64]:
    """Return the number of the grain that each body is by its name, −1 for a part, shape (n_bodies,)."""
    return np.array([int(name[1:]) if _GRAIN.fullmatch(name) else -1 for name in bodies], np.int64)


def name_parts(
    model: Any, bodies: list[str], grain_of_body: NDArray[np.int64]
) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Return the parts' names and, for each geom, its grain's number or −1 − its part's, shape (n_geoms,)."""
    parts: list[str] = []
    ids = np.empty(model.ngeom, dtype=np.int64)
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        moves_freely = grain_of_body[body] >= 0 and model.body_dofnum[body] > 0
        if moves_freely:
            ids[geom] = grain_of_body[body]
            continue
        holder = model.body_parentid[body] if grain_of_body[body] >= 0 else body  # a glued grain belongs to its plate
        # The walls of the container are parts of their own.
        name = model.geom(geom).name if bodies[holder] in ("world", "container") else bodies[holder]
        if name not in parts:
            parts.append(name)
        ids[geom] = -1 - parts.index(name)
    return tuple(parts), ids


def name_of_coordinate(model: Any, grain_of_body: NDArray[np.int64], number: int, *, is_speed: bool) -> str:
    """Return what body a position's or a speed's number belongs to."""
    first = model.jnt_dofadr if is_speed else model.jnt_qposadr
    body = int(model.jnt_bodyid[int(np.searchsorted(first, number, side="right")) - 1])
    grain = grain_of_body[body]
    return f"grain {grain}" if grain >= 0 else str(model.body(body).name)
