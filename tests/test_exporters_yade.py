"""Yade: the script is run as it stands, and then asked what it has built and where it went."""

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from beds import SIZES, check_golden, small_bed, two_grains, written
from conftest import cube_packing

import exporters
from exporters.dem.yade import YadeOptions, factors
from exporters.units import units
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import to_matrices, world_vertices
from grainsdem.model import Domain
from grainsdem.packing import carve, rescale, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

pytestmark = pytest.mark.client

# Runs in Yade, in the folders named on its last line: the scene as it is built, after one step, and after many.
ASK = """
import json, os
def state(n):
    return {
        "masses": [O.bodies[i].state.mass for i in range(n)],
        "inertias": [list(map(float, O.bodies[i].state.inertia)) for i in range(n)],
        "turns": [[float(x) for row in O.bodies[i].state.ori.toRotationMatrix() for x in row] for i in range(n)],
        "places": [list(map(float, O.bodies[i].state.pos)) for i in range(n)],
        "vertices": [[list(map(float, v)) for v in O.bodies[i].shape.v] for i in range(n)],
        "overlaps": [[c.id1, c.id2, c.geom.penetrationVolume] for c in O.interactions
                     if c.isReal and c.geom.equivalentPenetrationDepth > 0],
        "n_bodies": len(O.bodies), "time": O.time,
    }
told = []
for folder, steps in JOBS:
    os.chdir(folder)
    O.reset()
    exec(open("bed.py").read())
    n = len(bed["ids"])
    states = [state(n)]
    O.stopAtIter = 0
    for wanted in steps:
        O.run(wanted, True)
        states.append(state(n))
    told.append(states)
open(OUT, "w").write(json.dumps(told))
"""


@pytest.fixture
def yade(program, tmp_path):
    """A function that runs the scripts of some folders and returns, for each, its states after so many steps."""
    path = program("yade", "yade")

    def run(jobs):
        out = tmp_path / "told.json"
        script = tmp_path / "ask.py"
        script.write_text(f"JOBS = {[(str(folder), steps) for folder, steps in jobs]}\nOUT = {str(out)!r}\n{ASK}")
        command = [path, "-n", "-x", str(script)]
        result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-2000:]
        return json.loads(out.read_text())

    return run


@pytest.mark.opens("yade", "Yade", "counted", "weighed", "stepped")
def test_yade_holds_beds_of_any_size_and_steps_them_from_a_start_without_overlap(yade, tmp_path):
    # The last one in SI.
    cases = [(diameter, "grain") for diameter in SIZES] + [(SIZES[0], "si")]
    jobs = []
    for k, (diameter, unit) in enumerate(cases):
        folder = tmp_path / str(k)
        folder.mkdir()
        written(small_bed(diameter), folder / "bed.py", units=unit)
        jobs.append((folder, [1, 99]))
    for (diameter, unit), (built, first, last) in zip(cases, yade(jobs), strict=True):
        bed = small_bed(diameter)
        scale = factors(bed, YadeOptions(units=unit))
        length, mass = scale["length"], scale["mass"]
        assert built["n_bodies"] == len(bed) + 5
        assert first["overlaps"] == []
        exact = integrate(bed.grains)
        assert np.allclose(np.array(built["masses"]) * mass, exact.volumes * 2650, rtol=1e-12)
        assert np.abs(np.array(built["places"]) * length - bed.positions).max() < 1e-12 * diameter
        world, offsets, matrices = world_vertices(bed), bed.grains.vertex_offsets, to_matrices(bed.quaternions)
        for i in range(len(bed)):
            turn = np.reshape(built["turns"][i], (3, 3))
            theirs = turn @ np.diag(built["inertias"][i]) @ turn.T * mass * length**2
            ours = matrices[i] @ exact.inertias[i] @ matrices[i].T * 2650
            assert np.abs(theirs - ours).max() < 1e-9 * np.abs(ours).max()
            seen = (np.array(built["vertices"][i]) @ turn.T + built["places"][i]) * length
            mine = world[offsets[i] : offsets[i + 1]]
            assert len(seen) == len(mine)
            apart = np.linalg.norm(seen[:, None] - mine[None], axis=2)
            assert apart.min(axis=1).max() < 1e-9 * diameter
            assert apart.min(axis=0).max() < 1e-9 * diameter
        # They fall as one until the lowest meet the floor.
        fallen = (np.array(built["places"]) - np.array(last["places"]))[:, 2] * length
        assert np.median(fallen) == pytest.approx(9.81 * (last["time"] * scale["time"]) ** 2 / 2, rel=0.35)
        assert fallen.min() > 0


def test_grains_land_on_the_floor_and_sand_does_as_cobbles_do(yade, tmp_path):
    tilted = np.array([[0.98, 0.1, 0.05, 0.0], [0.9, 0.2, -0.1, 0.3]])
    tilted /= np.linalg.norm(tilted, axis=1)[:, None]
    low = replace(two_grains(), positions=np.array([[4.0, 4.0, 4.0], [4.0, 4.2, 11.5]]) * 1e-3, quaternions=tilted)
    jobs = []
    for diameter in (SIZES[0], SIZES[-1]):
        folder = tmp_path / str(diameter)
        folder.mkdir()
        written(rescale(low, diameter / units(low).length), folder / "bed.py")
        jobs.append((folder, [900, 600]))
    told = yade(jobs)
    sand, cobbles = (np.array([state["places"] for state in states]) for states in told)
    assert [0, 2] in [pair[:2] for pair in told[1][1]["overlaps"]], "the brick has met the floor"
    assert cobbles[2, 0, 2] > cobbles[1, 0, 2] > 0.5, "and is on its way up again"
    # What happens is blind to size: the numbers are the same but for the last digits of the files.
    assert np.abs(sand - cobbles).max() < 1e-3


def test_overlapping_cubes_are_told_by_yade_with_their_volume(yade, tmp_path):
    written(cube_packing([[5, 5, 3], [5.2, 5.3, 4.9]], domain=Domain.cube(10.0)), tmp_path / "bed.py", units="si")
    [[_, first]] = yade([(tmp_path, [1])])
    [[one, other, volume]] = first["overlaps"]
    assert {one, other} == {0, 1}
    assert volume == pytest.approx(1.8 * 1.7 * 0.1, rel=1e-4)


def test_a_periodic_bed_wraps_around_and_cubes_meet_their_images(yade, tmp_path):
    domain = Domain.box((2.5e-3, 2.5e-3, 2.5e-3), periodic=True)
    bed, few = (
        shrink(carve(tessellate(relax(poisson(domain, n, rng=2), domain, iterations=3), domain)), porosity=0.4)
        for n in (90, 8)
    )
    far = Domain(np.array([10.0, 10.0, 10.0]), np.array([18.0, 18.0, 18.0]), np.ones(3, bool))
    cubes = cube_packing([[10.5, 13, 13], [16.51, 13.1, 13.2]], domain=far)
    for name, packing in (("bed", bed), ("cubes", cubes)):
        (tmp_path / name).mkdir()
        written(packing, tmp_path / name / "bed.py", units="si")
    [[built, first], [_, met]] = yade([(tmp_path / "bed", [1]), (tmp_path / "cubes", [1])])
    assert built["n_bodies"] == 90
    assert first["overlaps"] == []
    [[_, _, volume]] = met["overlaps"]
    assert volume == pytest.approx(0.01 * 1.9 * 1.8, rel=1e-4)
    with pytest.raises(InputError, match="narrower than half the periodic domain"):
        written(few, tmp_path / "few.py")


def test_the_script_finds_its_arrays_from_any_folder(program, tmp_path):
    yade, elsewhere = program("yade", "yade"), tmp_path / "else where"
    elsewhere.mkdir()
    written(two_grains(), tmp_path / "bed.py")
    for script in (tmp_path / "bed.py", "../bed.py"):
        done = subprocess.run(
            [yade, "-n", "-x", script], cwd=elsewhere, capture_output=True, text=True, check=False, timeout=300
        )
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        assert "Error" not in done.stdout + done.stderr


def test_the_golden_script_runs_and_weighs_its_two_grains(yade, tmp_path):
    made = check_golden(two_grains(), "yade", "two.py")
    for name, content in made.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "bed.py").write_text((tmp_path / "two.py").read_text())
    [[built, last]] = yade([(tmp_path, [100])])
    scales = units(two_grains())
    assert np.array(built["masses"]) * scales.mass == pytest.approx([2500 * 48e-9, 2500 * 32e-9])
    moments = np.sort(built["inertias"][0]) * scales.inertia
    assert moments == pytest.approx(np.array([20, 40, 52]) * 1e-6 / 12 * 2500 * 48e-9)
    assert last["overlaps"] == []


def test_the_arrays_hold_what_a_reader_needs_and_are_the_same_bytes_twice(tmp_path):
    bed = small_bed(1e-3)
    one, two = (exporters.files(bed, "yade")["bed.npz"] for _ in range(2))
    assert one == two
    (tmp_path / "bed.npz").write_bytes(one)
    arrays = np.load(tmp_path / "bed.npz")
    assert arrays["ids"].tolist() == list(range(len(bed)))
    length, mass, time = arrays["units"]
    assert np.allclose(arrays["positions"] * length, bed.positions, rtol=1e-14)
    assert np.allclose(arrays["densities"] * mass / length**3, bed.densities)
    assert length / time**2 == pytest.approx(9.81)
    assert np.array_equal(arrays["quaternions"], bed.quaternions)
    assert arrays["wall_names"].tolist() == ["wall_z0", "wall_x0", "wall_x1", "wall_y0", "wall_y1"]


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"depth": 0.0}, "depth"),
        ({"damping": -0.1}, "damping"),
        ({"walls": "cup"}, "walls"),
        ({"friction": np.nan}, "fric"),
    ],
)
def test_options_out_of_range_are_refused(tmp_path, options, match):
    with pytest.raises(InputError, match=match):
        written(two_grains(), tmp_path / "bed.py", **options)
    assert list(tmp_path.iterdir()) == []
