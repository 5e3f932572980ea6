"""What a USD stage says of its grains, as arrays; it runs in a process of its own, since pxr may crash at damage."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.reading.rebuild import Shape, gather, refuse_several
from exporters.usd.scene import CLASS
from grainsdem.errors import FileFormatError, shown
from grainsdem.foreign import refusing

if TYPE_CHECKING:
    from numpy.typing import NDArray


def arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return shapes, poses, masses [kg] and, where it is noted, the domain of a stage, in metres."""
    from pxr import Tf

    with refusing(path, "damaged or incomplete"), np.errstate(all="ignore"):
        try:
            _refuse_foreign(path)
            return _arrays(path)
        except Tf.ErrorException as error:
            raise FileFormatError(f"pxr does not open it: {_words(error)}") from error


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    from pxr import Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.Open(str(path))
    length = _unit("metersPerUnit", UsdGeom.GetStageMetersPerUnit(stage))
    unit_mass = _unit("kilogramsPerUnit", UsdPhysics.GetStageKilogramsPerUnit(stage))
    bodies = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
    found = [(body, prim) for body in bodies for prim in Usd.PrimRange(body) if prim.IsA(UsdGeom.Mesh)]
    if found and not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        raise FileFormatError("says no metersPerUnit, which USD would take for centimetres: author it, 1 for metres")
    refuse_several(path, [str(body.GetPath()) for body, _ in found])
    cache = UsdGeom.XformCache()
    shapes, poses, masses, classes = [], [], [], []
    for body, mesh in found:
        shapes.append(_shape(UsdGeom.Mesh(mesh), length))
        pose = cache.GetLocalToWorldTransform(body)
        turn = pose.ExtractRotationQuat()
        poses.append([*(x * length for x in pose.ExtractTranslation()), turn.GetReal(), *turn.GetImaginary()])
        masses.append(_mass(UsdPhysics.MassAPI(body)) * unit_mass)
        classes.append(mesh.GetAttribute(CLASS).Get())
    polyhedra = gather(path, shapes)
    names = ("vertices", "vertex_offsets", "face_offsets", "face_vertices", "face_vertex_offsets")
    return {
        **{name: getattr(polyhedra, name) for name in names},
        "poses": np.array(poses),
        "masses": np.array(masses),
        **({"classes": np.array(classes)} if all(isinstance(one, int) for one in classes) else {}),
        **_domain(stage.GetRootLayer().customLayerData),
    }


def _refuse_foreign(path: Path) -> None:
    """Raise `FileFormatError` where a layer names one that lies outside the folder of the file, or that is not told.

    Textures and the like, which values of attributes name, are no layers: they are neither opened nor looked for.
    """
    from pxr import Sdf, Usd  # noqa: F401  (formats of files are known once Usd is there)

    folder = path.resolve().parent
    waiting, seen = [str(path)], {str(path)}
    while waiting:
        layer = Sdf.Layer.FindOrOpen(waiting.pop())
        for other in [] if layer is None else [*layer.GetCompositionAssetDependencies(), *_clips(layer)]:
            if other.startswith("`"):
                raise FileFormatError(f"names {shown(other)}, an expression for a file, which is not read")
            place = layer.ComputeAbsolutePath(other)
            if "://" in other or not Path(place.partition("[")[0]).resolve().is_relative_to(folder):
                raise FileFormatError(f"names {shown(other)}, which is outside its folder and is not read")
            waiting += {place} - seen
            seen.add(place)


def _clips(layer: Any) -> list[str]:
    """Return the files that the value clips of a layer name, or raise `FileFormatError` where a pattern names them."""
    from pxr import Sdf

    sets: list[Any] = []

    def note(path: Any) -> None:
        spec = layer.GetObjectAtPath(path)
        if isinstance(spec, Sdf.PrimSpec) and spec.HasInfo("clips"):
            sets.extend(spec.GetInfo("clips").values())

    layer.Traverse(Sdf.Path.absoluteRootPath, note)
    told = [one for one in sets if isinstance(one, dict)]
    pattern = next((one["templateAssetPath"] for one in told if "templateAssetPath" in one), None)
    if pattern is not None:
        raise FileFormatError(f"names its clips by a pattern, {shown(pattern)}, which is not read")
    values = [value for one in told for value in one.values()]
    assets = [one for value in values for one in (value if isinstance(value, Sdf.AssetPathArray) else [value])]
    return [one.path for one in assets if isinstance(one, Sdf.AssetPath) and one.path]


def _words(error: Exception) -> str:
    """Return what pxr says of an error, without where it says so."""
    last = (str(error).strip().splitlines() or [type(error).__name__])[-1].strip()
    said = re.search(r" : '(.*)'$", last)
    return said[1] if said else last


def _unit(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0):
        raise FileFormatError(f"{name} must be a number above 0; got {value}")
    return float(value)


def _mass(body: Any) -> float:
    """Return the mass of a body in the stage's unit: zero where it has none."""
    value = body.GetMassAttr().Get()
    if value is None:
        return 0.0
    if not (isinstance(value, int | float) and np.isfinite(value) and value >= 0):
        raise FileFormatError(f"mass of {body.GetPath()} must be finite and zero or more; got {value}")
    return float(value)


def _shape(mesh: Any, length: float) -> Shape:
    given = {
        "points": mesh.GetPointsAttr(),
        "faceVertexIndices": mesh.GetFaceVertexIndicesAttr(),
        "faceVertexCounts": mesh.GetFaceVertexCountsAttr(),
    }
    values = {}
    for name, attribute in given.items():
        value = attribute.Get()
        if value is None or not len(value):
            raise FileFormatError(f"{mesh.GetPath()} has no {name}")
        values[name] = np.array(value)
    points, corners, counts = values.values()
    if not (points.dtype.kind == "f" and points.ndim == 2 and corners.dtype.kind == counts.dtype.kind == "i"):
        raise FileFormatError(f"{mesh.GetPath()} must have points of three numbers, and whole numbers of faces")
    if points.shape[1] != 3 or (counts < 1).any() or counts.sum(dtype=np.int64) != corners.size:
        raise FileFormatError(f"{mesh.GetPath()}: its faceVertexCounts are not those of its faceVertexIndices")
    if corners.min() < 0 or corners.max() >= len(points):
        raise FileFormatError(f"{mesh.GetPath()}: faceVertexIndices must be from 0 to {len(points) - 1}")
    return Shape(points.astype(np.float64) * length, corners, counts)


def _domain(told: Any) -> dict[str, NDArray[Any]]:
    """Return the domain that our writer notes in the layer, if it does."""
    noted = told.get("grainsdem", {}) if isinstance(told, dict) else {}
    names = ("domainLower", "domainUpper", "domainPeriodic")
    if not isinstance(noted, dict) or not set(names) & set(noted):
        return {}
    try:
        lower, upper, periodic = (np.array(noted[name], dtype=np.float64) for name in names)
    except (KeyError, ValueError, TypeError) as error:
        raise FileFormatError(f"a domain is noted by {', '.join(names)}, three numbers each") from error
    return {"lower": lower, "upper": upper, "periodic": periodic > 0}
