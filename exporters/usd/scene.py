"""What a stage of a packing holds: gravity, materials, the container, and a rigid body with a hull for every grain."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.check import grain_names, shapes_of
from exporters.container import container_box, plane_frames, wall_names, world_bounds
from exporters.mjcf.bouncing import DAMPED_STEPS
from exporters.mjcf.options import IMPRATIO
from exporters.rest import down, frictions, one_friction, restitution, rolling_friction, time_step
from exporters.usd.prims import Attribute, Column, Many, Prim
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.principal import principal_inertia
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.rest import Frictions
    from exporters.units import GrainUnits
    from exporters.usd.options import UsdOptions
    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

# Thickness of the container's boxes in median diameters: nothing passes a wall in one step.
_WALL_THICKNESS = 2.0

PHYSX_ITERATIONS = 32
"""Iterations of PhysX's solver for places: with the one that it takes by default beds sink."""

CLASS = "primvars:grainClass"
"""Name of the primvar that holds the class of a grain, where grains have classes; materials may read it."""

_HULL = (
    "PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "PhysxConvexHullCollisionAPI", "NewtonCollisionAPI",
    "NewtonMeshCollisionAPI", "MaterialBindingAPI",
)  # fmt: skip


def metadata(packing: Packing, scales: GrainUnits, root: str) -> dict[str, Any]:
    """Return what the layer says of itself: units, axis, and the domain [m], which has no place in a stage."""
    domain = packing.domain
    is_si = (scales.length, scales.mass) == (1.0, 1.0)
    units = "metres and kilograms" if is_si else f"units of {scales.length!r} m and {scales.mass!r} kg"
    return {
        "defaultPrim": Attribute("token", root),
        "documentation": Attribute("string", f"{len(packing)} grains, in {units}."),
        "metersPerUnit": Attribute("double", scales.length),
        "kilogramsPerUnit": Attribute("double", scales.mass),
        "upAxis": Attribute("token", "Z"),
        "customLayerData": {"grainsdem": {
            "domainLower": Attribute("double[]", domain.lower),
            "domainUpper": Attribute("double[]", domain.upper),
            "domainPeriodic": Attribute("int[]", domain.periodic.astype(int)),
        }},
    }  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Bed:
    """What every part of a stage is made from.

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
    scales : GrainUnits
        Factors from the stage's units to SI; times are in seconds.
    """

    packing: Packing
    integrals: Integrals
    options: UsdOptions
    colours: Floats
    scales: GrainUnits

    @property
    def diameter(self) -> float:
        """Median diameter of the grains in the stage's units."""
        return float(np.median(cube_roots(self.integrals.volumes * (6.0 / np.pi)))) / self.scales.length

    @property
    def gap(self) -> float:
        """Distance at which Newton begins to look at a pair, in the stage's units."""
        return self.options.contact_gap * self.diameter

    @property
    def step(self) -> float:
        """Time step [s] that contacts are made for; none without gravity."""
        gravity = self.options.gravity / self.scales.length
        return time_step(self.packing, self.options.time_step) * math.sqrt(self.diameter / gravity) if gravity else 0.0

    def made_of(self, material: str) -> dict[str, str]:
        """Return the relationship of a collider to its material."""
        return {"material:binding:physics": f"/{self.options.root}/Materials/{material}"}

    @property
    def frictions(self) -> Frictions:
        """What friction grains and walls have."""
        return frictions(self.packing, self.options.friction, self.options.wall_friction)


def world(bed: Bed) -> Prim:
    """Return the prim that holds all, ``/World`` by default."""
    holder = bare_world(bed)
    names = grain_names(bed.packing)
    grains = Prim(name="Grains", kind="Xform", many=Many(names, _grain(bed, bed.made_of("Grain"))))
    return replace(holder, children=(*holder.children, grains))


def bare_world(bed: Bed) -> Prim:
    """Return the prim that holds all but the grains: gravity, materials and the container."""
    parts = [_scene(bed), _materials(bed)] if bed.options.scene else [_materials(bed)]
    container = _container(bed)
    if container:
        parts.append(Prim(name="Container", kind="Xform", children=tuple(container)))
    return Prim(name=bed.options.root, kind="Xform", model="component", children=tuple(parts))


def asset(bed: Bed, name: str) -> Prim:
    """Return a grain that stands alone, in its own frame: one rigid body, its hull, and its material."""
    material = next(one for one in _materials(bed).children if one.name == "Grain")
    body = _grain(bed, {"material:binding:physics": f"/{name}/Grain"})
    kept = {key: value for key, value in body.attributes.items() if not key.startswith("xformOp")}
    # What is pointed at comes first.
    return replace(body, name=name, model="component", attributes=kept, children=(material, *body.children))


def _scene(bed: Bed) -> Prim:
    """Return gravity, and the time step that contacts are made for."""
    attributes = {
        "physics:gravityDirection": Attribute("vector3f", down(bed.packing)),
        "physics:gravityMagnitude": Attribute("float", bed.options.gravity / bed.scales.length),
    }
    schemas: tuple[str, ...] = ()
    if bed.step:
        rate = math.ceil(1 / bed.step)
        schemas = ("NewtonSceneAPI", "PhysxSceneAPI", "MjcSceneAPI")
        attributes |= {
            "newton:timeStepsPerSecond": Attribute("int", rate, is_fixed=True),
            "physxScene:timeStepsPerSecond": Attribute("uint", rate),
            # Else grains of millimetres are asleep at once, in the air, and friction acts at a distance of many.
            "physxScene:disableSleeping": Attribute("bool", 1, is_fixed=True),
            "physxScene:frictionOffsetThreshold": Attribute("float", 0.04 * bed.diameter),
            "physxScene:frictionCorrelationDistance": Attribute("float", 0.025 * bed.diameter),
            "physxScene:solverType": Attribute("token", "PGS"),
            "physxScene:minPositionIterationCount": Attribute("uint", PHYSX_ITERATIONS, is_fixed=True),
            "physxScene:minVelocityIterationCount": Attribute("uint", 1, is_fixed=True),
            "mjc:option:timestep": Attribute("double", 1 / rate, is_fixed=True),
            "mjc:option:cone": Attribute("token", "elliptic"),
            "mjc:option:impratio": Attribute("double", IMPRATIO, is_fixed=True),
            "mjc:flag:multiccd": Attribute("bool", 1, is_fixed=True),
        }
    return Prim(name="PhysicsScene", kind="PhysicsScene", schemas=schemas, attributes=attributes)


def _contacts(bed: Bed) -> dict[str, Attribute]:
    """Return how stiff Newton's contacts are: with the stiffness that it takes by default grains sink into each other.

    Its numbers are a spring and a dashpot a unit of mass. They are the stiffest that a time step carries, damped
    critically, as in files for MuJoCo.
    """
    arm = rolling_friction(bed.packing, None) * bed.diameter / 2
    arms = {"newton:torsionalFriction": Attribute("float", arm), "newton:rollingFriction": Attribute("float", arm)}
    if not bed.step:
        return arms
    rate = 1 / (DAMPED_STEPS * bed.step)
    return {
        "newton:contactStiffness": Attribute("float", rate**2),
        "newton:contactDamping": Attribute("float", 2 * rate),
        **arms,
    }


def _materials(bed: Bed) -> Prim:
    """Return what grains and walls are made of; the mass that each body has goes before the mean density."""
    options, volumes = bed.options, bed.integrals.volumes
    density = float(volumes @ bed.packing.densities / volumes.sum()) / bed.scales.density
    grains, given = one_friction(bed.packing, options.friction), bed.frictions
    bounce = restitution(bed.packing, options.restitution) or 0.0
    kinds = {"Grain": grains, "Wall": grains if given.walls is None else given.walls}
    kinds |= {_material(wall): friction for wall, friction in given.by_wall.items()}
    if bed.packing.domain.is_planar:
        kinds["Side"] = 0.0
    contacts = _contacts(bed)
    materials = [
        Prim(name=name, kind="Material", schemas=("PhysicsMaterialAPI", "NewtonMaterialAPI"), attributes={
            "physics:staticFriction": Attribute("float", friction),
            "physics:dynamicFriction": Attribute("float", friction),
            "physics:restitution": Attribute("float", bounce),
            "physics:density": Attribute("float", density),
            **contacts,
        })
        for name, friction in kinds.items()
    ]  # fmt: skip
    return Prim(name="Materials", kind="Scope", children=tuple(materials))


def _material(wall: str) -> str:
    """Return the name of the material of a wall that has friction of its own."""
    return "".join(part.capitalize() for part in wall.split("_"))


def _container(bed: Bed) -> list[Prim]:
    """Return floor and walls as static boxes around the domain: not every program knows planes."""
    options, domain = bed.options, bed.packing.domain.scaled(1 / bed.scales.length)
    lower, upper = (corner / bed.scales.length for corner in container_box(bed.packing, world_bounds(bed.packing)))
    thick = _WALL_THICKNESS * bed.diameter
    axis_of = {"x": 0, "y": 1, "z": 2}
    # No joint of USD holds a body in a plane: two smooth walls do.
    names = ["y0", "x0", "x1", "z0", "z1"] if domain.is_planar else ["z0", "x0", "x1", "y0", "y1"]
    chosen = {"box": names, "floor": names[:1], "none": []}[options.walls]
    walls, made_of = [], bed.frictions
    made_of.refuse_unknown(wall_names(domain, options.walls))
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
        is_side = domain.is_planar and axis == 2
        look = ("floor", 1.0) if is_floor else (f"wall_{name}", 0.02 if is_side else 0.12)
        # Named as files for MuJoCo name them; the two that hold a plane have no friction ever.
        own = "floor" if name == "z0" else f"wall_{name}"
        kind = "Side" if is_side else _material(own) if own in made_of.by_wall else "Wall"
        walls.append(_wall(bed, *look, box, kind))
    if options.walls == "box":
        reach = float(np.linalg.norm(upper - lower)) + 2 * thick
        for k, (point, rotation) in enumerate(zip(*plane_frames(domain), strict=True)):
            outward = domain.planes[k, :3]
            box = (point + outward * thick / 2, np.array([reach, reach, thick]), rotation)
            own = f"wall_p{k}"
            walls.append(_wall(bed, own, 0.02, box, _material(own) if own in made_of.by_wall else "Wall"))
    return walls


def _wall(bed: Bed, name: str, opacity: float, box: tuple[Any, Any, Any], material: str) -> Prim:
    """Return one static box of the container: its centre, size and rotation."""
    centre, size, rotation = box
    schemas = ("PhysicsCollisionAPI", "NewtonCollisionAPI", "MaterialBindingAPI")
    return Prim(name=name, kind="Cube", schemas=schemas, targets=bed.made_of(material), attributes={
        "size": Attribute("double", 1.0),
        "extent": Attribute("float3[]", [(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)]),
        "xformOp:translate": Attribute("double3", centre),
        "xformOp:orient": Attribute("quatd", rotation),
        "xformOp:scale": Attribute("float3", size),
        "xformOpOrder": Attribute("token[]", ["xformOp:translate", "xformOp:orient", "xformOp:scale"]),
        "newton:contactGap": Attribute("float", bed.gap),
        "primvars:displayColor": Attribute("color3f[]", [(0.72, 0.75, 0.77)]),
        "primvars:displayOpacity": Attribute("float[]", [opacity]),
    })  # fmt: skip


def _grain(bed: Bed, made_of: dict[str, str]) -> Prim:
    """Return the rigid body that every grain is, and its hull below it."""
    packing, integrals, scales = bed.packing, bed.integrals, bed.scales
    moments, axes = principal_inertia(integrals.inertias * (packing.densities / scales.inertia)[:, None, None])
    centres = integrals.centroids / scales.length
    # Rounding noise about zero is not written as numbers of its own.
    centres[np.abs(centres) < 1e-12 * bed.diameter] = 0.0
    return Prim(name="grain", kind="Xform", schemas=("PhysicsRigidBodyAPI", "PhysicsMassAPI"), attributes={
        "xformOp:translate": Attribute("double3", Column.of(packing.positions / scales.length)),
        "xformOp:orient": Attribute("quatd", Column.of(packing.quaternions)),
        "xformOpOrder": Attribute("token[]", ["xformOp:translate", "xformOp:orient"]),
        "physics:mass": Attribute("float", Column.of(packing.densities * integrals.volumes / scales.mass)),
        "physics:centerOfMass": Attribute("point3f", Column.of(centres)),
        "physics:diagonalInertia": Attribute("float3", Column.of(moments)),
        "physics:principalAxes": Attribute("quatf", Column.of(axes)),
    }, children=(_hull(bed, made_of),))  # fmt: skip


def _hull(bed: Bed, made_of: dict[str, str]) -> Prim:
    """Return the mesh of a grain, which is its collider; its lists are cut from the flat arrays as they are written."""
    grains, length = bed.packing.grains, bed.scales.length
    vertices, faces = grains.vertex_offsets, grains.face_offsets
    corners = grains.face_vertex_offsets[faces]

    def counts(first: int, last: int) -> NDArray[np.int64]:
        return np.diff(grains.face_vertex_offsets[faces[first] : faces[last] + 1])

    def points(first: int, last: int) -> Floats:
        return grains.vertices[vertices[first] : vertices[last]] / length

    def indices(first: int, last: int) -> NDArray[np.int32]:
        return grains.face_vertices[corners[first] : corners[last]]

    def normals(first: int, last: int) -> NDArray[np.float64]:
        part = shapes_of(grains, first, last)
        repeats = np.diff(part.face_vertex_offsets)
        return np.repeat(face_planes(part).normals, repeats, axis=0)

    def extents(first: int, last: int) -> NDArray[np.float32]:
        singles = points(first, last).astype(np.float32)
        starts = vertices[first:last] - vertices[first]
        ends = [np.minimum.reduceat(singles, starts), np.maximum.reduceat(singles, starts)]
        return np.stack(ends, axis=1)

    two, one = np.full(len(grains), 2), np.ones(len(grains), dtype=np.int64)
    classes = bed.packing.classes
    own = {} if classes is None else {CLASS: Attribute("int", Column.of(classes), "constant")}
    # Bound on every collider: bindings are inherited, and not every program follows them.
    return Prim(name="shape", kind="Mesh", schemas=_HULL, targets=made_of, attributes={
        "points": Attribute("point3f[]", Column(points, np.diff(vertices))),
        "faceVertexCounts": Attribute("int[]", Column(counts, np.diff(faces))),
        "faceVertexIndices": Attribute("int[]", Column(indices, np.diff(corners))),
        "normals": Attribute("normal3f[]", Column(normals, np.diff(corners)), "faceVarying"),
        "extent": Attribute("float3[]", Column(extents, two)),
        "subdivisionScheme": Attribute("token", "none"),
        "physics:approximation": Attribute("token", "convexHull"),
        "physxConvexHullCollision:minThickness": Attribute("float", 1e-3 * bed.diameter),
        "newton:contactGap": Attribute("float", bed.gap),
        "primvars:displayColor": Attribute("color3f[]", Column(lambda first, last: bed.colours[first:last], one)),
        **own,
    })  # fmt: skip
