"""USD as a part of another stage, and a bed at rest in Newton, which stays there."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from beds import some

import exporters
from exporters import usd
from exporters.units import units
from exporters.usd import UsdOptions
from grainsdem.dynamics import settle
from grainsdem.errors import FileFormatError, InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import random_quaternions, world_vertices
from grainsdem.packing import rescale

STEPS = 1000


BEDS = {"sand": (0.2e-3, "grain"), "millimetre": (1e-3, "grain"), "cobble": (0.1, "si")}
"""Diameter [m] and units of the stage: in SI Newton gives grains below 4 mm another inertia."""


@pytest.fixture(scope="module")
def foreign(fresh, tmp_path_factory):
    """A stage of somebody else in centimetres, with y up and gravity of its own, that has our bed as a payload."""
    from pxr import Usd, UsdGeom, UsdPhysics

    folder = tmp_path_factory.mktemp("foreign")
    exporters.write(fresh, folder / "part.usdc", scene=False, walls="none", root="Gravel", units=0.01)
    stage = Usd.Stage.CreateNew(str(folder / "plant.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Plant").GetPrim())
    scene = UsdPhysics.Scene.Define(stage, "/Plant/physics")
    scene.CreateGravityDirectionAttr((0, -1, 0))
    scene.CreateGravityMagnitudeAttr(981.0)
    bed = UsdGeom.Xform.Define(stage, "/Plant/Silo/Bed")
    bed.AddTranslateOp().Set((100, 20, 0))
    bed.AddRotateXOp().Set(-90)
    bed.GetPrim().GetPayloads().AddPayload("./part.usdc")
    stage.Save()
    return folder / "plant.usda"


@pytest.mark.client
@pytest.mark.opens("usd", "OpenUSD", "part of another scene")
def test_in_a_stage_of_centimetres_with_y_up_places_and_masses_are_right_and_gravity_is_theirs(fresh, foreign):
    from pxr import Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.Open(str(foreign))
    scenes = [prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene)]
    assert [str(prim.GetPath()) for prim in scenes] == ["/Plant/physics"]
    grains = stage.GetPrimAtPath("/Plant/Silo/Bed/Grains").GetChildren()
    assert len(grains) == len(fresh)
    assert not stage.GetPrimAtPath("/Plant/Silo/Bed/Container")
    cache, ours = UsdGeom.XformCache(), world_vertices(fresh)
    for i, grain in enumerate(grains):
        assert UsdPhysics.MassAPI(grain).GetMassAttr().Get() == pytest.approx(
            fresh.densities[i] * volumes(fresh.grains)[i], rel=1e-6
        )
        points = np.array(grain.GetChild("shape").GetAttribute("points").Get(), dtype=float)
        pose = np.array(cache.GetLocalToWorldTransform(grain))
        first, last = fresh.grains.vertex_offsets[i : i + 2]
        x, y, z = 100 * ours[first:last].T
        wanted = np.column_stack([100 + x, 20 + z, -y])
        assert np.allclose(np.column_stack([points, np.ones(len(points))]) @ pose[:, :3], wanted, atol=1e-5)


@pytest.mark.client
def test_every_collider_has_its_material_itself_wherever_the_bed_is(foreign):
    from pxr import Usd, UsdPhysics, UsdShade

    stage = Usd.Stage.Open(str(foreign))
    for grain in stage.GetPrimAtPath("/Plant/Silo/Bed/Grains").GetChildren():
        binding = UsdShade.MaterialBindingAPI(grain.GetChild("shape")).GetDirectBinding("physics")
        assert str(binding.GetMaterialPath()) == "/Plant/Silo/Bed/Materials/Grain"
        assert UsdPhysics.MaterialAPI(binding.GetMaterial()).GetDynamicFrictionAttr().Get() == pytest.approx(0.5)


@pytest.mark.client
@pytest.mark.parametrize("options", [{}, {"scene": False}, {"root": "Bed_2"}, {"gravity": 0.0}])
def test_openusd_has_nothing_to_say_against_a_part(fresh, tmp_path, options):
    from pxr import Usd, UsdValidation

    [path] = exporters.write(fresh, tmp_path / "bed.usdc", **options)
    stage = Usd.Stage.Open(str(path))
    assert stage.GetDefaultPrim().GetName() == options.get("root", "World")
    assert Usd.ModelAPI(stage.GetDefaultPrim()).GetKind() == "component"
    assert bool(stage.GetDefaultPrim().GetChild("PhysicsScene")) == options.get("scene", True)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetErrorAsString() for error in errors] == []
    assert len(exporters.read(path)) == len(fresh)


@pytest.mark.client
def test_the_stage_says_the_step_that_its_contacts_are_made_for(fresh, tmp_path):
    from pxr import Usd

    for name, options in {"grain": {"units": "grain"}, "si": {}, "half": {"time_step": 0.005}}.items():
        [path] = exporters.write(fresh, tmp_path / f"{name}.usdc", **options)
        stage = Usd.Stage.Open(str(path))
        scene = stage.GetPrimAtPath("/World/PhysicsScene")
        step = options.get("time_step", 0.01) * np.sqrt(units(fresh).length / 9.81)
        rate = np.ceil(1 / step)
        assert scene.GetAttribute("newton:timeStepsPerSecond").Get() == rate
        assert scene.GetAttribute("physxScene:timeStepsPerSecond").Get() == rate
        assert scene.GetAttribute("mjc:option:timestep").Get() == pytest.approx(1 / rate)
        material = stage.GetPrimAtPath("/World/Materials/Wall")
        # A spring and a dashpot a unit of mass, damped critically, with a time of twice the step.
        stiffness, damping = (material.GetAttribute(f"newton:contact{name}").Get() for name in ("Stiffness", "Damping"))
        assert stiffness == pytest.approx(1 / (2 * step) ** 2, rel=1e-5)
        assert damping**2 == pytest.approx(4 * stiffness, rel=1e-5)
        assert material.GetAttribute("newton:rollingFriction").Get() == 0


@pytest.mark.unit
@pytest.mark.parametrize("root", ["", "my bed", "1st", "a/b", "é", "x\n"])
def test_a_root_that_is_no_identifier_is_refused(fresh, root):
    with pytest.raises(InputError, match="root must be a name of letters, digits and _, no digit first; got"):
        exporters.files(fresh, ".usdc", root=root)


@pytest.fixture(scope="module")
def settled(fresh):
    return settle(some(fresh, 60), friction=0.3, rng=1).packing


@pytest.fixture(scope="module")
def resting(settled, newton, tmp_path_factory):
    """The bed at rest in each size, and what became of it under each of Newton's solvers."""
    folder = tmp_path_factory.mktemp("resting")
    tasks, beds = [], {}
    for name, (diameter, words) in BEDS.items():
        beds[name] = rescale(settled, diameter / units(settled).length)
        [path] = exporters.write(beds[name], folder / f"{name}.usdc", units=words)
        tasks += [(str(path), solver, STEPS) for solver in ("mujoco", "xpbd")]
    script = Path(__file__).with_name("newton_rest.py")
    command = [newton, str(script), json.dumps(tasks), str(folder / "found.json")]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert run.returncode == 0, run.stderr
    found = json.loads((folder / "found.json").read_text())
    return {
        (Path(path).stem, solver): (beds[Path(path).stem], one)
        for (path, solver, _), one in zip(tasks, found, strict=True)
    }


@pytest.mark.slow
@pytest.mark.programs
@pytest.mark.client
@pytest.mark.parametrize(
    "solver",
    [
        pytest.param("mujoco", marks=pytest.mark.opens("usd", "Newton", "at rest")),
        pytest.param("xpbd", marks=pytest.mark.opens("usd", "Newton, XPBD", "weighed", "stepped", "at rest")),
    ],
)
@pytest.mark.parametrize("size", BEDS)
def test_a_bed_at_rest_stays_at_rest_in_newton(resting, size, solver):
    bed, found = resting[size, solver]
    diameter, words = BEDS[size]
    scales = usd.factors(bed, UsdOptions(units=words))
    d = diameter / scales["length"]
    assert found["step"] == pytest.approx(0.01 * np.sqrt(diameter / 9.81), rel=2e-2)
    assert found["gravity"] == pytest.approx(9.81 / scales["length"], rel=1e-5)
    assert found["frictions"] == pytest.approx([0.3])
    np.testing.assert_allclose(np.array(found["masses"]) * scales["mass"], bed.densities * volumes(bed.grains), 1e-5)
    # Ten units of time; without a stiffness of their own grains sank by a diameter.
    assert np.mean(found["moved"]) < 0.02 * d
    assert found["lowest"][1] > found["lowest"][0] - 0.01 * d


@pytest.mark.slow
@pytest.mark.programs
@pytest.mark.client
@pytest.mark.parametrize(("diameter", "words"), [(1e-3, "grain"), (0.1, "si")])
@pytest.mark.opens("usd", "PhysX", "counted", "stepped", "at rest")
def test_physx_opens_the_stage_and_a_bed_at_rest_stays_there(settled, physx, tmp_path, diameter, words):
    bed = rescale(settled, diameter / units(settled).length)
    [path] = exporters.write(bed, tmp_path / "bed.usdc", units=words)
    step = 0.01 * np.sqrt(diameter / 9.81)
    script = Path(__file__).with_name("physx_client.py")
    command = [physx, str(script), str(path), str(step), "200", str(tmp_path / "found.json")]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (tmp_path / "found.json").is_file(), run.stderr
    found = json.loads((tmp_path / "found.json").read_text())
    length = usd.factors(bed, UsdOptions(units=words))["length"]
    before, after = (np.array(found[key]) * length / diameter for key in ("before", "after"))
    # Rows are in an order of its own.
    ours = bed.positions / diameter
    assert np.abs(before[np.lexsort(before.round(5).T)] - ours[np.lexsort(ours.round(5).T)]).max() < 1e-4
    moved = np.linalg.norm(after - before, axis=1)
    assert moved.mean() < 0.01
    assert after[:, 2].min() > before[:, 2].min() - 0.02


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".usdc", ".usda"])
def test_assets_of_one_body_each_are_put_together_to_the_same_bed(fresh, tmp_path, suffix):
    from pxr import Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation

    bed = replace(fresh, quaternions=random_quaternions(len(fresh), np.random.default_rng(3)), links=None)
    paths = exporters.write(bed, tmp_path / f"bed{suffix}", per_grain=True)
    assert [path.relative_to(tmp_path).as_posix() for path in paths[:2]] == [f"bed{suffix}", "bed.grains/g000000.usdc"]
    assert len(paths) == 1 + len(bed)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    for path in (paths[0], paths[3]):
        errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
        assert [error.GetErrorAsString() for error in errors] == []
    one = Usd.Stage.Open(str(paths[3]))
    bodies = [prim for prim in one.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
    assert bodies == [one.GetDefaultPrim()]
    stage = Usd.Stage.Open(str(paths[0]))
    shape = stage.GetPrimAtPath("/World/Grains/g000002/shape")
    material = UsdShade.MaterialBindingAPI(shape).GetDirectBinding("physics").GetMaterialPath()
    assert str(material) == "/World/Grains/g000002/Grain"
    pose = UsdGeom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath("/World/Grains/g000002"))
    assert np.allclose(pose.ExtractTranslation(), bed.positions[2], rtol=0, atol=1e-12)
    alone, together = exporters.read(paths[0]), exporters.read(exporters.write(bed, tmp_path / "whole.usdc")[0])
    assert np.array_equal(alone.grains.vertices, together.grains.vertices)
    assert np.allclose(alone.positions, together.positions, rtol=1e-12)
    assert np.array_equal(alone.densities, together.densities)


@pytest.mark.unit
def test_assets_do_not_go_into_a_package(fresh, tmp_path):
    with pytest.raises(InputError, match=r"per_grain writes files beside the stage, which a .usdz cannot have: take"):
        exporters.write(fresh, tmp_path / "bed.usdz", per_grain=True)


@pytest.mark.unit
@pytest.mark.parametrize(("length", "what"), [(1e14, "moments of inertia"), (1e-28, "moments of inertia")])
def test_units_in_which_single_precision_holds_no_inertia_are_refused(fresh, length, what):
    words = rf"{what} must be 1.2e-38 to 3.4e\+38 in units of {length}, since USD has them in single precision"
    with pytest.raises(InputError, match=words):
        exporters.files(fresh, ".usdc", units=length)


@pytest.mark.client
def test_a_stage_that_says_no_length_is_not_guessed_at(fresh, tmp_path):
    [path] = exporters.write(fresh, tmp_path / "bed.usda")
    path.write_text(path.read_text().replace("    metersPerUnit = 1\n", ""))
    with pytest.raises(FileFormatError, match="says no metersPerUnit, which USD would take for centimetres: author it"):
        exporters.read(path)
