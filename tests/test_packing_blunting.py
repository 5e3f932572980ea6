"""Short edges merged: no edge is short after, every corner was one before, and nothing overlaps that did not."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, cKDTree
from solids import polyhedra
from typer.testing import CliRunner

import exporters
from exporters.dem.bodies import bodies, rounded
from grainsdem.cli import app
from grainsdem.errors import InputError
from grainsdem.geometry.blunt import blunt
from grainsdem.geometry.edges import edge_lengths, edges
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import diameters
from grainsdem.model import Domain
from grainsdem.packing import carve, merge_edges, shuffle
from grainsdem.points import poisson
from grainsdem.ragged import owners
from grainsdem.storage import save
from grainsdem.tessellation import tessellate
from grainsdem.validation import validate

pytestmark = pytest.mark.unit


def bed(kind):
    """Return grains that touch, with edges of all lengths."""
    domain = Domain.slab([1.0, 1.0], 0.1) if kind == "planar" else Domain.cube(1.0, periodic=kind == "periodic")
    packing = carve(tessellate(poisson(domain, 60, rng=5), domain), keep="all")
    return shuffle(packing, rng=1) if kind == "poured" else packing


def lengths_of(packing):
    """Return the lengths of edges, those along z of a planar bed left out, and their grains."""
    found = edges(packing.grains)
    lengths, grain = edge_lengths(packing.grains, found), owners(found.offsets)
    if packing.domain.is_planar:
        ends = packing.grains.vertices[packing.grains.vertex_offsets[grain][:, None] + found.ends]
        is_level = np.ptp(ends[..., 2], axis=1) < 1e-9
        lengths, grain = lengths[is_level], grain[is_level]
    return lengths, grain


@pytest.mark.parametrize("kind", ["box", "periodic", "poured", "planar"])
def test_grains_that_touch_stay_sound_and_apart_without_their_short_edges(kind):
    packing, shortest = bed(kind), 0.05
    made = merge_edges(packing, shortest)
    lengths, grain = lengths_of(packing)
    is_short = lengths < shortest * diameters(packing)[grain]
    assert made.n_edges == is_short.sum() >= 20
    assert made.n_grains == len(np.unique(grain[is_short]))
    lengths, grain = lengths_of(made.packing)
    assert (lengths >= shortest * diameters(packing)[grain] * (1 - 1e-12)).all()
    assert validate(made.packing).ok
    # Every corner was a corner, so the hull that grains are lies in the hull that they were.
    before, after = world_vertices(packing), world_vertices(made.packing)
    offsets, new = packing.grains.vertex_offsets, made.packing.grains.vertex_offsets
    left, apart = [], []
    for i in range(len(packing)):
        old, own = before[offsets[i] : offsets[i + 1]], after[new[i] : new[i + 1]]
        assert cKDTree(old).query(own)[0].max() < 1e-14
        left.append(ConvexHull(own).volume)
        apart.append(cKDTree(own).query(old)[0].max())
    sharp = volumes(packing.grains)
    np.testing.assert_allclose(volumes(made.packing.grains), left, rtol=1e-9)
    assert made.volume_change == pytest.approx(sum(left) / sharp.sum() - 1, rel=1e-6)
    assert made.largest_volume_change == pytest.approx((np.array(left) / sharp - 1).min(), rel=1e-6)
    assert made.largest_distance == pytest.approx((np.array(apart) / diameters(packing)).max(), rel=1e-6)
    assert -0.02 < made.volume_change < 0
    assert made.largest_distance < 3 * shortest
    if kind == "planar":
        heights = made.packing.grains.vertices[:, 2]
        assert np.allclose(np.abs(heights), 0.05, rtol=1e-12)


def test_a_grain_without_short_edges_is_the_same_to_the_bit():
    packing = bed("box")
    lengths, grain = lengths_of(packing)
    shortest = 0.01
    made = merge_edges(packing, shortest).packing
    clean = np.setdiff1d(np.arange(len(packing)), grain[lengths < shortest * diameters(packing)[grain]])
    assert 0 < len(clean) < len(packing)
    for i in clean:
        own, was = made.grains, packing.grains
        rows = slice(*own.vertex_offsets[i : i + 2]), slice(*was.vertex_offsets[i : i + 2])
        assert np.array_equal(own.vertices[rows[0]], was.vertices[rows[1]])
        assert np.array_equal(made.positions[i], packing.positions[i])


def test_a_cut_corner_of_a_cube_becomes_one_corner_again_and_the_loss_is_that_of_a_corner():
    # A cube of edge 2 whose corner is cut off by 0.01: three edges of 0.014.
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    cut = np.concatenate([signs[:-1], 1 - 0.01 * np.eye(3)])
    cube = cube_packing([[0.0, 0.0, 0.0]])
    packing = replace(cube, grains=polyhedra(cut))
    made = merge_edges(packing, 0.02)
    assert (made.n_edges, made.n_grains) == (3, 1)
    # One of the three corners at the cut stays, on an edge of the cube, 0.01 from where the corner was.
    assert len(made.packing.grains.vertices) == 8
    assert volumes(made.packing.grains)[0] == pytest.approx(8 - 4 * 0.01 / 3, rel=1e-3)
    told = json.loads(made.packing.provenance[-1])
    assert told["step"] == "merge_edges"
    assert (told["min_edge"], told["n_edges"], told["largest_volume_change"]) == (0.02, 3, made.largest_volume_change)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.floats(1e-4, 0.2))
@pytest.mark.property
def test_whatever_is_merged_lies_inside(seed, shortest):
    points = np.random.default_rng(seed).normal(size=(30, 3))
    grains = polyhedra(points / np.linalg.norm(points, axis=1)[:, None])
    made = blunt(grains, np.array([shortest]))
    hull = ConvexHull(grains.vertices)
    assert (hull.equations[:, :3] @ made.shapes.vertices.T + hull.equations[:, 3:]).max() < 1e-12
    assert edge_lengths(made.shapes, edges(made.shapes)).min() >= shortest
    assert volumes(made.shapes)[0] == pytest.approx(ConvexHull(made.shapes.vertices).volume, rel=1e-9)


@pytest.mark.parametrize("min_edge", [0.0, -1e-3, 0.3, np.nan])
def test_a_length_out_of_range_is_refused(min_edge, tmp_path):
    packing = bed("box")
    with pytest.raises(InputError, match=r"above 0 and at most 0\.2 diameters"):
        merge_edges(packing, min_edge)
    for word in ("obj", "lammps"):
        for wrong in (min_edge, "x", True):
            with pytest.raises(InputError, match=r"above 0 and at most 0\.2 diameters"):
                exporters.options_for([word], {"min_edge": wrong})
    for file in ("bed.obj", "bed.conf"):
        with pytest.raises(InputError, match=r"above 0 and at most 0\.2 diameters"):
            exporters.write(packing, tmp_path / file, min_edge=min_edge)


def test_a_grain_of_which_little_would_be_left_is_named():
    flake = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) * [1e-4, 1, 1]
    packing = replace(cube_packing([[0.0, 0, 0], [5.0, 0, 0]]), grains=polyhedra(flake + 1, flake))
    with pytest.raises(InputError, match=r"min_edge of 0\.1 diameters leaves less than half of grains 0, 1"):
        merge_edges(packing, 0.1)


def test_every_format_takes_it_and_the_manifest_says_what_it_took(tmp_path):
    packing = merge_edges(bed("periodic"), 1e-12).packing
    save(packing, tmp_path / "bed.h5")
    words = ["export", str(tmp_path / "bed.h5"), str(tmp_path / "all"), "--option", "min_edge=0.02", "--json"]
    for name in ("obj", "vtk", "lammps"):
        words += ["--to", name]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    manifest = json.loads((tmp_path / "all" / "manifest.json").read_text())
    expected = merge_edges(packing, 0.02)
    told = manifest["provenance"][-1]
    assert (told["step"], told["min_edge"], told["n_edges"]) == ("merge_edges", 0.02, expected.n_edges)
    assert told["largest_volume_change"] == pytest.approx(expected.largest_volume_change)
    assert manifest["packing"]["volume"] == pytest.approx(volumes(expected.packing.grains).sum(), rel=1e-12)
    again = exporters.read(tmp_path / "all" / "bed.obj")
    assert volumes(again.grains) == pytest.approx(volumes(expected.packing.grains), rel=1e-6)
    assert exporters.options_for(["obj"], {"min_edge": 0.02}) == [{"min_edge": 0.02}]


@pytest.mark.parametrize("kind", ["poured", "planar"])
def test_cores_have_none_either(kind):
    packing = merge_edges(bed(kind), 0.02).packing
    sizes = bodies(packing)
    plain, made = (rounded(packing, sizes, 0.02, min_edge=least) for least in (None, 0.02))
    short = [0.02 * diameters(packing)[owners(one.edges.offsets)] for one in (plain, made)]
    for one, limit, has_any in zip((plain, made), short, (True, False), strict=True):
        lengths, ends = edge_lengths(one.cores, one.edges), one.edges.ends
        if kind == "planar":
            points = one.cores.vertices[one.cores.vertex_offsets[owners(one.edges.offsets)][:, None] + ends]
            lengths = np.where(np.ptp(points[..., 2], axis=1) > 1e-9, np.inf, lengths)
        assert (lengths < limit).any() == has_any
    assert (made.volumes <= plain.volumes * (1 + 1e-12)).all()
    assert (made.core_volumes <= plain.core_volumes).all()
