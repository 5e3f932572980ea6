from __future__ import annotations

import json

import numpy as np
import pytest

from grainsdem import recipe as recipes
from grainsdem.errors import InputError
from grainsdem.measures import porosity
from grainsdem.storage import load

pytestmark = pytest.mark.unit

SMALL = {
    "rng": 4,
    "domain": {"lengths": [6, 6, 7], "periodic": "xyz"},
    "seeds": {"process": "poisson", "count": 120, "relax": 2},
    "grains": {"porosity": 0.4, "median_diameter": 0.72e-3},
    "output": {"formats": [], "figures": False},
}


def test_a_recipe_writes_voxels_a_section_and_a_planform_of_its_bed(tmp_path):
    views = {
        "voxels": {"per_diameter": 6, "formats": ["npy", "vti"]},
        "section": {"axis": "y", "at": 0.25, "levels": 4},
        "planform": {"per_diameter": 10, "light": [1, 0, 2], "blur": 0.5, "least_pixels": 3},
    }
    result = recipes.run(recipes.make(**SMALL, **views), tmp_path)
    bed = load(tmp_path / "bed.h5")
    names = {str(path.relative_to(tmp_path)) for path in result.files}
    assert {"voxels.npy", "voxels.vti", "section.csv", "section_levels.csv", "planform/truth.csv"} <= names
    assert not [name for name in names if name.startswith("section") and name.endswith("png")]
    told = json.loads((tmp_path / "summary.json").read_text())
    labels = np.load(tmp_path / "voxels.npy")
    assert told["voxels"]["porosity"] == pytest.approx(np.mean(labels == 0))
    assert told["voxels"]["porosity"] == pytest.approx(porosity(bed), abs=0.01)
    levels = np.genfromtxt(tmp_path / "section_levels.csv", delimiter=",", names=True)
    np.testing.assert_allclose(levels["y"], bed.domain.lengths[1] * (np.arange(4) + 0.5) / 4, rtol=1e-12)
    assert told["section"]["expected"]["area_fraction"] == pytest.approx(0.6)
    asked = json.loads((tmp_path / "planform" / "planform.json").read_text())["photograph"]
    assert (asked["light"], asked["blur"], asked["rng"]) == ([1, 0, 2], 0.5, 4)
    assert told["planform"]["d50_apparent_by_number"] < told["planform"]["d50_bed_by_number"]


def test_pictures_of_views_are_drawn_where_figures_are(tmp_path, monkeypatch):
    from grainsdem.recipe import chain

    monkeypatch.setattr(chain.figures, "render", lambda _, path: path)  # the one that takes seconds
    slab = {
        "domain": {"shape": "slab", "lengths": [1, 1, 0.1]},
        "seeds": {"process": "poisson", "count": 40},
        "grains": {"scale": 0.8, "keep": "all"},
        "output": {"formats": []},
    }
    recipes.run(recipes.make(**slab, section={}, planform={"formats": ["png"]}), tmp_path)
    for name in ("section.png", "planform.png", "planform/image.png"):
        assert (tmp_path / name).stat().st_size > 1000


def test_a_recipe_that_asks_for_no_view_is_told_as_before():
    dumped = recipes.make(**SMALL).model_dump()
    assert not {"voxels", "section", "planform"} & set(dumped)
    assert recipes.make(**SMALL, voxels={}).model_dump()["voxels"]["formats"] == ("vti",)


@pytest.mark.parametrize(
    ("tables", "match"),
    [
        ({"voxels": {"size": 1e-4, "per_diameter": 9}}, r"voxels: give size or per_diameter, not both"),
        ({"voxels": {"edge": 1e-4}}, r"voxels\.edge: unknown key; allowed are size, per_diameter, formats, phase"),
        ({"voxels": {"formats": ["bin"]}}, r"voxels\.formats"),
        ({"section": {"at": 2}}, r"section\.at: .*less than or equal to 1; got 2"),
        ({"section": {"axis": "w"}}, r"section\.axis"),
        ({"planform": {"light": [0, 0, -1]}}, r"planform\.light"),
        ({"planform": {"ambient": 2}}, r"planform\.ambient"),
        ({"planform": {"pixel": 1e-4, "per_diameter": 9}}, r"planform: give pixel or per_diameter"),
    ],
)
def test_odd_views_are_refused(tables, match):
    with pytest.raises(InputError, match=match):
        recipes.make(**SMALL, **tables)
