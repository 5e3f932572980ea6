"""What has no end, or fits nowhere, is refused before anything is made."""

from __future__ import annotations

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import grainsdem as gd
from grainsdem.errors import InputError, WriteError
from grainsdem.survey.plan import MOST_BEDS
from grainsdem.workers import check_workers, share

pytestmark = pytest.mark.unit

RECIPE = {"seeds": {"count": 8}, "grains": {"scale": 0.9, "keep": "all"}}


@pytest.mark.parametrize("count", [10**8, 10**12])
def test_more_cells_than_memory_holds_are_refused_before_their_seeds_are_placed(count, monkeypatch):
    monkeypatch.setattr("grainsdem.recipe.growing.place", None)
    monkeypatch.setenv("GRAINSDEM_MEMORY", "16")
    with pytest.raises(InputError, match=r"cells would take .* GB, and 16 GB may be taken here"):
        gd.recipe.grow(gd.recipe.make(seeds={"count": count}, grains={"scale": 0.9}))


def test_more_loose_grains_than_memory_holds_are_refused(monkeypatch):
    monkeypatch.setenv("GRAINSDEM_MEMORY", "16")
    with pytest.raises(InputError, match="grains would take"):
        gd.pack(gd.shapes.platonic("cube"), gd.Grading([1e-3, 2e-3], [0, 1]), n=10**9)
    wanted = gd.recipe.make(grains={"shapes": {"kinds": [{"shape": "cube"}], "count": 10**15, "diameter": 1e-3}})
    with pytest.raises(InputError, match="grains would take"):
        gd.recipe.grow(wanted)


@pytest.mark.parametrize("repeats", [MOST_BEDS + 1, 10**18])
def test_surveys_and_sets_have_an_end(repeats, tmp_path):
    with pytest.raises(InputError, match=f"at most {MOST_BEDS} beds; got"):
        gd.survey.Survey(RECIPE, {}, repeats=repeats)
    with pytest.raises(InputError, match=f"at most {MOST_BEDS} beds; got"):
        gd.survey.Survey(RECIPE, {name: list(range(200)) for name in ("a", "b", "c")})
    with pytest.raises(InputError, match=f"at most {MOST_BEDS} photographs"):
        gd.images(gd.recipe.make(**RECIPE), tmp_path / "set", count=repeats)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("workers", [0, -1, 1025, 10**22])
def test_no_machine_is_asked_for_more_workers_than_any_has(workers, tmp_path):
    with pytest.raises(InputError, match="workers must be between 1 and 1024; got"):
        check_workers(workers)
    with pytest.raises(InputError, match="workers"):
        list(share(abs, [1, 2], workers=workers))
    with pytest.raises(InputError, match="workers"):
        gd.images(
            gd.recipe.make(**{**RECIPE, "seeds": {"count": 8, "process": "poisson"}}),
            tmp_path,
            count=2,
            workers=workers,
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("reach", [1e-308, 1e-20, 0.0, -1.0, np.inf, np.nan])
def test_distances_between_seeds_are_such_as_there_are(reach):
    domain = gd.Domain.cube(1.0)
    with pytest.raises(InputError, match=r"reach must be positive and finite|radii must be at least 1e-12 m"):
        gd.points.describe(gd.points.halton(domain, 9), domain, reach=reach)


def test_voxels_that_the_disk_has_no_room_for_are_refused(fresh, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1000))
    with pytest.raises(WriteError, match=r"voxels would take .* GB of disk, and 1e-06 GB are free in"):
        gd.write_voxels(fresh, tmp_path / "a.npy", per_diameter=10)
    with pytest.raises((InputError, WriteError), match="voxels"):
        gd.write_voxels(fresh, tmp_path / "a.npy", size=1e-12)
    assert list(tmp_path.iterdir()) == []


def test_a_photograph_has_no_light_along_the_ground_and_no_blur_beyond_its_edge(fresh):
    view = gd.planform(fresh, per_diameter=4)
    with pytest.raises(InputError, match=r"0\.01 rad or more above the horizon"):
        gd.photograph(view, fresh, light=(1.0, 0.0, 1e-6))
    with pytest.raises(InputError, match=r"blur must be at most the picture's longer edge, \d+ pixels; got 1e\+09"):
        gd.photograph(view, fresh, blur=1e9)


def test_a_ring_that_its_grains_do_not_fill_is_refused_before_it_is_laid_out(fresh):
    with pytest.raises(InputError, match="grains a layer and needs four times as many"):
        gd.ring_shear(fresh, outer_radius=1e20)


def test_a_bed_in_a_vast_domain_has_its_surface_on_the_floor(fresh):
    wide = gd.Domain.box((1e6, 1e6, 1.0))
    lost = gd.Packing(fresh.grains, fresh.positions, fresh.quaternions, fresh.densities, wide)
    with pytest.raises(InputError, match="too small for a core"):
        gd.core_box(lost)


def test_grains_without_volume_cannot_be_healed():
    corners = 1e-3 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    flat = gd.Polyhedra(corners, [0, 4], [0, 2], [0, 1, 2, 3, 3, 2, 1, 0], [0, 4, 8])
    packing = gd.Packing(flat, np.full((1, 3), 0.5), [[1, 0, 0, 0]], [2650.0], gd.Domain.cube(1.0))
    with pytest.raises(InputError, match="grains must have volumes above zero"):
        gd.heal(packing)
