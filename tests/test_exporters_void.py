from __future__ import annotations

import os
import re
import subprocess

import manifold3d
import numpy as np
import pytest
import trimesh
from conftest import cube_packing

import exporters
from exporters.void.faces import faces
from exporters.void.tetrahedra import quality
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.measures import diameters
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

ENVIRONMENT = {**os.environ, "WM_PROJECT_DIR": os.environ.get("WM_PROJECT_DIR", "/usr/share/openfoam")}
BOX = ([1.0, 1.0, 1.0], [9.0, 9.0, 9.0])
FOUR = [[3.0, 3, 3], [7, 3.5, 5], [3, 7, 9], [6.5, 7, 1]]
"""Cubes of edge 2, of which the last two are cut in halves by the box."""


def script_of(packing, **options):
    content = exporters.files(packing, ".msh", region="void", **options)
    return content["bed.geo"].decode(), content["bed.msh"].decode()


def filled(program, folder, *more):
    """Let Gmsh fill a script and return what it says of its mesh."""
    done = subprocess.run(
        [program("gmsh", "gmsh"), "-3", *more, "-o", "filled.msh", "bed.geo"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Error" not in done.stdout + done.stderr, done.stderr
    return quality(folder / "filled.msh")


@pytest.fixture(scope="module")
def forty():
    """A bed, and a box of two diameters in it that forty of its grains reach into."""
    domain = Domain.cube(0.01)
    bed = carve(tessellate(relax(poisson(domain, 200, rng=1), domain, iterations=5), domain))
    bed = shrink(bed, porosity=0.4)
    half = float(diameters(bed.grains).mean())
    return bed, (np.full(3, 0.005) - half, np.full(3, 0.005) + half)


@pytest.mark.unit
def test_plane_faces_have_their_holes_and_hollows():
    block = manifold3d.Manifold.cube([4.0, 4.0, 4.0])
    through = manifold3d.Manifold.cube([1.0, 1.0, 6.0]).translate([0.5, 0.5, -1.0])
    hollow = manifold3d.Manifold.cube([1.0, 1.0, 1.0]).translate([2.0, 2.0, 2.0])
    apart = manifold3d.Manifold.cube([1.0, 1.0, 1.0]).translate([9.0, 0.0, 0.0])
    found = faces((block - through - hollow) + apart, np.zeros(3), np.full(3, 4.0))
    assert found.volume() == pytest.approx(64 - 4 - 1 + 1)
    assert sorted(len(loops) for loops in found.loops) == [1] * 20 + [2, 2]
    # Six faces and four of the passage, the hollow's six, and the block apart.
    assert [[len(shell) for shell in part] for part in found.parts] == [[10, 6], [6]]
    assert all(len(loop) == 4 for loops in found.loops for loop in loops)


@pytest.mark.unit
def test_short_edges_go_and_corners_on_walls_stay_there():
    cube = manifold3d.Manifold.cube([1.0, 1.0, 1.0])
    # A corner cut off by so little that its triangle has edges of a thousandth.
    cut = cube.trim_by_plane([-1.0, -1.0, -1.0], -(3.0 - 7e-4) / 3**0.5)
    # Each of its corners lies on two walls: none may go.
    assert len(faces(cut, np.zeros(3), np.ones(3), shortest=2e-3).points) == 10
    found = faces(cut, np.zeros(3), np.array([1.0, 5.0, 5.0]), shortest=2e-3)
    assert len(found.points) == 8
    mesh = trimesh.Trimesh(found.points, found.triangles, process=False)
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [1, 1, 1]], atol=1e-12)
    assert (mesh.vertices[:, 0] == 1).sum() == 4
    assert found.volume() == pytest.approx(1, rel=1e-3)


@pytest.mark.unit
def test_the_voids_surface_is_closed_and_says_its_groups():
    script, surface = script_of(cube_packing(FOUR), box=BOX)
    assert "volume 488 m3, porosity 0.953125" in script
    assert "parts from inlet to outlet: 1; pockets: 0" in script
    for k, name in enumerate(("inlet", "outlet", "sides", "grains"), 1):
        assert f'Physical Surface("{name}", {k})' in script
        assert f'2 {k} "{name}"' in surface
    lines = surface.splitlines()
    first = lines.index("$Nodes")
    n = int(lines[first + 1].split()[1])
    points = np.array([line.split() for line in lines[first + 3 + n : first + 3 + 2 * n]], float)
    rows = iter(lines[lines.index("$Elements") + 2 : lines.index("$EndElements")])
    corners = [next(rows).split()[1:] for head in rows for _ in range(int(head.split()[3]))]
    mesh = trimesh.Trimesh(points, np.array(corners, int) - 1, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(488)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"region": "between"}, "region must be one of grains, void, core, bed; got 'between'"),
        ({"box": ([0, 0, 0], [99, 9, 9])}, "the box must lie in the domain"),
        ({"size": 0.0}, "size must be positive"),
        ({"shortest_edge": -1.0}, "shortest_edge must be zero or more"),
        ({"axis": "w"}, "axis must be one of x, y, z"),
        ({"contact": "glue"}, "contact must be one of shrink"),
        ({"box": ([4.5, 4.5, 4.5], [5.5, 5.5, 5.5]), "gap": 0.01}, "the box holds no void"),
    ],
)
def test_voids_that_cannot_be_are_refused(options, told):
    with pytest.raises(InputError, match=told):
        exporters.files(cube_packing([[5.0, 5, 5]]), ".msh", **{"region": "void", **options})


@pytest.mark.unit
def test_words_that_are_openfoams_fill_the_grains():
    bed = cube_packing([[5.0, 5, 5]])
    assert exporters.files(bed, ".msh", region="bed") == exporters.files(bed, ".msh")


@pytest.mark.unit
def test_the_quality_of_the_regular_tetrahedron_and_of_a_corner_of_a_cube(tmp_path):
    regular = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    corner = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    nodes = "".join(f"{k} {x} {y} {z}\n" for k, (x, y, z) in enumerate([*regular, *corner], 1))
    elements = "1 15 2 0 1 1\n2 4 2 5 1 1 3 2 4\n3 4 2 5 1 5 6 7 8\n"
    path = tmp_path / "two.msh"
    path.write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n{nodes}$EndNodes\n$Elements\n3\n{elements}$EndElements\n"
    )
    found = quality(path)
    assert found.n_tetrahedra == 2
    assert found.volume == pytest.approx(8 / 3 + 1 / 6)
    assert found.least_angle == pytest.approx(np.arccos(1 / np.sqrt(3)))
    assert found.greatest_angle == pytest.approx(np.pi / 2)
    # |A| |A^-1| of the map from the regular one to the corner, from its Gram matrix.
    edges = np.array([[1, 0, 0], [0.5, np.sqrt(3) / 2, 0], [0.5, np.sqrt(3) / 6, np.sqrt(2 / 3)]])
    bent = 3 / (np.linalg.norm(np.linalg.inv(edges)) * np.linalg.norm(edges))
    assert (found.least_sicn, found.mean_sicn) == pytest.approx((bent, (1 + bent) / 2))


@pytest.mark.unit
def test_meshes_that_are_none_are_one_line(tmp_path):
    with pytest.raises(MissingFileError, match="gmsh -3"):
        quality(tmp_path / "none.msh")
    for text, told in (
        ("", "not a mesh in MSH 2.2"),
        ("$MeshFormat\n4.1 0 8\n", "its version must be 2.2, as text; got '4.1 0 8'"),
        ("$MeshFormat\n2.2 0 8\n$Nodes\n0\n$EndNodes\n$Elements\n0\n$EndElements\n", "it holds no tetrahedron"),
    ):
        (tmp_path / "bad.msh").write_text(text)
        with pytest.raises(FileFormatError, match=re.escape(told)):
            quality(tmp_path / "bad.msh")


@pytest.mark.client
@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-4])
def test_gmsh_fills_the_void_of_cut_cubes_exactly(program, tmp_path, scale):
    bed = cube_packing(np.multiply(FOUR, scale), half=scale, domain=Domain.cube(10 * scale))
    box = tuple(scale * np.array(corner) for corner in BOX)
    exporters.write(bed, tmp_path / "bed.msh", region="void", box=box, size=0.5, gap=0.01 * scale)
    assert filled(program, tmp_path).volume == pytest.approx(488 * scale**3, rel=1e-9)


@pytest.mark.client
@pytest.mark.opens("msh", "Gmsh", "counted", "weighed", "meshed")
@pytest.mark.opens("msh", "OpenFOAM", "counted")
def test_gmsh_fills_the_void_of_forty_grains_and_openfoam_takes_it(program, forty, tmp_path):
    bed, box = forty
    path = tmp_path / "bed.msh"
    exporters.write(bed, path, region="void", box=box)
    told = (tmp_path / "bed.geo").read_text()
    assert "void of 39 grains" in told
    volume = float(re.search(r"volume (\S+) m3", told)[1])
    found = filled(program, tmp_path)
    assert found.volume == pytest.approx(volume, rel=1e-9)
    assert np.degrees(found.least_angle) > 1
    assert found.least_sicn > 0.01
    assert found.mean_sicn > 0.7
    # Merging no edges, it is the void itself.
    exact = exporters.files(bed, "openfoam", region=box, cells=12, void_mesh=False)["case.json"].decode()
    case = {key: float(re.search(rf'"{key}": (\S+),', exact)[1]) for key in ("volume", "porosity")}
    exporters.write(bed, path, region="void", box=box, shortest_edge=0, overwrite=True)
    assert filled(program, tmp_path).volume == pytest.approx(case["volume"] * case["porosity"], rel=1e-9)
    # The surface as triangles is read too.
    done = subprocess.run(
        [program("gmsh", "gmsh"), "-0", "-o", "again.msh", "bed.msh"],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "Error" not in done.stdout + done.stderr
    converted(program, tmp_path)


def converted(program, folder):
    """Let OpenFOAM convert a filled void, and find its mesh sound and its patches those of the groups."""
    exporters.write(cube_packing([[5.0, 5, 5]]), folder / "case", formats="openfoam", region=BOX, cells=6)
    for command in (["gmshToFoam", "../filled.msh"], ["checkMesh"]):
        done = subprocess.run(
            [program(command[0], "openfoam"), *command[1:]],
            cwd=folder / "case", env=ENVIRONMENT, capture_output=True, text=True, check=True,
        )  # fmt: skip
    assert "Mesh OK." in done.stdout
    patches = (folder / "case" / "constant" / "polyMesh" / "boundary").read_text()
    assert re.findall(r"^    (\w+)\n    {", patches, re.MULTILINE) == ["grains", "sides", "inlet", "outlet"]
