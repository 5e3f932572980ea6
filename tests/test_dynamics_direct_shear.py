from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from chance import margin
from conftest import cube_packing
from loading import check_that_it_goes_on, grow, grow_planar

from exporters.mjcf import MjcfOptions, units
from grainsdem.dynamics import direct_shear
from grainsdem.dynamics.experiments.cells.shear_box import ShearBox
from grainsdem.dynamics.scene import equip
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Domain

pytestmark = pytest.mark.client


def two_blocks():
    """A cube that fills the lower half of a box, and one on it that is narrower, and stays on it while it slides."""
    pair = cube_packing([[1.0, 1.0, 1.0], [1.0, 1.0, 3.0]], density=2000.0, domain=Domain.box((2.0, 2.0, 4.0)))
    corners = pair.grains.vertices.copy()
    corners[8:, :2] *= 0.8
    return replace(pair, grains=replace(pair.grains, vertices=corners))


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_a_block_that_is_pushed_over_another_one_slides_at_its_friction(friction):
    # Without a gap: one of half a diameter would be half a block, and push so high that the block tips.
    options = {"normal_stress": 1e4, "displacement": 0.16, "inertial_number": 1e-2, "gap": 0.0}
    outcome = direct_shear(two_blocks(), friction=friction, **options)
    assert outcome.report.steady_friction == pytest.approx(friction, rel=0.02)
    assert outcome.report.dilation == pytest.approx(0, abs=0.005)
    assert outcome.report.normal_stress == pytest.approx(1e4, rel=0.01)


def test_prisms_are_sheared_in_their_plane_and_a_box_too_small_for_them_is_warned_of(caplog):
    start = grow_planar(16)
    outcome = direct_shear(start, displacement=0.02, inertial_number=0.05, rng=1)
    np.testing.assert_allclose(outcome.packing.positions[:, 2], start.positions[0, 2], atol=1e-9)
    # Of 12 beds: 1.006 ± 0.010.
    assert outcome.report.normal_stress == pytest.approx(1e4, rel=0.006 + margin(0.010, measured=12))
    assert 0 < outcome.report.initial_solid_fraction < 1
    assert "of its largest grains long and" in caplog.text


@pytest.mark.parametrize(("aspect", "gap"), [(2.0, 0.0), (4.0, 3e-4)])
def test_a_box_has_the_aspect_and_the_gap_that_were_asked_for(aspect, gap):
    grains = grow(60)
    box = ShearBox(grains, rng=1, aspect=aspect, gap=gap)
    options = MjcfOptions(gravity=1.0, walls="none")
    apparatus, scales = equip(box.packing, options), units(box.packing, 1.0)
    box.furnish(apparatus, scales, friction=0.5)
    model = mujoco.MjModel.from_xml_string(apparatus.text())
    low, high = (model.geom(name) for name in ("lower_x1", "upper_x1"))
    opening = (high.pos[2] - high.size[2]) - (low.pos[2] + low.size[2])
    assert opening * scales.length == pytest.approx(gap, abs=1e-9)
    depth = box.area / box.length
    assert box.length / depth == pytest.approx(aspect, rel=1e-9)
    # As high as deep where grains fill 0.55 of it.
    assert float(volumes(grains.grains).sum()) / scales.length**3 == pytest.approx(0.55 * box.area * depth, rel=1e-9)


@pytest.mark.slow
def test_a_box_goes_on_after_an_interrupt_to_the_same_bits(tmp_path):
    check_that_it_goes_on(
        direct_shear, grow(16), tmp_path, samples=24, displacement=0.02, inertial_number=0.05, spheres=True, rng=1
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"normal_stress": 0.0}, "normal_stress"),
        ({"displacement": 0.6}, "displacement"),
        ({"friction": -0.5}, "friction"),
        ({"aspect": 0.5}, "aspect: input should be greater than or equal to 1; got 0.5"),
        ({"gap": -1e-4}, "gap: input should be greater than or equal to 0; got -0.0001"),
    ],
)
def test_options_out_of_range_are_refused_by_name(options, words):
    with pytest.raises(InputError, match=words):
        direct_shear(two_blocks(), **options)
