"""What a model's text says that Box3D needs: grains and the walls of a container that stands still."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from grainsdem.dynamics.engine.names import grain_numbers
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import to_matrices
from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_ELSEWHERE = "; engine='mujoco' has it"


class Walls(NamedTuple):
    """Planes that grains cannot pass.

    Parameters
    ----------
    names : tuple of str
        Names of the k walls.
    points : ndarray, shape (k, 3)
        A point [d] of each.
    rotations : ndarray, shape (k, 3, 3)
        Turn z to the side that the grains are on.
    frictions : ndarray, shape (k,)
        Coefficient of friction with grains.
    """

    names: tuple[str, ...]
    points: Floats
    rotations: Floats
    frictions: Floats


class Model(NamedTuple):
    """A bed in grain units.

    Parameters
    ----------
    time_step : float
        Time step [t].
    gravity : ndarray, shape (3,)
        Acceleration [g].
    grains : Polyhedra or None
        Shapes in their own frames; nothing where grains are spheres.
    radii : ndarray, shape (n,), or None
        Radii [d] of spheres.
    positions, quaternions : ndarray, shapes (n, 3) and (n, 4)
        Poses of the frames at the start.
    masses : ndarray, shape (n,)
        Masses.
    centres : ndarray, shape (n, 3)
        Centres of mass in the grains' frames [d].
    inertias : ndarray, shape (n, 3, 3)
        About those, along the frames' axes.
    is_planar : bool
        Whether grains move in x and y and turn about z alone.
    friction : float
        Coefficient of friction among grains.
    walls : Walls
        The container.
    """

    time_step: float
    gravity: Floats
    grains: Polyhedra | None
    radii: Floats | None
    positions: Floats
    quaternions: Floats
    masses: Floats
    centres: Floats
    inertias: Floats
    is_planar: bool
    friction: float
    walls: Walls


def parse(text: str) -> Model:
    """Return what a text says that our exporter wrote.

    Raises
    ------
    InputError
        If it has what Box3D cannot do: parts that move, glued grains, frictions by grain, rolling friction, bounces.
    """
    root = ET.fromstring(text)  # noqa: S314  (our own exporter's text)
    option, world = _find(root, "option"), _find(root, "worldbody")
    bodies = world.findall("body")
    numbers = grain_numbers([body.get("name", "") for body in bodies])
    grains = [bodies[k] for k in np.argsort(numbers, kind="stable") if numbers[k] >= 0]
    for body, number in zip(bodies, numbers.tolist(), strict=True):
        if number < 0 and (body.find("body") is not None or body.find("joint") is not None):
            raise InputError(f"Box3D has no parts that move, such as {body.get('name')}{_ELSEWHERE}")
    classes = {kind.get("class", ""): _find(kind, "geom") for kind in _find(root, "default").findall("default")}
    shapes = [_find(body, "geom") for body in grains]
    _refuse_bouncing(_find(_find(root, "default"), "geom"))
    friction = _friction_of([shape.get("friction") for shape in shapes], classes["grain"])
    inertial = [_find(body, "inertial") for body in grains]
    turns = to_matrices(_table(inertial, "quat", 4))
    is_sphere = bool(shapes) and shapes[0].get("mesh") is None
    return Model(
        float(option.get("timestep", "0")),
        _numbers(option.get("gravity", "")),
        None if is_sphere else _polyhedra(root, [shape.get("mesh", "") for shape in shapes]),
        _table(shapes, "size", 1)[:, 0] if is_sphere else None,
        _table(grains, "pos", 3),
        _table(grains, "quat", 4),
        _table(inertial, "mass", 1)[:, 0],
        _table(inertial, "pos", 3),
        np.einsum("nij,nj,nkj->nik", turns, _table(inertial, "diaginertia", 3), turns),
        bool(grains) and _is_planar(grains),
        friction,
        _walls([*world.findall("geom"), *(geom for body in bodies if body.get("name") == "container" for geom in body)],
               classes["wall"], friction, int(shapes[0].get("priority", "0")) if shapes else 0),
    )  # fmt: skip


def _is_planar(grains: list[ET.Element]) -> bool:
    """Return whether the grains have joints of a plane; none of them may hang on nothing."""
    if any(body.find("freejoint") is None and body.find("joint") is None for body in grains):
        raise InputError(f"Box3D has no grains that are glued to a part{_ELSEWHERE}")
    return grains[0].find("freejoint") is None


def _refuse_bouncing(default: ET.Element) -> None:
    if float(default.get("solref", "0 1").split()[1]) != 1.0:
        raise InputError(f"Box3D has no restitution of contacts here{_ELSEWHERE}")


def _friction_of(own: list[str | None], default: ET.Element) -> float:
    """Return the one coefficient that all grains have; rolling friction and several of them are refused."""
    told = {default.get("friction", "") if word is None else word for word in own} or {default.get("friction", "")}
    if len(told) > 1:
        raise InputError(f"Box3D takes one friction for all grains; got {len(told)} of them{_ELSEWHERE}")
    numbers = _numbers(told.pop())
    if numbers.size > 1 and (numbers[1:] > 0).any() and int(default.get("condim", "3")) > 3:
        raise InputError(f"Box3D has no rolling friction here{_ELSEWHERE}")
    return float(numbers[0]) if int(default.get("condim", "3")) > 1 else 0.0


def _walls(geoms: list[ET.Element], default: ET.Element, friction: float, priority: int) -> Walls:
    """Return the planes of the container, with the friction that each has with grains."""
    planes = [geom for geom in geoms if geom.get("class") == "wall"]
    if len(planes) < len(geoms):
        raise InputError(f"Box3D has no shapes around grains but flat walls{_ELSEWHERE}")
    found = []
    for geom in planes:
        own, condim, rank = (geom.get(key) or default.get(key, "0") for key in ("friction", "condim", "priority"))
        value = float(own.split()[0]) if int(condim) > 1 else 0.0
        # The friction of what has the higher priority rules, else the larger one.
        rule = {True: value, False: friction}.get(int(rank) > priority) if int(rank) != priority else None
        found.append(max(value, friction) if rule is None else rule)
    return Walls(
        tuple(geom.get("name", "") for geom in planes),
        _table(planes, "pos", 3),
        to_matrices(_table(planes, "quat", 4)),
        np.array(found, dtype=np.float64),
    )


def _polyhedra(root: ET.Element, names: list[str]) -> Polyhedra:
    """Return the meshes of the grains in their order."""
    meshes = {mesh.get("name"): mesh for mesh in _find(root, "asset").findall("mesh")}
    vertices = [_numbers(meshes[name].get("vertex", "")).reshape(-1, 3) for name in names]
    faces = [_numbers(meshes[name].get("face", "")).astype(np.int32).reshape(-1, 3) for name in names]
    return Polyhedra(
        np.concatenate(vertices) if vertices else np.empty((0, 3)),
        offsets_from_counts([len(points) for points in vertices]),
        offsets_from_counts([len(triangles) for triangles in faces]),
        np.concatenate(faces).ravel() if faces else np.empty(0, dtype=np.int32),
        3 * np.arange(sum(map(len, faces)) + 1),
    )


def _table(elements: list[ET.Element], key: str, width: int) -> Floats:
    """Return numbers of an attribute, shape (n, width)."""
    return _numbers(" ".join(element.get(key, "") for element in elements)).reshape(len(elements), width)


def _numbers(text: str) -> Floats:
    return np.array(text.split(), dtype=np.float64)


def _find(element: ET.Element, tag: str) -> ET.Element:
    found = element.find(tag)
    if found is None:
        raise InputError(f"the model has no {tag}: it must be a text that exporters.mjcf wrote")
    return found
