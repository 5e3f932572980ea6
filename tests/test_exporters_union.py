"""Beds as one mesh, and with fewer corners: closed, opened by trimesh, of the volume that is told."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from conftest import cube_packing
from scipy.spatial import ConvexHull
from solids import polyhedra

import exporters
from exporters.meshes import glb
from exporters.meshes.fewer import fewer_corners
from exporters.meshes.glb import GlbOptions
from exporters.meshes.union import united, what_united
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Domain
from grainsdem.packing import carve, heal
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate

pytestmark = pytest.mark.client

SUFFIXES = [".stl", ".obj", ".ply", ".glb"]


def loaded(path):
    """Return a file as one mesh in the axes of the bed, points of STL put together."""
    mesh = trimesh.load(path, force="mesh", process=path.suffix == ".stl")
    if path.suffix == ".glb":
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return mesh


@pytest.fixture(scope="module")
def overlapping(cells):
    """Grains a hundredth larger than their cells: every one shares volume with its neighbours."""
    packing = carve(cells)
    return replace(packing, grains=replace(packing.grains, vertices=1.01 * packing.grains.vertices), links=None)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_grains_apart_become_one_closed_mesh_of_their_volume(fresh, tmp_path, suffix):
    [path] = exporters.write(fresh, tmp_path / f"bed{suffix}", merge=True)
    mesh = loaded(path)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == len(fresh)
    assert mesh.volume == pytest.approx(volumes(fresh.grains).sum(), rel=1e-6)
    lower, upper = mesh.bounds
    assert (lower > fresh.domain.lower).all()
    assert (upper < fresh.domain.upper).all()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_grains_that_overlap_become_one_piece_without_what_they_share(overlapping, tmp_path, suffix):
    exporters.write(overlapping, tmp_path, formats=suffix, merge=True)
    [row] = json.loads((tmp_path / "manifest.json").read_text())["formats"]
    mesh = loaded(tmp_path / f"bed{suffix}")
    assert mesh.is_watertight
    assert mesh.body_count == row["report"]["n_pieces"] < len(overlapping) / 4
    total = volumes(overlapping.grains).sum()
    assert row["report"]["volume_change"] == pytest.approx(mesh.volume / total - 1, abs=1e-6)
    assert -0.03 < row["report"]["volume_change"] < -0.005


def test_touching_cells_and_healed_grains_keep_their_volume(cells, overlapping):
    for packing in (carve(cells), heal(overlapping).packing):
        told = what_united(packing)
        assert abs(told["volume_change"]) < 1e-9


def test_two_cubes_share_what_they_share_and_images_do_not_meet():
    pair = cube_packing([[3.0, 5, 5], [4.5, 5, 5]])
    whole = united(pair)
    assert volumes(whole.grains)[0] == pytest.approx(14.0)
    assert whole.positions[0] == pytest.approx([3.75, 5, 5])
    assert float((whole.densities * volumes(whole.grains))[0]) == pytest.approx(16.0)
    ends = cube_packing(
        [[0.5, 5, 5], [9.0, 5, 5]],
        domain=Domain(np.zeros(3), np.full(3, 10.0), periodic=np.array([True, False, False])),
    )
    assert what_united(ends) == {"n_pieces": 2, "volume_change": pytest.approx(0.0, abs=1e-14)}


def test_a_mesh_of_more_points_than_16_bits_count_is_read_from_glb(tmp_path):
    domain = Domain.cube(1e-2)
    packing = carve(tessellate(poisson(domain, 3800, rng=1), domain))
    packing = replace(packing, grains=replace(packing.grains, vertices=0.9 * packing.grains.vertices), links=None)
    [path] = exporters.write(packing, tmp_path / "bed.glb", merge=True)
    mesh = loaded(path)
    assert len(mesh.vertices) > 65536
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volumes(packing.grains).sum(), rel=1e-6)


def test_merged_files_have_no_ids_and_one_name(fresh, tmp_path):
    content = exporters.files(fresh, ".ply", merge=True)["bed.ply"]
    assert b"grain" not in content.partition(b"end_header")[0]
    text = exporters.files(fresh, ".obj", merge=True, name="sand")["sand.obj"].decode()
    assert [line for line in text.splitlines() if line.startswith("o ")] == ["o sand"]
    scene = trimesh.load(exporters.write(fresh, tmp_path / "bed.glb", merge=True)[0])
    assert list(scene.geometry) == ["bed0"]
    with pytest.raises(InputError, match="either merged into one surface or written to a file each"):
        exporters.files(fresh, ".stl", merge=True, per_grain=True)


@pytest.mark.parametrize("most", [6, 8, 12])
def test_grains_of_fewer_corners_lie_inside_and_what_they_lose_is_told(fresh, tmp_path, most):
    exporters.write(fresh, tmp_path, formats="glb", lod=most)
    [row] = json.loads((tmp_path / "manifest.json").read_text())["formats"]
    scene = trimesh.load(tmp_path / "bed.glb")
    left = []
    for i in range(len(fresh)):
        mesh = scene.geometry[f"g{i:06d}"]
        hull = ConvexHull(fresh.grains.vertices_of(i))
        assert mesh.is_watertight
        assert len(mesh.vertices) <= most
        reach = hull.equations[:, :3] @ mesh.vertices.T + hull.equations[:, 3:]
        assert reach.max() < 1e-6 * np.ptp(fresh.grains.vertices_of(i))
        left.append(mesh.volume)
    sharp = volumes(fresh.grains)
    assert row["report"]["volume_lost"] == pytest.approx(1 - sum(left) / sharp.sum(), abs=1e-6)
    assert row["report"]["largest_volume_lost_by_a_grain"] == pytest.approx((1 - left / sharp).max(), abs=1e-5)


def test_masses_and_poses_stay_those_of_the_grains_whatever_is_drawn(poured):
    def nodes(**options):
        content = exporters.files(poured, ".glb", **options)["bed.glb"]
        return json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])["nodes"][1:]

    plain = nodes()
    assert [node["extras"]["mass"] for node in nodes(lod=8)] == [node["extras"]["mass"] for node in plain]
    assert [node["translation"] for node in nodes(lod=8)] == [node["translation"] for node in plain]
    for options in ({"merge": True}, {"merge": True, "lod": 8}):
        [whole] = nodes(**options)
        assert whole["extras"]["mass"] == pytest.approx(sum(node["extras"]["mass"] for node in plain))
    assert glb.report(poured, GlbOptions()) == {}


def test_what_has_few_corners_or_would_be_flat_is_drawn_as_it_is():
    cube = cube_packing([[5.0, 5, 5]]).grains
    assert fewer_corners(cube, 8) is cube
    assert len(fewer_corners(cube, 6).vertices) == 6
    turns = 2 * np.pi * np.arange(20) / 20
    tent = polyhedra(np.vstack([np.c_[np.cos(turns), np.sin(turns), 0 * turns], [0.9, 0, 0.1]]))
    both = polyhedra(*(shape.vertices for shape in (tent, cube)))
    left = fewer_corners(both, 6)
    assert np.diff(left.vertex_offsets).tolist() == [21, 6]
    for wrong in (5, 8.5, True, "x", np.nan):
        with pytest.raises(InputError, match="lod, the most corners of a grain, must be a whole number from 6; got"):
            exporters.files(cube_packing([[5.0, 5, 5]]), ".glb", lod=wrong)
