from __future__ import annotations

import io
import json
import os
import re
import subprocess

import numpy as np
import pytest
import trimesh
from conftest import cube_packing

import exporters
from exporters import openfoam
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import diameters, porosity
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

ENVIRONMENT = {**os.environ, "WM_PROJECT_DIR": os.environ.get("WM_PROJECT_DIR", "/usr/share/openfoam")}


def case_of(packing, **options):
    content = exporters.files(packing, "openfoam", **options)
    return content, json.loads(content["case.json"])


def surface(content, name="constant/triSurface/grains.stl"):
    return trimesh.load(io.BytesIO(content[name]), file_type="stl")


def touching(gap=0.0, overlap=0.0):
    """Two cubes of edge 2 beside each other along x, their faces ``gap`` apart or ``overlap`` deep in one another."""
    half = 1.0 + 0.5 * (gap - overlap)
    return cube_packing([[5 - half, 5, 5], [5 + half, 5, 5]])


BOX = ([1.0, 1.0, 1.0], [9.0, 9.0, 9.0])


@pytest.mark.unit
@pytest.mark.parametrize(
    ("contact", "volume", "area"),
    [
        # Both cubes lose g/2 on all six faces.
        ("shrink", 2 * 1.9**3, 2 * 6 * 1.9**2),
        # Each loses a slab of g/2 at the face that is cut.
        ("cap", 2 * 1.95 * 4, 2 * (2 * 4 + 4 * 2 * 1.95)),
        # Grown by g over the mean diameter about their centres, they overlap by the growth and are one.
        ("union", None, None),
    ],
)
def test_what_a_treatment_does_to_porosity_and_surface_is_told_exactly(contact, volume, area):
    gap = 0.1
    bed = touching()
    _, case = case_of(bed, region=BOX, contact=contact, gap=gap, cells=10, void_mesh=False)
    if contact == "union":
        f = 1 + gap / float(diameters(bed.grains).mean())
        edge = 2 * f
        volume = edge * edge * (2 + edge)
        area = 2 * edge * edge + 4 * edge * (2 + edge)
    assert case["porosity_before"] == pytest.approx(1 - 16 / 512, abs=1e-12)
    assert case["surface_area_before"] == pytest.approx(2 * (10 + 4 * 2) + 2 * 2, rel=1e-9)  # the common face is inside
    assert case["porosity"] == pytest.approx(1 - volume / 512, abs=1e-12)
    assert case["surface_area"] == pytest.approx(area, rel=1e-9)
    assert case["near_contacts"] == 1


@pytest.mark.unit
def test_a_bridge_is_a_prism_between_the_grains():
    gap = 0.1
    bed = touching(gap=0.05)
    _, case = case_of(bed, region=BOX, contact="bridge", gap=gap, cells=10, void_mesh=False)
    radius = 3 * gap
    section = 0.5 * 16 * radius**2 * np.sin(2 * np.pi / 16)
    side = 16 * 2 * radius * np.sin(np.pi / 16)
    assert case["porosity"] == pytest.approx(1 - (16 + 0.05 * section) / 512, abs=1e-12)
    assert case["surface_area"] == pytest.approx(48 - 2 * section + 0.05 * side, rel=1e-9)


@pytest.mark.unit
@pytest.mark.parametrize("contact", ["shrink", "cap", "bridge", "union"])
def test_overlapping_grains_become_a_closed_surface(contact):
    content, case = case_of(touching(overlap=0.02), region=BOX, contact=contact, gap=0.1, cells=10)
    mesh = surface(content)
    assert mesh.is_watertight
    assert case["smallest_gap_before"] == pytest.approx(-0.02, rel=1e-9)
    # Single precision keeps seven digits.
    assert mesh.volume == pytest.approx((1 - case["porosity"]) * 512, rel=1e-5)
    assert len(mesh.split()) == (2 if contact in ("shrink", "cap") else 1)


@pytest.mark.unit
def test_the_void_is_the_region_less_the_grains(fresh):
    content, case = case_of(fresh, cells=10)
    region = (np.array(case["lower"]), np.array(case["upper"]))
    assert case["porosity"] == pytest.approx(porosity(fresh, region=region), abs=1e-9)
    parts = {}
    for text in content["void.stl"].decode().split("endsolid")[:-1]:
        name = re.search(r"solid (\w+)\nfacet", text)[1]
        parts[name] = np.array(re.findall(r"vertex (\S+) (\S+) (\S+)", text), float).reshape(-1, 3, 3)
    assert set(parts) == {"inlet", "outlet", "sides", "grains"}
    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(np.concatenate(list(parts.values()))))
    mesh.merge_vertices()
    assert mesh.is_watertight
    size = region[1] - region[0]
    assert mesh.volume == pytest.approx(case["porosity"] * np.prod(size), rel=1e-5)
    np.testing.assert_allclose(parts["inlet"][..., 2], region[0][2], rtol=1e-6)
    np.testing.assert_allclose(parts["outlet"][..., 2], region[1][2], rtol=1e-6)
    area = np.linalg.norm(trimesh.triangles.cross(parts["grains"]), axis=1).sum() / 2
    assert area == pytest.approx(case["surface_area"], rel=1e-5)


@pytest.mark.unit
@pytest.mark.parametrize("contact", ["shrink", "bridge", "union"])
def test_the_point_is_in_the_void(fresh, contact):
    content, case = case_of(fresh, contact=contact, gap=0.1 * float(diameters(fresh.grains).mean()), cells=15)
    point = np.array(case["void_point"])
    mesh = surface(content)
    assert not mesh.contains([point])[0]
    # The clearance is a lower bound of the distance to the surface.
    _, (distance,), _ = trimesh.proximity.closest_point(mesh, [point])
    assert 0 < case["void_point_clearance"] <= distance * (1 + 1e-6)
    # A cell's centre lies on no face of the background mesh.
    cell = (np.array(case["upper"]) - case["lower"]) / case["cells"]
    np.testing.assert_allclose(np.mod((point - case["lower"]) / cell, 1), 0.5, atol=1e-6)


@pytest.mark.unit
def test_a_whole_bed_has_a_plenum_before_and_behind(fresh):
    _, case = case_of(fresh, region="bed", cells=10, void_mesh=False)
    d = case["mean_diameter"]
    corners = world_vertices(fresh)
    assert case["lower"][2] == pytest.approx(corners[:, 2].min() - d)
    assert case["upper"][2] == pytest.approx(corners[:, 2].max() + d)
    np.testing.assert_allclose(case["upper"][:2], fresh.domain.upper[:2])


@pytest.mark.unit
def test_grains_of_a_periodic_bed_reach_in_from_the_other_side():
    domain = Domain.cube(1.0, periodic=True)
    bed = shrink(carve(tessellate(poisson(domain, 60, rng=4), domain)), porosity=0.5)
    _, case = case_of(bed, region=(domain.lower, domain.upper), cells=8, void_mesh=False)
    assert case["porosity"] == pytest.approx(0.5, abs=1e-9)


def tiled(n=12, periodic=(True, True, True), **shrinking):
    domain = Domain(np.zeros(3), np.full(3, 3e-3), periodic=periodic)
    cells = tessellate(relax(poisson(domain, n, rng=4), domain, iterations=5), domain)
    return shrink(carve(cells), **shrinking)


@pytest.mark.unit
@pytest.mark.parametrize(
    "contact", ["shrink", *(pytest.param(k, marks=pytest.mark.slow) for k in ("cap", "bridge", "union"))]
)
def test_opposite_faces_of_a_periodic_cell_are_one(contact):
    # Gaps are about the one asked for: images of a grain must be treated alike.
    bed = tiled(n=30, scale=0.9)
    content, case = case_of(bed, region="periodic", contact=contact, gap=0.1e-3, cells=60)
    assert case["periodic"]
    assert case["near_contacts"] > 10
    parts = {}
    for text in content["void.stl"].decode().split("endsolid")[:-1]:
        name = re.search(r"solid (\w+)\nfacet", text)[1]
        parts[name] = np.array(re.findall(r"vertex (\S+) (\S+) (\S+)", text), float).reshape(-1, 3, 3)
    assert set(parts) == {"grains", *(f"{axis}_{side}" for axis in "xyz" for side in ("lower", "upper"))}
    for k, axis in enumerate("xyz"):
        corners = [np.unique(parts[f"{axis}_{side}"].reshape(-1, 3), axis=0) for side in ("lower", "upper")]
        shifted = corners[0] + 3e-3 * np.eye(3)[k]
        for a, b in ((shifted, corners[1]), (corners[1], shifted)):
            # A corner of one is a corner of the other, or lies on an edge of it that is cut in two.
            away = np.linalg.norm(a[:, None] - b[None], axis=2).min(axis=1)
            assert (away < 1e-9).mean() > 0.9
        areas = [
            np.linalg.norm(trimesh.triangles.cross(parts[f"{axis}_{side}"]), axis=1).sum()
            for side in ("lower", "upper")
        ]
        assert areas[0] == pytest.approx(areas[1], rel=1e-6)


@pytest.mark.unit
def test_each_grain_has_a_patch_of_its_own_where_asked(monkeypatch):
    bed = tiled(porosity=0.5)
    content, _ = case_of(bed, region="periodic", cells=10, per_grain=True, void_mesh=False)
    names = re.findall(r"^solid (\w+)$", content["constant/triSurface/grains.stl"].decode(), re.MULTILINE)
    # Twelve grains, with all their images.
    assert names == [f"g{i:06d}" for i in range(12)]
    one, _ = case_of(bed, region="periodic", cells=10, void_mesh=False)
    areas = [surface(part).area for part in (content, one)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-6)
    assert "inGroups (grains)" in content["system/snappyHexMeshDict"].decode()
    with pytest.raises(
        InputError, match="per_grain needs grains that stay apart: contact shrink, cap or none; got 'union'"
    ):
        case_of(bed, region="periodic", contact="union", per_grain=True)
    monkeypatch.setattr(openfoam, "MOST_PATCHES", 5)
    with pytest.raises(InputError, match="a patch a grain, at most 5; got 12 grains"):
        case_of(bed, region="periodic", cells=10, per_grain=True)


@pytest.mark.client
@pytest.mark.parametrize(("contact", "processes"), [("shrink", "1"), ("cap", "2")])
def test_openfoam_has_a_patch_a_grain_and_runs_in_parallel_too(contact, processes, program, tmp_path):
    program("simpleFoam", "openfoam")
    program("mpirun", "openmpi-bin")
    bed = cube_packing([[3.0, 5, 5], [7, 5, 5], [5, 5, 9], [5, 1, 1.2]])
    # The last two are cut by the box.
    exporters.write(bed, tmp_path, formats="openfoam", region=BOX, cells=5, per_grain=True, contact=contact)
    result = subprocess.run(
        ["./Allrun", processes], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-500:]
    patches = re.findall(
        r"(\w+)\n +{\n +type +wall;\n +inGroups[^(]*\(grains wall\);\n +nFaces +(\d+)",
        (tmp_path / "constant/polyMesh/boundary").read_text(),
    )
    assert [name for name, _ in patches] == [f"grains_g{i:06d}" for i in range(4)]
    assert all(int(faces) > 20 for _, faces in patches)
    assert openfoam.flow(tmp_path).is_steady


@pytest.mark.unit
def test_a_cell_that_is_periodic_along_the_flow_only_has_sides():
    content, _ = case_of(tiled(periodic=(False, False, True), n=40, porosity=0.5), region="periodic", cells=10)
    mesh, velocity, pressure = (content[name].decode() for name in ("system/blockMeshDict", "0.orig/U", "0.orig/p"))
    assert "z_lower { type cyclic; neighbourPatch z_upper; faces ((0 3 2 1)); }" in mesh
    assert "x_lower { type wall; inGroups (sides); faces ((0 4 7 3)); }" in mesh
    assert "sides { type noSlip; }" in velocity
    for text in (mesh, velocity, pressure):
        assert "inlet" not in text
        assert "outlet" not in text
    assert "injectionRateSuSp { U ((0 0 " in content["constant/fvOptions"].decode()


@pytest.mark.unit
def test_a_cylinder_brings_its_walls():
    domain = Domain.cylinder(1.0, 2.0, sides=16)
    bed = shrink(carve(tessellate(poisson(domain, 150, rng=4), domain)), porosity=0.5)
    content, _ = case_of(bed, region="bed", cells=10, void_mesh=False)
    walls = surface(content, "constant/triSurface/walls.stl")
    assert walls.is_watertight
    assert walls.volume / np.ptp(walls.vertices[:, 2]) == pytest.approx(np.pi, rel=1e-5)
    assert "walls" in content["0.orig/U"].decode()


@pytest.mark.unit
def test_the_origin_can_be_that_of_the_region(fresh):
    _, world = case_of(fresh, cells=10, void_mesh=False)
    content, moved = case_of(fresh, cells=10, void_mesh=False, origin="region")
    np.testing.assert_allclose(moved["lower"], 0, atol=1e-12)
    np.testing.assert_allclose(np.subtract(moved["void_point"], moved["moved_by"]), world["void_point"])
    assert surface(content).bounds[1].max() < 1.2 * max(moved["upper"])


@pytest.mark.unit
def test_the_same_packing_gives_the_same_bytes(fresh):
    assert case_of(fresh, cells=8)[0] == case_of(fresh, cells=8)[0]


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"region": "middle"}, "'core', 'bed', 'periodic' or the two corners"),
        ({"region": "periodic"}, "region='periodic' needs a bed that is periodic along the flow, z"),
        ({"region": ([0, 0, 0], [1, 1, 1])}, "the box must lie in the domain"),
        ({"region": ([0, 0], [1, 1])}, "'core', 'bed', 'periodic' or the two corners"),
        ({"axis": "w"}, "axis must be one of x, y, z; got 'w'"),
        ({"contact": "glue"}, "contact must be one of shrink, cap, bridge, union, none; got 'glue'"),
        ({"gap": -1.0}, "gap must be positive"),
        ({"cells": 0.0}, "cells must be positive"),
        ({"level": 7}, "0 to 5; got 7"),
        ({"cells": 1.0}, "use more cells a diameter"),
    ],
)
def test_impossible_options_are_refused(fresh, options, words):
    with pytest.raises(InputError, match=words):
        case_of(fresh, **options)


@pytest.mark.unit
def test_a_region_without_grains_is_refused():
    with pytest.raises(InputError, match="no grain reaches into"):
        case_of(cube_packing([[2.0, 2.0, 2.0]]), region=([7, 7, 7], [8, 8, 8]))


@pytest.mark.unit
def test_a_bed_without_a_core_is_refused_with_the_way_out():
    few = cube_packing([[1.0, 1.0, 1.0], [3.0, 1.0, 1.0]])
    with pytest.raises(
        InputError, match=r"too small for a core.*; region='bed' takes all of it \(--option region=bed\)"
    ):
        case_of(few)


@pytest.mark.unit
def test_kozeny_and_carman_are_the_formula():
    assert openfoam.kozeny_carman(2.0, 0.5) == pytest.approx(4 * 0.125 / (180 * 0.25))
    for bad in ((0, 0.5), (1, 0), (1, 1)):
        with pytest.raises(InputError, match="a porosity between 0 and 1"):
            openfoam.kozeny_carman(*bad)


@pytest.mark.unit
def test_a_case_that_was_not_run_is_told(tmp_path, fresh):
    exporters.write(fresh, tmp_path, formats="openfoam", cells=8, void_mesh=False)
    with pytest.raises(MissingFileError, match="run its Allrun first"):
        openfoam.flow(tmp_path)
    table = tmp_path / "postProcessing" / "flowRate" / "0"
    table.mkdir(parents=True)
    with pytest.raises(MissingFileError, match="holds no flow rate"):
        openfoam.flow(tmp_path)
    (table / "surfaceFieldValue.dat").write_text("# nothing\nword word\n")
    with pytest.raises(FileFormatError, match="not a table of flow rates"):
        openfoam.flow(tmp_path)


@pytest.mark.unit
def test_permeability_is_darcys(tmp_path, fresh):
    exporters.write(fresh, tmp_path, formats="openfoam", cells=8, void_mesh=False)
    case = json.loads((tmp_path / "case.json").read_text())
    size = np.subtract(case["upper"], case["lower"])
    table = tmp_path / "postProcessing" / "flowRate" / "0" / "surfaceFieldValue.dat"
    table.parent.mkdir(parents=True)
    table.write_text("# Time\tsum(phi)\n1\t5e-13\n2\t1e-12\n3\t1e-12\n")
    found = openfoam.flow(tmp_path)
    assert found.velocity == pytest.approx(1e-12 / (size[0] * size[1]))
    assert found.permeability == pytest.approx(found.velocity * 1e-6 * size[2] / case["kinematic_pressure_drop"])
    assert found.is_steady
    table.write_text("# Time\tsum(phi)\n1\t5e-13\n2\t1e-12\n")
    assert not openfoam.flow(tmp_path).is_steady
    # Of a periodic cell, the integral of velocity in place of the flow rate.
    (tmp_path / "case.json").write_text(json.dumps({**case, "periodic": True}))
    with pytest.raises(MissingFileError, match="holds no flow rate"):
        openfoam.flow(tmp_path)
    table = tmp_path / "postProcessing" / "drift" / "0" / "volFieldValue.dat"
    table.parent.mkdir(parents=True)
    drift = 1e-12 * size[2]
    table.write_text(f"# Time\tvolIntegrate(U)\n1\t(0 0 {drift:.12g})\n2\t(1e-15 -2e-15 {drift:.12g})\n")
    assert openfoam.flow(tmp_path).permeability == pytest.approx(found.permeability)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("junk", "not JSON: Expecting value"),
        ("[1]", "not a JSON object; got"),
        ("[" * 100_000, "nested too deep"),
        ({"axis": "w"}, "axis must be 'x', 'y' or 'z'; got 'w'"),
        ({"kinematic_pressure_drop": None}, "kinematic_pressure_drop must be a number above 0; got None"),
        ({"kinematic_pressure_drop": 0}, "kinematic_pressure_drop must be a number above 0; got 0"),
        ({"volume": True}, "volume must be a number above 0; got True"),
        ({"upper": [0, 0, 0]}, "upper must be above lower along z"),
        ({"porosity": "x"}, "porosity must be a number above 0; got 'x'"),
    ],
)
def test_a_junk_case_is_one_line(tmp_path, fresh, change, told):
    exporters.write(fresh, tmp_path, formats="openfoam", cells=8, void_mesh=False)
    table = tmp_path / "postProcessing" / "flowRate" / "0" / "surfaceFieldValue.dat"
    table.parent.mkdir(parents=True)
    table.write_text("# Time\tsum(phi)\n1\t5e-13\n")
    case = tmp_path / "case.json"
    case.write_text(change if isinstance(change, str) else json.dumps({**json.loads(case.read_text()), **change}))
    with pytest.raises(FileFormatError) as error:
        openfoam.flow(tmp_path)
    assert told in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.client
@pytest.mark.parametrize("contact", ["shrink", "cap", "bridge", "union"])
def test_openfoam_finds_the_surface_of_touching_grains_closed(contact, program, tmp_path):
    check = program("surfaceCheck", "openfoam")
    domain = Domain.cube(1.0)
    bed = carve(tessellate(relax(poisson(domain, 120, rng=3), domain, iterations=2), domain))
    # Nearly touching: gaps of about a hundredth of a diameter, all below the gap asked for.
    bed = shrink(bed, scale=0.99)
    d = float(diameters(bed.grains).mean())
    # A point outside the hull of the kept grains: there is void enough.
    exporters.write(bed, tmp_path, formats="openfoam", region="bed", contact=contact, gap=0.03 * d, cells=10)
    for name in ("constant/triSurface/grains.stl", "void.stl"):
        command = [check, "-checkSelfIntersection", name]
        told = subprocess.run(command, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=True).stdout
        assert "no illegal triangles" in told
        assert "Surface is closed" in told, told[-800:]
        assert "Surface is not self-intersecting" in told


@pytest.mark.client
@pytest.mark.opens("openfoam", "OpenFOAM", "meshed", "stepped")
def test_openfoam_runs_the_case_as_it_stands_and_finds_the_permeability_of_kozeny_and_carman(program, tmp_path):
    program("simpleFoam", "openfoam")
    domain = Domain.cube(0.01)
    bed = carve(tessellate(relax(poisson(domain, 200, rng=1), domain, iterations=5), domain))
    bed = shrink(bed, porosity=0.4)
    half = float(diameters(bed.grains).mean())
    box = (np.full(3, 0.005) - half, np.full(3, 0.005) + half)
    exporters.write(bed, tmp_path, formats="openfoam", region=box, cells=15)
    result = subprocess.run(["./Allrun"], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-500:]
    case = json.loads((tmp_path / "case.json").read_text())
    told = (tmp_path / "log.checkMesh").read_text()
    assert "Mesh OK." in told
    lower, upper = (np.array(corner.split(), float) for corner in re.search(r"box \((.*?)\) \((.*?)\)", told).groups())
    # To the digits of single precision, which the surfaces have.
    np.testing.assert_allclose(lower, case["lower"], atol=1e-6 * case["mean_diameter"])
    np.testing.assert_allclose(upper, case["upper"], atol=1e-6 * case["mean_diameter"])
    void = float(re.search(r"Total volume = (\S+)\.\s", told)[1]) / np.prod(np.subtract(case["upper"], case["lower"]))
    # The mesh holds the void that the geometry has, but for the narrowest gaps.
    assert void == pytest.approx(case["porosity"], abs=0.01)
    found = openfoam.flow(tmp_path)
    assert found.is_steady
    assert 0.5 < found.permeability / found.kozeny_carman < 2
    assert found.reynolds < 0.1


@pytest.mark.client
@pytest.mark.opens("openfoam", "OpenFOAM", "meshed", "stepped")
def test_a_periodic_cell_has_the_permeability_of_its_box_without_the_ends(program, tmp_path):
    program("simpleFoam", "openfoam")
    bed = tiled(porosity=0.5)
    found = {}
    for name, region in (("cell", "periodic"), ("box", (bed.domain.lower, bed.domain.upper))):
        folder = tmp_path / name
        exporters.write(bed, folder, formats="openfoam", region=region, cells=12, void_mesh=False)
        result = subprocess.run(["./Allrun"], cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-500:]
        found[name] = openfoam.flow(folder)
        assert found[name].is_steady
    assert "Mesh OK." in (tmp_path / "cell" / "log.checkMesh").read_text()
    mesh = (tmp_path / "cell" / "constant" / "polyMesh" / "boundary").read_text()
    assert mesh.count(" cyclic;") == 6
    faces = re.findall(r"[xyz]_\w+\n[^}]*?nFaces +(\d+);", mesh)
    assert faces[::2] == faces[1::2]
    assert found["cell"].permeability == pytest.approx(found["box"].permeability, rel=0.2)
    assert 0.5 < found["cell"].permeability / found["cell"].kozeny_carman < 2


@pytest.mark.client
def test_a_mesh_too_coarse_for_the_throats_is_told(program, tmp_path):
    program("simpleFoam", "openfoam")
    domain = Domain.cube(6.3e-3)
    bed = carve(tessellate(relax(poisson(domain, 250, rng=3), domain, iterations=3), domain))
    exporters.write(shrink(bed, porosity=0.4), tmp_path, formats="openfoam", cells=8)
    result = subprocess.run(["./Allrun"], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert "The mesh reaches no inlet: it is too coarse for the throats" in result.stderr


@pytest.mark.client
def test_a_mesh_that_openfoam_finds_unsound_is_told_and_not_run(program, tmp_path):
    real = program("checkMesh", "openfoam")
    exporters.write(touching(gap=0.5), tmp_path, formats="openfoam", region=BOX, cells=5)
    # The same check, as it would end for a skew mesh.
    (tmp_path / "bin").mkdir()
    check = tmp_path / "bin" / "checkMesh"
    check.write_text(f"#!/bin/sh\n{real} | sed 's/^Mesh OK.*/ ***Max skewness = 17, 8 highly skew faces/'\n")
    check.chmod(0o755)
    path = {**ENVIRONMENT, "PATH": f"{check.parent}:{ENVIRONMENT['PATH']}"}
    result = subprocess.run(["./Allrun"], cwd=tmp_path, env=path, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert "checkMesh finds the mesh unsound:\nMax skewness = 17, 8 highly skew faces\n" in result.stderr
    assert not (tmp_path / "log.simpleFoam").exists()
