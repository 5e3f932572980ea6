"""STL: read by trimesh, each grain closed and of the right volume."""

import csv
import io
import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import exporters
from exporters.meshes import stl
from exporters.meshes.stl import StlOptions
from exporters.units import units
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import rescale
from grainsdem.validation import compare


def read(content):
    """Return the triangles of an STL as trimesh has them, vertices merged."""
    return trimesh.load(io.BytesIO(content), file_type="stl", force="mesh")


def single(vertices, faces):
    """Return one polyhedron as a packing at the origin of a large domain."""
    shapes = Polyhedra(
        np.asarray(vertices, float), [0, len(vertices)], [0, len(faces)], np.concatenate(faces),
        np.cumsum([0, *map(len, faces)]),
    )  # fmt: skip
    return Packing(shapes, np.zeros((1, 3)), [[1.0, 0, 0, 0]], [1.0], Domain(np.full(3, -9.0), np.full(3, 9.0)))


def is_closed(corners):
    """Return whether every edge of the triangles is run through once each way."""
    ids = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(-1, 3)
    edges = [(a, b) for row in ids.tolist() for a, b in zip(row, row[1:] + row[:1], strict=True)]
    return len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)


@pytest.mark.client
@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("diameter", [0.2e-3, 1e-3, 0.1])
@pytest.mark.opens("stl", "trimesh", "weighed")
def test_trimesh_reads_a_closed_outward_surface_of_the_right_volume(fresh, binary, diameter):
    scaled = rescale(fresh, diameter / units(fresh).length)
    mesh = read(exporters.files(scaled, ".stl", binary=binary)["bed.stl"])
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volumes(scaled.grains).sum(), rel=1e-6)
    assert mesh.body_count == len(scaled)


@pytest.mark.client
@pytest.mark.parametrize("origin", ["world", "domain"])
def test_the_manifest_says_by_how_much_single_precision_changes_a_grain(fresh, tmp_path, origin):
    far = replace(
        fresh,
        positions=fresh.positions + 0.02,
        links=None,
        domain=Domain(fresh.domain.lower + 0.02, fresh.domain.upper + 0.02),
    )
    exporters.write(far, tmp_path, formats="stl", origin=origin)
    [row] = json.loads((tmp_path / "manifest.json").read_text())["formats"]
    with (tmp_path / "bed.triangles.csv").open() as file:
        counts = [int(line["n_triangles"]) for line in csv.DictReader(file)]
    corners = read((tmp_path / "bed.stl").read_bytes()).triangles
    corners = corners - corners.mean(axis=(0, 1))
    parts = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    found = np.add.reduceat(parts, np.cumsum(counts) - counts)
    expected = volumes(far.grains)
    worst = np.abs(found / expected - 1).max()
    assert row["report"]["largest_volume_change_of_a_grain"] == pytest.approx(worst, rel=1e-3)
    assert row["report"]["volume_change"] == pytest.approx(found.sum() / expected.sum() - 1, abs=1e-12)
    place = world_vertices(far) - (far.domain.lower if origin == "domain" else 0)
    diameters = np.cbrt(6 / np.pi * expected)
    assert 1e-9 < worst < 1e-7 * np.abs(place).max() / diameters.min()


@pytest.mark.client
def test_the_table_beside_a_binary_file_tells_the_grains_apart(fresh):
    content = exporters.files(fresh, ".stl", name="sand")
    assert list(content) == ["sand.stl", "sand.triangles.csv"]
    mesh = trimesh.load(io.BytesIO(content["sand.stl"]), file_type="stl", force="mesh", process=False)
    rows = list(csv.DictReader(io.StringIO(content["sand.triangles.csv"].decode())))
    assert [int(row["grain"]) for row in rows] == list(range(len(fresh)))
    exact = volumes(fresh.grains)
    for i, row in enumerate(rows):
        first, n = int(row["first_triangle"]), int(row["n_triangles"])
        grain = trimesh.Trimesh(mesh.vertices, mesh.faces[first : first + n]).process(validate=False)
        grain.merge_vertices()
        assert grain.is_watertight
        assert grain.volume == pytest.approx(exact[i], rel=1e-5)
    assert first + n == len(mesh.faces)


@pytest.mark.client
def test_ascii_has_one_named_solid_a_grain(fresh):
    content = exporters.files(fresh, ".stl", binary=False)
    assert list(content) == ["bed.stl"]
    lines = content["bed.stl"].decode().splitlines()
    names = [f"g{i:06d}" for i in range(len(fresh))]
    assert [line.split()[1] for line in lines if line.startswith("solid ")] == names
    assert [line.split()[1] for line in lines if line.startswith("endsolid ")] == names
    solids = trimesh.load(io.BytesIO(content["bed.stl"]), file_type="stl", force="scene")
    assert sorted(solids.geometry) == names
    exact = volumes(fresh.grains)
    for i, name in enumerate(names):
        assert solids.geometry[name].volume == pytest.approx(exact[i], rel=1e-5)


@pytest.mark.unit
def test_binary_is_eighty_bytes_a_count_and_fifty_bytes_a_triangle(cube):
    content = exporters.files(cube, ".stl")["bed.stl"]
    assert not content.startswith(b"solid")
    assert struct.unpack("<I", content[80:84]) == (12,)
    assert len(content) == 84 + 12 * 50
    normal_and_corners = struct.unpack("<12fH", content[84:134])
    assert normal_and_corners == (0, 0, -1, 1, 1, 1, 1, 3, 1, 3, 3, 1, 0)


@pytest.mark.unit
def test_an_edge_shorter_than_single_precision_vanishes_and_the_grain_stays_closed():
    tiny = 1e-9
    # A wedge-topped box whose ridge is so short that its two ends round to one vertex.
    vertices = [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [0, -tiny, 1], [0, tiny, 1]]
    faces = [[0, 3, 2, 1], [0, 1, 4], [1, 2, 5, 4], [2, 3, 5], [3, 0, 4, 5]]
    shifted = replace(single(vertices, faces), positions=[[0.0, 1.0, 0.0]])  # about 1 the step is 1e-7
    corners, _ = stl.surface(shifted)
    assert len(corners) == 6  # the pyramid that is left: two for its base, four sides
    assert is_closed(corners)
    mesh = read(exporters.files(shifted, ".stl")["bed.stl"])
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(8 / 3)


@pytest.mark.unit
def test_a_face_with_collinear_corners_is_cut_without_a_triangle_of_no_area():
    # A cube with a corner more in the middle of an edge; the fan from corner 0 would begin with a flat triangle.
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1], [0.5, 0, 0]]
    faces = [[0, 3, 2, 1, 8], [4, 5, 6, 7], [0, 8, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    corners, _ = stl.surface(single(vertices, faces))
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert areas.min() > 0.1
    assert areas.sum() == pytest.approx(6.0)
    assert is_closed(corners)


@pytest.mark.unit
def test_a_grain_that_single_precision_flattens_is_refused_by_name():
    thin = 1e-9
    vertices = [[-1, -1, -thin], [1, -1, -thin], [1, 1, -thin], [-1, 1, -thin],
                [-1, -1, thin], [1, -1, thin], [1, 1, thin], [-1, 1, thin]]  # fmt: skip
    faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    flat = replace(single(vertices, faces), positions=[[0.0, 0.0, 1.0]])
    with pytest.raises(InputError, match="single precision takes their volume; not so: 0"):
        stl.files(flat)


@pytest.mark.unit
def test_a_packing_far_from_its_origin_is_refused_and_can_be_written_from_its_domain(fresh):
    offset = np.array([50.0, 0.0, 0.0])
    domain = Domain(fresh.domain.lower + offset, fresh.domain.upper + offset)
    far = replace(fresh, positions=fresh.positions + offset, domain=domain, links=None)
    with pytest.raises(InputError, match="pass origin='domain'"):
        stl.files(far)
    mesh = read(exporters.files(far, ".stl", origin="domain")["bed.stl"])
    assert mesh.is_watertight
    world = world_vertices(fresh)
    assert np.allclose(mesh.bounds, [world.min(axis=0), world.max(axis=0)], atol=1e-9)


@pytest.mark.golden
def test_the_ascii_of_one_cube_is_known_and_closed(cube):
    content = exporters.files(cube, ".stl", binary=False)["bed.stl"]
    assert content.startswith(
        b"solid g000000\n"
        b"  facet normal 0 0 -1\n"
        b"    outer loop\n"
        b"      vertex 1 1 1\n"
        b"      vertex 1 3 1\n"
        b"      vertex 3 3 1\n"
        b"    endloop\n"
        b"  endfacet\n"
    )
    assert content.endswith(b"  endfacet\nendsolid g000000\n")
    assert content.count(b"facet normal") == 12
    assert read(content).volume == pytest.approx(8.0)


@pytest.mark.unit
def test_an_unknown_origin_or_unit_is_refused():
    with pytest.raises(InputError, match="origin must be one of world, domain; got 'centre'"):
        StlOptions(origin="centre")
    with pytest.raises(InputError, match="units must be si, mm, grain or a length in metres; got 'inch'"):
        StlOptions(units="inch")


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".stl", ".obj"])
@pytest.mark.parametrize("unit", ["mm", "grain", 0.0254])
def test_other_units_stand_in_the_file_and_are_read_back_in_si(fresh, tmp_path, suffix, unit):
    paths = exporters.write(fresh, tmp_path / f"bed{suffix}", units=unit)
    length = {"mm": 1e-3, "grain": units(fresh).length}.get(unit, unit)
    theirs = trimesh.load(paths[0], force="mesh")
    assert theirs.volume * length**3 == pytest.approx(volumes(fresh.grains).sum(), rel=1e-5)
    assert repr(length).encode() in paths[0].read_bytes()[:200]
    packing = exporters.read(paths[0])
    assert all(check.ok for check in compare(packing, fresh, tolerance=1e-5))
    manifest = json.loads(exporters.write(fresh, tmp_path / "all", formats=[suffix], units=unit)[-1].read_text())
    assert manifest["formats"][0]["units"]["length"] == length


@pytest.mark.client
def test_ascii_in_other_units_is_read_back_in_si_and_its_solids_keep_their_names(fresh, tmp_path):
    [path] = exporters.write(fresh, tmp_path / "bed.stl", units="mm", binary=False)
    assert all(check.ok for check in compare(exporters.read(path), fresh, tolerance=1e-5))
    lines = path.read_text().splitlines()
    assert lines[0] == "solid g000000 unit 0.001 m"
    assert [line.split()[1] for line in lines if line.startswith("solid")] == [f"g{i:06d}" for i in range(len(fresh))]


@pytest.mark.client
@pytest.mark.parametrize("binary", [True, False])
def test_one_file_a_grain_holds_that_grain_where_it_stands(fresh, tmp_path, binary):
    paths = exporters.write(fresh, tmp_path / "bed.stl", per_grain=True, binary=binary, units="mm")
    assert [path.relative_to(tmp_path).as_posix() for path in paths] == [
        f"bed/g{i:06d}.stl" for i in range(len(fresh))
    ]  # fmt: skip
    whole = read(exporters.files(fresh, ".stl", binary=binary, units="mm")["bed.stl"])
    meshes = [trimesh.load(path, force="mesh") for path in paths]
    exact = volumes(fresh.grains)
    for i in (0, 40, len(fresh) - 1):
        assert meshes[i].is_watertight
        assert meshes[i].volume * 1e-9 == pytest.approx(exact[i], rel=1e-5)
    bounds = np.array([mesh.bounds for mesh in meshes])
    assert np.allclose([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)], whole.bounds)


@pytest.mark.unit
@pytest.mark.parametrize("suffix", [".stl", ".obj"])
@pytest.mark.parametrize("binary", [True, False])
def test_where_one_stretch_of_grains_ends_makes_no_difference_to_the_bytes(fresh, monkeypatch, suffix, binary):
    from exporters import check

    options = {"binary": binary} if suffix == ".stl" else {}
    whole = exporters.files(fresh, suffix, **options)
    monkeypatch.setattr(check, "STRETCH", 7)
    assert exporters.files(fresh, suffix, **options) == whole
