"""Rockable and exaDEM, which cannot be installed: a strict reader of its own holds the files to the programs' rules."""

import json
from dataclasses import replace

import numpy as np
import pytest
from beds import SIZES, check_golden, small_bed, two_grains, written
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import exporters
from exporters.dem.bodies import bodies, rounded
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import random_quaternions, world_vertices
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate

pytestmark = pytest.mark.client

NUMBERS = {"radius": 1, "obb.extent": 3, "obb.e1": 3, "obb.e2": 3, "obb.e3": 3, "obb.center": 3, "volume": 1, "I/m": 3}


def read_shapes(path):
    """Return the shapes of a library by name, each checked for the rules of both programs."""
    shapes, lines = {}, iter(path.read_text().splitlines())
    assert next(lines).startswith("#")
    for line in lines:
        assert line == "<", "blocks follow each other, each between < and > alone on their lines"
        shape = {}
        for row in lines:
            if row == ">":
                break
            key, *words = row.split()
            if key in NUMBERS:
                assert len(words) == NUMBERS[key]
                shape[key] = np.array(words, float)
            elif key in ("nv", "ne", "nf"):
                rows = [next(lines).split() for _ in range(int(words[0]))]
                shape[key] = np.array(rows, float) if key == "nv" else [[int(word) for word in row] for row in rows]
            else:
                assert key in ("name", "preCompDone"), f"{key} is not a key that we write"
                [shape[key]] = words
        check_shape(shape)
        assert shape["name"] not in shapes, "an unknown or double name takes another shape, silently"
        shapes[shape["name"]] = shape
    return shapes


def check_shape(shape):
    """Assert what both programs trust blindly."""
    assert set(shape) == {*NUMBERS, "name", "preCompDone", "nv", "ne", "nf"}
    assert len(shape["name"]) < 16
    assert shape["preCompDone"] == "y"
    assert all(np.isfinite(shape[key]).all() for key in NUMBERS)
    assert shape["radius"] > 0
    assert shape["volume"] > 0
    vertices, radius = shape["nv"], shape["radius"][0]
    size = np.ptp(vertices, axis=0).max()
    axes = np.stack([shape["obb.e1"], shape["obb.e2"], shape["obb.e3"]])
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) > 0
    # The box holds the skin of every vertex, and is not larger.
    seen = (vertices - shape["obb.center"]) @ axes.T
    assert np.allclose(np.abs(seen).max(axis=0) + radius, shape["obb.extent"], atol=1e-9 * size)
    ends = {tuple(sorted(edge)) for edge in shape["ne"]}
    assert len(ends) == len(shape["ne"]), "each edge once"
    sides = []
    for count, *corners in shape["nf"]:
        assert count == len(corners) == len(set(corners))
        ring = vertices[corners]
        normal = np.cross(ring[1] - ring[0], ring[2] - ring[0])
        assert np.abs((ring - ring[0]) @ normal).max() < 1e-8 * size * np.linalg.norm(normal), "faces are planar"
        sides += [tuple(sorted((corners[k], corners[k - 1]))) for k in range(count)]
    assert set(sides) == ends, "the edges are those of the faces"
    if len(shape["nf"]) > 1:
        assert len(sides) == 2 * len(ends), "closed"
        assert len(vertices) - len(ends) + len(shape["nf"]) == 2


def read_conf(path):
    """Return settings and bodies of a configuration: {key: words}, and a list of name and 22 numbers."""
    first, *lines = path.read_text().splitlines()
    assert first == "Rockable 21-08-2022"
    lines = [line for line in lines if not line.startswith("#")]
    stop = next(k for k, line in enumerate(lines) if line.startswith("Particles"))
    settings = {}
    for line in lines[:stop]:
        key, *words = line.split()
        settings.setdefault(key, []).append(words)
    bodies = [(line.split()[0], np.array(line.split()[1:], float)) for line in lines[stop + 1 :]]
    assert len(bodies) == int(lines[stop].split()[1])
    assert all(len(numbers) == 22 for _, numbers in bodies)
    must = {
        "t", "tmax", "dt", "interVerlet", "interConf", "DVerlet", "dVerlet", "density", "gravity", "forceLaw",
        "knContact", "en2Contact", "ktContact", "muContact", "krContact", "murContact", "nDriven", "shapeFile",
    }  # fmt: skip
    assert must <= set(settings)
    for key in ("knContact", "en2Contact", "ktContact", "muContact", "krContact", "murContact"):
        assert {(a, b) for a, b, _ in settings[key]} == {("0", "1"), ("1", "1")}
    shapes = read_shapes(path.parent / settings["shapeFile"][0][0])
    assert {name for name, _ in bodies} == set(shapes)
    # exaDEM looks densities up by shape, Rockable by group.
    assert [int(k) for k, _ in settings["density"]] == list(range(len(shapes)))
    return settings, bodies, shapes


def turns(numbers):
    """Return the rotation of a body: w, x, y, z are its 13th to 16th numbers."""
    w, x, y, z = numbers[12:16]
    assert w * w + x * x + y * y + z * z == pytest.approx(1, abs=1e-11)
    return Rotation.from_quat([x, y, z, w]).as_matrix()


def hull_moments(points):
    """Return volume, centroid and inertia at unit density of the hull of points, by tetrahedra of Qhull's triangles."""
    hull = ConvexHull(points)
    middle = points.mean(axis=0)
    corners = points[hull.simplices] - middle
    det = np.abs(np.linalg.det(corners))
    volume = det.sum() / 6
    centroid = (det[:, None] * corners.sum(axis=1)).sum(axis=0) / 24 / volume
    sums = corners.sum(axis=1)
    second = np.einsum("t,tki,tkj->ij", det, corners, corners) + np.einsum("t,ti,tj->ij", det, sums, sums)
    second = second / 120 - volume * np.outer(centroid, centroid)
    return volume, centroid + middle, np.trace(second) * np.eye(3) - second


@pytest.mark.parametrize("diameter", SIZES)
def test_every_grain_is_where_it_was_with_its_mass_and_inertia_and_its_skin_ends_at_its_faces(tmp_path, diameter):
    bed = replace(small_bed(diameter), links=None)
    bed = replace(bed, quaternions=random_quaternions(len(bed), np.random.default_rng(2)))
    written(bed, tmp_path / "bed.conf")
    settings, bodies, shapes = read_conf(tmp_path / "bed.conf")
    assert settings["nDriven"] == [["5"]]
    world, offsets = world_vertices(bed), bed.grains.vertex_offsets
    for i, (name, numbers) in enumerate(bodies[5:]):
        assert name == f"g{i:06d}"
        assert numbers[:3].tolist() == [1, 0, 1]  # group, cluster, scale
        assert not numbers[6:12].any()
        assert not numbers[16:].any()
        shape, turn = shapes[name], turns(numbers)
        sharp = world[offsets[i] : offsets[i + 1]]
        volume, centre, inertia = hull_moments(sharp)
        mass = shape["volume"][0] * float(settings["density"][i][1])
        assert mass == pytest.approx(volume * 2650, rel=1e-9)
        assert np.abs(numbers[3:6] - centre).max() < 1e-9 * diameter
        theirs = turn @ np.diag(shape["I/m"]) @ turn.T * mass
        assert np.abs(theirs - inertia * 2650).max() < 1e-9 * np.abs(theirs).max()
        # The core swept by the sphere fits the grain's faces: every face that is left touches it from inside.
        hull = ConvexHull(sharp)
        core = shape["nv"] @ turn.T + numbers[3:6]
        reach = hull.equations[:, :3] @ core.T + hull.equations[:, 3:] + shape["radius"]
        assert reach.max() < 1e-9 * diameter
        assert np.median(reach.max(axis=1)) > -1e-9 * diameter


def test_golden_files_keep_the_rules_and_hold_the_closed_forms_of_their_two_grains(tmp_path):
    made = check_golden(two_grains(), "rockable", "two.conf", "two.shp")
    for name, content in made.items():
        (tmp_path / name).write_bytes(content)
    _, bodies, shapes = read_conf(tmp_path / "two.conf")
    brick, pyramid = shapes["g000000"], shapes["g000001"]
    assert brick["volume"] == pytest.approx(2e-3 * 4e-3 * 6e-3)
    assert brick["I/m"] == pytest.approx(np.array([4 + 16, 4 + 36, 16 + 36]) * 1e-6 / 12)
    # A bipyramid of half axes a, b, c: V = 4/3 a b c, and <x²> = a²/10.
    assert pyramid["volume"] == pytest.approx(4 / 3 * 24e-9)
    assert pyramid["I/m"] == pytest.approx(np.array([4 + 9, 4 + 16, 9 + 16]) * 1e-7)
    core = np.abs(brick["nv"]).max(axis=0) + brick["radius"]
    assert core == pytest.approx([3e-3, 2e-3, 1e-3])
    # The plates' skins end at the walls of the box.
    radius = shapes["wall_x0"]["radius"][0]
    places = {name: numbers[3:6] for name, numbers in bodies}
    assert places["wall_x0"][0] == pytest.approx(-radius)
    assert places["wall_x1"][0] == pytest.approx(8e-3 + radius)
    assert places["wall_z0"][2] == pytest.approx(-radius)


def test_a_grain_that_falls_the_bed_s_height_stops_within_one_radius_and_fifty_steps_of_its_spring(tmp_path):
    written(two_grains(), tmp_path / "bed.conf", depth=0.5, gravity=2.0)
    settings, _, shapes = read_conf(tmp_path / "bed.conf")
    stiffness = float(settings["knContact"][1][2])
    depths = []
    for grain in ("g000000", "g000001"):
        mass, drop = 2500 * shapes[grain]["volume"][0], 16e-3
        # All of m g h goes into k x²/2.
        depths.append(np.sqrt(2 * mass * 2.0 * drop / stiffness) / shapes[grain]["radius"][0])
    assert max(depths) == pytest.approx(0.5)
    lightest = 2500 * shapes["g000001"]["volume"][0]
    assert float(settings["dt"][0][0]) == pytest.approx(0.02 * np.sqrt(lightest / stiffness))


def test_densities_that_differ_are_carried_by_the_shapes_volumes(tmp_path):
    bed = replace(two_grains(), densities=[2500.0, 5000.0])
    written(bed, tmp_path / "bed.conf")
    settings, _, shapes = read_conf(tmp_path / "bed.conf")
    assert {density for _, density in settings["density"]} == {"2500"}
    assert shapes["g000000"]["volume"] == pytest.approx(48e-9)
    assert shapes["g000001"]["volume"] == pytest.approx(2 * 32e-9)


@pytest.mark.parametrize("walls", ["floor", "none"])
def test_the_container_may_be_a_floor_or_nothing(tmp_path, walls):
    written(two_grains(), tmp_path / "bed.conf", walls=walls)
    settings, bodies, _ = read_conf(tmp_path / "bed.conf")
    names = [name for name, _ in bodies if name.startswith("wall")]
    assert names == (["wall_z0"] if walls == "floor" else [])
    assert settings["nDriven"] == [[str(len(names))]]


def test_planar_periodic_and_walled_beds_stand_in_containers_that_hold_every_grain(tmp_path):
    planar = Domain.slab((4e-3, 4e-3), 1e-3)
    layer = poisson(planar, 60, rng=1)
    layer[:, 2] = 0.5e-3
    cylinder = Domain.cylinder(2e-3, 4e-3, sides=8)
    wrapped = Domain.box((3e-3, 3e-3, 3e-3), periodic=True)
    for domain, seeds, n_walls in (
        (planar, layer, 5),
        (cylinder, poisson(cylinder, 80, rng=1), 9),
        (wrapped, poisson(wrapped, 40, rng=1), 5),
    ):
        bed = shrink(carve(tessellate(seeds, domain)), scale=0.9)
        written(bed, tmp_path / "bed.conf", rounding=0.005)
        settings, bodies, _ = read_conf(tmp_path / "bed.conf")
        assert settings["nDriven"] == [[str(n_walls)]]
        vertices = world_vertices(bed)
        for name, numbers in bodies[:n_walls]:
            place, turn = numbers[3:6], turns(numbers)
            # The wall's z axis points to the grains, and its shape lies in its x and y.
            assert ((vertices - place) @ turn[:, 2]).min() > 0, name
        down = [0, -9.81, 0] if domain.is_planar else [0, 0, -9.81]
        assert np.allclose(np.array(settings["gravity"][0], float), down)


def test_the_manifest_and_the_file_tell_what_the_rounding_took(tmp_path):
    exporters.write(two_grains(), tmp_path, formats="rockable", rounding=0.05)
    [row] = json.loads((tmp_path / "manifest.json").read_text())["formats"]
    told = row["report"]
    d = np.cbrt(6 / np.pi * 48e-9)
    r, a = 0.05 * d, np.array([2e-3, 4e-3, 6e-3])
    assert told["largest_rounding_radius"] == pytest.approx(r)
    # A brick with rounded edges: the core, slabs on its faces, quarter cylinders along its edges, and a ball.
    core = a - 2 * r
    faces = 2 * (core[0] * core[1] + core[0] * core[2] + core[1] * core[2])
    swept = core.prod() + faces * r + np.pi * r**2 * core.sum() + 4 / 3 * np.pi * r**3
    lost = 1 - swept / a.prod()
    assert told["largest_volume_lost_by_a_grain"] >= lost
    skin = rounded(two_grains(), bodies(two_grains()), 0.05)
    assert 1 - skin.volumes[0] / 48e-9 == pytest.approx(lost, rel=1e-9)
    assert f"{100 * told['volume_lost']:.4g} % of the volume" in (tmp_path / "bed.conf").read_text()


@pytest.mark.parametrize("name", ["my bed", "bed$", "-bed", "bäd", "a'b", "x&y"])
def test_a_name_that_is_not_one_word_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="name must be of the letters"):
        exporters.write(two_grains(), tmp_path / f"{name}.conf")
    assert list(tmp_path.iterdir()) == []


def test_grains_that_the_rounding_would_eat_are_named(tmp_path):
    flat = two_grains()
    vertices = np.array(flat.grains.vertices)
    vertices[:8, 2] *= 1e-3
    flat = replace(flat, grains=replace(flat.grains, vertices=vertices))
    with pytest.raises(InputError, match=r"rounding by 0\.02 of a diameter: .* would vanish .*: 0"):
        exporters.write(flat, tmp_path / "bed.conf")
    assert list(tmp_path.iterdir()) == []
