from __future__ import annotations

import numpy as np
import pytest
from conftest import cube_packing
from matplotlib.image import imread

from grainsdem.errors import FileFormatError, InputError
from grainsdem.figures.networks import force_figure
from grainsdem.model import ContactGraph, Domain

pytestmark = pytest.mark.unit

RED, GREY = (0xB5, 0x45, 0x2C), (0x80, 0x80, 0x80)


def bed(n, forces, chain):
    """Return a row of cubes that press on each other, and the columns of their contacts."""
    packing = cube_packing([[2.0 + 3 * k, 2.0, 2.0] for k in range(n)], domain=Domain.box((3.0 * n + 1, 4.0, 4.0)))
    pairs = np.array([[k, k + 1] for k in range(n - 1)])
    points = 0.5 * (packing.positions[:-1] + packing.positions[1:])
    normals = np.tile([1.0, 0.0, 0.0], (n - 1, 1))
    graph = ContactGraph(n, pairs, np.zeros(n - 1), normals, points, np.zeros(n - 1))
    return packing, graph, {"normal_force": np.array(forces, float), "chain": np.array(chain)}


def inked(path, colour):
    """Return how many pixels have a colour."""
    return int((np.round(255 * imread(path)[..., :3]) == colour).all(axis=-1).sum())


def test_chains_are_red_and_other_contacts_grey(tmp_path):
    chained = force_figure(*bed(4, [1, 1, 1], [0, 0, 0]), tmp_path / "chained.png")
    free = force_figure(*bed(4, [1, 1, 1], [-1, -1, -1]), tmp_path / "free.png")
    assert inked(chained, RED) > 200 > inked(chained, GREY)
    assert inked(free, GREY) > 200 > inked(free, RED)


def test_a_line_is_as_wide_as_its_force(tmp_path):
    one, three = (
        inked(force_figure(*bed(3, [1, force], [-1, 0]), tmp_path / f"{force}.png"), RED) for force in (0.25, 1)
    )
    # Of forces 1 and 1/4 the second's line has 0.4 of the mean's width, of 1 and 1 all of it; the legend's are alike.
    assert three > 1.3 * one


def test_what_cannot_be_drawn_is_refused_before_a_file_is_there(tmp_path):
    with pytest.raises(InputError, match="no contact presses"):
        force_figure(*bed(3, [0, 0], [-1, -1]), tmp_path / "a.png")
    with pytest.raises(FileFormatError, match=r"\.png"):
        force_figure(*bed(3, [1, 1], [-1, -1]), tmp_path / "a.pdf")
    assert list(tmp_path.iterdir()) == []
