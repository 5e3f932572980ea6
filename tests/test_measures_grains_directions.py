from __future__ import annotations

import numpy as np
import pytest
from conftest import cube_packing

import grainsdem as gd
from grainsdem.errors import FileFormatError, InputError, ShapeError
from grainsdem.geometry.rotations import random_quaternions, to_matrices

pytestmark = pytest.mark.unit


@pytest.fixture(scope="module")
def bricks():
    """Bricks of 3 × 2 × 1, long side along x, each turned at random, and their rotations."""
    from dataclasses import replace

    places = np.arange(60)[:, None] * np.array([10.0, 0, 0])
    bed = cube_packing(places + 5.0, domain=gd.Domain.box((700.0, 10.0, 10.0)))
    grains = replace(bed.grains, vertices=bed.grains.vertices * np.array([1.5, 1.0, 0.5]))
    turns = random_quaternions(60, np.random.default_rng(1))
    return replace(bed, grains=grains, quaternions=turns), to_matrices(turns)


def test_axes_are_those_of_the_bricks(bricks):
    packing, turns = bricks
    found = gd.principal_axes(packing)
    for k in range(3):
        assert np.abs((found[:, k] * turns[:, :, k]).sum(axis=1)) == pytest.approx(1.0, abs=1e-9)
    rows = gd.table(packing, sieves=False)
    trend, plunge = gd.trend_and_plunge(turns[:, :, 2])
    assert rows["c_trend"] == pytest.approx(trend, abs=1e-6)
    assert rows["c_plunge"] == pytest.approx(plunge, abs=1e-6)


def test_the_tensor_is_the_mean_of_dyads(bricks):
    packing, turns = bricks
    lines = turns[:, :, 0]
    assert gd.orientation_tensor(packing) == pytest.approx(lines.T @ lines / 60, abs=1e-9)
    assert np.trace(gd.orientation_tensor(packing, "b")) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("line", "trend", "plunge"),
    [
        ([1, 0, 0], 0, 0),
        ([-1, 0, 0], 0, 0),
        ([0, -3, 0], 90, 0),
        ([-1, -1, 0], 45, 0),
        ([0, 0, 2], 0, 90),
        ([0, 1, -1], 90, 45),
        ([0, 1, 1], 270, 45),
        ([np.sqrt(3), 0, 1], 180, 30),
    ],
)
def test_trend_and_plunge_are_those_of_the_end_that_goes_down(line, trend, plunge):
    found = np.degrees(gd.trend_and_plunge([line]))
    assert found[:, 0] == pytest.approx([trend, plunge], abs=1e-9)


def test_in_a_plane_the_trend_is_that_of_the_long_side():
    domain = gd.Domain.slab((1.0, 1.0), 0.1)
    cells = gd.tessellate(gd.points.poisson(domain, 60, rng=1), domain)
    rows = gd.table(gd.carve(cells), sieves=False)
    lines = gd.principal_axes(gd.carve(cells))
    in_plane = [axes[np.abs(axes[:, 2]) < 0.5] for axes in lines]
    seen = [
        min(abs(np.cos(t) * a[0, 1] - np.sin(t) * a[0, 0]), 1) for t, a in zip(rows["a_trend"], in_plane, strict=True)
    ]
    assert max(seen) < 1e-6


def test_what_has_no_direction_is_refused(bricks):
    with pytest.raises(ShapeError, match=r"shape \(n, 3\); got shape \(3,\)"):
        gd.trend_and_plunge([1, 0, 0])
    with pytest.raises(InputError, match="'a', 'b' or 'c'; got 'x'"):
        gd.orientation_tensor(bricks[0], "x")
    with pytest.raises(InputError, match="at least one grain"):
        gd.orientation_tensor(gd.subset(bricks[0], []))


def test_nets_are_drawn_in_space_and_roses_in_a_plane(bricks, tmp_path):
    domain = gd.Domain.slab((1.0, 1.0), 0.1)
    flat = gd.carve(gd.tessellate(gd.points.poisson(domain, 60, rng=1), domain))
    for name, bed, axis in (("net.png", bricks[0], "c"), ("rose.png", flat, "a")):
        path = gd.figures.stereonet(bed, tmp_path / name, axis=axis)
        assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(FileFormatError):
        gd.figures.stereonet(flat, tmp_path / "net.gif")
    with pytest.raises(InputError, match="no grains"):
        gd.figures.stereonet(gd.subset(flat, []), tmp_path / "none.png")
