"""A world of Box3D through its C interface, as Robox3D declares it: bodies, shapes, poses, contacts."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.errors import InputError, MissingPackageError, name_offenders
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import from_matrices

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.dynamics.engine.box3d.model import Model

    Floats = NDArray[np.float64]
    Singles = NDArray[np.float32]

UNIT = 0.01
"""Box3D's metre [d]: its margins are parts of it. Grains begin to look at one another at 2e-4 d."""

PUSH = 3.0
"""Speed [d/t] at which what overlaps is pushed apart, at most."""

DYNAMIC = 2
"""Number of Box3D's kind of body that moves by itself."""

SAME_VOLUME = 1e-4
"""Relative difference of volume up to which a hull of Box3D's is the grain."""

THICKNESS = 4.0
"""Of walls [d], which are slabs: nothing passes one in a step."""

BEYOND = 50.0
"""How far [d] walls reach beyond the grains' start, which what spreads past a removed wall still lies on."""

_POINT = np.dtype({
    "names": ["anchors", "separation", "impulse"],
    "formats": [("<f4", (2, 3)), "<f4", "<f4"],
    "offsets": [0, 24, 32],
    "itemsize": 56,
})  # fmt: skip
_MANIFOLD = np.dtype({
    "names": ["points", "normal", "friction", "count"],
    "formats": [(_POINT, 4), ("<f4", 3), ("<f4", 3), "<i4"],
    "offsets": [0, 224, 240, 264],
    "itemsize": 268,
})  # fmt: skip
_CONTACT = np.dtype({
    "names": ["a", "b", "manifolds", "count"],
    "formats": ["<i4", "<i4", "<u8", "<i4"],
    "offsets": [12, 20, 32, 40],
    "itemsize": 48,
})  # fmt: skip
"""What is read of Box3D's structures, version 0.1."""


class Touches(NamedTuple):
    """Points of contact: the first shape's number is of shapes as they were made, grains first.

    Parameters
    ----------
    shapes : ndarray of int64, shape (m, 2)
        The two shapes.
    arms : ndarray, shape (m, 2, 3)
        Where they touch, from the centre of mass of either [d].
    normals : ndarray, shape (m, 3)
        From the first to the second.
    gaps : ndarray, shape (m,)
        Gap [d].
    impulses : ndarray, shape (m, 3)
        Impulse on the second in the last part of the last step.
    """

    shapes: NDArray[np.int64]
    arms: Floats
    normals: Floats
    gaps: Floats
    impulses: Floats


def library() -> tuple[Any, Any, Any]:
    """Return Robox3D's interface: the foreign functions, Box3D, and what reads many bodies at once.

    Raises
    ------
    MissingPackageError
        If Robox3D is not installed, or is of a version whose structures are not known.
    """
    try:
        from robox3d import _ffi
    except ImportError as error:
        raise MissingPackageError('engine="box3d" needs Robox3D: pip install "grainsdem[box3d]"') from error
    ffi = _ffi.ffi
    sizes = [ffi.sizeof(name) for name in ("b3ContactData", "b3Manifold", "b3ManifoldPoint")]
    if sizes != [_CONTACT.itemsize, _MANIFOLD.itemsize, _POINT.itemsize] or _ffi.shim is None:
        raise MissingPackageError('engine="box3d" needs Robox3D 0.1: pip install "grainsdem[box3d]"')
    return ffi, _ffi.lib, _ffi.shim


class World:
    """A world of Box3D with grains and walls.

    Parameters
    ----------
    model : Model
        What is in it.

    Raises
    ------
    InputError
        If Box3D refuses a grain's shape.
    """

    def __init__(self, model: Model) -> None:
        self._ffi, self._lib, self._shim = library()
        self._lib.b3SetLengthUnitsPerMeter(UNIT)
        self.version = ".".join(str(getattr(self._lib.b3GetVersion(), part)) for part in ("major", "minor", "revision"))
        self._world = self._made(model.gravity)
        self.n = len(model.masses)
        self._shapes: list[Any] = []
        self._ids = self._ffi.new("b3BodyId[]", max(self.n, 1))
        for grain in range(self.n):
            self._ids[grain] = self._body(model.positions[grain], model.quaternions[grain], kind=DYNAMIC)
            self._lock(self._ids[grain], is_planar=model.is_planar)
        self._add_grains(model)
        self._walls = self._add_walls(model)
        self._poses, self._speeds = np.empty((self.n, 7), np.float32), np.empty((self.n, 6), np.float32)

    def __del__(self) -> None:
        """Let go of the world; Box3D has room for 128."""
        world = getattr(self, "_world", None)
        if world is not None:
            self._lib.b3DestroyWorld(world)

    def step(self, time_step: float, parts: int) -> None:
        """Go on by a step, solved in so many parts."""
        self._lib.b3World_Step(self._world, time_step, parts)

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Change the acceleration."""
        self._lib.b3World_SetGravity(self._world, self._vector(gravity))

    def set_friction(self, grains: float, walls: ArrayLike) -> None:
        """Set the friction of grains, and that of each wall with them.

        Raises
        ------
        InputError
            If walls are to be rough where grains are smooth.
        """
        wanted = np.asarray(walls, dtype=np.float64)
        if grains == 0 and (wanted > 0).any():
            raise InputError("Box3D has no rough walls around smooth grains; engine='mujoco' has them")
        # Of a pair it takes the root of both frictions' product.
        own = np.zeros_like(wanted) if grains == 0 else wanted**2 / grains
        for shape in self._shapes[: self.n]:
            self._lib.b3Shape_SetFriction(shape, grains)
        for shape, value in zip(self._shapes[self.n :], own.tolist(), strict=True):
            self._lib.b3Shape_SetFriction(shape, value)

    def set_damping(self, rate: float) -> None:
        """Let grains lose velocity and spin at a rate."""
        for body in self._ids[0 : self.n]:
            self._lib.b3Body_SetLinearDamping(body, rate)
            self._lib.b3Body_SetAngularDamping(body, rate)

    def set_weights(self, shares: ArrayLike) -> None:
        """Set the share of gravity that acts on each grain."""
        for body, share in zip(self._ids[0 : self.n], np.asarray(shares, np.float64).tolist(), strict=True):
            self._lib.b3Body_SetGravityScale(body, share)

    def enable(self, wall: int, *, is_there: bool) -> None:
        """Let a wall be there, or not."""
        (self._lib.b3Body_Enable if is_there else self._lib.b3Body_Disable)(self._walls[wall])

    def poses(self) -> tuple[Floats, Floats]:
        """Return positions and quaternions (w, x, y, z) of the grains' frames."""
        self._shim.rxBodyGetPoses(self._ids, self.n, self._floats(self._poses))
        rows = self._poses.astype(np.float64)
        return rows[:, :3], rows[:, [6, 3, 4, 5]]

    def speeds(self) -> tuple[Floats, Floats]:
        """Return velocities of the centres of mass and spins."""
        self._shim.rxBodyGetVelocities(self._ids, self.n, self._floats(self._speeds))
        rows = self._speeds.astype(np.float64)
        return rows[:, :3], rows[:, 3:]

    def put(self, positions: Floats, quaternions: Floats) -> None:
        """Put all grains somewhere."""
        for body, place, turn in zip(self._ids[0 : self.n], positions, quaternions, strict=True):
            self._lib.b3Body_SetTransform(body, self._vector(place, "b3Pos *"), self._rotation(turn))

    def move(self, velocities: Floats, spins: Floats) -> None:
        """Set velocities and spins of all grains."""
        for body, velocity, spin in zip(self._ids[0 : self.n], velocities, spins, strict=True):
            self._lib.b3Body_SetLinearVelocity(body, self._vector(velocity))
            self._lib.b3Body_SetAngularVelocity(body, self._vector(spin))

    def touches(self) -> Touches:
        """Return the points of all contacts of the last step, those that bear nothing too."""
        lib, ffi = self._lib, self._ffi
        bodies = self._ids[0 : self.n]
        room = sum(lib.b3Body_GetContactCapacity(body) for body in bodies)
        data, at = ffi.new("b3ContactData[]", max(room, 1)), 0
        for body in bodies:
            at += lib.b3Body_GetContactData(body, data + at, room - at)
        found = np.frombuffer(ffi.buffer(data), dtype=_CONTACT, count=at)
        # Each contact is told by both of its bodies: once is enough. Shapes are numbered from one as they were made.
        found = found[found["count"] > 0]
        _, once = np.unique(found["manifolds"], return_index=True)
        found = found[once]
        blocks = [
            ctypes.string_at(place, count * _MANIFOLD.itemsize)
            for place, count in zip(found["manifolds"].tolist(), found["count"].tolist(), strict=True)
        ]
        manifolds = np.frombuffer(b"".join(blocks), dtype=_MANIFOLD)
        shapes = np.column_stack([found["a"], found["b"]]).repeat(found["count"], axis=0).astype(np.int64) - 1
        return _points(shapes, manifolds)

    def _made(self, gravity: Floats) -> Any:
        """Return an empty world."""
        wanted = self._lib.b3DefaultWorldDef()
        wanted.gravity = self._vector(gravity)
        wanted.enableSleep = wanted.enableContinuous = False
        # As stiff as the parts of a step allow, and never springy.
        wanted.contactHertz, wanted.contactDampingRatio, wanted.contactSpeed = 1e9, 1.0, PUSH
        wanted.restitutionThreshold = 1e9
        world = self._lib.b3CreateWorld(self._ffi.new("b3WorldDef *", wanted))
        self._lib.b3World_SetContactRecycleDistance(world, 0.0)
        return world

    def _body(self, position: ArrayLike, quaternion: ArrayLike, *, kind: int = 0) -> Any:
        wanted = self._lib.b3DefaultBodyDef()
        wanted.type = kind
        wanted.position, wanted.rotation = self._vector(position, "b3Pos *"), self._rotation(quaternion)
        wanted.enableSleep = wanted.enableContactRecycling = False
        return self._lib.b3CreateBody(self._world, self._ffi.new("b3BodyDef *", wanted))

    def _lock(self, body: Any, *, is_planar: bool) -> None:
        if is_planar:
            locks = self._lib.b3Body_GetMotionLocks(body)
            locks.linearZ = locks.angularX = locks.angularY = True
            self._lib.b3Body_SetMotionLocks(body, locks)

    def _add_grains(self, model: Model) -> None:
        """Give grains their shapes, masses and inertias."""
        refused = []
        sizes = None if model.grains is None else volumes(model.grains)
        for grain in range(self.n):
            body = self._ids[grain]
            if model.radii is not None:
                centre = model.centres[grain].tolist()
                sphere = self._ffi.new("b3Sphere *", {"center": centre, "radius": float(model.radii[grain])})
                self._shapes.append(self._lib.b3CreateSphereShape(body, self._material(), sphere))
            elif (
                sizes is not None
                and model.grains is not None
                and not self._add_hull(body, model.grains.vertices_of(grain), float(sizes[grain]))
            ):
                refused.append(grain)
                continue
            mass = self._ffi.new("b3MassData *")
            mass.mass, mass.center = float(model.masses[grain]), self._vector(model.centres[grain])
            for name, column in zip(("cx", "cy", "cz"), model.inertias[grain].T, strict=True):
                setattr(mass.inertia, name, self._vector(column))
            self._lib.b3Body_SetMassData(body, mass[0])
        if refused:
            raise InputError(f"Box3D takes no hull of so many corners, or so flat: grains {name_offenders(refused)}")

    def _add_hull(self, body: Any, corners: Floats, volume: float) -> bool:
        """Add the hull of points to a body, and return whether Box3D made one of such a volume."""
        points = np.ascontiguousarray(corners, dtype=np.float32)
        pointer = self._ffi.cast("b3Vec3 *", self._ffi.from_buffer(points))
        hull = self._lib.b3CreateHull(pointer, len(points), max(len(points), 4))
        if hull == self._ffi.NULL:
            return False
        # It welds corners that are very near to one another.
        is_whole = bool(abs(hull.volume / volume - 1.0) < SAME_VOLUME)
        if is_whole:
            self._shapes.append(self._lib.b3CreateHullShape(body, self._material(), hull))  # it keeps a copy
        self._lib.b3DestroyHull(hull)
        return is_whole

    def _add_walls(self, model: Model) -> list[Any]:
        """Add the walls as slabs behind their planes."""
        walls = []
        reach = BEYOND + float(np.ptp(model.positions, axis=0).max(initial=0.0))
        half = np.array([reach, reach, THICKNESS / 2])
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        for point, rotation in zip(model.walls.points, model.walls.rotations, strict=True):
            centre = point - rotation[:, 2] * THICKNESS / 2
            body = self._body(centre, from_matrices(rotation[None])[0])
            self._add_hull(body, signs * half, float(8 * half.prod()))
            walls.append(body)
        return walls

    def _material(self) -> Any:
        wanted = self._lib.b3DefaultShapeDef()
        wanted.baseMaterial.restitution = wanted.baseMaterial.rollingResistance = 0.0
        wanted.density = 1.0
        return self._ffi.new("b3ShapeDef *", wanted)

    def _vector(self, values: ArrayLike, kind: str = "b3Vec3 *") -> Any:
        x, y, z = np.asarray(values, dtype=np.float64).tolist()
        return self._ffi.new(kind, {"x": x, "y": y, "z": z})[0]

    def _rotation(self, quaternion: ArrayLike) -> Any:
        w, x, y, z = np.asarray(quaternion, dtype=np.float64).tolist()
        return self._ffi.new("b3Quat *", {"v": {"x": x, "y": y, "z": z}, "s": w})[0]

    def _floats(self, rows: Singles) -> Any:
        return self._ffi.cast("float *", self._ffi.from_buffer(rows))


def _points(shapes: NDArray[np.int64], manifolds: NDArray[Any]) -> Touches:
    """Return the points of manifolds one by one, the friction of each shared out as its points bear."""
    counts = manifolds["count"]
    row = np.repeat(np.arange(len(manifolds)), counts)
    column = np.arange(row.size) - np.repeat(np.cumsum(counts) - counts, counts)
    points = manifolds["points"][row, column]
    normals = manifolds["normal"].astype(np.float64)
    pressing = points["impulse"].astype(np.float64)
    total = np.bincount(row, pressing, minlength=len(manifolds))
    shares = np.divide(pressing, total[row], out=np.zeros_like(pressing), where=total[row] > 0)
    impulses = pressing[:, None] * normals[row] + shares[:, None] * manifolds["friction"].astype(np.float64)[row]
    return Touches(
        shapes[row], points["anchors"].astype(np.float64), normals[row], points["separation"].astype(np.float64),
        impulses,
    )  # fmt: skip
