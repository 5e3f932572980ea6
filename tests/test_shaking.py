from __future__ import annotations

import numpy as np
import pytest
from loading import grow_few, grow_planar
from shaking import MOVE, shaken, shaking

from exporters import mjcf
from exporters.mjcf import MjcfOptions
from grainsdem.dynamics import collapse, ensemble, scene

pytestmark = pytest.mark.unit


@pytest.mark.parametrize("grow", [grow_few, lambda: grow_planar(9)], ids=["solid", "planar"])
def test_a_shake_moves_every_coordinate_by_a_billionth_of_a_diameter(grow):
    packing = grow()
    moved = (shaken(packing, 3).positions - packing.positions) / (MOVE * mjcf.units(packing).length)
    free = 2 if packing.domain.is_planar else 3
    np.testing.assert_allclose(np.abs(moved[:, :free]), 1.0, rtol=1e-5)
    np.testing.assert_array_equal(moved[:, free:], 0.0)
    assert shaken(packing, 3).positions.tobytes() == shaken(packing, 3).positions.tobytes()
    assert shaken(packing, 3).positions.tobytes() != shaken(packing, 4).positions.tobytes()


def test_engines_get_shaken_grains_while_the_shake_lasts_and_files_never_do():
    packing, options = grow_few(), MjcfOptions()
    file = mjcf.text(packing, options)
    assert scene.mjcf.text(packing, options) == file
    with shaking(1):
        assert scene.mjcf.text(packing, options) != file
        assert mjcf.text(packing, options) == file
    assert scene.mjcf.text(packing, options) == file


@pytest.mark.slow
@pytest.mark.client
def test_runs_in_processes_of_their_own_are_shaken_as_those_in_this_one():
    grains, options = grow_planar(4), {"seeds": 2, "max_time": 0.2}
    still = ensemble(collapse, grains, through="processes", workers=1, **options)
    with shaking(1):
        here, there = (ensemble(collapse, grains, through="processes", workers=n, **options) for n in (1, 2))
    for one, two, three in zip(here.outcomes, there.outcomes, still.outcomes, strict=True):
        assert one.packing.positions.tobytes() == two.packing.positions.tobytes()
        assert one.packing.positions.tobytes() != three.packing.positions.tobytes()
