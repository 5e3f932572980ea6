"""PLY, GLB, 3MF, VTK and MSH: each opened by programs that it is for, every grain counted and weighed."""

import io
import json
import subprocess

import lib3mf
import meshio
import numpy as np
import pytest
import pyvista
import trimesh

import exporters
from exporters.meshes import vtk
from exporters.units import units
from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.integrals import integrate, volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import table
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import carve, rescale, shrink
from grainsdem.points import poisson
from grainsdem.ragged import owners
from grainsdem.tessellation import tessellate

SUFFIXES = [".ply", ".glb", ".3mf", ".vtp", ".vtu", ".msh"]
DIAMETERS = [0.2e-3, 1e-3, 0.1]


@pytest.fixture(scope="module")
def planar():
    """A planar bed of prisms."""
    domain = Domain.slab((8e-3, 6e-3), 1e-3)
    return shrink(carve(tessellate(poisson(domain, 60, rng=2), domain)), porosity=0.3)


@pytest.fixture(scope="module")
def periodic():
    """A bed that is periodic along x and y: cells reach over the boundary."""
    domain = Domain(np.zeros(3), np.full(3, 5e-3), periodic=(True, True, False))
    return shrink(carve(tessellate(poisson(domain, 80, rng=4), domain)), porosity=0.35)


def written(packing, tmp_path, suffix, **options):
    """Write a packing and return its main file."""
    return exporters.write(packing, tmp_path / f"bed{suffix}", **options)[0]


def sized(packing, diameter):
    """Return the packing with a median diameter as given."""
    return rescale(packing, diameter / units(packing).length)


@pytest.mark.client
@pytest.mark.parametrize("diameter", DIAMETERS)
@pytest.mark.opens("vtk", "VTK", "counted", "weighed")
def test_vtk_reads_polygons_with_every_measure_of_their_grain(fresh, tmp_path, diameter):
    packing = sized(fresh, diameter)
    mesh = pyvista.read(written(packing, tmp_path, ".vtp", precision="double"))
    assert mesh.n_cells == packing.grains.n_faces
    np.testing.assert_array_equal(mesh.points, world_vertices(packing))
    rows = table(packing)
    faces = np.diff(packing.grains.face_offsets)
    for column in [name for name in rows.dtype.names if rows.dtype[name].kind in "fi"]:
        np.testing.assert_array_equal(mesh.cell_data[column], np.repeat(rows[column], faces))
    grain = mesh.extract_cells(np.flatnonzero(mesh.cell_data["id"] == 7)).extract_surface(algorithm="dataset_surface")
    assert grain.is_manifold
    assert grain.volume == pytest.approx(volumes(packing.grains)[7], rel=1e-9)


@pytest.mark.client
@pytest.mark.parametrize("diameter", DIAMETERS)
@pytest.mark.opens("vtk", "VTK", "counted", "weighed")
def test_vtk_reads_one_polyhedron_a_grain(fresh, tmp_path, diameter):
    packing = sized(fresh, diameter)
    grid = pyvista.read(written(packing, tmp_path, ".vtu"))
    assert grid.n_cells == len(packing)
    assert set(grid.celltypes.tolist()) == {vtk.POLYHEDRON}
    np.testing.assert_array_equal(grid.cell_data["id"], np.arange(len(packing)))
    measured = grid.compute_cell_sizes(length=False, area=False).cell_data["Volume"]
    np.testing.assert_allclose(measured, volumes(packing.grains), rtol=1e-9)
    np.testing.assert_allclose(grid.cell_data["mass"], table(packing)["mass"], rtol=1e-7)


@pytest.mark.client
def test_a_time_series_lists_every_time_with_the_grains_where_they_were(fresh, tmp_path):
    times = np.array([0.0, 0.25, 1e-17 + 0.5])
    positions = fresh.positions + np.arange(3.0)[:, None, None]
    quaternions = np.repeat(fresh.quaternions[None], 3, axis=0)
    for name, content in vtk.series(fresh, times, positions, quaternions, name="run").items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else b"".join(content))
    reader = pyvista.get_reader(tmp_path / "run.pvd")
    assert reader.time_values == times.tolist()
    for k, time in enumerate(times):
        reader.set_active_time_value(time)
        [mesh] = reader.read()
        np.testing.assert_allclose(mesh.points, world_vertices(fresh) + k, atol=1e-12)


@pytest.mark.unit
def test_a_time_series_of_no_time_or_of_other_grains_is_refused(fresh):
    with pytest.raises(InputError, match="at least one time"):
        vtk.series(fresh, np.empty(0), np.empty((0, 3)), np.empty((0, 4)))
    with pytest.raises(ShapeError, match="positions"):
        vtk.series(fresh, np.zeros(1), np.zeros((1, 2, 3)), np.zeros((1, 2, 4)))


@pytest.mark.client
@pytest.mark.parametrize("diameter", DIAMETERS)
@pytest.mark.opens("ply", "trimesh", "weighed")
@pytest.mark.opens("ply", "VTK", "counted")
def test_trimesh_reads_a_closed_ply_and_vtk_the_polygons(fresh, tmp_path, diameter):
    packing = sized(fresh, diameter)
    expected = volumes(packing.grains)
    mesh = trimesh.load(written(packing, tmp_path, ".ply"), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == len(packing)
    assert mesh.volume == pytest.approx(expected.sum(), rel=1e-12)
    ids = mesh.metadata["_ply_raw"]["vertex"]["data"]["grain"].ravel()[mesh.faces]
    assert (ids == ids[:, :1]).all()
    np.testing.assert_allclose(solid_volumes(mesh, ids[:, 0], len(packing)), expected, rtol=1e-10)
    polygons = pyvista.read(written(packing, tmp_path, ".ply", polygons=True))
    assert polygons.n_cells == packing.grains.n_faces
    assert polygons.volume == pytest.approx(expected.sum(), rel=1e-6)


def solid_volumes(mesh, owner, n):
    """Return the volume that the triangles of each of n grains enclose."""
    corners = mesh.triangles - mesh.bounds.mean(axis=0)
    parts = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return np.bincount(owner, parts, minlength=n)


@pytest.mark.client
@pytest.mark.opens("ply", "meshio", "counted", "weighed")
def test_meshio_reads_ply_with_the_grain_of_every_vertex(fresh, tmp_path):
    mesh = meshio.read(written(fresh, tmp_path, ".ply"))
    assert np.array_equal(mesh.points, world_vertices(fresh))
    assert np.array_equal(mesh.point_data["grain"], owners(fresh.grains.vertex_offsets))
    [block] = mesh.cells
    ids = mesh.point_data["grain"][block.data]
    assert (ids == ids[:, :1]).all()
    again = trimesh.Trimesh(mesh.points, block.data, process=False)
    np.testing.assert_allclose(solid_volumes(again, ids[:, 0], len(fresh)), volumes(fresh.grains), rtol=1e-10)
    bare = meshio.read(written(fresh, tmp_path, ".ply", ids="none", double=False))
    assert bare.points.dtype == np.float32
    assert np.array_equal(bare.cells[0].data, block.data)


@pytest.mark.client
@pytest.mark.opens("ply", "Gmsh", "weighed")
def test_gmsh_reads_ply_of_single_precision_without_ids(program, fresh, tmp_path):
    path = written(fresh, tmp_path, ".ply", ids="none", double=False)
    done = subprocess.run(
        [program("gmsh", "gmsh"), "-2", "-format", "msh2", "-o", "read.msh", path.name],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Error" not in done.stdout + done.stderr
    mesh = meshio.read(tmp_path / "read.msh")
    surface = trimesh.Trimesh(mesh.points, mesh.cells_dict["triangle"])
    assert surface.is_watertight
    assert surface.volume == pytest.approx(volumes(fresh.grains).sum(), rel=1e-6)


@pytest.mark.client
@pytest.mark.opens("vtk", "meshio", "counted", "weighed")
def test_meshio_reads_polyhedra_with_their_measures_where_they_are_sorted_by_corners(fresh, tmp_path):
    path = written(fresh, tmp_path, ".vtu", by_corners=True, precision="double")
    mesh, rows = meshio.read(path), table(fresh)
    n_corners, found = np.diff(fresh.grains.vertex_offsets), []
    for block, ids, masses in zip(mesh.cells, mesh.cell_data["id"], mesh.cell_data["mass"], strict=True):
        assert len(block.data) == len(ids)
        np.testing.assert_array_equal(masses, rows["mass"][ids])
        for faces, i in zip(block.data, ids, strict=True):
            assert len(faces) == len(fresh.grains.faces_of(i))
            corners = np.unique(np.concatenate(faces))
            assert len(corners) == n_corners[i]
            np.testing.assert_allclose(mesh.points[corners].mean(axis=0), centres(fresh)[i], rtol=1e-9)
        found += ids.tolist()
    assert sorted(found) == list(range(len(fresh)))
    grid = pyvista.read(path)
    order = grid.cell_data["id"]
    measured = grid.compute_cell_sizes(length=False, area=False).cell_data["Volume"]
    np.testing.assert_allclose(measured, volumes(fresh.grains)[order], rtol=1e-9)
    polygons = pyvista.read(written(fresh, tmp_path, ".vtp", by_corners=True))
    np.testing.assert_array_equal(polygons.cell_data["id"], np.repeat(order, np.diff(fresh.grains.face_offsets)[order]))


def centres(packing):
    """Return the mean of each grain's vertices in the world."""
    offsets = packing.grains.vertex_offsets
    return np.add.reduceat(world_vertices(packing), offsets[:-1]) / np.diff(offsets)[:, None]


@pytest.mark.client
@pytest.mark.parametrize("diameter", DIAMETERS)
@pytest.mark.opens("glb", "trimesh", "counted")
def test_trimesh_reads_a_node_a_grain_from_glb_with_its_pose_and_y_up(poured, tmp_path, diameter):
    packing = sized(poured, diameter)
    scene = trimesh.load(written(packing, tmp_path, ".glb"))
    integrals = integrate(packing.grains)
    assert len(scene.geometry) == len(packing)
    corners = np.split(world_vertices(packing), packing.grains.vertex_offsets[1:-1])
    for i in (0, 3, len(packing) - 1):
        pose, geometry = scene.graph[f"g{i:06d}"]
        mesh = scene.geometry[geometry]
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(integrals.volumes[i], rel=1e-5)
        # z up becomes y up: (x, y, z) is (x, z, -y) there.
        expected = corners[i].mean(axis=0)[[0, 2, 1]] * [1, 1, -1]
        found = trimesh.transform_points(mesh.vertices, pose).mean(axis=0)
        np.testing.assert_allclose(found, expected, atol=1e-5 * diameter * np.cbrt(len(packing)))


@pytest.mark.unit
def test_a_glb_file_is_laid_out_as_its_specification_says(fresh):
    content = exporters.files(fresh, ".glb")["bed.glb"]
    assert content[:4] == b"glTF"
    assert int.from_bytes(content[8:12], "little") == len(content)
    n_text = int.from_bytes(content[12:16], "little")
    document = json.loads(content[20 : 20 + n_text])
    n_binary = int.from_bytes(content[20 + n_text : 24 + n_text], "little")
    assert n_text % 4 == n_binary % 4 == 0
    assert n_binary == document["buffers"][0]["byteLength"] == len(content) - 28 - n_text
    starts = [view["byteOffset"] for view in document["bufferViews"]]
    assert all(start % 4 == 0 for start in starts)
    root, *nodes = document["nodes"]
    assert root["children"] == list(range(1, len(fresh) + 1))
    masses = fresh.densities * volumes(fresh.grains)
    assert [node["extras"]["mass"] for node in nodes] == masses.tolist()
    # Bounds are those of the numbers as they stand in the buffer.
    binary = content[28 + n_text :]
    for i in (0, len(fresh) - 1):
        view, accessor = document["bufferViews"][2 * i], document["accessors"][2 * i]
        part = np.frombuffer(binary, "<f4", count=3 * accessor["count"], offset=view["byteOffset"]).reshape(-1, 3)
        np.testing.assert_array_equal(part.min(axis=0), np.float32(accessor["min"]))
        np.testing.assert_array_equal(part.max(axis=0), np.float32(accessor["max"]))


@pytest.mark.client
@pytest.mark.parametrize(
    ("unit", "length", "known_as"),
    [("millimeter", 1e-3, "MilliMeter"), ("meter", 1.0, "Meter"), ("micron", 1e-6, "MicroMeter")],
)
@pytest.mark.opens("3mf", "lib3mf", "counted", "weighed")
def test_lib3mf_reads_every_grain_closed_and_in_the_unit_that_is_said(fresh, tmp_path, unit, length, known_as):
    path = written(fresh, tmp_path, ".3mf", unit=unit)
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    assert reader.GetWarningCount() == 0
    assert model.GetUnit().name == known_as
    objects = model.GetMeshObjects()
    assert objects.Count() == len(fresh) == model.GetBuildItems().Count()
    expected = volumes(fresh.grains)
    number = 0
    while objects.MoveNext():
        mesh = objects.GetCurrentMeshObject()
        assert mesh.GetName() == f"g{number:06d}"
        assert mesh.IsManifoldAndOriented()
        corners = np.array([list(vertex.Coordinates) for vertex in mesh.GetVertices()])
        faces = np.array([list(face.Indices) for face in mesh.GetTriangleIndices()])
        volume = trimesh.Trimesh(corners, faces, process=False).volume * length**3
        assert volume == pytest.approx(expected[number], rel=1e-4)
        number += 1
    assert trimesh.load(path).volume * length**3 == pytest.approx(expected.sum(), rel=1e-6)


@pytest.mark.client
@pytest.mark.parametrize("diameter", DIAMETERS)
@pytest.mark.opens("msh", "Gmsh", "counted", "weighed", "meshed")
def test_gmsh_fills_every_grain_with_tetrahedra_of_its_volume(program, cells, tmp_path, diameter):
    gmsh = program("gmsh", "gmsh")
    packing = sized(shrink(carve(cells), porosity=0.5), diameter)
    path = written(packing, tmp_path, ".msh")
    done = subprocess.run(
        [gmsh, "-3", "-format", "msh2", "-o", "filled.msh", path.with_suffix(".geo").name],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Error" not in done.stdout + done.stderr
    assert done.returncode == 0
    lines = (tmp_path / "filled.msh").read_text().splitlines()
    first = lines.index("$Nodes")
    nodes = np.array([line.split() for line in lines[first + 2 : lines.index("$EndNodes")]], dtype=float)
    points = np.zeros((int(nodes[:, 0].max()) + 1, 3))
    points[nodes[:, 0].astype(int)] = nodes[:, 1:]
    first = lines.index("$Elements")
    rows = [[int(word) for word in line.split()] for line in lines[first + 2 : lines.index("$EndElements")]]
    # number, kind 4 of a tetrahedron, two tags: the group and the volume; then the corners
    tetrahedra = np.array([row for row in rows if row[1] == 4])
    corners = points[tetrahedra[:, 5:]]
    parts = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    filled = np.bincount(tetrahedra[:, 4] - 1, parts, minlength=len(packing))
    np.testing.assert_allclose(filled, volumes(packing.grains), rtol=1e-9)


@pytest.mark.client
def test_gmsh_knows_a_group_a_grain_where_asked(program, cube, tmp_path):
    path = written(cube, tmp_path, ".msh", per_grain=True)
    done = subprocess.run(
        [program("gmsh", "gmsh"), "-3", "-format", "msh2", "-o", "filled.msh", path.with_suffix(".geo").name],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "Error" not in done.stdout
    assert '3 1 "g000000"' in (tmp_path / "filled.msh").read_text()


@pytest.mark.client
@pytest.mark.opens("obj", "trimesh", "counted", "weighed")
def test_trimesh_reads_a_closed_object_a_grain_from_obj(fresh, tmp_path):
    [path] = exporters.write(fresh, tmp_path / "bed.obj")
    mesh = trimesh.load(path, force="mesh")
    assert mesh.is_watertight
    assert mesh.body_count == len(fresh)
    assert mesh.volume == pytest.approx(volumes(fresh.grains).sum(), rel=1e-6)


@pytest.mark.client
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("kind", ["planar", "periodic", "poured"])
def test_every_kind_of_bed_keeps_its_volume(suffix, kind, request, tmp_path):
    packing = request.getfixturevalue(kind)
    path = written(packing, tmp_path, suffix)
    total = volumes(packing.grains).sum()
    if suffix == ".vtu":
        volume = pyvista.read(path).compute_cell_sizes().cell_data["Volume"].sum()
    elif suffix == ".vtp":
        volume = pyvista.read(path).volume
    elif suffix == ".msh":
        volume = msh_volume(path)
    else:
        scene = trimesh.load(path)
        parts = scene.geometry.values() if hasattr(scene, "geometry") else [scene]
        volume = sum(part.volume for part in parts) * (1e-9 if suffix == ".3mf" else 1.0)
    assert volume == pytest.approx(total, rel=1e-5)


def msh_volume(path):
    """Return the volume inside the triangles of an MSH 4.1 file, read by its own rules."""
    lines = iter(path.read_text().splitlines())
    points, corners = {}, []
    for line in lines:
        if line == "$Nodes":
            for _ in range(int(next(lines).split()[0])):
                tags = [next(lines) for _ in range(int(next(lines).split()[3]))]
                points |= {tag: [float(word) for word in next(lines).split()] for tag in tags}
        elif line == "$Elements":
            for _ in range(int(next(lines).split()[0])):
                corners += [next(lines).split()[1:] for _ in range(int(next(lines).split()[3]))]
    places = np.array([[points[tag] for tag in row] for row in corners])
    return np.einsum("ij,ij->i", places[:, 0], np.cross(places[:, 1], places[:, 2])).sum() / 6


@pytest.mark.unit
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_same_packing_gives_the_same_bytes(fresh, suffix):
    assert exporters.files(fresh, suffix) == exporters.files(fresh, suffix)


@pytest.mark.unit
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_packing_that_cannot_be_written_is_refused_and_nothing_is_left(fresh, tmp_path, suffix):
    nothing = Packing(
        Polyhedra(np.empty((0, 3)), [0], [0], np.empty(0, int), [0]),
        np.empty((0, 3)), np.empty((0, 4)), np.empty(0), Domain.cube(),
    )  # fmt: skip
    with pytest.raises(InputError, match="at least one grain"):
        exporters.write(nothing, tmp_path / f"bed{suffix}")
    lost = Packing(
        fresh.grains, fresh.positions + np.array([np.nan, 0, 0]), fresh.quaternions, fresh.densities, fresh.domain
    )
    with pytest.raises(InputError, match="finite"):
        exporters.write(lost, tmp_path / f"bed{suffix}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.unit
def test_options_that_a_format_does_not_know_are_refused(fresh):
    with pytest.raises(InputError, match=r"precision must be one of single, double; got 'half'"):
        exporters.files(fresh, ".vtp", precision="half")
    with pytest.raises(InputError, match=r"unit must be one of micron"):
        exporters.files(fresh, ".3mf", unit="furlong")


@pytest.mark.client
@pytest.mark.parametrize(("n", "parts"), [(255, [255]), (256, [3, 255]), (300, [47, 255]), (600, [94, 255, 255])])
def test_a_polygon_of_more_corners_than_a_byte_counts_is_cut_into_such(tmp_path, n, parts):
    turns = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    vertices = np.vstack([np.c_[ring, -np.ones(n)], np.c_[ring, np.ones(n)]])
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    faces = [list(range(n))[::-1], list(range(n, 2 * n)), *sides]
    shape = Polyhedra(vertices, [0, 2 * n], [0, n + 2], np.concatenate(faces), np.cumsum([0, *map(len, faces)]))
    drum = Packing(shape, np.zeros((1, 3)), [[1.0, 0, 0, 0]], [1.0], Domain(np.full(3, -9.0), np.full(3, 9.0)))
    polygons = pyvista.read(written(drum, tmp_path, ".ply", polygons=True))
    assert sorted(cell.n_points for cell in polygons.cell) == sorted([*[4] * n, *parts, *parts])
    assert polygons.extract_feature_edges(feature_edges=False, manifold_edges=False).n_cells == 0
    assert polygons.volume == pytest.approx(volumes(shape).sum(), rel=1e-6)
    mesh = trimesh.load(io.BytesIO(exporters.files(drum, ".ply")["bed.ply"]), file_type="ply")
    assert mesh.volume == pytest.approx(volumes(shape).sum(), rel=1e-6)
