from __future__ import annotations

import json

import numpy as np
import pytest
from chance import margin
from conftest import cube_packing
from loading import first_at_rest, grow, grow_few, grow_planar
from typer.testing import CliRunner

from grainsdem.cli import app
from grainsdem.dynamics import compact, ensemble, settle, tap
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.measures import porosity
from grainsdem.model import Domain
from grainsdem.storage import load, load_history, save
from grainsdem.validation import validate


@pytest.fixture(scope="module")
def few():
    """Twenty-eight grains of a relaxed tessellation."""
    return grow_few()


@pytest.fixture(scope="module")
def pressed(few, shake):
    return first_at_rest(lambda seed: compact(few, pressure=2e4, rng=seed))


@pytest.mark.client
def test_a_compacted_bed_bears_the_pressure_on_walls_and_in_contacts(pressed):
    assert pressed.report.is_reached
    # Of 15 beds: the walls' pressure 1.0000 ± 0.0002 of it, the contacts' 1.001 ± 0.005.
    assert pressed.report.pressure == pytest.approx(2e4, rel=margin(2e-4, measured=15))
    assert pressed.report.pressure_contacts == pytest.approx(2e4, rel=margin(5e-3, measured=15))
    assert validate(pressed.packing, overlap=2e-3).ok


@pytest.mark.client
def test_the_porosity_between_the_walls_is_that_of_the_grains_in_them(pressed, few):
    domain = pressed.packing.domain
    assert pressed.report.porosity == pytest.approx(1 - volumes(few.grains).sum() / domain.volume, rel=1e-9)
    assert porosity(pressed.packing, region=(domain.lower, domain.upper)) == pytest.approx(
        pressed.report.porosity, abs=1e-3
    )


@pytest.mark.slow
@pytest.mark.statistical
def test_less_friction_while_compacting_makes_a_denser_bed(few):
    rough, smooth = (
        [compact(few, pressure=2e4, rng=seed, **options).report.porosity for seed in range(6)]
        for options in ({}, {"compaction_friction": 0.0})
    )
    # Of 10 and 7 beds: porosity 0.536 ± 0.028 and 0.444 ± 0.008; means of six differ by 7 spreads.
    assert np.mean(rough) > np.mean(smooth)


@pytest.mark.slow
@pytest.mark.statistical
def test_half_the_time_step_leaves_the_porosity_of_compacted_beds_as_it_is(few):
    steps = 0.01, 0.005
    coarse, fine = (
        [
            compact(few, pressure=2e4, rng=seed, compaction_friction=0.0, time_step=step).report.porosity
            for seed in range(8)
        ]
        for step in steps
    )
    # Of 15 beds with either step the spread was 0.008: of a difference of two, 0.011.
    assert np.mean(coarse) == pytest.approx(np.mean(fine), abs=margin(0.011, measured=13, runs=8))


@pytest.mark.client
def test_a_porosity_above_that_of_the_jam_is_reached_and_kept(few):
    # Without friction these grains jam at 0.44 ± 0.01 (12 beds): a bed that does not reach 0.5 is 6 spreads away.
    made = compact(few, pressure=2e4, rng=1, compaction_friction=0.0, porosity=0.5)
    assert made.report.is_reached
    assert made.report.porosity == pytest.approx(0.5, abs=1e-4)


@pytest.mark.slow
@pytest.mark.client
def test_grains_jam_before_a_porosity_that_is_too_low(few):
    made = compact(few, pressure=2e4, rng=1, porosity=0.2)
    assert not made.report.is_reached
    # They jam at 0.51 ± 0.03 (12 beds), 7 spreads above.
    assert made.report.porosity > 0.3


@pytest.mark.client
def test_cubes_in_place_are_put_together_without_a_void():
    places = np.array([[x, y, z] for x in (0.0, 2.05) for y in (0.0, 2.05) for z in (0.0, 2.05)]) + 2.0
    made = compact(cube_packing(places, domain=Domain.cube(6.0), density=2000.0), pressure=1e4)
    assert made.report.at_rest
    assert made.report.porosity == pytest.approx(0.0, abs=2e-3)
    assert made.packing.domain.lengths == pytest.approx(4.0, abs=4e-3)


@pytest.mark.client
def test_planar_beds_and_spheres_are_compacted_too():
    flat = grow_planar(9)
    made = first_at_rest(lambda seed: compact(flat, rng=seed))
    assert 0.0 < made.report.porosity < 0.5
    assert made.packing.domain.is_planar
    grains = grow(12)
    round_ = first_at_rest(lambda seed: compact(grains, pressure=2e4, rng=seed, spheres=True))
    np.testing.assert_allclose(np.sort(volumes(round_.packing.grains)), np.sort(volumes(grains.grains)), rtol=1e-9)


@pytest.fixture(scope="module")
def tapped(shake):
    return first_at_rest(lambda seed: tap(grow(12), taps=2, rng=seed))


@pytest.mark.client
def test_each_tap_of_a_bed_is_told(tapped):
    assert tapped.profile["taps"].tolist() == [0, 1, 2]
    assert tapped.profile["porosity"][0] == tapped.report.initial_porosity
    assert tapped.profile["porosity"][-1] == tapped.report.final_porosity
    assert validate(tapped.packing, overlap=2e-3).ok


@pytest.mark.slow
@pytest.mark.statistical
def test_tapping_makes_beds_denser(few):
    reports = [tap(few, taps=4, rng=seed).report for seed in range(8)]
    # Of 30 beds: 0.060 ± 0.019 less porosity; the mean of eight is 8 of its spreads above nothing, once in 4e8.
    assert np.mean([report.initial_porosity - report.final_porosity for report in reports]) > 0


@pytest.mark.client
def test_a_tap_below_gravity_leaves_a_cube_on_the_floor_where_it_is():
    cube = cube_packing([[3.0, 3.0, 1.0]], domain=Domain.cube(6.0))
    made = tap(cube, taps=2, acceleration=0.9)
    assert made.history["height"].max() < 1.0 + 2e-3
    assert made.packing.positions[0] == pytest.approx([3.0, 3.0, 1.0], abs=2e-3)


@pytest.mark.client
def test_a_cube_is_thrown_as_high_as_the_floor_throws_it():
    # It leaves the floor where 1 + Γ cos ωt = 0, with the floor's height and speed, and flies from there.
    amplitude, strength, gravity, edge = 0.5, 3.0, 9.81, 2.0
    rate = np.sqrt(2 * strength * gravity / amplitude)
    phase = np.arccos(-1 / strength)
    speed = 0.5 * amplitude * rate * np.sin(phase)
    times = np.linspace(0, 3 * speed / gravity, 20001)
    flight = 0.5 * amplitude * (1 - np.cos(phase)) + speed * times - 0.5 * gravity * times**2
    ground = np.where(rate * times + phase < 2 * np.pi, 0.5 * amplitude * (1 - np.cos(rate * times + phase)), 0.0)
    cube = cube_packing([[3.0, 3.0, 0.5 * edge]], domain=Domain.cube(6.0))
    made = tap(cube, taps=1, amplitude=amplitude, acceleration=strength, gravity=gravity)
    thrown = made.history["height"].max() - 0.5 * edge
    expected = (flight - ground).max()
    # The history has samples 0.2 √(d/g) apart, and may miss the top by 0.5 % of d; steps blur when the cube leaves.
    assert thrown == pytest.approx(expected, rel=0.05)


@pytest.mark.unit
def test_what_compaction_cannot_do_is_refused(few):
    with pytest.raises(InputError, match="below that of the start"):
        compact(few, rng=1, porosity=0.99)
    with pytest.raises(InputError, match="porosity: input should be greater than 0; got 0"):
        compact(few, porosity=0.0)
    with pytest.raises(InputError, match="pressure: input should be greater than 0; got -1"):
        compact(few, pressure=-1.0)
    with pytest.raises(InputError, match="taps: input should be greater than or equal to 1; got 0"):
        tap(few, taps=0)
    with pytest.raises(InputError, match="amplitude: input should be greater than 0; got 0"):
        tap(few, amplitude=0.0)
    funnel = Domain.hopper((8e-3, 8e-3), (2e-3, 2e-3), 6e-3)
    with pytest.raises(InputError, match="upright"):
        tap(type(few)(few.grains, few.positions, few.quaternions, few.densities, funnel))


@pytest.mark.slow
@pytest.mark.client
@pytest.mark.parametrize("function", [compact, tap])
def test_an_interrupted_compaction_goes_on_to_the_same_bits(tmp_path, function):
    few = grow(12)
    options = {"rng": 1, **({"taps": 1} if function is tap else {"pressure": 2e4})}
    whole = function(few, **options)

    def interrupt(_, __):
        nonlocal heard
        heard += 1
        if heard == 20:
            raise KeyboardInterrupt

    heard, path = 0, tmp_path / "history.h5"
    with pytest.raises(KeyboardInterrupt):
        function(few, **options, history_path=path, progress=interrupt)
    resumed = function(few, **options, history_path=path, resume=True)
    assert resumed.packing.positions.tobytes() == whole.packing.positions.tobytes()
    assert resumed.report == whole.report
    assert load_history(path)["kinetic_energy"].size == whole.history["kinetic_energy"].size - 1


@pytest.mark.slow
@pytest.mark.client
def test_the_command_line_compacts_and_taps(tmp_path):
    bed = save(grow(12), tmp_path / "bed.h5")
    words = {"compact": ["--compaction-friction", "0"], "tap": ["--taps", "1", "--history", str(tmp_path / "h.h5")]}
    words = {name: [*options, "--figure", str(tmp_path / f"{name}.png")] for name, options in words.items()}
    for command, options in words.items():
        out = tmp_path / f"{command}.h5"
        result = CliRunner().invoke(app, [command, str(bed), str(out), "--rng", "1", "--json", *options])
        assert result.exit_code == 0, result.output
        assert len(load(out)) == 12
        assert json.loads(result.stdout)["at_rest"] in (True, False)
        assert (tmp_path / f"{command}.png").read_bytes().startswith(b"\x89PNG")
    assert load_history(tmp_path / "h.h5")["taps"].max() == 1.0


@pytest.mark.slow
@pytest.mark.client
def test_seeds_of_a_compaction_make_an_ensemble():
    runs = ensemble(
        compact, grow(8), seeds=range(2), through="processes", workers=1, compaction_friction=0.0, max_time=30.0
    )
    assert runs.mean()["porosity"] == pytest.approx(np.mean([run.report.porosity for run in runs.outcomes]))


@pytest.mark.client
def test_a_settled_bed_can_be_tapped_as_it_lies():
    bed = settle(grow(12), start="pour", rng=1, max_time=60.0).packing
    made = first_at_rest(lambda seed: tap(bed, taps=1, acceleration=3.0 + 0.1 * seed))
    np.testing.assert_array_equal(np.sort(volumes(made.packing.grains)), np.sort(volumes(bed.grains)))
