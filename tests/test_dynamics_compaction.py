from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import cube_packing
from typer.testing import CliRunner

from grainsdem.cli import app
from grainsdem.dynamics import compact, ensemble, settle, tap
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.measures import porosity
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.storage import load, load_history, save
from grainsdem.tessellation import relax, tessellate
from grainsdem.validation import validate


@pytest.fixture(scope="module")
def few():
    """Twenty-seven grains of a relaxed tessellation."""
    domain = Domain.cube(5e-3)
    return shrink(carve(tessellate(relax(poisson(domain, 120, rng=2), domain, iterations=2), domain)), porosity=0.4)


@pytest.fixture(scope="module")
def pressed(few, shake):
    return compact(few, pressure=2e4, rng=1)


@pytest.fixture(scope="module")
def smoothly_pressed(few, shake):
    return compact(few, pressure=2e4, rng=1, compaction_friction=0.0)


@pytest.mark.client
def test_a_compacted_bed_bears_the_pressure_on_walls_and_in_contacts(pressed):
    assert pressed.report.at_rest
    assert pressed.report.is_reached
    assert pressed.report.pressure == pytest.approx(2e4, rel=0.01)
    assert pressed.report.pressure_contacts == pytest.approx(2e4, rel=0.03)
    assert validate(pressed.packing, overlap=2e-3).ok


@pytest.mark.client
def test_the_porosity_between_the_walls_is_that_of_the_grains_in_them(pressed, few):
    domain = pressed.packing.domain
    assert pressed.report.porosity == pytest.approx(1 - volumes(few.grains).sum() / domain.volume, rel=1e-9)
    assert porosity(pressed.packing, region=(domain.lower, domain.upper)) == pytest.approx(
        pressed.report.porosity, abs=1e-3
    )


@pytest.mark.client
def test_less_friction_while_compacting_makes_a_denser_bed(pressed, smoothly_pressed):
    assert smoothly_pressed.report.at_rest
    assert smoothly_pressed.report.porosity < pressed.report.porosity - 0.02
    assert smoothly_pressed.report.coordination > pressed.report.coordination


@pytest.mark.client
def test_a_porosity_between_is_reached_and_kept(few, pressed, smoothly_pressed):
    asked = round(0.5 * (pressed.report.porosity + smoothly_pressed.report.porosity), 3)
    made = compact(few, pressure=2e4, rng=1, compaction_friction=0.0, porosity=asked)
    assert made.report.is_reached
    assert made.report.at_rest
    assert made.report.porosity == pytest.approx(asked, abs=1e-4)


@pytest.mark.client
def test_grains_jam_before_a_porosity_that_is_too_low(few):
    made = compact(few, pressure=2e4, rng=1, porosity=0.2)
    assert not made.report.is_reached
    assert made.report.porosity > 0.3


@pytest.mark.client
def test_cubes_in_place_are_put_together_without_a_void():
    places = np.array([[x, y, z] for x in (0.0, 2.05) for y in (0.0, 2.05) for z in (0.0, 2.05)]) + 2.0
    made = compact(cube_packing(places, domain=Domain.cube(6.0), density=2000.0), pressure=1e4)
    assert made.report.at_rest
    assert made.report.porosity == pytest.approx(0.0, abs=2e-3)
    assert made.packing.domain.lengths == pytest.approx(4.0, abs=4e-3)


@pytest.mark.client
def test_planar_beds_and_spheres_are_compacted_too(few):
    slab = Domain.slab((7e-3, 7e-3), 1e-3)
    flat = shrink(carve(tessellate(relax(poisson(slab, 60, rng=3), slab, iterations=2), slab)), porosity=0.3)
    made = compact(flat, rng=1)
    assert made.report.at_rest
    assert 0.05 < made.report.porosity < 0.35
    assert made.packing.domain.is_planar
    round_ = compact(few, pressure=2e4, rng=1, spheres=True)
    assert round_.report.at_rest
    np.testing.assert_allclose(np.sort(volumes(round_.packing.grains)), np.sort(volumes(few.grains)), rtol=1e-9)


@pytest.fixture(scope="module")
def tapped(few, shake):
    return tap(few, taps=4, rng=1)


@pytest.mark.client
def test_tapping_makes_a_bed_denser_tap_by_tap(tapped):
    assert tapped.report.at_rest
    assert tapped.profile["taps"].tolist() == [0, 1, 2, 3, 4]
    assert tapped.profile["porosity"][0] == tapped.report.initial_porosity
    assert tapped.report.final_porosity < tapped.report.initial_porosity - 0.005
    assert validate(tapped.packing, overlap=2e-3).ok


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
    with pytest.raises(InputError, match="between 0 and 1"):
        compact(few, porosity=0.0)
    with pytest.raises(InputError, match="pressure must be positive"):
        compact(few, pressure=-1.0)
    with pytest.raises(InputError, match="taps must be 1"):
        tap(few, taps=0)
    with pytest.raises(InputError, match="amplitude must be positive"):
        tap(few, amplitude=0.0)
    funnel = Domain.hopper((8e-3, 8e-3), (2e-3, 2e-3), 6e-3)
    with pytest.raises(InputError, match="upright"):
        tap(type(few)(few.grains, few.positions, few.quaternions, few.densities, funnel))


@pytest.mark.client
@pytest.mark.parametrize("function", [compact, tap])
def test_an_interrupted_compaction_goes_on_to_the_same_bits(few, tmp_path, function):
    options = {"rng": 1, **({"taps": 2} if function is tap else {"pressure": 2e4})}
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


@pytest.mark.client
def test_the_command_line_compacts_and_taps(few, tmp_path):
    bed = save(few, tmp_path / "bed.h5")
    words = {"compact": ["--compaction-friction", "0"], "tap": ["--taps", "1", "--history", str(tmp_path / "h.h5")]}
    words = {name: [*options, "--figure", str(tmp_path / f"{name}.png")] for name, options in words.items()}
    for command, options in words.items():
        out = tmp_path / f"{command}.h5"
        result = CliRunner().invoke(app, [command, str(bed), str(out), "--rng", "1", "--json", *options])
        assert result.exit_code == 0, result.output
        assert len(load(out)) == len(few)
        assert json.loads(result.stdout)["at_rest"]
        assert (tmp_path / f"{command}.png").read_bytes().startswith(b"\x89PNG")
    assert load_history(tmp_path / "h.h5")["taps"].max() == 1.0


@pytest.mark.client
def test_seeds_of_a_compaction_make_an_ensemble(few):
    runs = ensemble(
        compact, few, seeds=range(2), through="processes", workers=1, compaction_friction=0.0, max_time=30.0
    )
    assert 0.2 < runs.mean()["porosity"] < 0.6


@pytest.mark.client
def test_a_settled_bed_can_be_tapped_as_it_lies(few):
    bed = settle(few, start="pour", rng=1).packing
    made = tap(bed, taps=1)
    assert made.report.at_rest
