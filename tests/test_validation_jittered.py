"""Contacts and validation of grains that were moved at random: the tessellation no longer tells who is near whom."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grainsdem.geometry.rotations import multiply, random_quaternions, world_vertices
from grainsdem.geometry.triangles import triangles
from grainsdem.packing import carve, contacts, jitter_throats, neighbor_contacts, shrink
from grainsdem.packing.contacts import mean_diameter
from grainsdem.validation import validate


@pytest.fixture(scope="module")
def jittered(cells):
    """Grains moved within their cells."""
    return jitter_throats(shrink(carve(cells), porosity=0.3), rng=7)


@pytest.fixture(scope="module")
def thrown(jittered):
    """The same thrown about by a tenth of a diameter and turned a little: some overlap."""
    rng = np.random.default_rng(1)
    n, d = len(jittered), mean_diameter(jittered)
    turns = random_quaternions(n, rng) * 0.1
    turns[:, 0] = 1.0
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return replace(
        jittered,
        positions=jittered.positions + 0.1 * d * rng.standard_normal((n, 3)),
        quaternions=multiply(turns, jittered.quaternions),
        links=None,
    )


def solids(packing):
    """Return every grain as manifold3d has it, in units of the mean diameter."""
    import manifold3d

    mesh, vertices, d = triangles(packing.grains), world_vertices(packing), mean_diameter(packing)
    starts = packing.grains.vertex_offsets
    return [
        manifold3d.Manifold(
            manifold3d.Mesh64(
                np.ascontiguousarray(vertices[starts[i] : starts[i + 1]] / d),
                mesh.indices[mesh.offsets[i] : mesh.offsets[i + 1]].astype(np.uint64),
            )
        )
        for i in range(len(packing))
    ]


def nearest(packing, within):
    """Return {pair: gap in d} and {pair: shared volume in d³} of all grains, every pair tried, by manifold3d."""
    bodies, d = solids(packing), mean_diameter(packing)
    boxes = np.array([body.bounding_box() for body in bodies])
    gaps, shared = {}, {}
    for i in range(len(bodies)):
        apart = np.maximum(boxes[i + 1 :, :3] - boxes[i, 3:], boxes[i, :3] - boxes[i + 1 :, 3:]).max(axis=1)
        for j in i + 1 + np.flatnonzero(apart <= within / d):
            volume = (bodies[i] ^ bodies[j]).volume()
            gap = 0.0 if volume > 0 else bodies[i].min_gap(bodies[j], 1.0)
            if gap <= within / d:
                gaps[i, int(j)] = gap
            if volume > 0:
                shared[i, int(j)] = volume
    return gaps, shared


@pytest.mark.client
@pytest.mark.parametrize("which", ["jittered", "thrown"])
def test_the_contacts_of_moved_grains_are_those_that_manifold3d_finds_trying_every_pair(request, which):
    packing = request.getfixturevalue(which)
    d = mean_diameter(packing)
    graph = contacts(packing, within=0.05 * d)
    gaps, shared = nearest(packing, 0.05 * d)
    assert [tuple(pair) for pair in graph.pairs.tolist()] == sorted(gaps)
    expected = np.array([gaps[tuple(pair)] for pair in graph.pairs.tolist()])
    np.testing.assert_allclose(np.maximum(graph.gaps / d, 0), expected, atol=1e-9)
    assert {tuple(pair) for pair in graph.pairs[graph.gaps < 0].tolist()} == set(shared)
    assert bool(shared) == (which == "thrown")


@pytest.mark.unit
def test_facing_planes_of_jittered_grains_are_as_far_apart_as_the_search_says(jittered):
    d = mean_diameter(jittered)
    closed = neighbor_contacts(jittered)
    searched = contacts(jittered, within=float(closed.gaps.max()))
    known = dict(zip(map(tuple, closed.pairs.tolist()), closed.gaps / d, strict=True))
    facing = [
        abs(gap / d - known[tuple(pair)])
        for pair, gap, area in zip(searched.pairs.tolist(), searched.gaps, searched.areas, strict=True)
        # Faces whose shadows only meet have a patch of rounding, 1e-32 d², and are farther apart than their planes.
        if area > 1e-12 * d**2
    ]
    assert len(facing) > 0.6 * len(closed)
    assert max(facing) < 1e-12


@pytest.mark.unit
@pytest.mark.parametrize("method", ["planes", "manifold3d"])
def test_grains_jittered_within_their_cells_are_valid(jittered, method):
    report = validate(jittered, method=method)
    assert report.ok, report.failed


@pytest.mark.client
@pytest.mark.parametrize("method", ["planes", "manifold3d"])
def test_grains_thrown_into_one_another_are_named_and_no_others(thrown, method):
    found = {check.name: check for check in validate(thrown, method=method).checks}
    _, shared = nearest(thrown, 0.0)
    assert len(shared) > 10
    sizes = np.array([body.volume() for body in solids(thrown)])
    worst = max(volume / sizes[list(pair)].min() for pair, volume in shared.items())
    assert not found["overlaps"].ok
    assert set(found["overlaps"].offenders) == {
        pair for pair, volume in shared.items() if volume > 1e-9 * sizes[list(pair)].min()
    }
    assert found["overlaps"].worst == pytest.approx(worst, rel=1e-9)
    deepest = -contacts(thrown).gaps.min() / mean_diameter(thrown)
    assert found["overlap depth"].worst == pytest.approx(deepest, rel=1e-9)
