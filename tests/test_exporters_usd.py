"""USD: opened, validated and read back by pxr."""

import hashlib
import json
import logging
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import cube_packing
from hypothesis import given
from hypothesis import strategies as st
from solids import place, polyhedra
from typer.testing import CliRunner

import exporters
from exporters import usd
from exporters.units import units
from exporters.usd import UsdOptions
from exporters.usd.codes import packed_ints
from exporters.usd.replay import write_replay
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, MissingFileError, ShapeError, WriteError
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.geometry.rotations import random_quaternions, to_matrices, world_vertices
from grainsdem.model import Domain
from grainsdem.packing import rescale
from grainsdem.storage import save
from grainsdem.validation import compare

REDS = [0.267, 0.279, 0.230, 0.173, 0.128, 0.158, 0.369, 0.678, 0.993]
"""Red of viridis at nine even places."""

DIAMETERS = [0.2e-3, 1e-3, 0.1]


def opened(path):
    from pxr import Usd

    return Usd.Stage.Open(str(path))


def grain_prims(stage):
    return stage.GetPrimAtPath("/World/Grains").GetChildren()


@pytest.fixture(scope="module")
def tilted(fresh):
    """The fresh grains, each turned in place: poses that are not the identity."""
    return replace(fresh, quaternions=random_quaternions(len(fresh), np.random.default_rng(3)), links=None)


@pytest.fixture(scope="module")
def stage(tilted, tmp_path_factory):
    path = tmp_path_factory.mktemp("usd") / "bed.usdc"
    exporters.write(tilted, path)
    return opened(path)


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
@pytest.mark.parametrize("diameter", DIAMETERS)
def test_the_validators_of_openusd_find_no_error(tilted, tmp_path, suffix, diameter):
    from pxr import UsdValidation

    scaled = rescale(tilted, diameter / units(tilted).length)
    [path] = exporters.write(scaled, tmp_path / f"bed{suffix}")
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    errors = UsdValidation.ValidationContext(validators).Validate(opened(path))
    assert [error.GetErrorAsString() for error in errors] == []


@pytest.mark.client
def test_the_stage_says_its_units_its_axis_its_gravity_and_its_default_prim(stage):
    from pxr import UsdGeom, UsdPhysics

    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetDefaultPrim().GetPath() == "/World"
    scene = UsdPhysics.Scene.Get(stage, "/World/PhysicsScene")
    assert scene.GetGravityMagnitudeAttr().Get() == pytest.approx(9.81)
    assert tuple(scene.GetGravityDirectionAttr().Get()) == (0.0, 0.0, -1.0)


@pytest.mark.client
@pytest.mark.opens("usd", "OpenUSD", "counted", "weighed")
def test_masses_centres_and_inertias_read_back_are_the_exact_ones(stage, tilted):
    from pxr import UsdPhysics

    exact = integrate(tilted.grains)
    diameter = units(tilted).length
    prims = grain_prims(stage)
    assert [prim.GetName() for prim in prims] == [f"g{i:06d}" for i in range(len(tilted))]
    for i, prim in enumerate(prims):
        assert prim.HasAPI(UsdPhysics.RigidBodyAPI)
        mass = UsdPhysics.MassAPI(prim)
        assert mass.GetMassAttr().Get() == pytest.approx(exact.volumes[i] * tilted.densities[i], rel=1e-6)
        assert np.abs(np.array(mass.GetCenterOfMassAttr().Get())).max() < 1e-6 * diameter
        q = mass.GetPrincipalAxesAttr().Get()
        [axes] = to_matrices(np.array([[q.GetReal(), *q.GetImaginary()]], dtype=float))
        moments = np.array(mass.GetDiagonalInertiaAttr().Get(), dtype=float)
        wanted = exact.inertias[i] * tilted.densities[i]
        assert np.abs(axes @ np.diag(moments) @ axes.T - wanted).max() < 1e-6 * np.abs(wanted).max()


@pytest.mark.client
def test_vertices_in_the_world_of_the_stage_are_ours(stage, tilted):
    from pxr import Usd, UsdGeom

    ours, offsets = world_vertices(tilted), tilted.grains.vertex_offsets
    cache = UsdGeom.XformCache(Usd.TimeCode.Default())
    diameter = units(tilted).length
    for i, prim in enumerate(grain_prims(stage)):
        mesh = UsdGeom.Mesh(prim.GetChild("shape"))
        points = np.array(mesh.GetPointsAttr().Get(), dtype=float)
        matrix = np.array(cache.GetLocalToWorldTransform(mesh.GetPrim()))
        theirs = np.c_[points, np.ones(len(points))] @ matrix  # row vectors, as USD has them
        assert np.abs(theirs[:, :3] - ours[offsets[i] : offsets[i + 1]]).max() < 1e-6 * diameter


@pytest.mark.client
def test_meshes_are_convex_colliders_with_normals_of_their_faces(stage, tilted):
    from pxr import UsdGeom, UsdPhysics, UsdShade

    normals = face_planes(tilted.grains).normals
    first = 0
    for prim in grain_prims(stage):
        shape = prim.GetChild("shape")
        mesh = UsdGeom.Mesh(shape)
        points = np.array(mesh.GetPointsAttr().Get())
        counts = np.array(mesh.GetFaceVertexCountsAttr().Get())
        assert shape.HasAPI(UsdPhysics.CollisionAPI)
        assert UsdPhysics.MeshCollisionAPI(shape).GetApproximationAttr().Get() == "convexHull"
        assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
        assert mesh.GetNormalsInterpolation() == "faceVarying"
        theirs = np.array(mesh.GetNormalsAttr().Get())
        assert np.allclose(theirs, np.repeat(normals[first : first + counts.size], counts, axis=0), atol=1e-6)
        first += counts.size
        assert np.array_equal(np.array(mesh.GetExtentAttr().Get()), [points.min(axis=0), points.max(axis=0)])
        material, _ = UsdShade.MaterialBindingAPI(shape).ComputeBoundMaterial("physics")
        physics = UsdPhysics.MaterialAPI(material.GetPrim())
        assert (physics.GetStaticFrictionAttr().Get(), physics.GetDynamicFrictionAttr().Get()) == (0.5, 0.5)
        assert physics.GetDensityAttr().Get() == pytest.approx(2650.0)
    assert first == tilted.grains.n_faces


@pytest.mark.client
def test_physx_and_newton_get_distances_of_the_size_of_grains(stage, tilted):
    diameter = units(tilted).length
    for prim in grain_prims(stage):
        shape = prim.GetChild("shape")
        thickness = shape.GetAttribute("physxConvexHullCollision:minThickness").Get()
        assert thickness == pytest.approx(1e-3 * diameter)
        assert shape.GetAttribute("newton:contactGap").Get() == pytest.approx(0.01 * diameter)


@pytest.mark.client
@pytest.mark.parametrize(("walls", "n_walls"), [("box", 5), ("floor", 1), ("none", 0)])
def test_static_boxes_close_the_domain_around_the_grains(fresh, tmp_path, walls, n_walls):
    from pxr import Usd, UsdGeom, UsdPhysics

    [path] = exporters.write(fresh, tmp_path / "bed.usda", walls=walls, wall_friction=0.2)
    stage = opened(path)
    container = stage.GetPrimAtPath("/World/Container")
    prims = container.GetChildren() if container else []
    assert len(prims) == n_walls
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    lower, upper = fresh.domain.lower, fresh.domain.upper
    planes = {
        "floor": (2, lower),
        "wall_x0": (0, lower),
        "wall_x1": (0, upper),
        "wall_y0": (1, lower),
        "wall_y1": (1, upper),
    }
    for prim in prims:
        assert prim.HasAPI(UsdPhysics.CollisionAPI)
        assert not prim.HasAPI(UsdPhysics.RigidBodyAPI)
        box = cache.ComputeWorldBound(prim).ComputeAlignedRange()
        axis, corner = planes[prim.GetName()]
        inner = box.GetMin()[axis] if corner is upper else box.GetMax()[axis]
        assert inner == pytest.approx(corner[axis], abs=1e-6 * upper[axis])
        others = [k for k in range(3) if k != axis]
        assert all(box.GetMin()[k] <= lower[k] + 1e-9 and box.GetMax()[k] >= upper[k] - 1e-9 for k in others)


@pytest.mark.client
def test_the_same_packing_gives_the_same_bytes_in_another_process(cube):
    code = (
        "import sys, pickle, hashlib, exporters\n"
        "packing = pickle.load(sys.stdin.buffer)\n"
        "for suffix in ('.usda', '.usdc', '.usdz'):\n"
        "    print(suffix, hashlib.sha256(exporters.files(packing, suffix)['bed' + suffix]).hexdigest())"
    )
    run = subprocess.run([sys.executable, "-c", code], input=pickle.dumps(cube), capture_output=True, check=True)
    elsewhere = [tuple(line.split()) for line in run.stdout.decode().splitlines()]

    def here():
        for suffix in (".usda", ".usdc", ".usdz"):
            yield suffix, hashlib.sha256(exporters.files(cube, suffix)[f"bed{suffix}"]).hexdigest()

    assert elsewhere == list(here()) == list(here())


@pytest.mark.golden
def test_the_layer_of_one_cube_is_known_and_opens(cube, tmp_path):
    [path] = exporters.write(cube, tmp_path / "cube.usda", walls="none")
    lines = [line.strip() for line in path.read_text().splitlines()]
    assert lines[0] == "#usda 1.0"
    assert "float physics:mass = 8" in lines  # edge 2, density 1
    assert "float3 physics:diagonalInertia = (5.3333335, 5.3333335, 5.3333335)" in lines
    assert "quatf physics:principalAxes = (1, 0, 0, 0)" in lines
    assert "double3 xformOp:translate = (2, 2, 2)" in lines
    assert "int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]" in lines
    assert "float3[] extent = [(-1, -1, -1), (1, 1, 1)]" in lines
    assert len(grain_prims(opened(path))) == 1


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
def test_grains_too_large_for_physx_are_written_and_named_in_the_log(tmp_path, caplog, suffix):
    bed = row(drum(4), drum(40), spindle(33))  # of 8, 80 and 35 vertices, 6, 42 and 66 faces
    with caplog.at_level(logging.WARNING):
        exporters.write(row(drum(32), spindle(32)), tmp_path / f"bed{suffix}")
        assert not caplog.records
        exporters.write(bed, tmp_path / f"bed{suffix}")
    [line] = caplog.messages
    assert line.startswith("PhysX holds at most 64 vertices and 64 faces a hull on the GPU")
    assert line.endswith("2 of 3 grains are beyond that: 1, 2")
    stage = opened(tmp_path / f"bed{suffix}")
    meshes = [body.GetChild("shape") for body in grain_prims(stage)]
    assert [len(mesh.GetAttribute("points").Get()) for mesh in meshes] == [8, 80, 35]
    assert [len(mesh.GetAttribute("faceVertexCounts").Get()) for mesh in meshes] == [6, 42, 66]


@pytest.mark.unit
def test_grains_too_large_for_physx_are_refused_on_request(tmp_path):
    bed = row(drum(4), *[drum(40)] * 7)
    words = "7 of 8 grains are beyond that: 1, 2, 3, 4, 5 and 2 more; hulls='any' writes them all the same"
    limit = "at most 64 vertices and 64 faces a hull on the GPU, of at most 32 corners, and simplifies what has more"
    with pytest.raises(InputError, match=f"{limit}; {words}"):
        exporters.write(bed, tmp_path / "bed.usdc", hulls="physx")
    save(bed, tmp_path / "bed.h5")
    command = ["export", str(tmp_path / "bed.h5"), str(tmp_path / "bed.usdc"), "--option", "hulls=physx"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2
    assert words in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["bed.h5"]
    assert CliRunner().invoke(app, command[:-2]).exit_code == 0


@pytest.mark.unit
@pytest.mark.parametrize(("sides", "told"), [((1, 1, 0.02), False), ((1, 1, 0.009), True), ((150, 1, 1), True)])
def test_rods_and_plates_that_physx_takes_no_hull_of_are_named(tmp_path, caplog, sides, told):
    """Half the longest side over the least distance of the centre from a face is at most a hundred."""
    cube = cube_packing([(0, 0, 0)])
    plate = replace(cube, grains=replace(cube.grains, vertices=cube.grains.vertices * sides))
    with caplog.at_level(logging.WARNING):
        exporters.write(plate, tmp_path / "bed.usdc")
    line = (
        "PhysX takes no hull on the GPU that is more than 100 times as long as thick; 1 of 1 grains are beyond that: 0"
    )
    assert caplog.messages == ([line] if told else [])
    if told:
        with pytest.raises(InputError, match="more than 100 times as long as thick"):
            exporters.write(plate, tmp_path / "bed.usdc", hulls="physx")


@pytest.mark.unit
def test_the_manifest_names_grains_too_large_for_physx(tmp_path):
    bed = row(drum(4), *[drum(40)] * 7)
    rows = json.loads(exporters.write(bed, tmp_path, formats=["usdc", "stl"])[-1].read_text())["formats"]
    assert rows[0]["report"] == {
        "most_vertices_of_physx": 64, "most_faces_of_physx": 64, "most_corners_of_physx": 32,
        "n_grains_beyond": 7, "first_grains_beyond": [1, 2, 3, 4, 5],
        "n_grains_oblong": 0, "first_grains_oblong": [],
    }  # fmt: skip
    rows = json.loads(exporters.write(row(drum(4)), tmp_path, formats=["usdc"])[-1].read_text())["formats"]
    assert (rows[0]["report"]["n_grains_beyond"], rows[0]["report"]["first_grains_beyond"]) == (0, [])


def ring(sides, height):
    angles = 2 * np.pi * np.arange(sides) / sides
    return np.c_[np.cos(angles), np.sin(angles), np.full(sides, height)]


def drum(sides):
    """Return corners: twice as many as it has sides, and two faces more than sides."""
    return np.concatenate([ring(sides, -0.5), ring(sides, 0.5)])


def spindle(sides):
    """Return corners: two more than the ring between its tips, and twice as many faces."""
    return np.concatenate([ring(sides, 0.0), [[0, 0, -0.5], [0, 0, 0.5]]])


def row(*clouds):
    """Return convex grains in a row."""
    return place(polyhedra(*clouds), 4.0 * np.arange(len(clouds))[:, None] * [1, 0, 0])


@pytest.mark.client
def test_where_one_stretch_of_grains_ends_makes_no_difference_to_what_is_read(tilted, tmp_path, monkeypatch):
    from pxr import Sdf

    from exporters.usd import columns

    [whole] = exporters.write(tilted, tmp_path / "whole.usdc")
    monkeypatch.setattr(columns, "STRETCH", 7)
    [parts] = exporters.write(tilted, tmp_path / "parts.usdc")
    assert whole.read_bytes() != parts.read_bytes()
    texts = [Sdf.Layer.FindOrOpen(str(path)).ExportToString() for path in (whole, parts)]
    assert texts[0] == texts[1]
    assert texts[0].count("def Xform") == len(tilted) + 3


@pytest.mark.client
def test_tables_of_many_thousand_grains_are_read_to_the_last(tmp_path):
    # So many that differences in the tables take one, two and four bytes.
    n = 8000
    places = 3.0 * np.stack(np.unravel_index(np.arange(n), (20, 20, 20)), axis=1) + 2.0
    many = cube_packing(places, domain=Domain.cube(70.0))
    exporters.write(many, tmp_path / "bed.usdc", colour="id")
    stage = opened(tmp_path / "bed.usdc")
    prims = grain_prims(stage)
    assert [prim.GetName() for prim in prims] == [f"g{i:06d}" for i in range(n)]
    for i in (0, 1, 4095, 4096, 5958, 7999):
        assert tuple(prims[i].GetAttribute("xformOp:translate").Get()) == tuple(places[i])
        shape = prims[i].GetChild("shape")
        assert np.array_equal(shape.GetAttribute("points").Get(), many.grains.vertices_of(i))
        assert len(shape.GetAttribute("normals").Get()) == 24
        red = shape.GetAttribute("primvars:displayColor").Get()[0][0]
        assert red == pytest.approx(np.interp(i / (n - 1) * 8, range(9), REDS), abs=1e-6)


@pytest.mark.property
@given(st.lists(st.integers(-(2**31), 2**31 - 1) | st.integers(-300, 300), min_size=1, max_size=50))
def test_packed_numbers_are_unpacked_by_the_rules_of_the_format(numbers):
    data = packed_ints(numbers)
    assert int.from_bytes(data[:8], "little") == len(data) - 8
    body = unpacked(data[8:])
    common, codes, rest = int.from_bytes(body[:4], "little", signed=True), body[4 : 4 + -(-len(numbers) // 4)], []
    place, value = 4 + len(codes), 0
    for i in range(len(numbers)):
        size = [0, 1, 2, 4][codes[i // 4] >> 2 * (i % 4) & 3]
        step = int.from_bytes(body[place : place + size], "little", signed=True) if size else common
        place += size
        value = (value + step + 2**31) % 2**32 - 2**31
        rest.append(value)
    assert rest == numbers
    assert place == len(body)


def unpacked(data):
    """Return what a block of LZ4 without matches holds, behind the byte that says that it is one block."""
    assert data[0] == 0
    n, place = data[1] >> 4, 2
    if n == 15:
        while data[place] == 255:
            n, place = n + 255, place + 1
        n, place = n + data[place], place + 1
    assert len(data) == place + n
    return data[place:]


@pytest.mark.client
def test_openusd_writes_our_crate_again_without_a_change(tilted, tmp_path):
    from pxr import Sdf

    [ours] = exporters.write(tilted, tmp_path / "ours.usdc")
    layer = Sdf.Layer.FindOrOpen(str(ours))
    assert layer.Export(str(tmp_path / "theirs.usdc"))
    theirs = Sdf.Layer.FindOrOpen(str(tmp_path / "theirs.usdc"))
    assert theirs.ExportToString() == layer.ExportToString()
    data = layer.customLayerData["grainsdem"]
    assert list(data["domainUpper"]) == tilted.domain.upper.tolist()


@pytest.mark.client
@pytest.mark.parametrize("colour", ["mineral", "id", "diameter", "array", "rgb"])
def test_grains_have_the_colour_that_was_asked_for(tilted, tmp_path, colour):
    n = len(tilted)
    numbers = {"array": np.arange(n)[::-1], "rgb": np.tile([1.0, 0.5, 0.0], (n, 1))}
    exporters.write(tilted, tmp_path / "bed.usdc", colour=numbers.get(colour, colour))
    stage = opened(tmp_path / "bed.usdc")
    found = np.array([
        prim.GetChild("shape").GetAttribute("primvars:displayColor").Get()[0] for prim in grain_prims(stage)
    ])  # fmt: skip
    dark, bright = (0.267, 0.005, 0.329), (0.993, 0.906, 0.144)
    sizes = integrate(tilted.grains).volumes
    first, last = {"id": (0, n - 1), "diameter": (sizes.argmin(), sizes.argmax()), "array": (n - 1, 0)}.get(
        colour, (None, None)
    )
    if first is not None:
        assert np.allclose(found[[first, last]], [dark, bright], atol=1e-6)
    assert len(np.unique(found, axis=0)) == {"mineral": 6, "rgb": 1}.get(colour, n)


@pytest.mark.unit
@pytest.mark.parametrize("option", ["friction", "restitution", "gravity", "contact_gap", "wall_friction"])
def test_options_out_of_range_are_refused(option):
    with pytest.raises(InputError, match=f"{option} must be zero or more and finite; got -1"):
        UsdOptions(**{option: -1.0})
    with pytest.raises(InputError, match="walls must be one of box, floor, none; got 'lid'"):
        UsdOptions(walls="lid")


@pytest.mark.client
@pytest.mark.parametrize("units_of_stage", ["si", "mm", "grain", 0.5])
def test_a_stage_in_other_units_is_the_same_bed_in_si(tilted, tmp_path, units_of_stage):
    from pxr import Usd, UsdGeom, UsdPhysics

    exporters.write(tilted, tmp_path / "bed.usdc", units=units_of_stage)
    packing = exporters.read(tmp_path / "bed.usdc")
    assert all(check.ok for check in compare(packing, tilted, tolerance=1e-5))
    np.testing.assert_allclose(packing.densities, tilted.densities, rtol=1e-5)
    np.testing.assert_allclose(packing.domain.upper, tilted.domain.upper, rtol=1e-12)
    stage = opened(tmp_path / "bed.usdc")
    length = {"si": 1.0, "mm": 1e-3, "grain": units(tilted).length}.get(units_of_stage, units_of_stage)
    assert UsdGeom.GetStageMetersPerUnit(stage) == length
    gravity = UsdPhysics.Scene.Get(stage, "/World/PhysicsScene").GetGravityMagnitudeAttr().Get()
    assert gravity * length == pytest.approx(9.81)
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    floor = box.ComputeWorldBound(stage.GetPrimAtPath("/World/Container/floor")).ComputeAlignedRange()
    assert floor.GetMax()[2] == pytest.approx(0.0, abs=1e-6)
    assert floor.GetMin()[2] * length == pytest.approx(-2 * units(tilted).length, rel=1e-6)
    shape = grain_prims(stage)[0].GetChild("shape")
    thickness = shape.GetAttribute("physxConvexHullCollision:minThickness").Get()
    assert thickness * length == pytest.approx(1e-3 * units(tilted).length)
    assert shape.GetAttribute("newton:contactGap").Get() * length == pytest.approx(0.01 * units(tilted).length)
    unit_mass = UsdPhysics.GetStageKilogramsPerUnit(stage)
    moments = np.array([
        UsdPhysics.MassAPI(prim).GetDiagonalInertiaAttr().Get() for prim in grain_prims(stage)
    ])  # fmt: skip
    traces = np.trace(integrate(tilted.grains).inertias, axis1=1, axis2=2) * tilted.densities
    np.testing.assert_allclose(moments.sum(axis=1) * unit_mass * length**2, traces, rtol=1e-5)


SIZES_IN_NEWTON = {"sand": (0.2e-3, "grain"), "millimetre": (1e-3, "grain"), "cobble": (0.1, "si")}
"""Diameter [m] and units of the stage. In SI Newton replaces the inertia of grains under four millimetres."""


@pytest.fixture(scope="module")
def in_newton(tilted, newton, tmp_path_factory):
    """The bed in each size, and what Newton made of its stage in twenty steps; one process, for its long start."""
    folder = tmp_path_factory.mktemp("newton")
    beds, tasks = {}, []
    for name, (diameter, words) in SIZES_IN_NEWTON.items():
        beds[name] = rescale(tilted, diameter / units(tilted).length)
        [path] = exporters.write(beds[name], folder / f"{name}.usdc", units=words)
        tasks.append((str(path), 20, 1e-3 * float(np.sqrt(diameter / 9.81))))
    script = Path(__file__).with_name("newton_client.py")
    command = [newton, str(script), json.dumps(tasks), str(folder / "found.json")]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert run.returncode == 0, run.stderr
    found = json.loads((folder / "found.json").read_text())
    return {name: (beds[name], each) for name, each in zip(SIZES_IN_NEWTON, found, strict=True)}


@pytest.mark.client
@pytest.mark.parametrize("size", SIZES_IN_NEWTON)
@pytest.mark.opens("usd", "Newton", "counted", "weighed", "stepped")
def test_newton_loads_and_steps_the_bed_with_our_masses(in_newton, size):
    bed, found = in_newton[size]
    diameter, words = SIZES_IN_NEWTON[size]
    length, mass = (usd.factors(bed, UsdOptions(units=words))[key] for key in ("length", "mass"))
    assert [name.split("/")[-1] for name in found["names"]] == [f"g{i:06d}" for i in range(len(bed))]
    exact = integrate(bed.grains)
    np.testing.assert_allclose(np.array(found["masses"]) * mass, exact.volumes * bed.densities, rtol=1e-6)
    inertias = np.array(found["inertias"]) * mass * length**2
    wanted = exact.inertias * bed.densities[:, None, None]
    assert np.abs(inertias - wanted).max() < 1e-6 * np.abs(wanted).max()
    assert np.abs(found["centres"]).max() * length < 1e-6 * diameter
    assert np.abs(np.array(found["positions"]) * length - bed.positions).max() < 1e-5 * diameter
    # In the air still. Symplectic steps of a thousandth of √(d/g) fall by 1e-6 d (1 + … + 20).
    assert np.median(found["fallen"]) * length == pytest.approx(210e-6 * diameter, rel=0.05)
    assert found["finite"]
    # It takes a stage's numbers as they are, and says so; nothing of ours was corrected.
    assert all("units are not supported" in warning for warning in found["warnings"]), found["warnings"]


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
@pytest.mark.opens("usd", "NVIDIA's validator")
def test_the_validator_of_nvidia_finds_no_issue(tilted, tmp_path, newton, suffix):
    [path] = exporters.write(tilted, tmp_path / f"bed{suffix}")
    # Text is slower than a crate, which is all that one of its rules says.
    rules = ["--disable-rule", "UsdAsciiPerformanceChecker"] if suffix == ".usda" else []
    command = [str(Path(newton).with_name("omni_asset_validate")), *rules, path.name]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "No issues found." in run.stdout + run.stderr


@pytest.fixture
def motion(tilted):
    """Five poses of every grain, a tenth of a second apart, whose quaternions change their sign."""
    rng = np.random.default_rng(1)
    steps = rng.normal(size=(5, len(tilted), 3)) * 1e-4
    turns = np.stack([random_quaternions(len(tilted), rng) for _ in range(5)])
    return tilted.positions + np.cumsum(steps, axis=0), turns, 2.0 + 0.1 * np.arange(5)


@pytest.mark.client
@pytest.mark.parametrize("units_of_stage", ["si", "grain"])
def test_a_replay_puts_every_grain_where_it_was_recorded(tilted, motion, tmp_path, units_of_stage):
    from pxr import Usd, UsdGeom, UsdPhysics, UsdValidation

    [scene] = exporters.write(tilted, tmp_path / "bed.usdc", units=units_of_stage)
    positions, turns, times = motion
    path = write_replay(scene, positions, turns, times)
    assert path == tmp_path / "bed.replay.usdc"
    stage = opened(path)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, pytest.approx(4.0))
    assert stage.GetTimeCodesPerSecond() == pytest.approx(10.0)
    length = UsdGeom.GetStageMetersPerUnit(stage)
    for k in range(5):
        cache = UsdGeom.XformCache(Usd.TimeCode(float(k)))
        for i, prim in enumerate(grain_prims(stage)):
            pose = cache.GetLocalToWorldTransform(prim)
            assert np.allclose(np.array(pose.ExtractTranslation()) * length, positions[k, i], rtol=0, atol=1e-12)
            q = pose.ExtractRotationQuat()
            theirs = np.array([q.GetReal(), *q.GetImaginary()])
            assert abs(theirs @ turns[k, i]) == pytest.approx(1.0, abs=1e-9)
    body = grain_prims(stage)[0]
    assert UsdPhysics.RigidBodyAPI(body).GetKinematicEnabledAttr().Get() is True
    assert UsdPhysics.MassAPI(body).GetMassAttr().Get() > 0
    samples = [body.GetAttribute("xformOp:orient").Get(float(k)) for k in range(5)]
    four = np.array([[q.GetReal(), *q.GetImaginary()] for q in samples])
    assert np.all(np.einsum("ij,ij->i", four[1:], four[:-1]) >= 0)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetErrorAsString() for error in errors] == []


@pytest.mark.unit
def test_a_record_of_other_grains_or_times_is_refused(tilted, motion, tmp_path):
    [scene] = exporters.write(tilted, tmp_path / "bed.usda")
    positions, turns, times = motion
    n = len(tilted)
    with pytest.raises(ShapeError, match=rf"shape \(5, {n}, 3\) .* got \(5, {n - 1}, 3\)"):
        write_replay(scene, positions[:, 1:], turns, times)
    with pytest.raises(ShapeError, match=r"times must grow; got 2\.1 and then 2\.0"):
        write_replay(scene, positions, turns, times[[0, 1, 0, 2, 3]])
    with pytest.raises(ShapeError, match="must be finite"):
        write_replay(scene, positions * np.nan, turns, times)
    with pytest.raises(MissingFileError, match="no such file"):
        write_replay(tmp_path / "none.usdc", positions, turns, times)
    (tmp_path / "empty.usda").write_text("#usda 1.0\n")
    with pytest.raises(FileFormatError, match="its default prim holds no Grains"):
        write_replay(tmp_path / "empty.usda", positions, turns, times)
    (tmp_path / "bed.replay.usdc").write_text("mine")
    with pytest.raises(WriteError, match="exists already"):
        write_replay(scene, positions, turns, times, overwrite=False)
    assert (tmp_path / "bed.replay.usdc").read_text() == "mine"


@pytest.mark.unit
@pytest.mark.parametrize(
    ("colour", "message"),
    [
        ("red", "colour must be one of mineral, id, diameter, class, or numbers; got 'red'"),
        ([[1.0, 2.0]], "a number or red, green and blue of each grain"),
        ([np.nan], "must be finite"),
        ([[0.5, 0.5, 1.5]], "from 0 to 1"),
        ([1.0, 2.0], "one row for each of 1 grains; got 2"),
    ],
)
def test_a_colour_that_is_none_is_refused(cube, colour, message):
    with pytest.raises(InputError, match=message):
        exporters.files(cube, ".usdc", colour=colour)


@pytest.mark.client
def test_prisms_of_a_planar_bed_stand_between_smooth_walls_and_fall_along_y(cube, tmp_path):
    from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

    slab = replace(cube, domain=Domain.slab((4.0, 4.0), 2.0), positions=np.array([[2.0, 2.0, 1.0]]))
    exporters.write(slab, tmp_path / "bed.usdc")
    stage = opened(tmp_path / "bed.usdc")
    assert tuple(UsdPhysics.Scene.Get(stage, "/World/PhysicsScene").GetGravityDirectionAttr().Get()) == (0, -1, 0)
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    inner = {"floor": (1, 0.0), "wall_x0": (0, 0.0), "wall_x1": (0, 4.0), "wall_z0": (2, 0.0), "wall_z1": (2, 2.0)}
    walls = {prim.GetName(): prim for prim in stage.GetPrimAtPath("/World/Container").GetChildren()}
    assert walls.keys() == inner.keys()
    for name, (axis, at) in inner.items():
        box = cache.ComputeWorldBound(walls[name]).ComputeAlignedRange()
        assert min(abs(box.GetMin()[axis] - at), abs(box.GetMax()[axis] - at)) < 1e-6
        material, _ = UsdShade.MaterialBindingAPI(walls[name]).ComputeBoundMaterial("physics")
        friction = UsdPhysics.MaterialAPI(material.GetPrim()).GetDynamicFrictionAttr().Get()
        assert friction == (0.0 if axis == 2 else 0.5)


@pytest.mark.client
def test_walls_of_a_cylinder_are_boxes_that_touch_its_planes_from_outside(fresh, tmp_path):
    from pxr import Gf, UsdGeom

    domain = Domain.cylinder(5e-3, 7e-3, sides=16)
    exporters.write(replace(fresh, domain=domain), tmp_path / "bed.usda")
    cache = UsdGeom.XformCache()
    stage = opened(tmp_path / "bed.usda")
    walls = {prim.GetName(): prim for prim in stage.GetPrimAtPath("/World/Container").GetChildren()}
    assert len(walls) == 5 + 12
    for k, plane in enumerate(domain.planes):
        matrix = cache.GetLocalToWorldTransform(walls[f"wall_p{k}"])
        corners = [matrix.Transform(Gf.Vec3d(x, y, z)) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
        heights = np.array(corners) @ plane[:3] - plane[3]
        assert heights.min() == pytest.approx(0.0, abs=1e-9)
        assert np.sort(heights)[3] == pytest.approx(0.0, abs=1e-9)
