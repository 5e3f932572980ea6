"""What beds do to bodies that go into them: signs, balances and trends, of discs in a plane and of a scoop."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from chance import margin

from grainsdem.dynamics import own_part, penetration, settle
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
        # It goes at a constant speed, so what it has done is the integral of its force over its way.
        way = np.trapezoid(history["force_y"][came], history["depth"][came])
        assert way == pytest.approx(report.work, rel=0.1)
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
    options = {"friction": 0.5, "mode": "roll", "body": "wheel", "load": 2e-4, "travel": 3e-3}
    spun, braked = (reports(slip=slip, **options) for slip in (0.6, -0.6))
    for name in ("torque", "drawbar_pull"):
        assert np.mean([getattr(report, name) for report in spun]) > np.mean([getattr(r, name) for r in braked])
    assert np.mean([report.torque for report in spun]) > 0 > np.mean([report.torque for report in braked])


def test_a_scoop_bears_what_hangs_on_it():
    domain = Domain.box((8e-3, 4.6e-3, 1.1e-3))
    bed = shrink(
        carve(tessellate(relax(poisson(domain, 40, rng=1), domain, iterations=2), domain), keep="all"), porosity=0.4
    )
    bed = settle(bed, start="pour", spheres=True, rolling_friction=0.1, rng=1).packing
    top = float(np.max(bed.positions[:, 2])) + 0.5e-3
    outcome = own_part(
        bed, model=str(PARTS / "bucket.xml"), motion=str(PARTS / "scoop.csv"), x=1.2e-3, y=2.3e-3, z=top + 1.8e-3,
        spheres=True, rolling_friction=0.1,
    )  # fmt: skip
    report = outcome.report
    history = outcome.history
    force = np.array([history["force_x"], history["force_z"]])
    joints = np.array([history["forward_force"], history["lift_force"]])
    np.testing.assert_allclose(joints, force, rtol=1e-6, atol=1e-3 * np.abs(force).max())
    assert report.carried_grains > 0
    assert report.borne_mass == pytest.approx(report.carried_mass, rel=0.05)
