"""MJCF: compiled and stepped by MuJoCo."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import exporters
from exporters import mjcf
from exporters.check import shapes_of
from exporters.mjcf import MjcfOptions
from grainsdem.errors import FileFormatError, InputError
from grainsdem.geometry.integrals import integrate, volumes
from grainsdem.geometry.rotations import random_quaternions, to_matrices, world_vertices
from grainsdem.geometry.triangles import triangles
from grainsdem.model import Domain
from grainsdem.packing import rescale
from grainsdem.validation import compare


def compiled(text):
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def grain_geoms(model):
    import mujoco

    return np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)


@pytest.fixture(scope="module")
def tilted(fresh):
    """The fresh grains, each turned in place: poses that are not the identity."""
    return replace(fresh, quaternions=random_quaternions(len(fresh), np.random.default_rng(3)), links=None)


@pytest.fixture(scope="module")
def model_of_tilted(tilted):
    return compiled(mjcf.text(tilted))


@pytest.mark.client
def test_a_fresh_packing_starts_without_a_contact_deeper_than_a_millionth_of_a_diameter(fresh):
    _, data = compiled(mjcf.text(fresh))
    assert data.ncon == 0 or data.contact.dist.min() > -1e-6


@pytest.mark.client
@pytest.mark.parametrize("diameter", [0.2e-3, 1e-3, 0.1])
@pytest.mark.opens("mjcf", "MuJoCo", "counted", "stepped")
def test_mujoco_steps_the_file_without_a_warning_at_any_grain_size(poured, diameter):
    import mujoco

    scaled = rescale(poured, diameter / mjcf.units(poured).length)
    assert mjcf.units(scaled).length == pytest.approx(diameter, rel=1e-12)
    model, data = compiled(mjcf.text(scaled))
    assert data.ncon == 0
    height = data.xpos[2:, 2].mean()
    for _ in range(100):  # one unit of time: the lowest grains have landed
        mujoco.mj_step(model, data)
    assert not np.any(data.warning.number)
    assert data.time == pytest.approx(1.0)
    assert data.xpos[2:, 2].mean() < height - 0.01
    assert data.ncon > 0
    assert data.contact.dist.min() > -1e-2


@pytest.fixture(scope="module")
def heap(poured):
    """The first thirty of the poured grains."""
    return replace(
        poured,
        grains=shapes_of(poured.grains, 0, 30),
        positions=poured.positions[:30],
        quaternions=poured.quaternions[:30],
        densities=poured.densities[:30],
    )


def stepped(python, path, n_steps=2000):
    """Return what a MuJoCo of another Python says of a file."""
    command = [python, str(Path(__file__).with_name("mujoco_client.py")), str(path), str(n_steps)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=path.parent)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


OLD = [pytest.mark.programs, pytest.mark.opens("mjcf", "MuJoCo 3.17", "counted", "weighed", "stepped")]


@pytest.fixture(params=[pytest.param("3.17", marks=OLD), "installed"])
def mujoco_python(request):
    """The Python of each MuJoCo that files are for."""
    return request.getfixturevalue("newton") if request.param == "3.17" else sys.executable


@pytest.mark.client
@pytest.mark.parametrize(
    "diameter", [pytest.param(0.2e-3, marks=pytest.mark.slow), 1e-3, pytest.param(0.1, marks=pytest.mark.slow)]
)
def test_two_thousand_steps_end_without_a_warning_in_old_and_new_mujoco(heap, tmp_path, mujoco_python, diameter):
    scaled = rescale(heap, diameter / mjcf.units(heap).length)
    [path] = exporters.write(scaled, tmp_path / "bed.xml")
    found = stepped(mujoco_python, path)
    units = mjcf.units(scaled)
    assert found["version"].startswith("3.17" if mujoco_python != sys.executable else "")
    assert found["grains"] == len(heap)
    assert found["mass"] * units.mass == pytest.approx(scaled.densities @ volumes(scaled.grains), rel=1e-6)
    assert found["start"] == {"contacts": 0, "deepest": 0.0}
    assert found["warnings"] == []
    assert found["time"] == pytest.approx(20.0)
    assert found["finite"]
    assert found["fallen"] > 1.0
    assert found["lowest"] > 0.2
    assert found["deepest"] > -1e-2


@pytest.mark.client
@pytest.mark.parametrize("units", ["si", "mm", 0.05])
def test_other_units_fall_as_fast_and_are_read_back_as_the_same_bed(heap, tmp_path, mujoco_python, units):
    [path] = exporters.write(heap, tmp_path / "bed.xml", units=units)
    length = {"si": 1.0, "mm": 1e-3}.get(units, units)
    found = stepped(mujoco_python, path, 60)
    assert found["warnings"] == []
    assert found["mass"] == pytest.approx(heap.densities @ volumes(heap.grains), rel=1e-6)
    assert found["deepest"] == 0.0
    # In the air still: so they fell by half g t².
    assert found["fallen"] * length == pytest.approx(0.5 * 9.81 * found["time"] ** 2, rel=0.02)
    packing = exporters.read(path)
    assert all(check.ok for check in compare(packing, heap, tolerance=1e-5))
    np.testing.assert_allclose(packing.domain.upper, heap.domain.upper, rtol=1e-9)
    np.testing.assert_allclose(packing.densities, heap.densities, rtol=1e-5)
    assert mjcf.factors(heap, MjcfOptions(units=units)) == {"length": length, "mass": 1.0, "time": 1.0}


@pytest.mark.client
def test_grains_in_a_file_of_their_own_and_compiled_are_the_same_model(heap, tmp_path, mujoco_python):
    import mujoco

    paths = exporters.write(heap, tmp_path / "bed.xml", split=True, compiled=True)
    assert [path.name for path in paths] == ["bed.xml", "bed.grains.xml", "bed.walls.xml", "bed.mjb"]
    assert 'mesh="g000003"' not in paths[0].read_text()
    whole = stepped(mujoco_python, exporters.write(heap, tmp_path / "whole.xml")[0], 200)
    assert stepped(mujoco_python, paths[0], 200) == whole
    if mujoco_python == sys.executable:
        assert stepped(mujoco_python, paths[3], 200) == whole
        assert whole["version"] == mujoco.__version__
    assert exporters.files(heap, ".xml", split=True, compiled=True)["bed.mjb"] == paths[3].read_bytes()


@pytest.mark.client
def test_spheres_have_the_volume_the_mass_and_the_inertia_of_spheres(heap, tmp_path, mujoco_python):
    [path] = exporters.write(heap, tmp_path / "bed.xml", shapes="spheres", walls="floor")
    found = stepped(mujoco_python, path)
    assert (found["warnings"], found["grains"]) == ([], len(heap))
    with pytest.raises(FileFormatError, match="its grains are spheres, which no packing holds"):
        exporters.read(path)
    model, _ = compiled(path.read_text())
    units, sizes = mjcf.units(heap), volumes(heap.grains)
    for i in range(len(heap)):
        radius = model.geom(f"g{i:06d}").size[0]
        assert 4 / 3 * np.pi * radius**3 * units.length**3 == pytest.approx(sizes[i], rel=1e-6)
        mass = model.body(f"g{i:06d}").mass[0]
        assert np.allclose(model.body(f"g{i:06d}").inertia, 0.4 * mass * radius**2, rtol=1e-6)


@pytest.mark.client
def test_discs_of_a_planar_bed_have_the_area_of_its_prisms(cube):
    slab = replace(cube, domain=Domain.slab((4.0, 4.0), 2.0), positions=np.array([[2.0, 2.0, 1.0]]))
    model, _ = compiled(mjcf.text(slab, MjcfOptions(shapes="spheres")))
    radius = model.geom("g000000").size[0] * mjcf.units(slab).length
    assert np.pi * radius**2 == pytest.approx(4.0, rel=1e-6)


@pytest.mark.client
@pytest.mark.parametrize("colour", ["id", "diameter", "array"])
def test_colours_go_from_dark_blue_to_yellow_along_what_was_asked_for(fresh, colour):
    numbers = np.linspace(5.0, -5.0, len(fresh))
    options = MjcfOptions(colour=numbers if colour == "array" else colour)
    model, _ = compiled(mjcf.text(fresh, options))
    colours = np.array([model.geom(f"g{i:06d}").rgba[:3] for i in range(len(fresh))])
    sizes = volumes(fresh.grains)
    first, last = {"id": (0, -1), "diameter": (sizes.argmin(), sizes.argmax()), "array": (-1, 0)}[colour]
    assert np.allclose(colours[[first, last]], [(0.267, 0.005, 0.329), (0.993, 0.906, 0.144)], atol=1e-3)


@pytest.mark.client
def test_the_file_begins_in_a_state_by_name_and_has_a_camera_and_a_light(fresh):
    import mujoco

    model, data = compiled(mjcf.text(fresh, MjcfOptions(keyframe="as <made>")))
    before = data.qpos.copy()
    mujoco.mj_step(model, data)
    assert not np.array_equal(data.qpos, before)
    mujoco.mj_resetDataKeyframe(model, data, model.key("as <made>").id)
    assert np.array_equal(data.qpos, before)
    assert (model.ncam, model.nlight) == (1, 1)
    assert model.cam("view").id == model.light("sun").id == 0
    assert compiled(mjcf.text(fresh, MjcfOptions(keyframe="")))[0].nkey == 0


@pytest.mark.unit
def test_where_one_stretch_of_grains_ends_makes_no_difference_to_the_text(fresh, monkeypatch):
    from exporters import check

    whole = mjcf.text(fresh)
    monkeypatch.setattr(check, "STRETCH", 7)
    assert mjcf.text(fresh) == whole


@pytest.mark.unit
def test_grains_too_small_for_si_are_refused_with_the_way_out(fresh):
    small = rescale(fresh, 0.2e-3 / mjcf.units(fresh).length)
    with pytest.raises(InputError, match=r"so small in units of si that .* not with units='grain'; not so: 0, 1"):
        mjcf.text(small, MjcfOptions(units="si"))


@pytest.mark.client
def test_the_same_bed_in_another_size_is_the_same_numbers(fresh):
    def without_si(packing):
        return re.sub(r"<!--.*?-->|<numeric .*?/>", "", mjcf.text(packing), flags=re.DOTALL)

    half = rescale(fresh, 0.5)  # a power of two changes no digit
    assert without_si(half) == without_si(fresh)
    assert mjcf.text(half) != mjcf.text(fresh)


@pytest.mark.client
def test_world_vertices_in_mujoco_are_ours_although_its_compiler_recentres_meshes(tilted, model_of_tilted):
    model, data = model_of_tilted
    length = mjcf.units(tilted).length
    ours = world_vertices(tilted) / length
    offsets = tilted.grains.vertex_offsets
    geoms = grain_geoms(model)
    assert geoms.size == len(tilted)
    for i, geom in enumerate(geoms):
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        vertices = model.mesh_vert[first : first + count].astype(float)
        theirs = vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        mine = ours[offsets[i] : offsets[i + 1]]
        nearest = np.linalg.norm(mine[:, None] - theirs[None], axis=2)
        assert nearest.min(axis=1).max() < 1e-6
        assert nearest.min(axis=0).max() < 1e-6


@pytest.mark.client
@pytest.mark.opens("mjcf", "MuJoCo", "weighed")
def test_mass_centre_and_inertia_agree_among_geometry_trimesh_and_mujoco(tilted, model_of_tilted):
    model, data = model_of_tilted
    units = mjcf.units(tilted)
    exact = integrate(tilted.grains)
    cut = triangles(tilted.grains)
    turns = to_matrices(tilted.quaternions)
    for i in range(len(tilted)):
        body = model.body(f"g{i:06d}")
        faces = cut.indices[cut.offsets[i] : cut.offsets[i + 1]]
        mesh = trimesh.Trimesh(tilted.grains.vertices_of(i), faces, process=False)
        mesh.density = tilted.densities[i]
        assert body.mass[0] * units.mass == pytest.approx(mesh.mass, rel=1e-6)
        assert body.mass[0] * units.mass == pytest.approx(exact.volumes[i] * tilted.densities[i], rel=1e-6)
        assert np.abs(mesh.center_mass).max() < 1e-6 * units.length
        centre = data.xipos[body.id] * units.length
        assert np.abs(centre - tilted.positions[i]).max() < 1e-6 * units.length
        axes = data.ximat[body.id].reshape(3, 3)
        theirs = axes @ np.diag(body.inertia) @ axes.T * units.inertia
        in_world = turns[i] @ mesh.moment_inertia @ turns[i].T
        ours = turns[i] @ exact.inertias[i] @ turns[i].T * tilted.densities[i]
        scale = np.abs(in_world).max()
        assert np.abs(theirs - in_world).max() < 1e-6 * scale
        assert np.abs(ours - in_world).max() < 1e-6 * scale


@pytest.mark.client
def test_floor_and_walls_stand_on_the_faces_of_the_domain_and_look_inward(fresh):
    model, data = compiled(mjcf.text(fresh))
    length = mjcf.units(fresh).length
    lower, upper = fresh.domain.lower / length, fresh.domain.upper / length
    upper[2] = world_vertices(fresh)[:, 2].max() / length  # walls are drawn as high as the grains
    wanted = {
        "floor": ([0, 0, 1], lower), "wall_x0": ([1, 0, 0], lower), "wall_x1": ([-1, 0, 0], upper),
        "wall_y0": ([0, 1, 0], lower), "wall_y1": ([0, -1, 0], upper),
    }  # fmt: skip
    for name, (normal, corner) in wanted.items():
        geom = data.geom(name)
        assert np.allclose(geom.xmat.reshape(3, 3)[:, 2], normal, atol=1e-12)
        assert np.dot(normal, geom.xpos) == pytest.approx(np.dot(normal, corner), abs=1e-6)
        sides = np.abs(geom.xmat.reshape(3, 3)[:, :2] @ model.geom(name).size[:2])
        flat = np.abs(normal) == 0
        assert np.allclose(sides[flat], (upper - lower)[flat] / 2, atol=1e-6)
    assert model.geom_bodyid[model.geom("floor").id] < model.body("g000000").id


@pytest.mark.client
def test_walls_of_a_periodic_axis_stand_clear_of_the_grains_that_reach_over_it(fresh):
    lower, upper = world_vertices(fresh).min(axis=0), world_vertices(fresh).max(axis=0)
    tight = Domain(lower + 0.1e-3, upper - 0.1e-3, np.array([True, True, True]))
    _, data = compiled(mjcf.text(replace(fresh, domain=tight, links=None)))
    assert data.ncon == 0 or data.contact.dist.min() > -1e-6
    _, data = compiled(mjcf.text(replace(fresh, domain=Domain(tight.lower, tight.upper), links=None)))
    assert data.contact.dist.min() == pytest.approx(-0.1e-3 / mjcf.units(fresh).length, abs=1e-6)


@pytest.mark.client
def test_the_settings_follow_the_options(fresh):
    import mujoco

    model, _ = compiled(mjcf.text(fresh))
    assert (model.opt.solver, model.opt.iterations) == (mujoco.mjtSolver.mjSOL_PGS, 30)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET
    assert not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_MULTICCD
    grains = grain_geoms(model)
    assert np.allclose(model.geom_solref, [0.02, 1.0])
    assert np.allclose(model.geom_solimp[:, 2], 1e-3)
    assert np.allclose(model.geom_friction[:, 0], 0.5)
    options = MjcfOptions(friction=0.4, wall_friction=0.1, solver="CG", time_step=0.005, noslip_iterations=5)
    model, _ = compiled(mjcf.text(fresh, options))
    assert (model.opt.solver, model.opt.iterations) == (mujoco.mjtSolver.mjSOL_CG, 100)
    assert (model.opt.timestep, model.opt.noslip_iterations) == (0.005, 5)
    assert np.allclose(model.geom_solref, [0.01, 1.0])
    assert np.allclose(model.geom_friction[grains, 0], 0.4)
    assert model.geom("floor").friction[0] == 0.1
    assert model.geom("floor").priority[0] > model.geom("g000000").priority[0]


@pytest.mark.client
def test_a_smooth_wall_stays_smooth_beside_rough_grains(cube):
    import mujoco

    lifted = replace(cube, positions=np.array([[2.0, 2.0, 1.0 - 1e-6]]))
    for wall, condim in ((0.0, 1), (0.3, 3)):
        text = mjcf.text(lifted, MjcfOptions(friction=0.6, wall_friction=wall, gravity=9.81))
        model, data = compiled(text)
        mujoco.mj_step(model, data)
        assert data.ncon > 0
        assert set(data.contact.dim) == {condim}
        assert np.allclose(data.contact.friction[:, 0], max(wall, 1e-5))


@pytest.mark.client
@pytest.mark.parametrize(("walls", "n_planes"), [("box", 5), ("floor", 1), ("none", 0)])
def test_the_container_is_what_was_asked_for(fresh, walls, n_planes):
    import mujoco

    model, _ = compiled(mjcf.text(fresh, MjcfOptions(walls=walls)))
    assert np.count_nonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) == n_planes
    assert model.nq == 7 * len(fresh)


@pytest.mark.client
def test_a_planar_bed_loads_and_moves_in_its_plane_only(cube):
    import mujoco

    slab = replace(cube, domain=Domain.slab((4.0, 4.0), 4.0))
    model, data = compiled(mjcf.text(slab))
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert model.nv == 3
    velocity = data.cvel[model.body("g000000").id]
    assert velocity[4] < -0.1  # it falls along y
    assert np.allclose(velocity[[0, 1, 3, 5]], 0.0, atol=1e-9)


@pytest.mark.client
def test_the_factors_in_the_file_are_the_units_of_the_packing(fresh):
    model, _ = compiled(mjcf.text(fresh, MjcfOptions(gravity=1.62)))
    units = mjcf.units(fresh, gravity=1.62)
    for name in ("length", "mass", "time"):
        assert model.numeric(f"grain_unit_{name}").data[0] == pytest.approx(getattr(units, name), rel=1e-15)
    assert units.acceleration == pytest.approx(1.62)
    assert units.density == pytest.approx(2650.0)
    diameters = np.sort(np.cbrt(6 * integrate(fresh.grains).volumes / np.pi))
    assert units.length == pytest.approx(np.median(diameters))
    assert units.energy == pytest.approx(units.mass * 1.62 * units.length)
    assert units.stress == pytest.approx(units.force / units.length**2)


@pytest.mark.unit
def test_numbers_keep_a_billionth_of_a_diameter_far_from_the_origin(cube):
    far = replace(cube, positions=np.array([[12345.678901234, 2.0, 2.0]]))
    length = mjcf.units(far).length
    x = float(re.search(r'name="g000000" pos="(\S+)', mjcf.text(far))[1])
    assert abs(x * length - 12345.678901234) < 1e-9 * length * 2


@pytest.mark.golden
def test_the_text_of_one_cube_is_known_and_compiles(cube):
    text = mjcf.text(cube, name="a <cube> & more")
    model, _ = compiled(text)
    assert model.nbody == 3
    edge = (np.pi / 6) ** (1 / 3)  # of a cube as large as the sphere of diameter one
    v = f"{edge / 2:.9g}"
    assert f'vertex="-{v} -{v} -{v} {v} -{v} -{v} -{v} {v} -{v}' in text
    assert 'face="0 2 3 0 3 1 4 5 7 4 7 6 0 1 5 0 5 4 2 6 7 2 7 3 0 4 6 0 6 2 1 3 7 1 7 5"' in text
    mass = np.pi / 6
    moment = f"{mass * edge**2 / 6:.9g}"
    assert f'<inertial pos="0 0 0" quat="1 0 0 0" mass="{mass:.9g}" diaginertia="{moment} {moment} {moment}"/>' in text
    assert f'pos="{2 * v_pos(edge)} {2 * v_pos(edge)} {2 * v_pos(edge)}" quat="1 0 0 0"' in text
    assert "a &lt;cube&gt; &amp; more" in text
    assert mjcf.text(cube, name="a <cube> & more") == text


def v_pos(edge):
    """Return half the position of the cube's centre in units: its centre lies one edge from the corner."""
    return float(f"{edge:.9f}") / 2


@pytest.mark.unit
def test_files_and_write_take_the_options_as_plain_words(fresh, tmp_path):
    text = mjcf.text(fresh, MjcfOptions(friction=0.25), name="bed")
    assert exporters.files(fresh, ".xml", friction=0.25) == {"bed.xml": text.encode()}
    assert exporters.write(fresh, tmp_path / "bed.xml", friction=0.25) == [tmp_path / "bed.xml"]
    assert (tmp_path / "bed.xml").read_text() == text


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"friction": -0.1}, "friction must be zero or more and finite; got -0.1"),
        ({"wall_friction": float("nan")}, "wall_friction must be zero or more"),
        ({"time_step": 0.0}, "time_step must be positive and finite; got 0.0"),
        ({"gravity": float("inf")}, "gravity must be positive"),
        ({"solver": "SOR"}, "solver must be one of PGS, CG, Newton; got 'SOR'"),
        ({"walls": "lid"}, "walls must be one of box, floor, none; got 'lid'"),
        ({"iterations": 0}, "iterations must be positive"),
        ({"units": "inch"}, "units must be si, mm, grain or a length in metres; got 'inch'"),
        ({"units": -1.0}, "units must be positive and finite; got -1.0"),
        ({"colour": "red"}, "colour must be one of mineral, id, diameter, class, or numbers; got 'red'"),
        ({"shapes": "cubes"}, "shapes must be one of hulls, spheres; got 'cubes'"),
        ({"keyframe": "a\nb"}, "keyframe must be a name that can be printed"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(InputError, match=re.escape(message)):
        MjcfOptions(**options)


@pytest.mark.unit
def test_grains_that_mujoco_would_take_for_massless_are_named(fresh):
    scale = np.ones(len(fresh.grains.vertices))
    scale[: fresh.grains.vertex_offsets[1]] = 1e-3
    grains = replace(fresh.grains, vertices=fresh.grains.vertices * scale[:, None])
    with pytest.raises(InputError, match=r"so small beside the median .*; not so: 0$"):
        mjcf.text(replace(fresh, grains=grains))
