from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem.cli import app
from grainsdem.errors import InputError, ShapeError

CUBE = gd.Domain.cube(periodic=True)


def by_volume(d, marks):
    sizes = np.sort(d)
    running = np.cumsum(sizes**3)
    return np.interp(np.asarray(marks) / 100 * running[-1], running, sizes)


def bed_of(sigma, n, rng, relaxations=2):
    law = stats.lognorm(s=sigma, scale=0.1)
    return gd.shrink(gd.carve(gd.sized_cells(CUBE, law, n=n, relaxations=relaxations, rng=rng)), porosity=0.4)


@pytest.mark.statistical
@pytest.mark.parametrize("sigma", [0.2, 0.4])
def test_sections_of_balls_tell_their_sizes(sigma):
    rng = np.random.default_rng(1)
    sizes = np.exp(rng.normal(0, sigma, 200_000))
    # A plane meets a ball as often as it is wide, at any distance from its middle.
    met = rng.choice(sizes, 5000, p=sizes / sizes.sum())
    found = gd.unfold(met * np.sqrt(1 - rng.random(5000) ** 2))
    # Of six such samples the worst percentile was off by 2.7 % by volume, by 4 % by number.
    assert found.percentiles([16, 50, 84]) == pytest.approx(by_volume(sizes, [16, 50, 84]), rel=0.06)
    assert found.percentiles([50], by="number") == pytest.approx(np.percentile(sizes, [50]), rel=0.06)
    assert found.number.sum() == pytest.approx(1)
    assert found.volume.sum() == pytest.approx(1)


@pytest.mark.unit
def test_the_kernel_of_balls_is_the_closed_form():
    ball = gd.SectionKernel.ball()
    t = np.linspace(0, 1, 11)
    assert ball.cdf(t) == pytest.approx(1 - np.sqrt(1 - t**2), abs=1e-3)
    # The mean section of a ball has π/4 of its diameter.
    assert ball.ratios.mean() == pytest.approx(np.pi / 4, abs=1e-4)


@pytest.mark.statistical
def test_a_kernel_is_that_of_the_shapes_whatever_the_sizes_and_agrees_with_cauchy():
    bed = bed_of(0.2, 300, 1)
    kernel = gd.SectionKernel.of(bed, n_planes=200)
    # Mean area of the sections of a convex body: V over its mean width.
    areas = np.pi / 4 * (kernel.ratios**2).mean()
    expected = (np.pi / 6 * gd.diameters(bed) ** 3).sum() / (gd.mean_widths(bed.grains) * gd.diameters(bed) ** 2).sum()
    assert areas == pytest.approx(expected, rel=0.05)
    assert 1.05 < kernel.width < 1.25


@pytest.mark.slow
@pytest.mark.statistical
def test_angular_grains_are_unfolded_by_a_kernel_of_their_kind(tmp_path):
    bed, other = bed_of(0.3, 700, 2), bed_of(0.1, 300, 5)
    rows = [gd.section_table(gd.section(bed, z=float(z))) for z in np.linspace(0.05, 0.95, 8)]
    sections = np.concatenate([row["diameter"][row["is_counted"]] for row in rows])
    sizes = gd.diameters(bed)
    found = gd.unfold(sections, gd.SectionKernel.of(other))
    # Of four such beds of 1500 grains the worst was off by 3.6 % by volume.
    assert found.percentiles([16, 50, 84]) == pytest.approx(by_volume(sizes, [16, 50, 84]), rel=0.1)
    # The sections themselves are smaller by a fifth.
    assert np.median(sections) < 0.88 * np.median(sizes)
    assert found.percentiles(50, by="number") == pytest.approx(np.median(sizes), rel=0.1)
    np.savetxt(tmp_path / "sections.txt", sections)
    gd.save(other, tmp_path / "kernel.h5")
    words = ["unfold", tmp_path / "sections.txt", "--kernel", tmp_path / "kernel.h5", "--table", tmp_path / "c.csv"]
    result = CliRunner().invoke(app, [str(word) for word in (*words, "--json")])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["volume"]["d50"] == pytest.approx(float(found.percentiles(50)))
    assert told["n_sections"] == len(sections)
    table = np.genfromtxt(tmp_path / "c.csv", delimiter=",", names=True)
    assert table["volume"] == pytest.approx(found.volume)


@pytest.mark.unit
def test_the_table_of_a_section_is_unfolded_by_its_polygons_that_count(tmp_path):
    bed = bed_of(0.2, 700, 1, relaxations=0)
    gd.save(bed, tmp_path / "bed.h5")
    for words in (
        ["section", tmp_path / "bed.h5", tmp_path / "s.png", "--table", tmp_path / "s.csv", "--quiet"],
        ["unfold", tmp_path / "s.csv"],
    ):
        result = CliRunner().invoke(app, [str(word) for word in words])
        assert result.exit_code == 0, result.output
    rows = gd.section_table(gd.section(bed, z=0.5))
    assert f"{np.count_nonzero(rows['is_counted'])} sections" in result.stdout
    assert "by volume, mm" in result.stdout


@pytest.mark.unit
def test_what_cannot_be_unfolded_gets_one_line(tmp_path):
    with pytest.raises(InputError, match="50 sections or more; got 3"):
        gd.unfold([1.0, 2.0, 3.0])
    with pytest.raises(ShapeError, match=r"shape \(n,\); got shape \(60, 1\)"):
        gd.unfold(np.ones((60, 1)))
    with pytest.raises(InputError, match="positive and finite; got 0"):
        gd.unfold(np.zeros(60))
    with pytest.raises(InputError, match="'volume' or 'number'; got 'mass'"):
        gd.unfold(np.linspace(1, 2, 60)).percentiles(50, by="mass")
    slab = gd.Domain.slab((1.0, 1.0), 0.1)
    with pytest.raises(InputError, match="nothing to unfold in a planar bed"):
        gd.SectionKernel.of(gd.carve(gd.tessellate(gd.points.poisson(slab, 30, rng=1), slab)))
    with pytest.raises(InputError, match="50 sections or more; 1 planes met"):
        gd.SectionKernel.of(bed_of(0.1, 30, 1, relaxations=0), n_planes=1)
    (tmp_path / "a.txt").write_text("one\n2\n", encoding="utf-8")
    for name, words in (("none.txt", "no such file"), ("a.txt", "50 sections or more")):
        result = CliRunner().invoke(app, ["unfold", str(tmp_path / name)])
        assert result.exit_code == 2
        assert words in result.stderr
