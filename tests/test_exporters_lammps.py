"""LAMMPS: the script is run as it stands, and what LAMMPS writes back is compared."""

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from beds import SIZES, check_golden, small_bed, two_grains, written
from conftest import cube_packing
from scipy.spatial import ConvexHull
from solids import place, polyhedra

import exporters
from exporters.dem.lammps import quads
from exporters.units import units
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import random_quaternions, to_matrices, world_vertices
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

pytestmark = pytest.mark.client


@pytest.fixture
def lmp(program, tmp_path):
    """A function that runs the script of a folder and returns rows of step, atoms, potential and kinetic energy."""
    path = program("lmp", "lammps")

    def run(steps, *more):
        (tmp_path / "run.in").write_text("\n".join(["include bed.in", *more, ""]))
        command = [path, "-log", "none", "-var", "steps", str(steps), "-in", "run.in"]
        told = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert told.returncode == 0, told.stdout[-2000:]
        assert "WARNING" not in told.stdout, told.stdout
        lines = told.stdout.splitlines()
        first = next(k for k, line in enumerate(lines) if line.split()[:2] == ["Step", "Atoms"])
        last = next(k for k, line in enumerate(lines) if line.startswith("Loop time"))
        return np.array([line.split() for line in lines[first + 1 : last]], float)

    return run


def read_back(path):
    """Return mass and place of each atom, and of its body: inertia, vertices, edges, faces and rounding diameter."""
    sections = {}
    for line in path.read_text().splitlines():
        if line.startswith(("Atoms", "Bodies", "Velocities")):
            rows = sections[line.split()[0]] = []
        elif sections:
            rows += [line.split()] if line.strip() else []
    atoms = {int(row[0]): (float(row[3]), np.array(row[4:7], float)) for row in sections["Atoms"]}
    words = [word for row in sections["Bodies"] for word in row]
    at, bodies = 0, {}
    while at < len(words):
        number, _, n_reals, v, e, f = map(int, words[at : at + 6])
        reals = np.array(words[at + 6 : at + 6 + n_reals], float)
        at += 6 + n_reals
        cuts = np.cumsum([6, 3 * v, 2 * e, 4 * f])
        six, vertices, ends, faces, diameter = np.split(reals, cuts)
        tensor = six[[0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(3, 3)
        shapes = vertices.reshape(-1, 3), ends.reshape(-1, 2).astype(int), faces.reshape(-1, 4).astype(int)
        bodies[number] = (tensor, *shapes, float(diameter[0]))
    return atoms, bodies


@pytest.mark.opens("lammps", "LAMMPS", "counted", "weighed")
def test_lammps_holds_every_grain_where_it_was_with_its_mass_inertia_and_core(lmp, tmp_path):
    bed = replace(small_bed(1e-3), links=None)
    bed = replace(bed, quaternions=random_quaternions(len(bed), np.random.default_rng(4)))
    written(bed, tmp_path / "bed.in", walls="none")
    [row] = lmp(0, "write_data back.data")
    assert row[1] == len(bed)
    scales, exact = units(bed), integrate(bed.grains)
    atoms, bodies = read_back(tmp_path / "back.data")
    world, offsets, matrices = world_vertices(bed), bed.grains.vertex_offsets, to_matrices(bed.quaternions)
    for i in range(len(bed)):
        mass, at = atoms[i + 1]
        tensor, vertices, ends, faces, diameter = bodies[i + 1]
        # LAMMPS writes six digits of some of its numbers.
        assert mass * scales.mass == pytest.approx(exact.volumes[i] * 2650, rel=1e-5)
        assert np.abs(at * scales.length - bed.positions[i]).max() < 1e-5 * 1e-3
        inertia = matrices[i] @ exact.inertias[i] @ matrices[i].T * 2650 / scales.inertia
        assert np.abs(tensor - inertia).max() < 1e-5 * np.abs(inertia).max()
        hull = ConvexHull(world[offsets[i] : offsets[i + 1]])
        core = vertices * scales.length + bed.positions[i]
        reach = hull.equations[:, :3] @ core.T + hull.equations[:, 3:] + diameter / 2 * scales.length
        assert reach.max() < 1e-5 * 1e-3
        assert np.median(reach.max(axis=1)) > -1e-5 * 1e-3
        # By Euler's formula, of whole faces: pieces add cuts that are no edges.
        assert len({tuple(sorted(end)) for end in ends.tolist()}) == len(ends)
        # Each piece of a face lies in its plane, and all of them are the core's surface.
        area = 0.0
        for a, b, c, d in faces:
            ring = vertices[[a, b, c] + [d] * int(d >= 0)]
            area += 0.5 * np.linalg.norm(
                sum(np.cross(ring[k - 1] - ring[0], ring[k] - ring[0]) for k in range(len(ring)))
            )
        assert area == pytest.approx(ConvexHull(vertices).area, rel=1e-4)


def test_both_files_and_the_manifest_say_how_much_smaller_cores_are_than_their_grains(tmp_path):
    bed = small_bed(1e-3)
    exporters.write(bed, tmp_path, formats="lammps", rounding=0.02)
    told = json.loads((tmp_path / "manifest.json").read_text())["formats"][0]["report"]
    _, bodies = read_back(tmp_path / "bed.data")
    cores = np.array([ConvexHull(bodies[i + 1][1]).volume for i in range(len(bed))]) * units(bed).length ** 3
    sharp = integrate(bed.grains).volumes
    assert told["core_volume_lost"] == pytest.approx(1 - cores.sum() / sharp.sum(), rel=1e-6)
    assert told["largest_core_volume_lost_by_a_grain"] == pytest.approx((1 - cores / sharp).max(), rel=1e-6)
    assert told["core_volume_lost"] > 50 * told["volume_lost"]
    line = (
        f"# The polyhedra here are cores, without the sphere that rounds them: {100 * told['core_volume_lost']:.4g} % "
        f"less volume than the grains, {100 * told['largest_core_volume_lost_by_a_grain']:.4g} % less than one at most."
    )
    for name in ("bed.in", "bed.data"):
        assert line in (tmp_path / name).read_text().splitlines()[:12]


@pytest.mark.parametrize("diameter", SIZES)
@pytest.mark.opens("lammps", "LAMMPS", "stepped")
def test_lammps_steps_a_bed_of_any_size_that_starts_without_overlap(lmp, tmp_path, diameter):
    bed = small_bed(diameter)
    written(bed, tmp_path / "bed.in")
    rows = lmp(100)
    assert rows[0].tolist() == [0, len(bed), 0, 0]  # no contact stores energy at the start
    assert rows[-1, 0] == 100
    assert rows[-1, 1] == len(bed)
    time = 100 * float((tmp_path / "bed.in").read_text().split("timestep")[1].split()[0])
    # They fall with gravity one: the mean kinetic energy is m t²/2 until the first contacts.
    mass = integrate(bed.grains).volumes.mean() * 2650 / units(bed).mass
    assert rows[-1, 3] == pytest.approx(mass * time**2 / 2, rel=0.05)
    assert rows[-1, 2] < 1e-3 * rows[-1, 3] + 1e-9


def test_golden_files_run_in_lammps_and_are_weighed(lmp, tmp_path):
    made = check_golden(two_grains(), "lammps", "two.in", "two.data")
    for name, content in made.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "bed.in").write_text("include two.in\n")
    rows = lmp(100, "write_data back.data")
    assert rows[-1, 1] == 2
    atoms, bodies = read_back(tmp_path / "back.data")
    scales = units(two_grains())
    assert atoms[1][0] * scales.mass == pytest.approx(2500 * 48e-9, rel=1e-5)
    assert atoms[2][0] * scales.mass == pytest.approx(2500 * 32e-9, rel=1e-5)
    moments = np.linalg.eigvalsh(bodies[1][0]) * scales.inertia / (2500 * 48e-9)
    assert moments == pytest.approx(np.array([4 + 16, 4 + 36, 16 + 36]) * 1e-6 / 12, rel=1e-5)


@pytest.mark.parametrize(("gap", "touches"), [(1e-3, False), (-1e-3, True)])
def test_the_skins_of_two_cubes_meet_where_the_sharp_cubes_would(lmp, tmp_path, gap, touches):
    half = 1.0 - gap / 2
    # A little aside, that the corners of one stand on the face of the other.
    bed = cube_packing([[5, 5, 3], [5.1, 5.2, 3 + 2 * half + gap]], half=half, domain=Domain.cube(10.0))
    written(bed, tmp_path / "bed.in", walls="none")
    [row] = lmp(0)
    assert bool(row[2] > 0) is touches


@pytest.mark.parametrize(("gap", "touches"), [(1e-3, False), (-1e-3, True)])
def test_grains_meet_their_images_across_a_periodic_boundary(lmp, tmp_path, gap, touches):
    domain = Domain(np.zeros(3), np.array([6.0, 6.0, 6.0]), np.array([True, False, False]))
    half = 1.0 - gap / 2
    # The first reaches over the boundary at x = 0, the second is its neighbour at x = 6.
    bed = cube_packing([[0.5, 3, 3], [6.5 - 2 * half - gap, 3.1, 3.2]], half=half, domain=domain)
    written(bed, tmp_path / "bed.in")
    assert "boundary        p m m" in (tmp_path / "bed.in").read_text()
    assert "wall_x" not in (tmp_path / "bed.in").read_text()
    [row] = lmp(0)
    assert row[1] == 2
    assert bool(row[2] > 0) is touches


def test_a_periodic_bed_starts_without_overlap_and_keeps_its_grains(lmp, tmp_path):
    domain = Domain.box((2.5e-3, 2.5e-3, 2.5e-3), periodic=True)
    bed = shrink(carve(tessellate(relax(poisson(domain, 12, rng=2), domain, iterations=3), domain)), porosity=0.4)
    written(bed, tmp_path / "bed.in")
    rows = lmp(20)
    assert rows[0].tolist() == [0, 12, 0, 0]
    assert rows[-1, 1] == 12
    assert rows[-1, 2] == 0  # all fall as one


def test_a_grain_stops_at_the_floor_of_its_container(lmp, tmp_path):
    low = replace(two_grains(), positions=np.array([[4.0, 4.0, 3.2], [4.0, 4.0, 10.4]]) * 1e-3)
    written(low, tmp_path / "bed.in")
    lmp(4000, "write_data back.data")
    atoms, _ = read_back(tmp_path / "back.data")
    # The brick, 6 mm high, stands on the floor but for the depth of its springs.
    assert atoms[1][1][2] * units(low).length == pytest.approx(3e-3, abs=0.1e-3)


def test_faces_are_cut_into_pieces_of_three_and_four_that_cover_them():
    angles = np.linspace(0, 2 * np.pi, 8)[:-1]
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    prism = polyhedra(np.concatenate([np.column_stack([ring, np.full(7, z)]) for z in (-1.0, 1.0)]))
    pieces, offsets = quads(prism)
    # Seven corners are two fours and a three, seven sides are fours.
    assert offsets.tolist() == [0, 13]
    assert sorted((pieces[:, 3] >= 0).tolist()) == [False] * 2 + [True] * 11
    area = 0.0
    for a, b, c, d in pieces:
        corners = prism.vertices[[a, b, c] + [d] * int(d >= 0)]
        crosses = [np.cross(corners[k] - corners[0], corners[k + 1] - corners[0]) for k in range(1, len(corners) - 1)]
        area += np.linalg.norm(np.sum(crosses, axis=0)) / 2
    assert area == pytest.approx(ConvexHull(prism.vertices).area)


def test_a_grain_of_more_corners_than_lammps_reads_is_refused(tmp_path):
    rng = np.random.default_rng(1)
    points = rng.standard_normal((120, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    ball = polyhedra(points)
    bed = place(ball, [[5.0, 5.0, 5.0]])
    with pytest.raises(InputError, match=r"more than 31 lines of one; not so: 0"):
        written(bed, tmp_path / "bed.in")
    assert list(tmp_path.iterdir()) == []
