"""Beds at rest whose contacts get stiffer: what weight is on them meanwhile, and what walls bear of it afterwards."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from chance import margin
from conftest import cube_packing
from loading import borne, grow

from exporters.mjcf import MjcfOptions
from grainsdem.dynamics import ensemble, settle
from grainsdem.dynamics.checkpoint import checkpoint_path
from grainsdem.dynamics.engine.relief import (
    LEAST_WEIGHT,
    LIFTING,
    LOADING,
    ROUGH_WEIGHT,
    UNLOADING,
    are_walls_smooth,
    weight_share,
)
from grainsdem.dynamics.loop import SAMPLE_TIME
from grainsdem.dynamics.scene import build
from grainsdem.model import Domain

settling = import_module("grainsdem.dynamics.settle")  # the function of the same name hides the module

RELIEF = UNLOADING + LIFTING + LOADING


@pytest.mark.unit
def test_weight_goes_down_to_the_least_and_comes_back_whole_along_straight_lines():
    assert weight_share(0.0) == 1.0
    assert weight_share(UNLOADING) == weight_share(UNLOADING + LIFTING) == LEAST_WEIGHT
    assert weight_share(RELIEF) == weight_share(10 * RELIEF) == 1.0
    halfway = 0.5 * (1.0 + LEAST_WEIGHT)
    assert weight_share(0.5 * UNLOADING) == pytest.approx(halfway)
    assert weight_share(RELIEF - 0.5 * LOADING) == pytest.approx(halfway)


@pytest.mark.unit
def test_walls_are_smooth_from_the_first_until_enough_of_the_weight_is_back():
    back = RELIEF - LOADING * (1 - ROUGH_WEIGHT) / (1 - LEAST_WEIGHT)
    assert all(are_walls_smooth(since) for since in np.linspace(0.0, back - 1e-9, 50))
    assert not any(are_walls_smooth(since) for since in np.linspace(back + 1e-9, 2 * RELIEF, 50))


@pytest.mark.client
@pytest.mark.parametrize("wall_friction", [None, 0.3])
def test_walls_that_are_made_smooth_have_no_friction_until_they_get_their_own_back(wall_friction):
    # A block in the corner of floor and wall, gravity between the two.
    block = cube_packing([[5.0, 3.0, 1.0]], domain=Domain.box((6.0, 6.0, 6.0)))
    scene = build(block, MjcfOptions(friction=0.6, wall_friction=wall_friction))
    engine = scene.engine
    engine.set_gravity([np.sqrt(0.5), 0.0, -np.sqrt(0.5)])
    own = wall_friction or 0.6
    for smooth, expected in (([], own), (scene.upright_walls, 0.0), ([], own)):
        engine.make_smooth(smooth)
        engine.step(50)
        told = engine.contacts()
        names = np.array(engine.parts)[-1 - told.pairs[:, 0]]
        assert set(names) == {"floor", "wall_x1"}
        np.testing.assert_allclose(told.frictions[names == "floor"], own)
        np.testing.assert_allclose(told.frictions[names == "wall_x1"], expected, atol=1e-4)


@pytest.mark.unit
def test_walls_that_lean_are_not_among_the_upright_ones():
    block = cube_packing([[0.0, 0.0, 5.0]], domain=Domain.hopper((12.0, 12.0), (6.0, 6.0), 10.0))
    hopper = build(block, MjcfOptions())
    assert {name for name in hopper.engine.parts if name.startswith("wall_p")}
    assert not any(name.startswith("wall_p") for name in hopper.upright_walls)
    pipe = build(cube_packing([[5.0, 5.0, 5.0]], domain=Domain.cylinder(5.0, 10.0, sides=8)), MjcfOptions())
    assert {name for name in pipe.engine.parts if name.startswith("wall_p")} > set()
    assert set(pipe.upright_walls) == set(pipe.engine.parts) - {"floor"}


@pytest.fixture
def refined(monkeypatch):
    """When [t] refinements began, and the time steps before them; every bed is refined once from now on."""

    def refine(run):
        begun.append((run.scene.time(), run.scene.engine.time_step))
        refine_as_ever(run)

    begun, refine_as_ever = [], settling.SettleLoop.refine
    monkeypatch.setattr(settling.SettleLoop, "refine", refine)
    monkeypatch.setattr(settling, "REST_OVERLAP", 0.0)
    monkeypatch.setattr(settling, "REFINEMENTS", 1)
    return begun


@pytest.mark.client
def test_a_block_presses_on_the_floor_with_the_weight_that_is_left_on_it(cube, refined):
    result = settle(cube)
    times, told = units_of_time(result), result.history["floor_force"]
    assert result.report.refinements == len(refined) == 1
    start, _ = refined[0]
    # A sample tells of the steps before it; what is on a grain changes from sample to sample.
    during = (times > start + 0.5 * SAMPLE_TIME) & (times < start + RELIEF + 1.5 * SAMPLE_TIME)
    expected = [weight_share(time - SAMPLE_TIME - start) for time in times[during]]
    assert min(expected) == pytest.approx(LEAST_WEIGHT)
    np.testing.assert_allclose(told[during], expected, atol=0.02)
    assert told[-1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.client
def test_a_step_is_halved_under_the_least_weight(cube, refined, monkeypatch):
    def set_time_step(scene, step):
        halved.append((scene.time(), step))
        set_as_ever(scene, step)

    halved, scenes = [], import_module("grainsdem.dynamics.scene")
    set_as_ever = scenes.Scene.set_time_step
    monkeypatch.setattr(scenes.Scene, "set_time_step", set_time_step)
    settle(cube)
    [(start, before)], [(time, after)] = refined, halved
    assert time == pytest.approx(start + UNLOADING)
    assert weight_share(time - start) == pytest.approx(LEAST_WEIGHT)
    assert after == before / 2


@pytest.mark.client
def test_a_bed_counts_as_at_rest_only_under_its_whole_weight(cube, refined):
    result = settle(cube)
    start, _ = refined[0]
    assert result.report.at_rest
    assert units_of_time(result)[-1] > start + RELIEF + settling.REST_SAMPLES * SAMPLE_TIME


@pytest.mark.client
@pytest.mark.parametrize("after", [0.5 * UNLOADING, UNLOADING, RELIEF - 2 * SAMPLE_TIME])
def test_a_run_that_is_killed_while_weight_is_off_goes_on_to_the_same_bits(after, refined, tmp_path, monkeypatch):
    def interrupt(progress):
        if refined and progress.time / second >= refined[0][0] + after:
            raise KeyboardInterrupt

    monkeypatch.setattr(import_module("grainsdem.dynamics.loop"), "SAMPLES_PER_CHUNK", 1)
    stack = cube_packing([[3.0, 3.0, 1.5], [3.3, 3.0, 4.0]], domain=Domain.box((6.0, 6.0, 8.0)))
    whole = settle(stack)
    second = whole.history["time"][1] / SAMPLE_TIME
    refined.clear()
    path = tmp_path / "parts.h5"
    with pytest.raises(KeyboardInterrupt):
        settle(stack, history_path=path, progress=interrupt)
    with np.load(checkpoint_path(path)) as file:
        assert json.loads(str(file["words"]))["memory"]["relief"] is not None
    parts = settle(stack, history_path=path, resume=True)
    assert parts.packing.positions.tobytes() == whole.packing.positions.tobytes()
    assert parts.report == whole.report
    for name, series in whole.history.items():
        np.testing.assert_array_equal(parts.history[name], series)


@pytest.mark.client
def test_runs_that_step_together_are_refined_as_each_of_them_alone(refined):
    stack = cube_packing([[3.0, 3.0, 1.5], [3.3, 3.0, 4.0]], domain=Domain.box((6.0, 6.0, 8.0)))
    together = ensemble(settle, stack, seeds=[1, 2], start="pour", through="batch")
    assert len(refined) == 2
    for seed, outcome in zip(together.seeds, together.outcomes, strict=True):
        alone = settle(stack, rng=seed, start="pour")
        assert outcome.packing.positions.tobytes() == alone.packing.positions.tobytes()
        assert outcome.report == alone.report


@pytest.mark.client
@pytest.mark.parametrize("is_planar", [False, True])
def test_a_block_without_friction_leans_on_a_wall_with_the_square_of_the_sine(is_planar):
    # Gravity leans by an angle a: the floor bears W cos a, the wall W sin a, each at that angle to gravity.
    angle = np.radians(30.0)
    if is_planar:
        block = cube_packing([[7.5, 1.2, 1.0]], domain=Domain.slab((9.0, 6.0), 2.0))
        down = np.sin(angle), -np.cos(angle), 0.0
    else:
        block = cube_packing([[7.5, 3.0, 1.2]], domain=Domain.box((9.0, 6.0, 6.0)))
        down = np.sin(angle), 0.0, -np.cos(angle)
    report = settle(block, friction=0.0, direction=down).report
    assert report.floor_force == pytest.approx(np.cos(angle) ** 2, abs=5e-3)
    assert report.wall_force == pytest.approx(np.sin(angle) ** 2, abs=5e-3)


def units_of_time(result):
    """Return the times of the samples in units of √(d/g)."""
    times = result.history["time"]
    return times / times[1] * SAMPLE_TIME


@pytest.fixture(scope="module")
def columns(shake):
    """What walls bear of five deep beds that were refined, and of the same at that time if not, shape (5, 2)."""
    tall = replace(grow(160), domain=Domain.box((5e-3, 5e-3, 12e-3)))
    shares = []
    for seed in range(1, 6):
        refined = settle(tall, start="pour", rng=seed, friction=0.6)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(settling, "REST_ENERGY", 0.0)  # what never rests is never refined
            limit = units_of_time(refined)[-1]
            other = settle(tall, start="pour", rng=seed, friction=0.6, max_time=limit)
        assert refined.report.refinements > other.report.refinements == 0
        assert refined.report.at_rest
        assert [borne(bed.report) for bed in (refined, other)] == pytest.approx([1.0, 1.0], abs=0.05)
        shares.append((refined.report.wall_force, other.report.wall_force))
    return np.array(shares)


@pytest.mark.slow
@pytest.mark.statistical
def test_walls_bear_a_part_of_a_deep_bed_whether_or_not_it_is_refined(columns):
    # Janssen: grains that sink slip down along the walls, and friction holds them back. Of 5 beds each it was
    # 0.204 ± 0.053 and 0.217 ± 0.044: means of five lie 8 and 11 of their spreads above nothing.
    assert (columns.mean(axis=0) > 0).all()


@pytest.mark.slow
@pytest.mark.statistical
def test_walls_bear_as_much_of_a_bed_that_was_refined_as_of_one_that_was_not(columns):
    refined, other = columns.T
    # Pairs differed by 0.013 ± 0.025. Refined under their whole weight two beds were off by 1.0.
    chance = margin(0.025, measured=5, runs=5)
    assert np.mean(refined - other) == pytest.approx(0.0, abs=0.03 + chance)
