from __future__ import annotations

import logging
import re
from types import SimpleNamespace

import numpy as np
import pytest
from chance import margin
from conftest import cube_packing
from loading import check_that_it_goes_on, grow, grow_planar

from exporters.mjcf import units
from grainsdem.dynamics import triaxial
from grainsdem.dynamics.experiments.cells import SixWalls
from grainsdem.dynamics.experiments.start import set_apart_in_block
from grainsdem.dynamics.experiments.triaxial import TriaxialSample, _Triaxial
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import to_matrices, world_vertices
from grainsdem.model import Domain
from grainsdem.storage import load_history

pytestmark = pytest.mark.client

PRESSURE = 2e4


@pytest.fixture(scope="module")
def grains():
    return grow(27)


@pytest.fixture(scope="module")
def sheared(grains, tmp_path_factory, shake):
    path = tmp_path_factory.mktemp("triaxial") / "history.h5"
    return triaxial(
        grains, confining_pressure=PRESSURE, strain=0.05, inertial_number=0.05, rng=3, history_path=path
    ), load_history(path)


@pytest.fixture(scope="module")
def several(shake):
    """So many grains that samples are three of the largest across, and sheared farther and more slowly."""
    options = {"confining_pressure": PRESSURE, "strain": 0.08, "inertial_number": 0.04}
    return [triaxial(grow(125), rng=seed, **options) for seed in range(1, 5)]


def test_walls_and_contacts_of_a_compressed_bed_have_the_same_stress(sheared):
    history = sheared[0].history
    last = np.flatnonzero(history["stage"] == 0)[-5:]
    for side in ("axial", "lateral"):
        walls, contacts = history[f"{side}_stress"][last].mean(), history[f"{side}_stress_contacts"][last].mean()
        # Of 22 beds: the contacts' over the walls' 1.000 ± 0.008, the walls' over the pressure 1.000 ± 0.002.
        assert contacts == pytest.approx(walls, rel=margin(0.008, measured=12))
        assert walls == pytest.approx(PRESSURE, rel=margin(0.002, measured=12))


@pytest.mark.slow
@pytest.mark.statistical
def test_walls_and_contacts_of_sheared_beds_have_the_same_mean_stress(several):
    # Of 8 beds: 0.995 ± 0.012 and 1.008 ± 0.010.
    for side, usual in (("axial", 0.995), ("lateral", 1.008)):
        ratios = []
        for outcome in several:
            chosen = outcome.history["stage"] == 1
            walls, contacts = (outcome.history[f"{side}_stress{of}"][chosen].mean() for of in ("", "_contacts"))
            ratios.append(contacts / walls)
        assert np.mean(ratios) == pytest.approx(usual, abs=margin(0.012, measured=8, runs=4))


@pytest.mark.slow
@pytest.mark.statistical
def test_side_walls_hold_the_pressure_while_beds_are_sheared(several):
    assert all(outcome.report.is_compressed for outcome in several)
    # Of 8 beds: 1.0065 ± 0.0010 of it; walls that are pushed outward take momentum as they get up to speed.
    pressure = np.mean([outcome.report.confining_pressure for outcome in several])
    assert pressure == pytest.approx(PRESSURE, rel=0.0065 + margin(0.001, measured=8, runs=4))


@pytest.mark.slow
@pytest.mark.statistical
def test_the_pressure_that_is_held_hardly_fluctuates_from_sample_to_sample(several):
    fluctuation = np.mean([outcome.report.confining_fluctuation for outcome in several])
    # Of 8 beds: 0.016 ± 0.007. Walls six times as heavy, as they once were, made it 0.13 ± 0.05 of 4.
    assert fluctuation < 0.016 + margin(0.007, measured=8, runs=4)


@pytest.mark.unit
@pytest.mark.parametrize("make", [grow, grow_planar])
def test_walls_are_as_light_around_grains_that_were_set_apart_as_around_a_bed(make):
    bed = make(60)
    apart = set_apart_in_block(bed, rng=1)
    near, far = (SixWalls(grains, units(grains, 9.81)).masses for grains in (bed, apart))
    # A block is a few grains longer one way than another; what it covers is six times as large as the bed.
    assert far == pytest.approx(near, rel=0.15)


@pytest.mark.unit
@pytest.mark.parametrize("time_step", [1e-3, 1e-2, 1.0])
def test_walls_that_drift_are_slowed_and_never_turned_round_however_light_they_are(time_step):
    cell = SixWalls(grow(8), units(grow(8), 9.81))
    cell.masses = dict.fromkeys(cell.masses, 0.1)
    pushes, speeds = {}, {"x0": -0.5, "x1": 0.7}
    engine = SimpleNamespace(axle=lambda name: (0.0, speeds.get(name, 0.0)), time_step=time_step)
    cell.hold(SimpleNamespace(push=pushes.__setitem__), engine, (0,))
    after = {name: speeds[name] + time_step * pushes[name] / cell.masses[name] for name in speeds}
    assert 0 < after["x1"] - after["x0"] < 1.2
    # What the two are pushed with besides the pressure cancels.
    area = float(np.prod(cell.lengths(engine)[1:]))
    assert sum(pushes.values()) == pytest.approx(-2 * area)


@pytest.mark.slow
@pytest.mark.statistical
def test_sheared_beds_bear_more_along_their_height_than_across_it(several):
    peaks = [outcome.report.peak_friction_angle for outcome in several]
    angles = [outcome.report.critical_friction_angle for outcome in several]
    # Of 8 beds: 0.65 ± 0.04 and 0.63 ± 0.06, the bounds 14 spreads of a mean of four away, or more.
    assert 0.2 < np.mean(angles) < 1.1
    assert 0.2 < np.mean(peaks) < 1.1


def test_a_bed_is_sheared_as_far_as_was_asked_for(sheared):
    assert sheared[0].history["axial_strain"][-1] >= 0.05


def test_volume_is_that_between_the_walls_and_its_change_that_of_the_solid_fraction(sheared):
    outcome = sheared[0]
    chosen = outcome.history["stage"] == 1
    fractions, strains = outcome.history["solid_fraction"][chosen], outcome.history["volumetric_strain"][chosen]
    np.testing.assert_allclose((1 + strains[-1]) / (1 + strains[0]), fractions[0] / fractions[-1], rtol=1e-9)
    box, corners = outcome.packing.domain, world_vertices(outcome.packing)
    d = 1e-3
    assert (corners > box.lower - 0.02 * d).all()
    assert (corners < box.upper + 0.02 * d).all()
    volume = np.prod(box.lengths)
    assert fractions[-1] * volume == pytest.approx(
        sum(outcome.snapshot.masses()) / outcome.packing.densities[0], rel=1e-6
    )


def test_the_report_tells_how_steady_the_pressure_was_and_what_contacts_were_like_in_the_last_quarter(sheared):
    report, history = sheared[0].report, sheared[0].history
    chosen = history["stage"] == 1
    lateral, strains = history["lateral_stress"][chosen], history["axial_strain"][chosen]
    assert report.confining_fluctuation == pytest.approx(lateral.std() / lateral.mean())
    last = strains >= 0.75 * strains[-1]
    assert 0 < last.sum() < len(last)
    for name in ("coordination", "sliding_fraction"):
        assert getattr(report, name) == pytest.approx(history[name][chosen][last].mean())


def test_the_history_on_disk_is_the_one_that_is_returned(sheared):
    outcome, stored = sheared
    for name, series in stored.items():
        if name in outcome.history:
            np.testing.assert_array_equal(series, outcome.history[name][1:])


@pytest.mark.slow
def test_a_triaxial_test_goes_on_after_an_interrupt_to_the_same_bits(tmp_path):
    options = {"strain": 0.02, "inertial_number": 0.05, "compaction_friction": 0.1, "rng": 1}
    check_that_it_goes_on(triaxial, grow(12), tmp_path, samples=24, **options)


@pytest.mark.slow
def test_prisms_are_sheared_in_their_plane():
    start = grow_planar(16)
    outcome = triaxial(start, strain=0.03, inertial_number=0.05, rng=1)
    assert outcome.packing.domain.is_planar
    np.testing.assert_allclose(outcome.packing.positions[:, 2], start.positions[0, 2], atol=1e-9)
    np.testing.assert_allclose(to_matrices(outcome.packing.quaternions)[:, 2, 2], 1, atol=1e-9)
    history = outcome.history
    last = np.flatnonzero(history["stage"] == 0)[-5:]
    # Of 10 beds: 0.998 ± 0.010.
    assert history["axial_stress_contacts"][last].mean() == pytest.approx(1e5, rel=0.002 + margin(0.010, measured=10))
    assert history["axial_strain"][-1] >= 0.03


def test_spheres_of_equal_volume_are_sheared_instead():
    start = grow(12)
    outcome = triaxial(start, strain=0.02, inertial_number=0.05, rng=1, spheres=True)
    assert outcome.snapshot.are_spheres
    assert sum(outcome.snapshot.masses()) == pytest.approx(start.densities[0] * sum(_volumes(start)), rel=1e-6)


def _volumes(packing):
    from grainsdem.geometry.integrals import volumes

    return volumes(packing.grains)


def test_a_column_of_one_cube_bears_the_load_that_walls_put_on_it():
    cube = cube_packing([[2.0, 2.0, 2.0]], density=2000.0, domain=Domain.cube(4.0))
    history = triaxial(cube, confining_pressure=1e3, strain=1e-4, inertial_number=1e-3).history
    still = history["stage"] == 0
    assert history["axial_stress_contacts"][still][-1] == pytest.approx(1e3, rel=1e-3)
    assert history["solid_fraction"][still][-1] == pytest.approx(1.0, abs=5e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"confining_pressure": 0.0}, "confining_pressure"),
        ({"strain": -0.1}, "strain"),
        ({"strain": 0.95}, "strain: input should be less than 0.9; got 0.95"),
        ({"inertial_number": np.nan}, "inertial_number"),
        ({"friction": -1.0}, "friction"),
        ({"compaction_friction": -1.0}, "compaction_friction"),
        ({"time_step": 0.0}, "time_step"),
    ],
)
def test_options_out_of_range_are_refused_by_name(cube, options, words):
    with pytest.raises(InputError, match=words):
        triaxial(cube, **options)


def test_a_periodic_packing_is_refused():
    with pytest.raises(InputError, match="periodic"):
        triaxial(cube_packing([[3.0, 3.0, 3.0]], domain=Domain.cube(6.0, periodic=True)))


def test_an_empty_packing_is_refused(fresh):
    from grainsdem.geometry.selection import select

    nothing = select(fresh.grains, [])[0]
    from dataclasses import replace

    empty = replace(
        fresh,
        grains=nothing,
        positions=np.empty((0, 3)),
        quaternions=np.empty((0, 4)),
        densities=np.empty(0),
        links=None,
    )
    with pytest.raises(InputError):
        triaxial(empty, rng=1)


@pytest.mark.slow
def test_cells_that_lock_like_a_jigsaw_are_no_test_and_the_run_ends_there():
    outcome = triaxial(grow(8), strain=0.6, inertial_number=0.1)
    report = outcome.report
    assert not report.is_valid
    assert report.is_compressed
    assert outcome.history["axial_strain"][-1] < 0.4  # judged after 3 t of the six that were asked for
    assert re.fullmatch(r"the porosity was -?0\.0\d, at a strain of 0\.\d+", report.reason)


def test_a_sample_of_few_grains_is_warned_of_and_its_size_told(caplog, sheared):
    report = sheared[0].report
    assert 1.8 < report.size_ratio < 3  # three grains of a mean across, and their largest a half larger
    assert not report.is_valid
    assert report.reason == f"the sample was only {report.size_ratio:.1f} of its largest grains across"
    with caplog.at_level(logging.WARNING, "grainsdem"):
        triaxial(grow(8), strain=1e-3, inertial_number=0.1)
    assert any("of its largest grains across" in record.message for record in caplog.records)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({}, ""),
        ({"lateral_stress": 0.75}, "the pressure was 0.75 of what it was to be held at, at a strain of 0.1"),
        ({"lateral_stress": 1.25}, "the pressure was 1.25"),
        ({"solid_fraction": 0.75}, "the porosity was 0.25"),
        ({"solid_fraction": 0.15}, "the porosity was 0.85"),
        ({"axial_stress": 21.0}, "σ1/σ3 was 21"),
        ({"axial_stress": 19.0}, ""),
    ],
)
def test_a_test_is_void_where_its_last_samples_are_out_of_bounds(changes, reason):
    run = object.__new__(_Triaxial)
    run.scene = SimpleNamespace(source=SimpleNamespace(domain=Domain.cube()), n_grains=100)
    usual = {"axial_strain": 0.1, "lateral_stress": 1.0, "axial_stress": 3.0, "solid_fraction": 0.6, "stage": 1.0}
    blank = dict.fromkeys(TriaxialSample._fields, 0.0)
    run.samples = [TriaxialSample(**{**blank, **usual, **changes, "time": 0.5 * k}) for k in range(9)]
    early = run.samples[:6]
    run.samples, late = early, run.samples
    assert run.fault() == ""  # 2.5 t
    run.samples = late
    assert run.fault().startswith(reason)
    assert bool(run.fault()) == bool(reason)


@pytest.mark.unit
def test_one_sample_out_of_bounds_is_no_reason_to_end_a_test():
    run = object.__new__(_Triaxial)
    run.scene = SimpleNamespace(source=SimpleNamespace(domain=Domain.cube()), n_grains=100)
    usual = TriaxialSample(0.0, 1.0, 0.1, 0.0, 3.0, 1.0, 3.0, 1.0, 0.6, 4.0, 0.0, 0.0)
    run.samples = [usual._replace(time=0.5 * k) for k in range(9)]
    run.samples[-1] = run.samples[-1]._replace(lateral_stress=1.5)
    assert run.fault() == ""
