"""OpenUSD with UsdPhysics: every grain a rigid body with exact mass properties and a convex-hull collider.

Written through Sdf specs in one change block: the calls of the Usd API recompose the stage and grow faster than the
number of grains.
"""

from __future__ import annotations

import logging
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from exporters.check import check_choice, check_name, check_positive, grain_names, measured
from exporters.container import GRAIN_COLOURS, container_box, plane_frames, shades
from exporters.units import units_of
from grainsdem.errors import WriteError, name_offenders
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.principal import principal_inertia
from grainsdem.geometry.rotations import world_vertices

if TYPE_CHECKING:
    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import Packing

_log = logging.getLogger(__name__)

# What PhysX can hold on the GPU in one hull.
_MOST_VERTICES = 64
_MOST_FACES = 64

# Thickness of the container's boxes in median diameters: nothing passes a wall in one step.
_WALL_THICKNESS = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class UsdOptions:
    """What the stage says beside the grains.

    Parameters
    ----------
    friction : float
        Static and dynamic friction of the grains [1].
    wall_friction : float, optional
        Friction of the walls [1]; that of the grains by default. Programs average the two of a pair unless told.
    restitution : float
        Coefficient of restitution [1], 0 to 1.
    gravity : float
        Magnitude of gravity [m/s²].
    contact_gap : float
        Distance, in median diameters, at which Newton begins to look at a pair.
    walls : {"box", "floor", "none"}
        Container from the packing's domain: floor and four walls, floor only, or nothing. A wall of a periodic axis
        stands where the outermost grain ends.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    friction: float = 0.5
    wall_friction: float | None = None
    restitution: float = 0.0
    gravity: float = 9.81
    contact_gap: float = 0.01
    walls: Literal["box", "floor", "none"] = "box"

    def __post_init__(self) -> None:
        for name in ("friction", "restitution", "gravity", "contact_gap"):
            check_positive(name, getattr(self, name), or_zero=True)
        if self.wall_friction is not None:
            check_positive("wall_friction", self.wall_friction, or_zero=True)
        check_choice("walls", self.walls, ("box", "floor", "none"))


Options = UsdOptions

LOSES = ("Points are in single precision about each grain's centre, masses and inertias in single precision.",)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".usdc", options: UsdOptions | None = None
) -> dict[str, bytes]:
    """Return the one layer: text where the suffix is ``.usda``, the binary crate where it is ``.usdc``.

    Raises
    ------
    InputError
        If the packing is empty or holds numbers that are not finite.
    """
    check_name(name)
    layer = _layer(packing, options or UsdOptions(), suffix.lower())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"layer{suffix.lower()}"
        if not layer.Export(str(path)):
            raise WriteError(f"{path}: cannot be written")
        return {f"{name}{suffix}": path.read_bytes()}


def _layer(packing: Packing, options: UsdOptions, suffix: str) -> Any:
    """Return the packing as an anonymous `Sdf.Layer`."""
    from pxr import Sdf, Vt

    integrals = measured(packing)
    _log_large_hulls(packing)
    scales = units_of(integrals.volumes, packing.densities, 1.0)
    length = scales.length
    layer = Sdf.Layer.CreateAnonymous(suffix)
    with Sdf.ChangeBlock():
        layer.defaultPrim = "World"
        layer.documentation = f"{len(packing)} grains, in metres and kilograms."
        root = layer.pseudoRoot
        for key, value in {"metersPerUnit": 1.0, "kilogramsPerUnit": 1.0, "upAxis": "Z"}.items():
            root.SetInfo(key, value)
        domain = packing.domain
        layer.customLayerData = {"grainsdem": {
            "domainLower": Vt.DoubleArray(domain.lower.tolist()),
            "domainUpper": Vt.DoubleArray(domain.upper.tolist()),
            "domainPeriodic": Vt.IntArray(domain.periodic.astype(int).tolist()),
        }}  # fmt: skip
        world = _prim(layer.pseudoRoot, "World", "Xform")
        _scene(world, packing, options)
        _materials(world, options, scales.density)
        _container(world, packing, options, length)
        _grains(world, packing, integrals, options.contact_gap * length, 1e-3 * length)
    return layer


def _log_large_hulls(packing: Packing) -> None:
    """Log which grains PhysX will simplify on the GPU."""
    grains = packing.grains
    large = (np.diff(grains.vertex_offsets) > _MOST_VERTICES) | (np.diff(grains.face_offsets) > _MOST_FACES)
    if large.any():
        _log.warning(
            "PhysX holds at most %d vertices and %d faces a hull on the GPU; more have grains %s",
            _MOST_VERTICES, _MOST_FACES, name_offenders(np.flatnonzero(large)),
        )  # fmt: skip


def _prim(parent: Any, name: str, kind: str, schemas: tuple[str, ...] = ()) -> Any:
    """Return a new prim of a type, with applied API schemas."""
    from pxr import Sdf

    prim = Sdf.PrimSpec(parent, name, Sdf.SpecifierDef, kind)
    if schemas:
        prim.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=list(schemas)))
    return prim


def _set(prim: Any, values: dict[str, tuple[str, Any]]) -> None:
    """Set attributes, name to type and value; tokens are uniform."""
    from pxr import Sdf

    for name, (kind, value) in values.items():
        uniform = kind.startswith("token")
        variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
        Sdf.AttributeSpec(prim, name, getattr(Sdf.ValueTypeNames, kind), variability).default = value


def _scene(world: Any, packing: Packing, options: UsdOptions) -> None:
    """Add gravity; a planar bed falls along its own second axis."""
    from pxr import Gf

    down = (0, -1, 0) if packing.domain.is_planar else (0, 0, -1)
    scene = _prim(world, "PhysicsScene", "PhysicsScene")
    _set(scene, {
        "physics:gravityDirection": ("Vector3f", Gf.Vec3f(*down)),
        "physics:gravityMagnitude": ("Float", options.gravity),
    })  # fmt: skip


def _materials(world: Any, options: UsdOptions, density: float) -> None:
    """Add what grains and walls are made of; the mass that each body has goes before the mean density [kg/m³]."""
    scope = _prim(world, "Materials", "Scope")
    wall_friction = options.friction if options.wall_friction is None else options.wall_friction
    for name, friction in (("Grain", options.friction), ("Wall", wall_friction)):
        _set(_prim(scope, name, "Material", ("PhysicsMaterialAPI",)), {
            "physics:staticFriction": ("Float", friction),
            "physics:dynamicFriction": ("Float", friction),
            "physics:restitution": ("Float", options.restitution),
            "physics:density": ("Float", density),
        })  # fmt: skip


def _bind(prim: Any, material: str) -> None:
    """Bind a physics material."""
    from pxr import Sdf

    relation = Sdf.RelationshipSpec(prim, "material:binding:physics", False)
    relation.targetPathList.explicitItems = [Sdf.Path(f"/World/Materials/{material}")]


def _container(world: Any, packing: Packing, options: UsdOptions, length: float) -> None:
    """Add floor and walls as static boxes around the domain: not every program knows planes."""
    lower, upper = container_box(packing, world_vertices(packing))
    thick = _WALL_THICKNESS * length
    axis_of = {"x": 0, "y": 1, "z": 2}
    names = ["y0", "x0", "x1"] if packing.domain.is_planar else ["z0", "x0", "x1", "y0", "y1"]
    chosen = {"box": names, "floor": names[:1], "none": []}[options.walls]
    if chosen:
        group = _prim(world, "Container", "Xform")
    for name in chosen:
        axis, at_upper = axis_of[name[0]], name[1] == "1"
        # Wider by its own thickness, so that the edges of the container are closed.
        centre, size = (lower + upper) / 2, upper - lower + 2 * thick
        centre[axis] = upper[axis] + thick / 2 if at_upper else lower[axis] - thick / 2
        size[axis] = thick
        is_floor = name == names[0]
        if not is_floor and not packing.domain.is_planar:
            size[2] = upper[2] - lower[2]
        wall = "floor" if is_floor else f"wall_{name}"
        _wall(group, wall, (centre, size, (1.0, 0.0, 0.0, 0.0)), options.contact_gap * length, 0.12)
    if options.walls == "box":
        reach = float(np.linalg.norm(upper - lower)) + 2 * thick
        for k, (point, rotation) in enumerate(zip(*plane_frames(packing.domain), strict=True)):
            outward = packing.domain.planes[k, :3]
            size = np.array([reach, reach, thick])
            _wall(
                group, f"wall_p{k}", (point + outward * thick / 2, size, rotation), options.contact_gap * length, 0.02
            )


def _wall(group: Any, name: str, box: tuple[Any, Any, Any], gap: float, opacity: float) -> None:
    """Add one static box of the container: its centre [m], size [m] and rotation."""
    from pxr import Gf, Vt

    prim = _prim(group, name, "Cube", ("PhysicsCollisionAPI", "NewtonCollisionAPI", "MaterialBindingAPI"))
    half = Gf.Vec3f(0.5)
    centre, size, rotation = box
    w, *xyz = (float(q) for q in rotation)
    _set(prim, {
        "size": ("Double", 1.0),
        "extent": ("Float3Array", Vt.Vec3fArray([-half, half])),
        "xformOp:translate": ("Double3", Gf.Vec3d(*centre.tolist())),
        "xformOp:orient": ("Quatd", Gf.Quatd(w, *xyz)),
        "xformOp:scale": ("Float3", Gf.Vec3f(*size.tolist())),
        "xformOpOrder": ("TokenArray", Vt.TokenArray(["xformOp:translate", "xformOp:orient", "xformOp:scale"])),
        "newton:contactGap": ("Float", gap),
        "primvars:displayColor": ("Color3fArray", Vt.Vec3fArray([Gf.Vec3f(0.72, 0.75, 0.77)])),
        "primvars:displayOpacity": ("FloatArray", Vt.FloatArray([1.0 if name == "floor" else opacity])),
    })  # fmt: skip
    _bind(prim, "Wall")


def _grains(world: Any, packing: Packing, integrals: Integrals, gap: float, thickness: float) -> None:
    """Add a rigid body and its mesh for every grain."""
    from pxr import Gf, Sdf, Vt

    # Bound once, above all grains: bindings are inherited.
    group = _prim(world, "Grains", "Xform", ("MaterialBindingAPI",))
    _bind(group, "Grain")
    masses, moments, axes = _mass_properties(packing, integrals)
    # Rounding noise about zero is not written as numbers of its own.
    centres = np.where(np.abs(integrals.centroids) < 1e-9 * thickness, 0.0, integrals.centroids)
    colours = [Vt.Vec3fArray([Gf.Vec3f(*rgb)]) for rgb in GRAIN_COLOURS.values()]
    order = Vt.TokenArray(["xformOp:translate", "xformOp:orient"])
    body_schemas = Sdf.TokenListOp.Create(prependedItems=["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
    mesh_schemas = Sdf.TokenListOp.Create(prependedItems=[
        "PhysicsCollisionAPI", "PhysicsMeshCollisionAPI",
        "PhysxConvexHullCollisionAPI", "NewtonCollisionAPI", "NewtonMeshCollisionAPI",
    ])  # fmt: skip
    kinds = Sdf.ValueTypeNames
    new, spec, varying, uniform = (
        Sdf.AttributeSpec,
        Sdf.PrimSpec,
        Sdf.VariabilityVarying,
        Sdf.VariabilityUniform,
    )
    rows = zip(
        grain_names(packing), packing.positions.tolist(), packing.quaternions.tolist(), masses.tolist(),
        centres.tolist(), moments.tolist(), axes.tolist(), shades(len(packing)).tolist(),
        _shapes(packing), strict=True,
    )  # fmt: skip
    for name, position, (w, *xyz), mass, centre, moment, (aw, *axyz), shade, shape in rows:
        body = spec(group, name, Sdf.SpecifierDef, "Xform")
        body.SetInfo("apiSchemas", body_schemas)
        new(body, "xformOp:translate", kinds.Double3, varying).default = Gf.Vec3d(*position)
        new(body, "xformOp:orient", kinds.Quatd, varying).default = Gf.Quatd(w, *xyz)
        new(body, "xformOpOrder", kinds.TokenArray, uniform).default = order
        new(body, "physics:mass", kinds.Float, varying).default = mass
        new(body, "physics:centerOfMass", kinds.Point3f, varying).default = Gf.Vec3f(*centre)
        new(body, "physics:diagonalInertia", kinds.Float3, varying).default = Gf.Vec3f(*moment)
        new(body, "physics:principalAxes", kinds.Quatf, varying).default = Gf.Quatf(aw, *axyz)
        mesh = spec(body, "shape", Sdf.SpecifierDef, "Mesh")
        mesh.SetInfo("apiSchemas", mesh_schemas)
        points, counts, corners, normals, extent = shape
        new(mesh, "points", kinds.Point3fArray, varying).default = Vt.Vec3fArray.FromNumpy(points)
        new(mesh, "faceVertexCounts", kinds.IntArray, varying).default = Vt.IntArray.FromNumpy(counts)
        new(mesh, "faceVertexIndices", kinds.IntArray, varying).default = Vt.IntArray.FromNumpy(corners)
        vectors = new(mesh, "normals", kinds.Normal3fArray, varying)
        vectors.default = Vt.Vec3fArray.FromNumpy(normals)
        vectors.SetInfo("interpolation", "faceVarying")
        new(mesh, "extent", kinds.Float3Array, varying).default = Vt.Vec3fArray.FromNumpy(extent)
        new(mesh, "subdivisionScheme", kinds.Token, uniform).default = "none"
        new(mesh, "physics:approximation", kinds.Token, uniform).default = "convexHull"
        new(mesh, "physxConvexHullCollision:minThickness", kinds.Float, varying).default = thickness
        new(mesh, "newton:contactGap", kinds.Float, varying).default = gap
        new(mesh, "primvars:displayColor", kinds.Color3fArray, varying).default = colours[shade]


def _mass_properties(packing: Packing, integrals: Integrals) -> tuple[Any, Any, Any]:
    """Return masses [kg], principal moments [kg m²] and principal axes of all grains."""
    moments, axes = principal_inertia(integrals.inertias * packing.densities[:, None, None])
    return packing.densities * integrals.volumes, moments, axes


def _shapes(packing: Packing) -> Any:
    """Yield points, corners of each face, corners, normals of each corner, and extent of every grain."""
    grains = packing.grains
    points = grains.vertices.astype(np.float32)
    counts = np.diff(grains.face_vertex_offsets).astype(np.int32)
    normals = np.repeat(face_planes(grains).normals.astype(np.float32), counts, axis=0)
    vertex, face = grains.vertex_offsets, grains.face_offsets
    corner = grains.face_vertex_offsets[face]
    lower = np.minimum.reduceat(points, vertex[:-1])
    extents = np.stack([lower, np.maximum.reduceat(points, vertex[:-1])], axis=1)
    bounds = zip(
        *(o.tolist() for o in (vertex[:-1], vertex[1:], face[:-1], face[1:], corner[:-1], corner[1:])),
        strict=True,
    )
    for extent, (v0, v1, f0, f1, c0, c1) in zip(extents, bounds, strict=True):
        yield points[v0:v1], counts[f0:f1], grains.face_vertices[c0:c1], normals[c0:c1], extent
