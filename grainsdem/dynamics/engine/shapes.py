"""Shapes and places of the parts of MuJoCo's models, as pictures need them: convex hulls in the parts' frames."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

SIDES = 32
"""Corners of what stands for a circle."""


def hulls_of_parts(model: Any, parts: tuple[str, ...], id_of_geom: NDArray[np.int64]) -> dict[str, list[Floats]]:
    """Return the corners [d] of the convex shapes of each part that has any, in the frame of the part.

    Glued grains are grains, not shapes of the plate that holds them; planes have no corners.
    """
    found: dict[str, list[Floats]] = {}
    for geom in np.flatnonzero(id_of_geom < 0).tolist():
        name = parts[-1 - int(id_of_geom[geom])]
        holder = model.body(int(model.geom_bodyid[geom])).name
        corners = _corners(model, geom)
        if corners is not None and (holder == name or holder in ("world", "container")):
            turn = to_matrices(model.geom_quat[geom][None])[0]
            found.setdefault(name, []).append(corners @ turn.T + model.geom_pos[geom])
    return found


def places_of_parts(model: Any, data: Any, numbers: list[int], id_of_geom: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return positions [d], shape (b, 3), and quaternions, shape (b, 4), of parts by number; NaN where removed."""
    import mujoco

    mujoco.mj_kinematics(model, data)
    positions, quaternions = np.full((len(numbers), 3), np.nan), np.full((len(numbers), 4), np.nan)
    for row, number in enumerate(numbers):
        geoms = np.flatnonzero(id_of_geom == -1 - number)
        if np.any(model.geom_contype[geoms] | model.geom_conaffinity[geoms]):
            body = model.geom_bodyid[geoms[0]]
            positions[row], quaternions[row] = data.xpos[body], data.xquat[body]
    return positions, quaternions


def _corners(model: Any, geom: int) -> Floats | None:
    """Return corners of a shape in its own frame, of curved ones as many as pictures need; none of a plane."""
    import mujoco

    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom], dtype=np.float64)
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, n = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        return np.array(model.mesh_vert[first : first + n], dtype=np.float64)
    found: dict[Any, Floats] = {
        kinds.mjGEOM_BOX: np.array(list(product((-1.0, 1.0), repeat=3))) * size,
        kinds.mjGEOM_CYLINDER: _at_both_ends(size[0] * _circle(), size[1]),
        kinds.mjGEOM_SPHERE: size[0] * _ball(),
        kinds.mjGEOM_ELLIPSOID: size * _ball(),
        kinds.mjGEOM_CAPSULE: _at_both_ends(size[0] * _ball(), size[1]),
    }
    return found.get(kinds(kind))


def _circle() -> Floats:
    """Return points on a circle of radius one in the plane of x and y, shape (SIDES, 3)."""
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros(SIDES)])


def _ball() -> Floats:
    """Return points on a sphere of radius one."""
    heights = np.sin(np.pi * (np.arange(1, SIDES // 2) / (SIDES // 2) - 0.5))
    rings = [_circle() * np.sqrt(1 - z * z) + [0.0, 0.0, z] for z in heights]
    return np.concatenate([*rings, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])


def _at_both_ends(points: Floats, half: float) -> Floats:
    """Return points twice, half a length along z to either side."""
    step = np.array([0.0, 0.0, half])
    return np.concatenate([points - step, points + step])
