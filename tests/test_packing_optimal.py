from __future__ import annotations

import json

import numpy as np
import pytest

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.measures import diameters, porosity, size_statistics
from grainsdem.model import Domain
from grainsdem.packing import VOID_RELATIONS, SortingRelation, carve, fit_void_ratio, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate

pytestmark = pytest.mark.unit


def void_ratio(packing):
    phi = porosity(packing)
    return phi / (1 - phi)


def mean_wadell(packing):
    """By trimesh: another program's volumes and areas."""
    import trimesh

    found = []
    for i in range(len(packing)):
        hull = trimesh.convex.convex_hull(packing.grains.vertices_of(i))
        found.append(np.pi ** (1 / 3) * (6 * hull.volume) ** (2 / 3) / hull.area)
    return np.mean(found)


def test_the_loosest_state_of_cho_is_the_papers_at_its_mean_sphericity():
    assert VOID_RELATIONS["cho_2006_max"](0.87) == pytest.approx(0.85, abs=0.005)


@pytest.mark.parametrize(("name", "a", "b"), [("cho_2006_max", 1.6, -0.86), ("cho_2006_min", 1.0, -0.51)])
def test_the_bed_lies_on_the_relation_and_the_factor_is_told(cells, name, a, b):
    start = carve(cells)
    bed = fit_void_ratio(start, relation=name)
    assert void_ratio(bed) == pytest.approx(a + b * mean_wadell(start), rel=1e-9)
    scale = json.loads(bed.provenance[-1])["scale"]
    assert scale**3 == pytest.approx(1 - porosity(bed), rel=1e-12)


def test_a_bed_has_the_void_ratio_of_its_sorting(cells):
    law = VOID_RELATIONS["terzaghi_1996"]
    # The paper's three classes, and halfway between two of them.
    assert [law(s) for s in (0.1, 0.425, 0.64, 0.855, 4.0, 5.0)] == pytest.approx([0.85, 0.85, 0.76, 0.67, 0.25, 0.25])
    bed = fit_void_ratio(carve(cells), relation="terzaghi_1996")
    sorting = size_statistics(diameters(bed), weights=volumes(bed.grains)).folk_ward.sorting
    assert void_ratio(bed) == pytest.approx(law(sorting), rel=1e-8)
    steep = SortingRelation((0.0, 10.0), (1.0, 0.0), "a test's own")
    assert void_ratio(fit_void_ratio(carve(cells), relation=steep)) == pytest.approx(1 - sorting / 10, rel=1e-8)


def test_any_function_of_the_sphericity_will_do(cells):
    heard = []
    bed = fit_void_ratio(carve(cells), relation=lambda s: heard.append(s) or 0.7)
    assert void_ratio(bed) == pytest.approx(0.7, rel=1e-12)
    assert heard == [pytest.approx(mean_wadell(carve(cells)), rel=1e-9)]


def test_in_a_planar_bed_the_sphericity_is_that_of_the_outlines():
    slab = Domain.slab((1.0, 1.0), 0.01)
    bed = carve(tessellate(poisson(slab, 60, rng=2), slab), keep="all")
    found = []
    for i in range(len(bed)):
        top = bed.grains.vertices_of(i)
        (face,) = (f for f in bed.grains.faces_of(i) if (top[f, 2] > 0).all())
        ring = top[face, :2]
        after = np.roll(ring, -1, axis=0)
        area = 0.5 * abs((ring[:, 0] * after[:, 1] - ring[:, 1] * after[:, 0]).sum())
        found.append(2 * np.sqrt(np.pi * area) / np.linalg.norm(after - ring, axis=1).sum())
    assert void_ratio(fit_void_ratio(bed)) == pytest.approx(1.6 - 0.86 * np.mean(found), rel=1e-9)


@pytest.mark.parametrize(
    ("relation", "words"),
    [
        ("cho", "one of cho_2006_max, cho_2006_min, terzaghi_1996; got 'cho'"),
        (lambda _s: -0.1, "void ratio of zero or more; at S = .* it is -0.1"),
        (lambda _s: np.nan, "it is nan"),
        (lambda _s: 0.5, "porosity can only grow"),
    ],
)
def test_relations_that_no_bed_can_follow_are_refused(cells, relation, words):
    with pytest.raises(InputError, match=words):
        fit_void_ratio(shrink(carve(cells), void_ratio=0.6), relation=relation)
