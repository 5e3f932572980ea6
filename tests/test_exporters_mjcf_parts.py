"""MJCF as a part of another model: included, attached, beside a robot whose own numbers stay what they are."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import exporters
from exporters import mjcf
from exporters.mjcf import MjcfOptions
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes

ROBOT = """<mujoco model="cell">
  <compiler angle="degree"/>
  <option timestep="0.002"/>
  <default><default class="wheel"><geom type="cylinder" size="0.1 0.05"/></default></default>
  <asset><material name="wall" rgba="1 0 0 1"/></asset>{}
  <worldbody>
    <geom name="floor" type="plane" size="9 9 1" pos="0 0 -50"/>
    <body name="arm" pos="40 0 0"><joint name="elbow" type="hinge" range="-90 45" limited="true"/>
      <geom name="hand" type="box" size="1 1 1" mass="1"/><geom name="rim" class="wheel" mass="1"/></body>
  </worldbody>
</mujoco>"""
"""A model of somebody else, with names of its own that ours would like to have."""

OF_GEOMS = ("geom_solref", "geom_solimp", "geom_solmix", "geom_friction", "geom_condim", "geom_priority", "geom_margin")


def compiled(path):
    import mujoco

    return mujoco.MjModel.from_xml_path(str(path))


def numbers_of(model):
    """Return what contacts of the robot's shapes are like, and its joint's range."""
    shapes = [model.geom(name).id for name in ("floor", "hand", "rim")]
    return [getattr(model, field)[shapes].tolist() for field in OF_GEOMS] + [model.joint("elbow").range.tolist()]


@pytest.mark.client
@pytest.mark.parametrize("parts", [("grains",), ("walls", "grains"), ("grains", "walls")])
def test_files_of_grains_and_walls_stand_alone_and_leave_the_including_model_alone(fresh, tmp_path, parts):
    exporters.write(fresh, tmp_path / "bed.xml", split=True, prefix="bed_")
    include = "".join(f'<include file="bed.{part}.xml"/>' for part in parts)
    (tmp_path / "cell.xml").write_text(ROBOT.format(include))
    (tmp_path / "bare.xml").write_text(ROBOT.format(""))
    model, bare = compiled(tmp_path / "cell.xml"), compiled(tmp_path / "bare.xml")
    assert numbers_of(model) == numbers_of(bare)
    assert (model.opt.timestep, model.opt.cone, model.opt.impratio) == (0.002, bare.opt.cone, bare.opt.impratio)
    assert (model.stat.extent, model.vis.global_.fovy) != (0, 0)
    assert model.vis.global_.fovy == bare.vis.global_.fovy
    ours = compiled(exporters.write(fresh, tmp_path / "whole.xml")[0])
    for name in (f"g{i:06d}" for i in range(len(fresh))):
        assert model.body(f"bed_{name}").mass == ours.body(name).mass
        for field in ("solref", "solimp", "friction", "condim"):
            assert np.array_equal(getattr(model.geom(f"bed_{name}"), field), getattr(ours.geom(name), field))
    has_walls = "walls" in parts
    assert model.ngeom == bare.ngeom + len(fresh) + 5 * has_walls
    if has_walls:
        assert np.array_equal(model.geom("bed_floor").solref, ours.geom("floor").solref)


@pytest.mark.unit
@pytest.mark.parametrize("options", [{}, {"colour": "id"}, {"shapes": "spheres"}, {"keyframe": "as made"}])
def test_every_name_and_every_use_of_one_begins_with_the_prefix(fresh, options):
    text = mjcf.text(fresh, MjcfOptions(prefix="a/b-", **options))
    text = re.sub(r"<mujoco model.*?>|<numeric.*?/>|<!--.*?-->", "", text, flags=re.DOTALL)
    names = re.findall(r' (?:name|class|childclass|mesh|material)="([^"]*)"', text)
    assert len(names) > 3 * len(fresh)
    assert {name[:4] for name in names} == {"a/b-"}
    assert text.count("<default>") == 1
    assert re.search(r"<default>\s*<default class=", text)  # nothing in it without a name


@pytest.mark.client
def test_a_file_with_a_prefix_is_read_back_as_the_same_bed(fresh, tmp_path):
    [path] = exporters.write(fresh, tmp_path / "bed.xml", prefix="bed_")
    packing = exporters.read(path)
    assert np.allclose(volumes(packing.grains), volumes(fresh.grains), rtol=1e-5)
    assert np.allclose(packing.positions, fresh.positions, atol=1e-6 * mjcf.units(fresh).length)
    assert np.allclose(packing.domain.upper, fresh.domain.upper, rtol=1e-9)


@pytest.mark.unit
@pytest.mark.parametrize("prefix", ["my bed", " ", "1st", 'a"', "é", "<", "a\n"])
def test_a_prefix_that_no_name_can_begin_with_is_refused(fresh, prefix):
    with pytest.raises(InputError, match=r"prefix must begin with a letter or _ and hold .*; got"):
        mjcf.text(fresh, MjcfOptions(prefix=prefix))


@pytest.mark.client
@pytest.mark.opens("mjcf", "MuJoCo", "part of another scene")
def test_an_attached_bed_has_our_contacts_and_with_our_options_our_settings(fresh, tmp_path, capfd):
    import mujoco

    [path] = exporters.write(fresh, tmp_path / "bed.xml", units=1e-2)
    bed = mujoco.MjSpec.from_file(str(path))
    cell = mujoco.MjSpec.from_string(ROBOT.format(""))
    before = numbers_of(cell.compile())
    for name, value in mjcf.options_for(fresh, MjcfOptions(units=1e-2)).items():
        setattr(cell.option, name, value)
    cell.memory = bed.memory
    cell.attach(bed, prefix="bed_", frame=cell.worldbody.add_frame(pos=[5, 0, 0]))
    model, ours = cell.compile(), compiled(path)
    assert capfd.readouterr().err == ""  # else MuJoCo tells of every setting that does not go along
    assert numbers_of(model) == before
    for field in ("timestep", "cone", "impratio", "solver", "iterations", "noslip_iterations", "integrator"):
        assert getattr(model.opt, field) == getattr(ours.opt, field)
    assert np.array_equal(model.opt.gravity, ours.opt.gravity)
    assert model.opt.disableflags == ours.opt.disableflags
    for i in range(len(fresh)):
        theirs, mine = model.geom(f"bed_g{i:06d}"), ours.geom(f"g{i:06d}")
        assert np.array_equal(theirs.solref, mine.solref)
        assert np.array_equal(theirs.solimp, mine.solimp)
    assert np.allclose(model.body("bed_g000003").pos, ours.body("g000003").pos + np.array([5, 0, 0]))


@pytest.mark.unit
def test_the_options_follow_the_packing_and_its_units(fresh):
    import mujoco

    grain = mjcf.options_for(fresh)
    assert (grain["timestep"], grain["solver"]) == (0.01, mujoco.mjtSolver.mjSOL_PGS)
    assert np.array_equal(grain["gravity"], (0, 0, -1))
    si = mjcf.options_for(fresh, MjcfOptions(units="mm", gravity=1.62, solver="CG"))
    assert si["timestep"] == pytest.approx(0.01 * np.sqrt(mjcf.units(fresh).length / 1.62), rel=1e-6)
    assert np.allclose(si["gravity"], (0, 0, -1620))
    assert (si["solver"], si["cone"]) == (mujoco.mjtSolver.mjSOL_CG, mujoco.mjtCone.mjCONE_ELLIPTIC)


@pytest.mark.unit
def test_without_walls_there_is_no_file_of_walls(fresh, tmp_path):
    paths = exporters.write(fresh, tmp_path / "bed.xml", split=True, walls="none")
    assert [path.name for path in paths] == ["bed.xml", "bed.grains.xml"]
    assert compiled(paths[0]).ngeom == len(fresh)


@pytest.mark.unit
def test_a_state_that_blows_up_is_kept_unless_told(fresh):
    import mujoco

    flag = mujoco.mjtDisableBit.mjDSBL_AUTORESET
    assert mjcf.options_for(fresh)["disableflags"] & flag
    assert not mjcf.options_for(fresh, MjcfOptions(autoreset=True))["disableflags"] & flag


@pytest.mark.slow
@pytest.mark.client
@pytest.mark.opens("mjcf", "MuJoCo", "part of another scene")
def test_the_scoop_of_a_robot_in_si_bears_what_is_in_it():
    import mujoco

    arm = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "arm.py"))
    model = arm["scene_with"](arm["make_bed"](50))
    data = mujoco.MjData(model)
    force = arm["follow"](model, data)
    grains = [b for b in range(model.nbody) if model.body(b).name.startswith("gravel_g")]
    lifted = [b for b in grains if data.xpos[b, 2] > 0.06]
    assert len(grains) == 50
    assert len(lifted) > 2
    assert not np.any(data.warning.number)
    assert force / 9.81 - arm["SCOOP"] == pytest.approx(model.body_mass[lifted].sum(), rel=0.01)
