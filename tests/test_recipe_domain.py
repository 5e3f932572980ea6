from __future__ import annotations

import numpy as np
import pytest

from grainsdem.errors import InputError
from grainsdem.recipe import grow, make

pytestmark = pytest.mark.unit


@pytest.mark.parametrize(
    ("table", "volume"),
    [
        ({}, 1.0),
        ({"lengths": (1, 2, 3), "periodic": "xz"}, 6.0),
        ({"shape": "slab", "lengths": (2, 1, 0.1), "periodic": "xy"}, 0.2),
        ({"shape": "cylinder", "radius": 2, "height": 3, "periodic": "z"}, np.pi * 4 * 3),
        # A frustum: height / 3 (A + B + √AB).
        ({"shape": "hopper", "top": (2, 2), "bottom": (1, 1), "height": 3}, 7.0),
    ],
)
def test_every_shape_of_domain_can_be_asked_for(table, volume):
    domain = make(domain=table, seeds={"count": 5}, grains={"scale": 1}).domain.make()
    assert domain.volume == pytest.approx(volume, rel=1e-12)
    assert "".join(axis for axis, wraps in zip("xyz", domain.periodic, strict=True) if wraps) == table.get(
        "periodic", ""
    )
    assert domain.is_planar == (table.get("shape") == "slab")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"shape": "hopper"}, "a hopper takes bottom, height, top; got none"),
        ({"radius": 1}, "a box takes lengths; got radius"),
        ({"shape": "slab", "lengths": (1, 1, 1), "periodic": "z"}, "a slab may be periodic along xy; got z"),
        ({"shape": "hopper", "top": (2, 2), "bottom": (1, 1), "height": 1, "periodic": "x"}, "along no axis; got x"),
        ({"periodic": "foo"}, "along xyz; got foo"),
    ],
)
def test_a_domain_that_does_not_fit_its_shape_is_refused(table, words):
    with pytest.raises(InputError, match=words):
        make(domain=table, seeds={"count": 5}, grains={"scale": 1})


def test_a_two_dimensional_bed_is_grown_from_a_recipe():
    slab = {"shape": "slab", "lengths": (1, 1, 0.05), "periodic": "xy"}
    bed = grow(make(domain=slab, seeds={"count": 100, "process": "poisson"}, grains={"porosity": 0.2}))
    assert len(bed) == 100
    assert np.ptp(bed.positions[:, 2]) < 1e-15
