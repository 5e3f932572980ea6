"""What surrounds the grains in the files of discrete-element programs: walls, gravity, springs, and words."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from exporters.check import check_name
from exporters.container import container_box, plane_frames
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.dem.bodies import Bodies
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

_WORD = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*")


def check_word(name: str) -> None:
    """Raise `InputError` unless ``name`` can stand as one word in the commands of another program."""
    check_name(name)
    if not _WORD.fullmatch(name):
        raise InputError(
            f"name must be of the letters A-Z and a-z, digits, and _ . + - only, for it is read; got {name!r}"
        )


class Walls(NamedTuple):
    """Flat walls, each a rectangle.

    Parameters
    ----------
    names : list of str
        ``wall_x0`` is the lower one along x, ``wall_p0`` the first plane of the domain.
    centres : ndarray, shape (k, 3)
        Middle [m] of each.
    quaternions : ndarray, shape (k, 4)
        Rotations (w, x, y, z) that turn z to the wall's normal, which points to the grains.
    halves : ndarray, shape (k, 2)
        Half lengths [m] along the turned x and y.
    """

    names: list[str]
    centres: Floats
    quaternions: Floats
    halves: Floats

    @property
    def normals(self) -> Floats:
        """Unit normals that point to the grains, shape (k, 3)."""
        return to_matrices(self.quaternions)[:, :, 2]

    def corners(self) -> Floats:
        """Return the corners [m], counter-clockwise seen from the grains, shape (k, 4, 3)."""
        signs = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        axes = to_matrices(self.quaternions)[:, None, :, :2] * self.halves[:, None, None, :]
        return np.asarray(
            self.centres[:, None] + np.einsum("kcij,cj->kci", np.broadcast_to(axes, (len(self.names), 4, 3, 2)), signs)
        )

    def plates(self, thickness: float) -> Floats:
        """Return the corners [m] of boxes behind the walls, shape (k, 8, 3): those of the wall, then those behind."""
        front = self.corners()
        return np.concatenate([front, front - thickness * self.normals[:, None]], axis=1)


def walls(packing: Packing, vertices: Floats, choice: str) -> Walls:
    """Return the container of a packing.

    Parameters
    ----------
    packing : Packing
        Its domain is the container. Along a periodic axis, where cells reach over the boundary, it is as wide as the
        grains.
    vertices : ndarray, shape (k, 3)
        Those of the grains [m] in the world, or their lowest and highest coordinates; walls reach a tenth of the
        container beyond them.
    choice : str
        One of `WALLS`. Where the bed is planar, y is up, and two more walls keep the grains in their plane.
    """
    lower, upper = container_box(packing, vertices)
    centre = (np.minimum(lower, vertices.min(axis=0)) + np.maximum(upper, vertices.max(axis=0))) / 2
    half = 0.55 * (np.maximum(upper, vertices.max(axis=0)) - np.minimum(lower, vertices.min(axis=0)))
    s = float(np.sqrt(0.5))
    # The quaternion turns z inward, and x and y along the axes named last.
    sides = {
        "wall_x0": (0, lower, (s, 0.0, s, 0.0), (2, 1)),
        "wall_x1": (0, upper, (s, 0.0, -s, 0.0), (2, 1)),
        "wall_y0": (1, lower, (s, -s, 0.0, 0.0), (0, 2)),
        "wall_y1": (1, upper, (s, s, 0.0, 0.0), (0, 2)),
        "wall_z0": (2, lower, (1.0, 0.0, 0.0, 0.0), (0, 1)),
        "wall_z1": (2, upper, (0.0, 1.0, 0.0, 0.0), (0, 1)),
    }
    planar = packing.domain.is_planar
    box = ["wall_y0", "wall_x0", "wall_x1", "wall_z0", "wall_z1"] if planar else ["wall_z0", *list(sides)[:4]]
    names = {"box": box, "floor": box[:1], "none": []}[choice]
    centres, quaternions, halves = np.empty((len(names), 3)), np.empty((len(names), 4)), np.empty((len(names), 2))
    for row, name in enumerate(names):
        axis, corner, quaternions[row], along = sides[name]
        centres[row] = centre
        centres[row, axis] = corner[axis]
        halves[row] = half[list(along)]
    if choice != "box":
        return Walls(names, centres, quaternions, halves)
    points, turns = plane_frames(packing.domain)
    return Walls(
        [*names, *(f"wall_p{k}" for k in range(len(points)))],
        np.concatenate([centres, points]),
        np.concatenate([quaternions, turns]),
        # As wide as the container from corner to corner.
        np.concatenate([halves, np.full((len(points), 2), 2 * float(np.linalg.norm(half)))]),
    )


def height(packing: Packing, vertices: Floats) -> float:
    """Return the height [m] from the container's floor to the highest vertex."""
    axis = 1 if packing.domain.is_planar else 2
    return float(vertices[:, axis].max() - container_box(packing, vertices)[0][axis])


class Springs(NamedTuple):
    """Linear contacts that suit a bed.

    Parameters
    ----------
    stiffness : float
        Force over depth [N/m].
    time_step : float
        Time step [s].
    """

    stiffness: float
    time_step: float


def springs(sizes: Bodies, depths: Floats, drop: float, gravity: float, *, steps: int) -> Springs:
    """Return the softest springs that stop every grain, fallen from ``drop`` [m], within a depth of its own.

    Parameters
    ----------
    sizes : Bodies
        The grains.
    depths : ndarray, shape (n,)
        Deepest overlap [m] that each may have.
    drop : float
        Height [m] that it falls from.
    gravity : float
        Acceleration [m/s²].
    steps : int
        Time steps in √(m/k), m being the lightest grain's mass and k the stiffness.
    """
    stiffness = float((2 * sizes.masses * gravity * drop / depths**2).max())
    return Springs(stiffness, float(np.sqrt(sizes.masses.min() / stiffness)) / steps)
