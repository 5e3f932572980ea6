"""What beds do to bodies that go into them: signs, balances and trends, of discs in a plane and of a scoop."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from chance import margin
from loading import grow_planar

from grainsdem.dynamics import ensemble, own_part, penetration, settle
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

pytestmark = [pytest.mark.client, pytest.mark.slow]

PARTS = Path(__file__).parent.parent / "examples" / "parts"
SEEDS = (1, 2, 3)


@cache
def prisms():
    """Forty prisms of a millimetre, 10 mm long and about 4 mm high; simulated as discs."""
    domain = Domain.slab((10e-3, 4e-3), 1e-3)
    cells = tessellate(relax(poisson(domain, 40, rng=1), domain, iterations=2), domain)
    return shrink(carve(cells, keep="all"), porosity=0.25)


def reports(**options):
    return [penetration(prisms(), rng=seed, spheres=True, **options).report for seed in SEEDS]


def test_a_plate_is_borne_from_its_touch_on_and_what_it_does_is_dissipated():
    found = [penetration(prisms(), rng=seed, spheres=True, friction=0.3, width=2e-3, depth=1.8e-3) for seed in SEEDS]
    for outcome in found:
        history, report = outcome.history, outcome.report
        came = history["stage"] == 1.0
        before = came & (history["depth"] < 0)
        assert before.any()
        assert np.all(history["force_y"][before] == 0)
        assert history["force_y"][came].mean() > 0
        assert report.work > 0
        assert np.diff(history["work"][came]).min() > -0.05 * report.work
        # Grains lie as high as before within a diameter: what is done is lost to friction and impacts.
        assert report.dissipated > 0.5 * report.work
        # It goes at a constant speed, so that means of the force over time are means over its way.
        done = np.sum(history["force_y"][came][1:] * np.diff(history["depth"][came]))
        assert done == pytest.approx(report.work, rel=0.03)
    # Of six runs with seeds 1 to 6 the mean force along x had a spread of 1.7e-4 N.
    sideways = np.mean([outcome.report.force_along_x for outcome in found])
    assert abs(sideways) < margin(1.7e-4, measured=6, runs=len(SEEDS))


def test_the_higher_a_plate_falls_from_the_deeper_it_gets_and_then_it_lies_with_its_weight():
    low, high = (reports(friction=0.3, width=2e-3, mode="drop", mass=2e-5, height=height) for height in (0.5e-3, 60e-3))
    for report in (*low, *high):
        assert report.at_rest
        assert report.final_force == pytest.approx(2e-5 * 9.81, rel=0.03)
        assert report.work == pytest.approx(report.dissipated, rel=0.3)
    # Six pairs at 0.5 and 20 mm differed by 0.69 mm in the mean, spread 0.22 mm: five spreads of the mean of three.
    assert np.mean([b.final_depth - a.final_depth for a, b in zip(low, high, strict=True)]) > 0


def test_a_wheel_that_slips_is_turned_and_pulls_and_a_braked_one_is_dragged():
    options = {"friction": 0.5, "mode": "roll", "body": "wheel", "load": 2e-4, "travel": 2e-3}
    spun, braked = (reports(slip=slip, **options) for slip in (0.6, -0.6))
    for name in ("torque", "drawbar_pull"):
        assert np.mean([getattr(report, name) for report in spun]) > np.mean([getattr(r, name) for r in braked])
    assert np.mean([report.torque for report in spun]) > 0 > np.mean([report.torque for report in braked])


def test_bodies_that_fall_together_fall_as_if_alone():
    options = {"seeds": 2, "spheres": True, "mode": "drop", "height": 1e-3, "max_time": 3.0, "width": 2e-3}
    together = ensemble(penetration, grow_planar(9), through="batch", **options)
    alone = ensemble(penetration, grow_planar(9), through="processes", workers=1, **options)
    for one, other in zip(together.outcomes, alone.outcomes, strict=True):
        assert one.report.work > 0
        for name, series in one.history.items():
            np.testing.assert_array_equal(series, other.history[name], err_msg=name)


@pytest.mark.parametrize("spheres", [False, True])
def test_a_scoop_bears_the_weight_of_the_grains_that_it_took_out_of_a_heap(spheres):
    domain, rolling = Domain.box((4e-3, 3.2e-3, 1.6e-3)), 0.1 if spheres else 0.0
    grown = tessellate(relax(poisson(domain, 20, rng=1), domain, iterations=2), domain)
    heap = shrink(carve(grown, keep="all"), porosity=0.4)
    for seed in SEEDS:
        bed = settle(heap, start="pour", spheres=spheres, rolling_friction=rolling, rng=seed).packing
        # Before the heap there is room for the scoop to begin from.
        bed = replace(bed, domain=Domain(bed.domain.lower - [4e-3, 0.0, 0.0], bed.domain.upper))
        outcome = own_part(
            bed, model=str(PARTS / "bucket.xml"), motion=str(PARTS / "scoop.csv"), x=-3.5e-3, y=1.6e-3, z=0.2e-3,
            spheres=spheres, rolling_friction=rolling,
        )  # fmt: skip
        report, history = outcome.report, outcome.history
        # Five runs of five took something, and all were at rest; of three in a row one does.
        if report.at_rest and report.carried_grains:
            break
    # The heap lies beyond x = 0; the scoop has come back to −2.3 mm and is 2.6 mm long.
    lifted = (outcome.packing.positions[:, 2] > 2.5e-3) & (outcome.packing.positions[:, 0] < 0.5e-3)
    assert report.carried_grains == lifted.sum() > 0
    assert report.borne_mass == pytest.approx(report.carried_mass, rel=0.03)
    assert report.carried_mass == pytest.approx(outcome.snapshot.masses()[lifted].sum(), rel=1e-9)
    for joint, force in (("forward_force", "force_x"), ("lift_force", "force_z")):
        np.testing.assert_allclose(history[joint], history[force], rtol=1e-6, atol=1e-6 * report.largest_force)
