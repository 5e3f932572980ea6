"""What a stage of a packing holds: gravity, materials, the container, and a rigid body with a hull for every grain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.check import grain_names, shapes_of
from exporters.container import container_box, plane_frames, world_bounds
from exporters.usd.prims import Attribute, Column, Many, Prim
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.principal import principal_inertia

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.usd import UsdOptions
    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import Domain, Packing, Polyhedra

    Floats = NDArray[np.float64]

# Thickness of the container's boxes in median diameters: nothing passes a wall in one step.
_WALL_THICKNESS = 2.0

_HULL = (
    "PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "PhysxConvexHullCollisionAPI", "NewtonCollisionAPI",
    "NewtonMeshCollisionAPI",
)  # fmt: skip


def metadata(packing: Packing) -> dict[str, Any]:
    """Return what the layer says of itself: units, axis, and the domain, which has no place in a stage."""
    domain = packing.domain
    return {
        "defaultPrim": Attribute("token", "World"),
        "documentation": Attribute("string", f"{len(packing)} grains, in metres and kilograms."),
        "metersPerUnit": Attribute("double", 1.0),
        "kilogramsPerUnit": Attribute("double", 1.0),
        "upAxis": Attribute("token", "Z"),
        "customLayerData": {"grainsdem": {
            "domainLower": Attribute("double[]", domain.lower),
            "domainUpper": Attribute("double[]", domain.upper),
            "domainPeriodic": Attribute("int[]", domain.periodic.astype(int)),
        }},
    }  # fmt: skip


def world(packing: Packing, integrals: Integrals, options: UsdOptions, colours: Floats) -> Prim:
    """Return the prim that holds all, ``/World``.

    Parameters
    ----------
    packing : Packing
        What is written.
    integrals : Integrals
        Of its grains.
    options : UsdOptions
        Friction, container and the like.
    colours : ndarray, shape (n, 3)
        Colour of each grain.
    """
    length = float(np.median(np.cbrt(integrals.volumes * (6.0 / np.pi))))
    density = float(integrals.volumes @ packing.densities / integrals.volumes.sum())
    parts = [_scene(packing.domain, options.gravity), _materials(options, density)]
    container = _container(packing, options, length)
    if container:
        parts.append(Prim(name="Container", kind="Xform", children=tuple(container)))
    grains = Prim(
        name="Grains",
        kind="Xform",
        # Bound once, above all grains: bindings are inherited.
        schemas=("MaterialBindingAPI",),
        targets={"material:binding:physics": "/World/Materials/Grain"},
        many=Many(grain_names(packing), _grain(packing, integrals, options.contact_gap * length, length, colours)),
    )
    return Prim(name="World", kind="Xform", children=(*parts, grains))


def _scene(domain: Domain, gravity: float) -> Prim:
    """Return gravity; a planar bed falls along its own second axis."""
    down = (0, -1, 0) if domain.is_planar else (0, 0, -1)
    return Prim(name="PhysicsScene", kind="PhysicsScene", attributes={
        "physics:gravityDirection": Attribute("vector3f", down),
        "physics:gravityMagnitude": Attribute("float", gravity),
    })  # fmt: skip


def _materials(options: UsdOptions, density: float) -> Prim:
    """Return what grains and walls are made of; the mass that each body has goes before the mean density [kg/m³]."""
    wall_friction = options.friction if options.wall_friction is None else options.wall_friction
    materials = [
        Prim(name=name, kind="Material", schemas=("PhysicsMaterialAPI",), attributes={
            "physics:staticFriction": Attribute("float", friction),
            "physics:dynamicFriction": Attribute("float", friction),
            "physics:restitution": Attribute("float", options.restitution),
            "physics:density": Attribute("float", density),
        })
        for name, friction in (("Grain", options.friction), ("Wall", wall_friction))
    ]  # fmt: skip
    return Prim(name="Materials", kind="Scope", children=tuple(materials))


def _container(packing: Packing, options: UsdOptions, length: float) -> list[Prim]:
    """Return floor and walls as static boxes around the domain: not every program knows planes."""
    domain, gap = packing.domain, options.contact_gap * length
    lower, upper = container_box(packing, world_bounds(packing))
    thick = _WALL_THICKNESS * length
    axis_of = {"x": 0, "y": 1, "z": 2}
    names = ["y0", "x0", "x1"] if domain.is_planar else ["z0", "x0", "x1", "y0", "y1"]
    chosen = {"box": names, "floor": names[:1], "none": []}[options.walls]
    walls = []
    for name in chosen:
        axis, at_upper = axis_of[name[0]], name[1] == "1"
        # Wider by its own thickness, so that the edges of the container are closed.
        centre, size = (lower + upper) / 2, upper - lower + 2 * thick
        centre[axis] = upper[axis] + thick / 2 if at_upper else lower[axis] - thick / 2
        size[axis] = thick
        is_floor = name == names[0]
        if not is_floor and not domain.is_planar:
            size[2] = upper[2] - lower[2]
        box = (centre, size, (1.0, 0.0, 0.0, 0.0))
        walls.append(_wall("floor", box, gap, 1.0) if is_floor else _wall(f"wall_{name}", box, gap, 0.12))
    if options.walls == "box":
        reach = float(np.linalg.norm(upper - lower)) + 2 * thick
        for k, (point, rotation) in enumerate(zip(*plane_frames(domain), strict=True)):
            outward = domain.planes[k, :3]
            box = (point + outward * thick / 2, np.array([reach, reach, thick]), rotation)
            walls.append(_wall(f"wall_p{k}", box, gap, 0.02))
    return walls


def _wall(name: str, box: tuple[Any, Any, Any], gap: float, opacity: float) -> Prim:
    """Return one static box of the container: its centre [m], size [m] and rotation."""
    centre, size, rotation = box
    schemas = ("PhysicsCollisionAPI", "NewtonCollisionAPI", "MaterialBindingAPI")
    targets = {"material:binding:physics": "/World/Materials/Wall"}
    return Prim(name=name, kind="Cube", schemas=schemas, targets=targets, attributes={
        "size": Attribute("double", 1.0),
        "extent": Attribute("float3[]", [(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)]),
        "xformOp:translate": Attribute("double3", centre),
        "xformOp:orient": Attribute("quatd", rotation),
        "xformOp:scale": Attribute("float3", size),
        "xformOpOrder": Attribute("token[]", ["xformOp:translate", "xformOp:orient", "xformOp:scale"]),
        "newton:contactGap": Attribute("float", gap),
        "primvars:displayColor": Attribute("color3f[]", [(0.72, 0.75, 0.77)]),
        "primvars:displayOpacity": Attribute("float[]", [opacity]),
    })  # fmt: skip


def _grain(packing: Packing, integrals: Integrals, gap: float, length: float, colours: Floats) -> Prim:
    """Return the rigid body that every grain is, and its hull below it."""
    moments, axes = principal_inertia(integrals.inertias * packing.densities[:, None, None])
    # Rounding noise about zero is not written as numbers of its own.
    centres = np.where(np.abs(integrals.centroids) < 1e-12 * length, 0.0, integrals.centroids)
    return Prim(name="grain", kind="Xform", schemas=("PhysicsRigidBodyAPI", "PhysicsMassAPI"), attributes={
        "xformOp:translate": Attribute("double3", Column.of(packing.positions)),
        "xformOp:orient": Attribute("quatd", Column.of(packing.quaternions)),
        "xformOpOrder": Attribute("token[]", ["xformOp:translate", "xformOp:orient"]),
        "physics:mass": Attribute("float", Column.of(packing.densities * integrals.volumes)),
        "physics:centerOfMass": Attribute("point3f", Column.of(centres)),
        "physics:diagonalInertia": Attribute("float3", Column.of(moments)),
        "physics:principalAxes": Attribute("quatf", Column.of(axes)),
    }, children=(_hull(packing.grains, gap, 1e-3 * length, colours),))  # fmt: skip


def _hull(grains: Polyhedra, gap: float, thickness: float, colours: Floats) -> Prim:
    """Return the mesh of a grain, which is its collider; its lists are cut from the flat arrays as they are written."""
    vertices, faces = grains.vertex_offsets, grains.face_offsets
    corners = grains.face_vertex_offsets[faces]

    def counts(first: int, last: int) -> NDArray[np.int64]:
        return np.diff(grains.face_vertex_offsets[faces[first] : faces[last] + 1])

    def normals(first: int, last: int) -> NDArray[np.float64]:
        part = shapes_of(grains, first, last)
        repeats = np.diff(part.face_vertex_offsets)
        return np.repeat(face_planes(part).normals, repeats, axis=0)

    def extents(first: int, last: int) -> NDArray[np.float32]:
        points = grains.vertices[vertices[first] : vertices[last]].astype(np.float32)
        starts = vertices[first:last] - vertices[first]
        ends = [np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)]
        return np.stack(ends, axis=1)

    two, one = np.full(len(grains), 2), np.ones(len(grains), dtype=np.int64)
    return Prim(name="shape", kind="Mesh", schemas=_HULL, attributes={
        "points": Attribute("point3f[]", Column(_cut(grains.vertices, vertices), np.diff(vertices))),
        "faceVertexCounts": Attribute("int[]", Column(counts, np.diff(faces))),
        "faceVertexIndices": Attribute("int[]", Column(_cut(grains.face_vertices, corners), np.diff(corners))),
        "normals": Attribute("normal3f[]", Column(normals, np.diff(corners)), "faceVarying"),
        "extent": Attribute("float3[]", Column(extents, two)),
        "subdivisionScheme": Attribute("token", "none"),
        "physics:approximation": Attribute("token", "convexHull"),
        "physxConvexHullCollision:minThickness": Attribute("float", thickness),
        "newton:contactGap": Attribute("float", gap),
        "primvars:displayColor": Attribute("color3f[]", Column(lambda first, last: colours[first:last], one)),
    })  # fmt: skip


def _cut(values: NDArray[Any], offsets: NDArray[np.int64]) -> Any:
    """Return what cuts the elements of a stretch of grains from the flat array of all."""
    return lambda first, last: values[offsets[first] : offsets[last]]
