"""Restitution: how high a sphere bounces, what a bed with it comes to, and what is written of it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from conftest import cube_packing
from loading import first_at_rest, grow

from exporters.mjcf import MjcfOptions, text
from exporters.mjcf.bouncing import LEAST, MOST, damping_of, mean_restitution
from exporters.rest import rest_of
from grainsdem.dynamics import collapse, settle
from grainsdem.dynamics.scene import equip, scene_of
from grainsdem.dynamics.starting import as_spheres
from grainsdem.errors import InputError
from grainsdem.geometry.forms.sizes import sphere_diameters
from grainsdem.model import Domain

HALF = 0.5 / sphere_diameters(np.array([1.0]))[0]
"""Half the edge of a cube whose sphere of equal volume has a diameter of one."""

PLACES = 8
"""Spheres that are dropped at once, each to hit the floor at another place in the step."""


def bounces(restitution, fall, *, step=0.01, friction=0.5):
    """Return √(height of the bounce / height of the fall) of spheres far apart, shape (PLACES,)."""
    late = np.arange(PLACES) / PLACES * np.sqrt(2 * fall) * step
    places = [[5.0 * k + 3, 3.0, 0.5 + fall + way] for k, way in enumerate(late)]
    balls = as_spheres(cube_packing(places, half=HALF, domain=Domain.box((5.0 * PLACES + 3, 6.0, fall + 4))))
    options = MjcfOptions(friction=friction, restitution=restitution, time_step=step)
    engine = scene_of(balls, equip(balls, options, are_spheres=True).text(), 9.81, are_spheres=True).engine
    highest, has_turned = np.zeros(PLACES), np.zeros(PLACES, dtype=bool)
    for _ in range(int(2.5 * np.sqrt(2 * fall) / step)):
        engine.step(1)
        now = engine.motion()
        has_turned |= now.velocities[:, 2] > 0
        highest = np.where(has_turned, np.maximum(highest, now.positions[:, 2] - 0.5), highest)
    return np.sqrt(np.maximum(highest, 0.0) / fall)


@pytest.mark.client
@pytest.mark.parametrize("restitution", [LEAST, 0.5, MOST])
@pytest.mark.parametrize(("fall", "step"), [(1.0, 0.01), (10.0, 0.01), (3.0, 0.005)])
def test_spheres_bounce_to_the_square_of_their_restitution_whatever_they_fall_from(restitution, fall, step):
    found = bounces(restitution, fall, step=step)
    assert found.mean() == pytest.approx(restitution, abs=0.03)
    # Where in a step it hits the floor moves a single bounce: by less than half as much again for any restitution.
    assert np.abs(found - restitution).max() < 0.07


@pytest.mark.client
def test_spheres_hardly_bounce_unless_told():
    # 0 to 0.22, in the mean 0.11 (8 places, one height).
    assert bounces(None, 3.0).mean() < 0.2 < bounces(LEAST, 3.0).mean()


@pytest.mark.client
@pytest.mark.parametrize("restitution", [LEAST, MOST])
def test_two_spheres_part_with_their_restitution_and_keep_their_momentum(restitution):
    found = []
    for place in np.arange(PLACES) / PLACES:
        pair = as_spheres(
            cube_packing([[5.0, 5.0, 5.0], [6.5 + 0.02 * place, 5.0, 5.0]], half=HALF, domain=Domain.cube(20.0))
        )
        apparatus = equip(pair, MjcfOptions(restitution=restitution, walls="none"), are_spheres=True)
        apparatus.set_gravity((0.0, 0.0, 0.0))
        engine = scene_of(pair, apparatus.text(), 9.81, are_spheres=True).engine
        engine.set_velocities([[2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        engine.step(100)
        one, two = engine.motion().velocities[:, 0]
        assert one + two == pytest.approx(2.0, abs=1e-9)
        found.append((two - one) / 2.0)
    assert np.mean(found) == pytest.approx(restitution, abs=0.03)


@pytest.mark.unit
def test_damping_is_what_the_restitution_falls_with():
    wanted = np.linspace(LEAST, MOST, 5)
    found = [damping_of(restitution) for restitution in wanted]
    np.testing.assert_allclose([mean_restitution(damping) for damping in found], wanted, atol=1e-9)
    # A spring that never pulls, where steps are short (Schwager and Pöschel 2007): e(0.1) = 0.744, e(0.25) = 0.510.
    assert mean_restitution(0.1) == pytest.approx(0.744, abs=0.02)
    assert mean_restitution(0.25) == pytest.approx(0.510, abs=0.02)


@pytest.mark.unit
@pytest.mark.parametrize("value", [0.0, 0.29, 0.71, 1.0, np.nan])
def test_a_restitution_that_contacts_cannot_have_is_refused(value):
    with pytest.raises(
        InputError, match=r"restitution must be 0.3 to 0.7, or left out for contacts that hardly bounce"
    ):
        MjcfOptions(restitution=value)
    with pytest.raises(InputError, match="restitution: input should be"):
        collapse(grow(8), restitution=value, rng=1)


@pytest.mark.client
def test_a_bed_that_bounces_comes_to_rest_and_is_written_as_it_rests():
    bed = cube_packing([[2.0, 2.0, 3.0]], domain=Domain.cube(6.0))
    end = settle(bed, restitution=0.5)
    assert end.report.at_rest
    assert rest_of(end.packing).restitution == 0.5
    model = mujoco.MjModel.from_xml_string(text(end.packing))
    damping = damping_of(0.5)
    assert model.geom("g000000").solref == pytest.approx([4 * model.opt.timestep / damping, damping], rel=1e-6)
    assert mujoco.MjModel.from_xml_string(text(bed)).geom("g000000").solref == pytest.approx([0.02, 1.0])


@pytest.mark.client
def test_a_smaller_step_keeps_the_damping_and_makes_contacts_stiffer():
    bed = cube_packing([[2.0, 2.0, 2.0]], domain=Domain.cube(4.0))
    engine = scene_of(bed, equip(bed, MjcfOptions(restitution=0.5)).text(), 9.81).engine
    before = engine.model.geom_solref.copy()
    engine.set_time_step(0.005)
    np.testing.assert_allclose(engine.model.geom_solref, before * [0.5, 1.0], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("spheres", [True, False])
def test_poured_beds_that_bounce_come_to_rest_at_the_highest_restitution(spheres):
    # Of 6 beds at 0.7 all did, in 26 to 44 t. At 0.8 polyhedra gained energy, until their step was a quarter.
    rolling = 0.1 if spheres else 0.0
    grains, options = grow(27), {"spheres": spheres, "rolling_friction": rolling, "restitution": MOST}
    bed = first_at_rest(lambda seed: settle(grains, start="pour", rng=seed, **options))
    assert rest_of(bed.packing).restitution == MOST
