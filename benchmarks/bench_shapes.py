"""Seconds for rocks, packs of mixed shapes and large scans: ``pytest benchmarks/bench_shapes.py``."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import grainsdem as gd

pytest.importorskip("pytest_benchmark")


def mixture():
    """Return four kinds: cubes, balls, rods, two hundred rocks."""
    return [
        gd.shapes.platonic("cube"),
        gd.shapes.ellipsoid(1, 1, 1),
        gd.shapes.prism(6, aspect=2.0),
        gd.shapes.rock(200, elongation=0.7, flatness=0.7, rng=1),
    ]


@pytest.mark.parametrize("sizes", ["one", "ten to one"])
@pytest.mark.parametrize("n", [1000, 10_000, 100_000])
def test_a_pack_of_mixed_shapes(benchmark, n, sizes):
    law = stats.uniform(1e-3, 1e-9) if sizes == "one" else stats.loguniform(1e-3, 1e-2)
    kinds = mixture()
    gd.pack(kinds, law, n=10, rng=1)
    bed = benchmark.pedantic(lambda: gd.pack(kinds, law, n=n, by="mass", rng=1), rounds=1)
    benchmark.extra_info["solid_fraction"] = float(gd.volumes(bed).sum() / bed.domain.volume)


def test_a_thousand_rocks(benchmark):
    benchmark.pedantic(lambda: gd.shapes.rock(1000, elongation=0.7, flatness=0.6, rng=1), rounds=1)


@pytest.mark.parametrize("kind", ["smooth", "rough"])
def test_a_scan_of_a_million_triangles(benchmark, tmp_path, kind):
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=8)
    rough = 1 + 0.02 * np.sin(ball.vertices @ np.random.default_rng(0).normal(0, 9, (3, 4))).sum(axis=1)
    points = ball.vertices * (rough[:, None] if kind == "rough" else 1.0) * [1.0, 0.8, 0.5]
    trimesh.Trimesh(points, ball.faces, process=False).export(tmp_path / "scan.stl")
    gd.shapes.read(tmp_path / "scan.stl", concave="hull")
    benchmark.pedantic(lambda: gd.shapes.read(tmp_path / "scan.stl", concave="hull"), rounds=1)
