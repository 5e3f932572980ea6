"""Rolling friction: a law that a sphere on a slope obeys, and what follows for files and beds at rest."""

from __future__ import annotations

import re

import numpy as np
import pytest
from conftest import cube_packing

from exporters import mjcf
from exporters.mjcf import MjcfOptions
from exporters.rest import rest_of
from grainsdem.dynamics import settle
from grainsdem.dynamics.scene import equip, scene_of
from grainsdem.dynamics.starting import as_spheres
from grainsdem.errors import InputError
from grainsdem.geometry.forms.sizes import sphere_diameters
from grainsdem.model import Domain

HALF = 0.5 / sphere_diameters(np.array([1.0]))[0]
"""Half the edge of a cube whose sphere of equal volume has a diameter of one."""


def way(slope, *, rolling):
    """Return how far [d] a sphere rolls in 20 t on a slope [rad]."""
    domain = Domain.box((60.0, 20.0, 4.0))
    ball = as_spheres(cube_packing([[10.0, 10.0, 0.5]], half=HALF, domain=domain))
    apparatus = equip(ball, MjcfOptions(friction=0.8, rolling_friction=rolling), are_spheres=True)
    apparatus.set_gravity((np.sin(slope), 0.0, -np.cos(slope)))
    scene = scene_of(ball, apparatus.text(), 9.81, are_spheres=True)
    start = scene.poses()[0][0, 0]
    scene.engine.step(2000)
    return float(scene.poses()[0][0, 0] - start)


@pytest.mark.client
@pytest.mark.parametrize("rolling", [0.05, 0.1, 0.3])
def test_a_sphere_rolls_on_a_slope_steeper_than_rolling_friction_allows_and_stays_below(rolling):
    # tan θ = μ_r, within a degree; without rolling friction it goes 2.5 d in this time on a slope of one degree.
    limit, degree = np.arctan(rolling), np.radians(1.0)
    assert abs(way(limit - degree, rolling=rolling)) < 0.05
    assert way(limit + degree, rolling=rolling) > 2.0


@pytest.mark.client
def test_a_sphere_without_rolling_friction_rolls_as_mechanics_has_it():
    # A rolling ball is accelerated by 5/7 g sin θ.
    assert way(np.radians(1.0), rolling=0.0) == pytest.approx(0.5 * 5 / 7 * np.sin(np.radians(1.0)) * 20**2, rel=0.02)


@pytest.mark.unit
def test_the_file_has_arms_of_torques_where_rolling_is_resisted_and_else_none():
    bed = cube_packing([[2.0, 2.0, 2.0]], domain=Domain.cube(4.0))
    plain, rolling = (mjcf.text(bed, MjcfOptions(friction=0.4, rolling_friction=mu)) for mu in (0.0, 0.1))
    assert re.findall(r'condim="(\d)" friction="([^"]*)"', plain) == [("3", "0.4")] * 2
    # In grain units the median diameter is one, and the arm half of 0.1.
    assert re.findall(r'condim="(\d)" friction="([^"]*)"', rolling) == [("6", "0.4 0.05 0.05")] * 2


@pytest.mark.client
def test_a_bed_that_came_to_rest_with_rolling_friction_is_written_with_it():
    bed = cube_packing([[2.0, 2.0, 1.001]], domain=Domain.cube(4.0))
    end = settle(bed, start="place", rolling_friction=0.2).packing
    assert rest_of(end).rolling_friction == 0.2
    assert 'condim="6"' in mjcf.text(end)
    assert 'condim="6"' not in mjcf.text(end, MjcfOptions(rolling_friction=0.0))


@pytest.mark.unit
@pytest.mark.parametrize("value", [-0.1, np.nan])
def test_rolling_friction_below_zero_is_refused(value):
    with pytest.raises(InputError, match="rolling_friction must be zero or more"):
        MjcfOptions(rolling_friction=value)
