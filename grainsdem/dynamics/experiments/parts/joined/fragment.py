"""A user's own part: what a file for MuJoCo in SI says, as elements of the scene's text in grain units.

MuJoCo itself reads and compiles the file, so that defaults, angles, frames, includes and meshes are what it takes them
for. Bodies, joints and colliding shapes are written anew from the compiled model; its text holds all that is simulated.
"""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from exporters.mjcf.log import compiling
from grainsdem.dynamics.experiments.parts.meshes import HOLLOW
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.foreign import refusing

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    from exporters.mjcf import GrainUnits
    from grainsdem.dynamics.engine import Apparatus

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

LIGHT = 1e9
"""Factor on masses while MuJoCo compiles: in SI it refuses moments of inertia below 1e-15 kg m²."""

UNSUPPORTED = {
    "nu": "actuators", "neq": "equalities", "ntendon": "tendons", "nflex": "flexes", "nhfield": "height fields",
    "nmocap": "mocap bodies", "nplugin": "plugins", "npair": "contact pairs",
}  # fmt: skip
"""What of a model is not taken over, by what MuJoCo counts it as. Cameras, lights, sites and sensors do no harm."""

KINDS = ("free", "ball", "slide", "hinge")
SHAPES = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")

_LINE = re.compile(r",? ?[Ll]ine(?: number)?[ =]*(\d+)")


@dataclass(frozen=True, slots=True, eq=False)
class Fragment:
    """A part of the user's own, compiled.

    Parameters
    ----------
    path : pathlib.Path
        Its file.
    model : mujoco.MjModel
        In SI, but for masses, which are `LIGHT` times too large.
    bodies, joints : tuple of str
        Names, those without one numbered.
    """

    path: Path
    model: Any
    bodies: tuple[str, ...]
    joints: tuple[str, ...]

    def kind(self, joint: str) -> str:
        """Return the kind of a joint."""
        return KINDS[self.model.jnt_type[self.joints.index(joint)]]

    def parts(self) -> list[str]:
        """Return the names of the parts of the scene that it becomes: moving bodies, and shapes that stand still."""
        return [*self.bodies[1:], *self._still()]

    def _still(self) -> list[str]:
        return [_name(self.model.geom(g).name, "still", g) for g in _solid(self.model) if not self.model.geom_bodyid[g]]

    def elements(
        self, units: GrainUnits, position: ArrayLike, armatures: Mapping[str, float], friction: float | None
    ) -> tuple[list[ET.Element], dict[str, Floats]]:
        """Return bodies and shapes in grain units, and the corners of their meshes by name.

        Parameters
        ----------
        units : GrainUnits
            Factors to SI.
        position : array_like, shape (3,)
            Where the file's origin goes [m].
        armatures : mapping of str to float
            What is added to the inertia of joints, in grain units.
        friction : float, optional
            Of all shapes; by default what the file gives each.
        """
        writer = _Writer(self, units, armatures, friction)
        return writer.written(np.asarray(position, dtype=np.float64)), writer.meshes

    def check_names(self, apparatus: Apparatus) -> None:
        """Raise `InputError` where a name is one of the scene's."""
        for tag, names in (("body", self.bodies[1:]), ("joint", self.joints), ("geom", self._still())):
            taken = apparatus.names(tag) | (apparatus.names("geom") if tag == "body" else set())
            clash = [name for name in names if name in taken or re.fullmatch(r"g\d{6,}", name)]
            if clash:
                raise InputError(
                    f"{self.path}: the {tag} {clash[0]!r} has the name of a part of the scene; give it another one"
                )


def read_fragment(path: str) -> Fragment:
    """Return a part of the user's own from a file for MuJoCo.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If MuJoCo refuses it; the message has its words, and the file and line.
    InputError
        If it holds nothing that grains can touch, or something that is not taken over.
    """
    import mujoco

    file = Path(path)
    if not file.is_file():
        raise MissingFileError(f"{file}: no such file")
    with compiling() as told:
        try:
            spec = mujoco.MjSpec.from_file(str(file))
            _make_heavy(spec)
            model = spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise FileFormatError(_told(file, str(error))) from error
    with refusing(file, "its names are not UTF-8"):
        bytes(model.names).decode()
    for line in told:
        LOG.warning("%s: MuJoCo warns of the part: %s", file, line)
    unsupported = [words for count, words in UNSUPPORTED.items() if getattr(model, count, 0)]
    bent = (getattr(model, name, 0) for name in ("jnt_stiffnesspoly", "dof_dampingpoly"))
    if any(np.any(values) for values in bent):
        unsupported.append("springs and dampers that are not linear")
    if unsupported:
        raise InputError(
            f"{file}: {', '.join(unsupported)} are not taken over; a part has bodies, joints and shapes, and a table "
            f"or a function drives its joints"
        )
    if not _solid(model):
        raise InputError(f"{file}: nothing in it can be touched: every geom has contype and conaffinity 0")
    bodies = tuple(_name(model.body(b).name, "part", b) for b in range(model.nbody))
    joints = tuple(_name(model.joint(j).name, "joint", j) for j in range(model.njnt))
    _warn_of_hollows(file, model)
    return Fragment(file, model, bodies, joints)


def _make_heavy(spec: Any) -> None:
    """Multiply all masses of a specification; those that are not given are NaN or zero, and stay so."""
    for body in spec.bodies:
        body.mass *= LIGHT
        body.inertia = np.asarray(body.inertia) * LIGHT
        body.fullinertia = np.asarray(body.fullinertia) * LIGHT
    for geom in spec.geoms:
        geom.mass *= LIGHT
        geom.density *= LIGHT


def _told(file: Path, words: str) -> str:
    """Return MuJoCo's words about a file in one line, with the line where it names one."""
    found = _LINE.search(words)
    where = f"{file}:{found[1]}" if found else str(file)
    said = " ".join(words.split())
    return f"{where}: MuJoCo refuses the part: {said}"


def _solid(model: Any) -> list[int]:
    """Return the numbers of the shapes that can touch something."""
    return np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0)).tolist()


def _name(name: str, kind: str, number: int) -> str:
    return name or f"{kind}_{number}"


def _warn_of_hollows(file: Path, model: Any) -> None:
    """Warn of meshes that fill less than their hulls: MuJoCo collides with the hulls."""
    import trimesh

    for mesh in sorted({int(model.geom_dataid[g]) for g in _solid(model) if SHAPES[model.geom_type[g]] == "mesh"}):
        first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        solid = trimesh.Trimesh(_corners(model, mesh), model.mesh_face[first : first + count])
        if not solid.is_watertight or abs(solid.volume) < (1 - HOLLOW) * solid.convex_hull.volume:
            LOG.warning(
                "%s: mesh %r is not convex; it collides as its convex hull, with its hollows filled", file,
                model.mesh(mesh).name,
            )  # fmt: skip


def _corners(model: Any, mesh: int) -> Floats:
    """Return the corners of a compiled mesh in the frame of the shapes that use it, shape (n, 3)."""
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return np.asarray(model.mesh_vert[first : first + count], dtype=np.float64)


class _Writer:
    """Writes a compiled fragment as elements in grain units."""

    def __init__(
        self, fragment: Fragment, units: GrainUnits, armatures: Mapping[str, float], friction: float | None
    ) -> None:
        self.fragment, self.model, self.units = fragment, fragment.model, units
        self.armatures, self.friction = armatures, friction
        self.mass = LIGHT * units.mass
        self.meshes: dict[str, Floats] = {}

    def written(self, origin: Floats) -> list[ET.Element]:
        """Return all bodies that stand in the world, and its shapes."""
        shapes = [self._shape(g, origin) for g in _solid(self.model) if self.model.geom_bodyid[g] == 0]
        children = [b for b in range(1, self.model.nbody) if self.model.body_parentid[b] == 0]
        return [*shapes, *(self._body(b, origin) for b in children)]

    def _body(self, number: int, origin: Floats) -> ET.Element:
        """Return a body with all that hangs on it."""
        model, length = self.model, self.units.length
        place = (model.body_pos[number] + origin) / length
        body = ET.Element(
            "body", name=self.fragment.bodies[number], pos=_text(place), quat=_text(model.body_quat[number])
        )
        if model.body_gravcomp[number]:
            body.set("gravcomp", _text(model.body_gravcomp[number]))
        first, count = model.body_jntadr[number], model.body_jntnum[number]
        for joint in range(first, first + count):
            body.append(self._joint(joint))
        mass = model.body_mass[number]
        if mass > 0:
            ET.SubElement(
                body, "inertial", pos=_text(model.body_ipos[number] / length), quat=_text(model.body_iquat[number]),
                mass=_text(mass / self.mass),
                diaginertia=_text(model.body_inertia[number] / (self.mass * length**2)),
            )  # fmt: skip
        for geom in _solid(model):
            if model.geom_bodyid[geom] == number:
                body.append(self._shape(geom, np.zeros(3)))
        for child in range(number + 1, model.nbody):
            if model.body_parentid[child] == number:
                body.append(self._body(child, np.zeros(3)))
        return body

    def _joint(self, number: int) -> ET.Element:
        """Return a joint: springs, dampers, friction and inertia of its own, and its range, in grain units."""
        model, units, name = self.model, self.units, self.fragment.joints[number]
        kind = KINDS[model.jnt_type[number]]
        dof, at = model.jnt_dofadr[number], model.jnt_qposadr[number]
        joint = ET.Element("joint", name=name, type=kind)
        if kind == "free":
            return joint
        is_slide = kind == "slide"
        way = units.length if is_slide else 1.0
        force = units.force if is_slide else units.energy
        inertia = units.mass if is_slide else units.inertia
        joint.set("pos", _text(model.jnt_pos[number] / units.length))
        joint.set("stiffness", _text(_first(model.jnt_stiffness[number]) * way / force))
        joint.set("damping", _text(_first(model.dof_damping[dof]) * way / units.time / force))
        joint.set("frictionloss", _text(model.dof_frictionloss[dof] / force))
        added = self.armatures.get(name, 0.0)
        joint.set("armature", _text(model.dof_armature[dof] / inertia + added))
        joint.set("limited", "true" if model.jnt_limited[number] else "false")
        if kind in ("slide", "hinge"):
            joint.set("axis", _text(model.jnt_axis[number]))
            joint.set("ref", _text(model.qpos0[at] / way))
            joint.set("springref", _text(model.qpos_spring[at] / way))
        if model.jnt_limited[number]:
            joint.set("range", _text(model.jnt_range[number] / way))
        return joint

    def _shape(self, number: int, origin: Floats) -> ET.Element:
        """Return a shape."""
        model, length = self.model, self.units.length
        kind = SHAPES[model.geom_type[number]]
        owner = int(model.geom_bodyid[number])
        name = _name(model.geom(number).name, "still" if owner == 0 else "shape", number)
        place, turn = model.geom_pos[number] + origin, model.geom_quat[number]
        shape = ET.Element("geom", type=kind, pos=_text(place / length), quat=_text(turn))
        if owner == 0:
            shape.set("name", name)
        if kind == "mesh":
            mesh = f"{self.fragment.bodies[owner]}_{name}"
            # The compiled corners are about the mesh's centroid, as the shape's place is.
            self.meshes[mesh] = _corners(model, int(model.geom_dataid[number])) / length
            shape.set("mesh", mesh)
        else:
            shape.set("size", _text(np.where(model.geom_size[number] > 0, model.geom_size[number] / length, 1.0)))
        friction = float(model.geom_friction[number][0]) if self.friction is None else self.friction
        shape.set("friction", _text(friction))
        shape.set("condim", "3" if friction > 0 else "1")
        return shape


def _first(values: Any) -> float:
    """Return a number, or the first of a polynomial's."""
    return float(np.ravel(values)[0])


def _text(values: ArrayLike) -> str:
    return " ".join(f"{value:.12g}" for value in np.atleast_1d(np.asarray(values, float)))
