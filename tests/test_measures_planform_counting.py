from __future__ import annotations

import numpy as np
import pytest

import grainsdem as gd
from grainsdem.errors import InputError
from grainsdem.model import Domain


@pytest.fixture(scope="module")
def bed():
    """Grains of many sizes, that hide one another in part."""
    domain = Domain.box((1.0, 0.7, 0.4), periodic=(True, True, False))
    seeds = gd.points.cluster_poisson(domain, 300, parents=40, spread=0.06, walls="periodic", rng=4)
    return gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), scale=0.8)


@pytest.fixture(scope="module")
def seen(bed):
    return gd.planform(bed, pixel=0.005)


@pytest.mark.statistical
def test_stones_of_a_grid_are_the_picture_by_area(bed, seen):
    rows = gd.planform_table(seen, bed)
    rng = np.random.default_rng(3)
    stones = np.concatenate([gd.pebble_count(seen, bed, 100, rows=rows, rng=rng) for _ in range(200)])
    for name in ("b", "apparent_b"):
        for q in (16, 50, 84):
            found = np.percentile(stones[name], q)
            below = rows["visible_area"][rows[name] < found].sum() / rows["visible_area"].sum()
            # A share of n points has a standard error of √(p (1 - p) / n); the largest grain is a step in the curve.
            error = np.sqrt(q / 100 * (1 - q / 100) / stones.size)
            step = rows["visible_area"].max() / rows["visible_area"].sum()
            assert below == pytest.approx(q / 100, abs=5 * error + step)
    # It is far from the count by number, so that the test can tell them apart.
    assert np.percentile(stones["apparent_b"], 50) > 1.2 * np.median(rows["apparent_b"])


@pytest.mark.statistical
def test_where_nothing_is_hidden_a_grid_finds_the_bed_by_area():
    domain = Domain.slab((1.0, 1.0), 0.05, periodic=(True, True))
    cells = gd.tessellate(gd.points.poisson(domain, 150, rng=2), domain)
    bed = gd.shrink(gd.carve(cells, keep="all"), porosity=0.2)
    view = gd.planform(bed, pixel=0.004)
    stones = np.concatenate([gd.pebble_count(view, bed, 400, rng=k) for k in range(40)])
    # Void lies under a fifth of the points.
    assert stones.size / 16_000 == pytest.approx(0.8, abs=5 * np.sqrt(0.16 / 16_000))
    found = gd.size_percentiles(gd.planform_table(view, bed), bed, stones)
    for q in (16, 50, 84):
        assert found[f"d{q}_counted"] == pytest.approx(found[f"d{q}_bed_by_area"], rel=0.03)
        assert found[f"d{q}_seen_by_area"] == pytest.approx(found[f"d{q}_bed_by_area"], rel=0.01)


@pytest.mark.unit
def test_the_grid_has_the_points_that_are_asked_for_and_each_finds_its_grain(bed, seen):
    # 1 × 0.7: twelve columns and eight rows are nearest to a hundred square meshes.
    stones = gd.pebble_count(seen, bed, 100, rng=1)
    columns, rows = np.unique(stones["x"]), np.unique(stones["y"])
    assert (columns.size, rows.size) == (12, 8)
    np.testing.assert_allclose(np.diff(columns), 1 / 12, atol=0.005)
    x, y = seen.places()
    for stone in stones[::7]:
        at = seen.labels[np.argmin(np.abs(y - stone["y"])), np.argmin(np.abs(x - stone["x"]))]
        assert at == stone["id"] + 1
    np.testing.assert_array_equal(gd.pebble_count(seen, bed, 100, rng=1), stones)
    assert gd.pebble_count(seen, bed, 1, rng=1).size <= 1
    for wrong in (0, 28_001):
        with pytest.raises(InputError, match=f"stones must be 1 to 28000, a point in each pixel; got {wrong}"):
            gd.pebble_count(seen, bed, wrong)
    for wrong in (2.5, True):
        with pytest.raises(InputError, match="stones must be a whole number"):
            gd.pebble_count(seen, bed, wrong)


@pytest.mark.unit
def test_percentiles_are_those_of_their_samples(bed, seen):
    rows = gd.planform_table(seen, bed)
    stones = gd.pebble_count(seen, bed, 100, rows=rows, rng=1)
    found = gd.size_percentiles(rows, bed, stones, least_pixels=20)
    whole = rows[rows["n_pixels"] >= 20]
    for name, sizes in (
        ("bed_by_number", gd.ellipsoid_axes(bed.grains)[:, 1]),
        ("seen_by_number", whole["b"]),
        ("apparent_by_number", whole["apparent_b"]),
        ("counted", stones["b"]),
        ("counted_apparent", stones["apparent_b"]),
    ):
        expected = np.percentile(sizes, [16, 50, 84], method="hazen")
        np.testing.assert_allclose([found[f"d{q}_{name}"] for q in (16, 50, 84)], expected, rtol=1e-12)
    bias = {row["statistic"]: row for row in gd.planform_bias(rows, bed, least_pixels=20)}
    for q in ("d16", "d50", "d84"):
        assert found[f"{q}_bed_by_mass"] == pytest.approx(bias[q]["bed_by_mass"], rel=1e-12)
        assert found[f"{q}_apparent_by_area"] == pytest.approx(bias[q]["apparent_by_area"], rel=1e-12)
        assert found[f"{q}_bed_by_number"] < found[f"{q}_bed_by_area"] < found[f"{q}_bed_by_mass"]
    none = gd.size_percentiles(rows, bed, stones[:0], least_pixels=10**9)
    assert np.isnan([none["d50_seen_by_area"], none["d50_counted"], none["d50_counted_apparent"]]).all()


@pytest.mark.unit
def test_tables_of_another_kind_are_refused(bed, seen):
    stones, rows = gd.pebble_count(seen, bed, 10, rng=1), gd.planform_table(seen, bed)
    with pytest.raises(InputError, match="rows must be what planform_table returns; they lack"):
        gd.size_percentiles(gd.table(bed), bed, stones)
    with pytest.raises(InputError, match="rows must be what planform_table returns; they lack"):
        gd.pebble_count(seen, bed, 10, rows=gd.table(bed))
    with pytest.raises(InputError, match="stones must be what pebble_count returns; they lack"):
        gd.size_percentiles(rows, bed, gd.table(bed))
