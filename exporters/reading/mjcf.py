"""MJCF through MuJoCo's own compiler: shapes and poses are those that it simulates."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

import numpy as np

from exporters.mjcf.log import compiling, quiet
from exporters.reading.rebuild import Shape, gather, placed, refuse_several, with_classes
from grainsdem.errors import FileFormatError, shown
from grainsdem.geometry.rotations import to_matrices
from grainsdem.memory import allow_memory
from grainsdem.model import Domain

if TYPE_CHECKING:
    from pathlib import Path

    from grainsdem.model import Packing

IS_LOCAL = True
_PLACES = {
    "file",
    "meshdir",
    "texturedir",
    "assetdir",
    "fileright",
    "fileleft",
    "fileup",
    "filedown",
    "filefront",
    "fileback",
}
"""Attributes of MJCF that hold paths."""

ROUNDINGS = 3  # as given, about the new centre, and along the new axes


def read(path: Path) -> Packing:
    """Read every body that has a joint and a mesh; lengths and masses by the file's own factors, else as SI."""
    import mujoco

    _refuse_foreign(path)
    try:
        with compiling():
            model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise FileFormatError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error
    # A file can ask for any room while it is simulated.
    allow_memory(model.narena + 8 * model.nuserdata, 1, "bytes that it asks for")
    with quiet():
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
    length, mass = _factor(model, "grain_unit_length"), _factor(model, "grain_unit_mass")
    meshes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    geoms = meshes[model.body_jntnum[model.geom_bodyid[meshes]] > 0]
    if not geoms.size and (model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE).any():
        raise FileFormatError(f"{path}: its grains are spheres, which no packing holds")
    bodies = model.geom_bodyid[geoms]
    refuse_several(path, [model.body(body).name for body in bodies])
    shapes = gather(path, [_shape(model, geom, length) for geom in geoms])
    corners = [_numeric(model, name) for name in ("domain_lower", "domain_upper")]
    domain = None if any(corner is None for corner in corners) else Domain(*(corner * length for corner in corners))
    packing = placed(shapes, data.xpos[bodies] * length, data.xquat[bodies], model.body_mass[bodies] * mass, domain)
    # In files of others a body's own numbers mean something else.
    is_ours = _numeric(model, "grain_unit_length") is not None and model.nuser_body == 1
    return with_classes(packing, model.body_user[bodies, 0]) if is_ours else packing


def _refuse_foreign(path: Path) -> None:
    """Raise `FileFormatError` where XML declares entities, or names a file that lies outside its folder."""
    folder = path.resolve().parent
    waiting, seen = [path.resolve()], set()

    def declare(*_: Any) -> None:
        raise FileFormatError(f"{path}: declares a document type; MJCF has none, and entities are not read")

    def begin(tag: str, attributes: dict[str, str]) -> None:
        for name in _PLACES & attributes.keys():
            place = (folder / attributes[name]).resolve()
            if not place.is_relative_to(folder):
                raise FileFormatError(f"{path}: names {shown(attributes[name])}, which is outside its folder")
            if tag == "include" and place.is_file() and place not in seen:
                waiting.append(place)

    while waiting:
        one = waiting.pop()
        seen.add(one)
        parser = expat.ParserCreate()
        parser.StartDoctypeDeclHandler = declare
        parser.StartElementHandler = begin
        with suppress(expat.ExpatError):  # MuJoCo says it better
            parser.Parse(one.read_bytes(), True)


def _shape(model: Any, geom: int, length: float) -> Shape:
    """Return the mesh of a geom in the frame of its body: the compiler has moved it into a frame of its own."""
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    turn = to_matrices(model.geom_quat[geom][None])[0]
    points = model.mesh_vert[first : first + count].astype(np.float64) @ turn.T + model.geom_pos[geom]
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    faces = model.mesh_face[first : first + count]
    return Shape(points * length, faces.ravel().astype(np.int32), np.full(count, 3, dtype=np.int32))


def _factor(model: Any, name: str) -> float:
    value = _numeric(model, name)
    return 1.0 if value is None else float(value[0])


def _numeric(model: Any, name: str) -> Any:
    """Return a custom number of the file, or None."""
    import mujoco

    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0:
        return None
    first = model.numeric_adr[index]
    return np.array(model.numeric_data[first : first + model.numeric_size[index]])
