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
        ({"region": "middle"}, "'core', 'bed' or the two corners"),
        ({"region": ([0, 0, 0], [1, 1, 1])}, "the box must lie in the domain"),
        ({"region": ([0, 0], [1, 1])}, "'core', 'bed' or the two corners"),
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
    void = float(re.search(r"Total volume = (\S+)\.\s", told)[1]) / np.prod(np.subtract(case["upper"], case["lower"]))
    # The mesh holds the void that the geometry has, but for the narrowest gaps.
    assert void == pytest.approx(case["porosity"], abs=0.01)
    found = openfoam.flow(tmp_path)
    assert found.is_steady
    assert 0.5 < found.permeability / found.kozeny_carman < 2
    assert found.reynolds < 0.1


@pytest.mark.client
def test_a_mesh_too_coarse_for_the_throats_is_told(program, tmp_path):
    program("simpleFoam", "openfoam")
    domain = Domain.cube(6.3e-3)
    bed = carve(tessellate(relax(poisson(domain, 250, rng=3), domain, iterations=3), domain))
    exporters.write(shrink(bed, porosity=0.4), tmp_path, formats="openfoam", cells=8)
    result = subprocess.run(["./Allrun"], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert "The mesh reaches no inlet: it is too coarse for the throats" in result.stderr
