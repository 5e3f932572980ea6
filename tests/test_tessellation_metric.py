from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grainsdem as gd
from grainsdem.errors import InputError, ShapeError
from grainsdem.tessellation.metric import TOLERANCE, Metric, Shape, shaped_cells


def grown(domain, shape, n=400, keep="inside"):
    seeds = gd.points.poisson(domain, n, rng=1)

    def grow(stretched, metric):
        return gd.tessellate(gd.relax(metric.back(seeds), stretched, iterations=3), stretched)

    return shaped_cells(domain, shape, grow, keep=keep)[0]


@pytest.mark.parametrize(
    ("shape", "domain"),
    [
        (Shape(elongation=0.6), gd.Domain.cube()),
        (Shape(flatness=0.4, dip=0.4), gd.Domain.cube()),
        (Shape(0.7, 0.35, trend=2.0, dip=0.35), gd.Domain.box((1.0, 2.0, 0.7))),
        (Shape(0.8, 0.3), gd.Domain.cube(periodic=True)),
        (Shape(0.6, 0.6, trend=np.pi / 2), gd.Domain.cylinder(0.5, 1.0)),
        (Shape(0.5, trend=0.6), gd.Domain.slab((1.0, 1.0), 0.05)),
    ],
)
def test_grains_have_the_mean_proportions_and_fill_the_domain(shape, domain):
    cells = grown(domain, shape)
    assert gd.volumes(cells.cells).sum() == pytest.approx(domain.volume, rel=1e-9)
    rows = gd.table(gd.carve(cells), sieves=False)
    for name, goal in (("elongation", shape.elongation), ("flatness", shape.flatness)):
        if goal is not None:
            assert rows[name].mean() == pytest.approx(goal, rel=TOLERANCE)
    # Closed, convex, outward, inside the domain, and apart.
    assert gd.validate(gd.shrink(gd.carve(cells, keep="all"), porosity=0.3)).ok


def test_faces_know_the_walls_and_the_cells_behind_them():
    domain = gd.Domain.box((1.0, 2.0, 0.7))
    cells = grown(domain, Shape(0.7, 0.5, trend=0.5, dip=0.35), n=150)
    from grainsdem.geometry.integrals import face_planes
    from grainsdem.ragged import owners

    planes = face_planes(cells.cells)
    owner = owners(cells.cells.face_offsets)
    sites = cells.sites[owner]
    walls = [(0, -1, 0.0), (0, 1, 1.0), (1, -1, 0.0), (1, 1, 2.0), (2, -1, 0.0), (2, 1, 0.7)]
    for k, (axis, sign, place) in enumerate(walls):
        on = cells.neighbors == -1 - k
        assert on.any()
        assert planes.normals[on][:, axis] == pytest.approx(sign, abs=1e-9)
        assert sign * planes.heights[on] + sites[on][:, axis] == pytest.approx(place, abs=1e-12)
    assert cells.neighbors.min() == -6
    pairs = {(i, j) for i, j in zip(owner.tolist(), cells.neighbors.tolist(), strict=True) if j >= 0}
    assert pairs == {(j, i) for i, j in pairs}


def test_axes_lie_along_the_trend_and_flat_sides_are_imbricated():
    bed = gd.carve(grown(gd.Domain.cube(), Shape(0.6, 0.4, trend=0.8, dip=0.5), n=500))
    mean = {axis: np.linalg.eigh(gd.orientation_tensor(bed, axis)) for axis in "ac"}
    # The long axis rises along the trend, so it goes down the other way; the flat side's pole is 0.5 off the plumb.
    trend, plunge = gd.trend_and_plunge(mean["a"][1][:, 2][None])
    assert trend == pytest.approx(0.8 + np.pi, abs=0.1)
    assert plunge == pytest.approx(0.5, abs=0.1)
    trend, plunge = gd.trend_and_plunge(mean["c"][1][:, 2][None])
    assert trend == pytest.approx(0.8, abs=0.15)
    assert plunge == pytest.approx(np.pi / 2 - 0.5, abs=0.1)
    assert mean["a"][0][2] > 0.7
    assert mean["c"][0][2] > 0.7
    equant = gd.carve(gd.tessellate(gd.points.poisson(gd.Domain.cube(), 500, rng=1), gd.Domain.cube()))
    values = np.linalg.eigvalsh(gd.orientation_tensor(equant))
    # Of n directions at random the eigenvalues are a third, but for 5 √(4 / 45 n).
    assert np.abs(values - 1 / 3).max() < 5 * np.sqrt(4 / 45 / len(equant))


@pytest.mark.property
@given(st.floats(0.05, 1), st.floats(0.05, 1), st.floats(-7, 7), st.floats(-1.5, 1.5))
def test_a_metric_keeps_volumes_and_goes_back(low, high, trend, dip):
    metric = Metric.along((low, high), trend=trend, dip=dip)
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert np.linalg.det(metric.matrix) == pytest.approx(1, rel=1e-9)
    assert metric.forward(metric.back(points)) == pytest.approx(points, abs=1e-9)
    sizes = np.linalg.eigvalsh(metric.matrix)
    assert sizes[1] / sizes[2] == pytest.approx(low, rel=1e-6)
    assert sizes[0] / sizes[1] == pytest.approx(high, rel=1e-6)
    domain = gd.Domain.box((1.0, 2.0, 0.5))
    assert metric.unstretched(domain).volume == pytest.approx(1.0, rel=1e-6)


def test_no_stretch_is_a_plain_tessellation():
    domain = gd.Domain.cube()
    metric = Metric.along((1.0, 1.0))
    seeds = gd.points.poisson(domain, 50, rng=1)
    plain = gd.tessellate(seeds, domain)
    same = metric.stretched(gd.tessellate(metric.back(seeds), metric.unstretched(domain)), domain)
    assert same.cells.vertices.tobytes() == plain.cells.vertices.tobytes()
    assert same.neighbors.tolist() == plain.neighbors.tolist()


@pytest.mark.parametrize(
    ("shape", "domain", "words"),
    [
        (Shape(), gd.Domain.cube(), "an elongation, a flatness or both; got neither"),
        (Shape(elongation=1.2), gd.Domain.cube(), r"mean of b/a, lies from 0\.02 to 1; got 1\.2"),
        (Shape(flatness=0.01), gd.Domain.cube(), r"mean of c/b, lies from 0\.02 to 1; got 0\.01"),
        (Shape(elongation=0.97), gd.Domain.cube(), r"have b/a of 0\.\d+ in the mean as they are, less than the 0\.97"),
        (Shape(0.5, trend=0.3), gd.Domain.cube(periodic=True), "along its own axes only"),
        (Shape(0.5, 0.5), gd.Domain.slab((1, 1), 0.1), "stretched in its plane: leave out flatness and dip"),
        (Shape(0.5), gd.Domain.cube(), "all 5 cells touch a wall"),
    ],
)
def test_proportions_that_cannot_be_had_get_one_line(shape, domain, words):
    with pytest.raises(InputError, match=words):
        grown(domain, shape, n=5 if "all 5" in words else 100)


@pytest.mark.unit
def test_a_matrix_that_is_no_stretch_is_refused():
    with pytest.raises(InputError, match="symmetric and of determinant 1"):
        Metric(2 * np.eye(3))
    with pytest.raises(ShapeError):
        Metric(np.eye(2))
