"""USD through pxr: every rigid body with a mesh below it, its points in single precision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.reading.rebuild import Shape, gather, placed, refuse_several, with_classes
from exporters.usd.scene import CLASS
from grainsdem.errors import FileFormatError
from grainsdem.model import Domain

if TYPE_CHECKING:
    from pathlib import Path

    from grainsdem.model import Packing

IS_LOCAL = True
ROUNDINGS = 1


def read(path: Path) -> Packing:
    """Read the rigid bodies of a stage, in metres and kilograms whatever its units."""
    from pxr import Tf, Usd, UsdGeom, UsdPhysics

    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise FileFormatError(f"{path}: pxr does not open it: {str(error).strip().splitlines()[-1].strip()}") from error
    length, unit_mass = UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage)
    cache = UsdGeom.XformCache()
    bodies = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
    found = [(body, prim) for body in bodies for prim in Usd.PrimRange(body) if prim.IsA(UsdGeom.Mesh)]
    refuse_several(path, [str(body.GetPath()) for body, _ in found])
    shapes, positions, quaternions, masses = [], [], [], []
    for body, mesh in found:
        shapes.append(_shape(UsdGeom.Mesh(mesh), length))
        pose = cache.GetLocalToWorldTransform(body)
        turn = pose.ExtractRotationQuat()
        positions.append([x * length for x in pose.ExtractTranslation()])
        quaternions.append([turn.GetReal(), *turn.GetImaginary()])
        masses.append((UsdPhysics.MassAPI(body).GetMassAttr().Get() or 0.0) * unit_mass)
    polyhedra = gather(path, shapes)
    turns = np.array(quaternions)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    packing = placed(polyhedra, np.array(positions), turns, np.array(masses), _domain(stage))
    classes = [mesh.GetAttribute(CLASS).Get() for _, mesh in found]
    return packing if None in classes else with_classes(packing, classes)


def _shape(mesh: Any, length: float) -> Shape:
    points = np.array(mesh.GetPointsAttr().Get(), dtype=np.float64).reshape(-1, 3) * length
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(), dtype=np.int32)
    return Shape(points, corners, np.array(mesh.GetFaceVertexCountsAttr().Get(), dtype=np.int32))


def _domain(stage: Any) -> Domain | None:
    """Return the domain that our writer notes in the layer, or None."""
    noted = stage.GetRootLayer().customLayerData.get("grainsdem", {})
    if "domainLower" not in noted:
        return None
    return Domain(np.array(noted["domainLower"]), np.array(noted["domainUpper"]), np.array(noted["domainPeriodic"]) > 0)
