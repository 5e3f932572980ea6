from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem import recipe as recipes
from grainsdem.cli import app
from grainsdem.errors import InputError
from grainsdem.points import Grade, poisson
from grainsdem.tessellation import relax, tessellate


@pytest.mark.statistical
@pytest.mark.parametrize(("domain", "power"), [(gd.Domain.box((1, 2, 4)), 3), (gd.Domain.slab((1, 3), 0.1), 2)])
@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0])
def test_there_are_as_many_seeds_as_grains_of_each_size_need(domain, power, ratio):
    axis = 2 if power == 3 else 1
    seeds = Grade(ratio, "xyz"[axis]).moved(poisson(domain, 5000, rng=1), domain)
    t = (seeds[:, axis] - domain.lower[axis]) / domain.lengths[axis]

    def share_below(t):  # ∫ h^-power over that to the end, with h = 1 + (r - 1) t
        fine = np.linspace(0, 1, 4001)
        density = (1 + (ratio - 1) * fine) ** -power
        running = np.append(0, np.cumsum(0.5 * (density[1:] + density[:-1])))
        return np.interp(t, fine, running / running[-1])

    assert kstest(t, share_below).pvalue > 1e-5
    assert domain.contains(seeds).all()


@pytest.mark.statistical
@pytest.mark.parametrize("ratio", [0.4, 2.5])
def test_sizes_go_linearly_from_one_end_to_the_other(ratio):
    domain = gd.Domain.box((1.0, 1.0, 2.0))
    grade = Grade(ratio)
    seeds = grade.moved(poisson(domain, 2000, rng=1), domain)
    seeds = relax(seeds, domain, iterations=8, density=grade.density(domain))
    bed = gd.carve(tessellate(seeds, domain))
    t, sizes = 0.5 * bed.positions[:, 2], gd.diameters(bed)
    slope, start = np.polyfit(t, sizes, 1)
    # Relaxed cells of one size vary by 5 % or so: of hundreds of grains the ratio is known within 3 %.
    assert (start + slope) / start == pytest.approx(ratio, rel=0.1)
    residual = sizes / (start + slope * t) - 1
    assert residual.std() < 0.12


@pytest.mark.unit
def test_recipe_and_command_fine_upward(tmp_path):
    seeds = {"process": "poisson", "count": 400, "relax": 3, "grade": {"ratio": 0.4}}
    bed = recipes.grow(recipes.make(seeds=seeds, grains={"porosity": 0.4, "keep": "all", "mean_diameter": 1e-3}))
    place = bed.positions[:, 2] / bed.domain.lengths[2]
    low, high = (gd.diameters(bed)[rows].mean() for rows in (place < 0.2, place > 0.8))
    assert high / low == pytest.approx((1 - 0.6 * 0.9) / (1 - 0.6 * 0.1), abs=0.1)
    words = ["generate", tmp_path / "a.h5", "--process", "poisson", "--count", 400, "--relax", 3, "--porosity", 0.4]
    words += ["--keep", "all", "--mean-diameter", 1e-3, "--seed-parameter", "grade={ratio=0.4}", "--quiet"]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    assert gd.load(tmp_path / "a.h5").positions.tobytes() == bed.positions.tobytes()
    flat = recipes.grow(recipes.make(seeds=seeds, grains={"porosity": 0.4, "keep": "all", "axes": {"flatness": 0.5}}))
    place = flat.positions[:, 2] / flat.domain.lengths[2]
    assert gd.diameters(flat)[place > 0.8].mean() < 0.65 * gd.diameters(flat)[place < 0.2].mean()


@pytest.mark.unit
@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"seeds": {"process": "cluster", "parents": 3, "spread": 0.1}}, "seeds of halton, poisson, strauss,"),
        ({"seeds": {"process": "poisson", "grade": {"ratio": 0}}}, "ratio: .*equal to 0.05; got 0"),
        ({"grains": {"scale": 1, "sizes": {"diameters": [1.0, 2.0]}}}, "leave out sizes, sieves, layers and shapes"),
        ({"domain": {"periodic": "z"}}, "wraps around along z"),
        ({"domain": {"shape": "slab", "lengths": [1, 1, 0.1]}}, "a slab is one grain thick along z"),
        ({"domain": {"shape": "cylinder", "radius": 1, "height": 1}}, "graded in boxes and slabs"),
    ],
)
def test_grades_without_a_meaning_get_one_line(tables, words):
    seeds = {"process": "poisson", "count": 9, "grade": {"ratio": 0.5}} | tables.pop("seeds", {})
    with pytest.raises(InputError, match=words):
        recipes.grow(recipes.make(**{"seeds": seeds, "grains": {"scale": 1}} | tables))


@pytest.mark.unit
def test_ratios_and_axes_are_checked():
    with pytest.raises(InputError, match=r"from 0\.05 to 20; got 30"):
        Grade(30)
    with pytest.raises(InputError, match="'x', 'y' or 'z'; got 'w'"):
        Grade(2, "w")
