from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import InputError, ShapeError
from grainsdem.measures import core_box, diameters, neighbor_table, porosity, sphericities, summary, table
from grainsdem.model import ContactGraph, Domain, Packing, Polyhedra
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate


def graph(n, pairs):
    m = len(pairs)
    return ContactGraph(n, pairs, np.zeros(m), np.tile([1.0, 0, 0], (m, 1)), np.zeros((m, 3)), np.zeros(m))


@pytest.mark.unit
def test_the_table_of_a_cube_says_what_a_cube_is():
    row = table(cube_packing([[1, 2, 3]], density=2650.0))[0]
    axis = 2 * np.sqrt(5 / 3)
    form = (np.cbrt(48 / np.pi), np.cbrt(np.pi / 6), 0, 6, 8)
    directions = {"a_trend", "a_plunge", "c_trend", "c_plunge"}  # of a cube they are any
    exact = [name for name in row.dtype.names if name not in {"sieve_diameter", "zingg"} | directions]
    assert [row[name] for name in exact] == pytest.approx(
        [0, 1, 2, 3, 8, 24, *form, 8 * 2650.0, *[axis] * 3, *[2] * 3, 1, 1, 1], rel=1e-14
    )
    assert row["sieve_diameter"] == pytest.approx(2, rel=1e-6)
    assert row["zingg"] == "spheroid"


@pytest.mark.unit
@pytest.mark.parametrize("is_planar", [False, True])
def test_a_table_without_sieves_lacks_that_column_and_no_other(is_planar, fresh):
    slab = Domain.slab((4.0, 2.0), 0.3)
    packing = carve(tessellate(np.array([[1.0, 1.0], [3.0, 1.0]]), slab), keep="all") if is_planar else fresh
    whole, rest = table(packing), table(packing, sieves=False)
    assert rest.dtype.names == tuple(name for name in whole.dtype.names if name != "sieve_diameter")
    for name in rest.dtype.names:
        np.testing.assert_array_equal(rest[name], whole[name])


@pytest.mark.unit
def test_rows_follow_the_grains_and_agree_with_the_single_measures(fresh):
    rows = table(fresh)
    np.testing.assert_array_equal(rows["id"], np.arange(len(fresh)))
    np.testing.assert_array_equal(np.stack([rows[a] for a in "xyz"], axis=1), fresh.positions)
    np.testing.assert_allclose(rows["diameter"], diameters(fresh.grains), rtol=1e-15)
    np.testing.assert_allclose(rows["sphericity"], sphericities(fresh.grains), rtol=1e-15)
    # Euler's polyhedron with three faces at each vertex: V = 2 F − 4
    np.testing.assert_array_equal(rows["n_vertices"], 2 * rows["n_faces"] - 4)


@pytest.mark.unit
def test_a_summary_is_json_and_names_the_region_of_its_porosity(fresh):
    found = json.loads(json.dumps(summary(fresh)))
    assert found["porosity_region"] == "cells"
    assert found["porosity"] == pytest.approx(0.4)
    assert found["porosity_box"] is None
    assert found["mean_coordination"] is None
    assert found["n_grains"] == len(fresh)
    assert found["d10"] < found["d50"] < found["d90"]
    assert found["total_mass"] == pytest.approx(2650 * found["solid_volume"])


@pytest.mark.unit
def test_after_the_grains_left_their_cells_the_porosity_is_that_of_the_core(poured):
    found = summary(poured)
    assert found["porosity_region"] == "core"
    lower, upper = core_box(poured)
    assert found["porosity_box"] == [lower.tolist(), upper.tolist()]
    assert found["porosity"] == porosity(poured, region=(lower, upper))


@pytest.mark.unit
def test_a_bed_too_small_for_a_core_gets_no_porosity_rather_than_a_wrong_one(cube):
    found = summary(cube)
    assert (found["porosity"], found["porosity_region"], found["porosity_box"]) == (None, None, None)


@pytest.mark.unit
def test_mean_coordination_counts_both_ends_of_a_contact_and_grains_without_one():
    packing = cube_packing([[2, 2, 2], [4, 2, 2], [6, 2, 2], [2, 8, 2]])
    assert summary(packing, graph(4, [[0, 1], [1, 2]]))["mean_coordination"] == 1.0
    with pytest.raises(ShapeError, match="4 grains; got 3"):
        summary(packing, graph(3, [[0, 1]]))


@pytest.mark.unit
def test_an_empty_packing_has_a_table_without_rows_and_no_summary():
    shapes = Polyhedra(np.empty((0, 3)), [0], [0], [], [0])
    nothing = Packing(shapes, np.empty((0, 3)), np.empty((0, 4)), [], Domain())
    assert len(table(nothing)) == 0
    with pytest.raises(InputError, match="at least one grain"):
        summary(nothing)


@pytest.mark.unit
def test_cells_of_a_cubic_lattice_have_six_neighbours_a_pitch_away_across_the_boundaries_too():
    domain = Domain.cube(3.0, periodic=True)
    packing = shrink(carve(tessellate(np.array(list(np.ndindex(3, 3, 3)), float) + 0.5, domain)), scale=0.8)
    rows = table(packing)
    assert set(rows["n_neighbors"]) == {6}
    np.testing.assert_allclose(rows["mean_distance"], 1.0, rtol=1e-12)
    np.testing.assert_allclose(rows["min_distance"], 1.0, rtol=1e-12)
    edges = neighbor_table(packing)
    assert len(edges) == 27 * 6
    np.testing.assert_allclose(edges["area"], 0.64, rtol=1e-12)
    moved = np.stack([edges[f"shift_{axis}"] for axis in "xyz"], axis=1)
    assert np.abs(moved).sum() == 2 * 27  # nine cells on each of six faces of the box


@pytest.mark.unit
def test_neighbours_are_those_that_share_a_ridge_of_scipys_diagram():
    from scipy.spatial import Voronoi

    domain = Domain.cube()
    seeds = poisson(domain, 60, rng=8)
    packing = carve(tessellate(seeds, domain), keep="all")
    edges = neighbor_table(packing)
    # Ridges outside the box are scipy's alone: those of ours are cut out of its.
    ridges = {frozenset(pair) for pair in Voronoi(seeds).ridge_points.tolist()}
    ours = {frozenset(pair) for pair in zip(edges["i"].tolist(), edges["j"].tolist(), strict=True)}
    assert ours <= ridges
    assert len(edges) == 2 * len(ours)
    apart = np.linalg.norm(packing.positions[edges["i"]] - packing.positions[edges["j"]], axis=1)
    np.testing.assert_allclose(edges["distance"], apart, rtol=1e-12)
    for grain, row in enumerate(table(packing)):
        mine = apart[edges["i"] == grain]
        assert (row["n_neighbors"], row["min_distance"]) == (len(mine), pytest.approx(mine.min()))
        assert row["mean_distance"] == pytest.approx(mine.mean())


@pytest.mark.unit
def test_grains_that_left_their_cells_have_no_neighbour_columns_and_no_neighbour_table(poured):
    assert {"n_neighbors", "mean_distance", "min_distance"}.isdisjoint(table(poured).dtype.names)
    with pytest.raises(InputError, match="lost the cells"):
        neighbor_table(poured)


@pytest.mark.unit
def test_a_grain_without_neighbours_is_at_no_distance_from_them():
    lone = carve(tessellate([[0.5, 0.5, 0.5]], Domain.cube()), keep="all")
    row = table(lone)[0]
    assert row["n_neighbors"] == len(neighbor_table(lone)) == 0
    assert np.isnan([row["mean_distance"], row["min_distance"]]).all()


@pytest.mark.unit
def test_in_a_planar_bed_sizes_and_axes_are_those_in_the_plane():
    domain = Domain.slab((4.0, 2.0), 0.3)
    bed = carve(tessellate(np.array([[1.0, 1.0], [3.0, 1.0]]), domain), keep="all")  # two squares of edge 2
    rows = table(bed)
    assert {"c", "box_c", "flatness", "krumbein", "zingg"}.isdisjoint(rows.dtype.names)
    np.testing.assert_allclose(rows["diameter"], 4 / np.sqrt(np.pi), rtol=1e-12)
    np.testing.assert_allclose(rows["sphericity"], np.sqrt(np.pi) / 2, rtol=1e-12)
    # The ellipse of equal second moments: ∫x² dA / A = s² / 12 = a² / 16.
    np.testing.assert_allclose([rows["a"], rows["b"]], 4 / np.sqrt(3), rtol=1e-12)
    np.testing.assert_allclose([rows["box_a"], rows["box_b"], rows["sieve_diameter"]], 2.0, rtol=1e-12)
    long = table(carve(tessellate(np.array([[2.0, 0.5], [2.0, 1.5]]), domain), keep="all"))
    np.testing.assert_allclose(long["elongation"], 0.25, rtol=1e-12)
