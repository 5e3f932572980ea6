"""The whole chain on a small bed, each file opened by the program that it is for."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from pxr import Usd, UsdPhysics

import grainsdem as gd
from grainsdem import recipe as recipes

pytestmark = pytest.mark.client

RECIPE = recipes.make(
    name="forty grains",
    rng=1,
    domain={"lengths": [5.3, 5.3, 5.3]},
    seeds={"process": "poisson", "count": 150, "relax": 2},
    grains={"porosity": 0.4, "median_diameter": 0.72e-3},
    settle={"friction": 0.5},
)


@pytest.fixture(scope="module")
def made(tmp_path_factory, shake):
    """What the recipe made, and where."""
    folder = tmp_path_factory.mktemp("chain")
    return recipes.run(RECIPE, folder), folder


def test_every_file_that_is_named_is_there(made):
    result, folder = made
    assert len(result.fresh) >= 40
    assert {path.name for path in result.files} == {path.name for path in folder.iterdir()}
    for name in (
        "bed.h5",
        "bed.xml",
        "bed.usda",
        "bed.stl",
        "settled.xml",
        "settled.png",
        "history.h5",
        "summary.json",
    ):
        assert (folder / name).stat().st_size > 0


@pytest.mark.parametrize("name", ["bed", "settled"])
def test_mujoco_steps_the_mjcf_without_a_warning(made, name):
    result, folder = made
    model = mujoco.MjModel.from_xml_path(str(folder / f"{name}.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.nbody - np.count_nonzero(model.body_dofnum == 0) == len(result.fresh)
    allowed = {"bed": 1e-6, "settled": 1e-3}[name]
    assert data.contact.dist.min(initial=0.0) > -allowed
    for _ in range(100):
        mujoco.mj_step(model, data)
    assert sum(int(w.number) for w in data.warning) == 0
    assert np.isfinite(data.qpos).all()


@pytest.mark.parametrize("name", ["bed", "settled"])
def test_pxr_reads_the_usd_with_the_same_total_mass(made, name):
    result, folder = made
    stage = Usd.Stage.Open(str(folder / f"{name}.usda"))
    bodies = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
    assert len(bodies) == len(result.fresh)
    mass = sum(UsdPhysics.MassAPI(prim).GetMassAttr().Get() for prim in bodies)
    assert mass == pytest.approx(result.summaries[name]["total_mass"], rel=1e-6)


@pytest.mark.parametrize("name", ["bed", "settled"])
def test_trimesh_reads_the_stl_as_closed_with_the_right_volume(made, name):
    result, folder = made
    mesh = trimesh.load(folder / f"{name}.stl")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(result.summaries[name]["solid_volume"], rel=1e-5)


def test_manifold3d_finds_no_overlap_in_the_fresh_bed_and_little_in_the_settled(made):
    result, folder = made
    assert gd.validate(gd.load(folder / "bed.h5"), method="manifold3d").ok
    assert gd.validate(gd.load(folder / "settled.h5"), overlap=1e-3, method="manifold3d").ok
    assert result.settled.report.overlap_max < 1e-3


def test_the_settled_bed_is_random_not_a_jigsaw(made):
    result, _ = made
    # Of 7 runs of it: 3.36 ± 0.12, 11 spreads above.
    assert result.summaries["settled"]["mean_coordination"] > 2


@pytest.mark.slow
def test_the_same_recipe_writes_the_same_bytes(made, tmp_path):
    _, folder = made
    recipes.run(RECIPE, tmp_path)
    for path in sorted(folder.iterdir()):
        if path.suffix in (".h5", ".xml", ".usda", ".stl") and path.name != "history.h5":
            assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name
