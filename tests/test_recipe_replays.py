from __future__ import annotations

import numpy as np
import pytest

from grainsdem import recipe as recipes
from grainsdem.errors import InputError
from grainsdem.storage import load, load_history


def move(folder, replays):
    """Return what a recipe made of a small bed that falls a little and is tapped once, with replays of some kinds."""
    recipe = recipes.make(
        domain={"lengths": [2.5, 2.5, 2.5]},
        seeds={"process": "poisson", "count": 15, "relax": 2},
        grains={"keep": "all", "porosity": 0.4, "median_diameter": 1e-3},
        settle={"max_time": 4.0, "overlap": 0.5},
        tap={"taps": 1, "start": "place"},
        output={"formats": [], "figures": False, "replays": replays},
    )
    return recipes.run(recipe, folder)


@pytest.fixture(scope="module")
def made(tmp_path_factory, shake):
    folder = tmp_path_factory.mktemp("made")
    return move(folder, ["usdc"]), folder


@pytest.mark.slow  # a hundred pictures each
@pytest.mark.client
def test_motions_become_animations(tmp_path):
    from PIL import Image

    result = move(tmp_path, ["gif"])
    for name in ("settling", "tap_replay"):
        assert tmp_path / f"{name}.gif" in result.files
        with Image.open(tmp_path / f"{name}.gif") as picture:
            assert picture.n_frames > 3


@pytest.mark.slow
@pytest.mark.client
@pytest.mark.parametrize(
    ("name", "history", "end"), [("settling", "history", "settled"), ("tap_replay", "tap_history", "tap")]
)
def test_motions_become_layers_of_usd(made, name, history, end):
    from pxr import Usd, UsdGeom

    result, folder = made
    assert {folder / f"{name}.usdc", folder / f"{name}.replay.usdc"} <= set(result.files)
    frames, packing = load_history(folder / f"{history}.h5"), load(folder / f"{end}.h5")
    stage = Usd.Stage.Open(str(folder / f"{name}.replay.usdc"))
    last = stage.GetEndTimeCode()
    grain = next(prim for prim in stage.Traverse() if prim.GetName() == "g000003")
    to_world = UsdGeom.Xformable(grain).ComputeLocalToWorldTransform(last)
    metres = UsdGeom.GetStageMetersPerUnit(stage)
    np.testing.assert_allclose(np.array(to_world.ExtractTranslation()) * metres, frames["positions"][-1, 3], atol=1e-8)
    np.testing.assert_allclose(packing.positions, frames["positions"][-1], atol=1e-12)


@pytest.mark.unit
def test_replays_of_unknown_kind_are_refused():
    with pytest.raises(InputError, match="replays"):
        recipes.make(seeds={"count": 10}, grains={"porosity": 0.4}, output={"replays": ["mpg"]})
