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
from exporters.rest import Rest, resting
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import random_quaternions, world_vertices
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink, subset
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
    assert set(settings) <= {*must, "AddOrRemoveInteractions", *CELL}, "every keyword is one that Rockable has"
    shapes = read_shapes(path.parent / settings["shapeFile"][0][0])
    assert {name for name, _ in bodies} == set(shapes)
    check_groups(settings, bodies, list(shapes))
    check_cell(settings)
    return settings, bodies, shapes


CELL = ["usePeriodicCell", "h", "vh", "ah", "mh"]


def check_groups(settings, bodies, shapes):
    """Assert that a pair of groups that can meet has each parameter once, since one that is not said is zero."""
    n_driven = int(settings["nDriven"][0][0])
    groups = [int(numbers[0]) for _, numbers in bodies]
    fixed, free = set(groups[:n_driven]), set(groups[n_driven:])
    assert not fixed & free
    meet = {(min(a, b), max(a, b)) for b in free for a in fixed | free}
    for key in ("knContact", "en2Contact", "ktContact", "muContact", "krContact", "murContact"):
        said = [(int(a), int(b)) for a, b, _ in settings[key]]
        assert all(a <= b for a, b in said)
        assert len(said) == len(set(said))
        assert meet <= set(said) <= meet | {(0, b) for b in free}
    # exaDEM looks densities up by shape, Rockable by group.
    assert [int(k) for k, _ in settings["density"]] == list(range(len(settings["density"])))
    assert len(settings["density"]) >= max(len(shapes), max(groups) + 1)
    densities = [float(value) for _, value in settings["density"]]
    for (name, _), group in zip(bodies[n_driven:], groups[n_driven:], strict=True):
        assert densities[shapes.index(name)] == densities[group], f"{name} weighs the same in both programs"


def check_cell(settings):
    """Assert the rules of a periodic cell: all of it said, no wall, and neighbours sought where images are."""
    if not set(CELL) & set(settings):
        return
    assert [settings[key] for key in CELL if key not in ("h", "mh")] == [[["1"]], [["0"] * 9], [["0"] * 9]]
    cell = np.array(settings["h"][0], float).reshape(3, 3)
    assert (cell == np.diag(np.diag(cell))).all()
    assert (np.diag(cell) > 0).all()
    assert float(settings["mh"][0][0]) > 0
    assert settings["nDriven"] == [["0"]]
    # The tree of boxes takes no account of the images, and cells of neighbours end at the box.
    assert settings["AddOrRemoveInteractions"] == [["bruteForce"]]
    assert "UpdateNL" not in settings
    assert not np.array(settings["gravity"][0], float).any()


def law(settings, key):
    """Return a parameter of every pair of groups."""
    return {(int(a), int(b)): float(value) for a, b, value in settings[key]}


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


def of_four(**changes):
    """Return four grains, two of the golden pair beside two more of it."""
    pair = two_grains()
    domain = Domain.box((16e-3, 8e-3, 16e-3))
    rows = np.array([0, 1, 0, 1])
    places = pair.positions[rows] + np.array([[0, 0, 0], [0, 0, 0], [8e-3, 0, 0], [8e-3, 0, 0]])
    four = subset(pair, rows)
    return replace(four, positions=places, domain=domain, **changes)


@pytest.mark.parametrize("walls", ["box", "floor", "none"])
def test_densities_and_frictions_make_groups_and_the_rougher_of_two_grains_rules(tmp_path, walls):
    bed = of_four(densities=[2500.0, 5000.0, 5000.0, 2500.0], frictions=[0.2, 0.2, 0.6, 0.6])
    written(bed, tmp_path / "bed.conf", walls=walls)
    settings, bodies, shapes = read_conf(tmp_path / "bed.conf")
    groups = {name: int(numbers[0]) for name, numbers in bodies if name.startswith("g")}
    assert groups == {"g000000": 1, "g000001": 3, "g000002": 4, "g000003": 2}
    densities = [float(value) for _, value in settings["density"]]
    masses = [shapes[name]["volume"][0] * densities[group] for name, group in groups.items()]
    assert masses == pytest.approx(np.array([48e-9, 32e-9, 48e-9, 32e-9]) * bed.densities)
    assert shapes["g000001"]["volume"] == pytest.approx(32e-9)
    mu, own = law(settings, "muContact"), {1: 0.2, 2: 0.6, 3: 0.2, 4: 0.6}
    assert mu == {(a, b): max(own[b], own.get(a, 0)) for b in own for a in range(b + 1)}
    text = (tmp_path / "bed.conf").read_text()
    assert "# group 3 is density 5000, friction 0.2\n" in text


def test_the_smoother_rules_where_it_is_to_and_walls_have_frictions_of_their_own(tmp_path):
    bed = of_four(frictions=[0.2, 0.2, 0.6, 0.6])
    walls = {"floor": 0.9, "wall_x0": 0.0, "wall_x1": 0.0}
    written(bed, tmp_path / "bed.conf", mixing="min", wall_friction=walls)
    settings, bodies, _ = read_conf(tmp_path / "bed.conf")
    groups = {name: int(numbers[0]) for name, numbers in bodies}
    mu = law(settings, "muContact")
    assert (mu[1, 1], mu[1, 2], mu[2, 2]) == (0.2, 0.2, 0.6)
    for name, grain, expected in (
        ("wall_z0", 1, 0.9), ("wall_z0", 2, 0.9), ("wall_x0", 1, 0.0), ("wall_x1", 2, 0.0), ("wall_y0", 1, 0.2),
        ("wall_y1", 2, 0.6),
    ):  # fmt: skip
        assert mu[tuple(sorted((groups[name], grain)))] == expected, name
    with pytest.raises(InputError, match="the container has no lid to have a wall_friction"):
        exporters.write(bed, tmp_path / "no.conf", wall_friction="lid=0.1")
    assert not (tmp_path / "no.conf").exists()


def test_a_bed_at_rest_has_the_walls_and_the_rule_that_it_came_to_rest_with(tmp_path):
    rest = Rest(0.01, None, {"floor": 0.9}, (0.0, 0.0, -1.0), are_spheres=False, mixing="min")
    bed = of_four(frictions=[0.2, 0.2, 0.6, 0.6]).with_step("settle", **resting(rest))
    written(bed, tmp_path / "bed.conf")
    settings, bodies, _ = read_conf(tmp_path / "bed.conf")
    floor = next(int(numbers[0]) for name, numbers in bodies if name == "wall_z0")
    mu = law(settings, "muContact")
    assert (mu[1, 2], mu[tuple(sorted((1, floor)))]) == (0.2, 0.9)


def test_shapes_without_walls_still_weigh_the_same_by_group_and_by_shape(tmp_path):
    written(of_four(densities=[2500.0, 2500.0, 2500.0, 5000.0]), tmp_path / "bed.conf", walls="none")
    _, bodies, shapes = read_conf(tmp_path / "bed.conf")
    assert list(shapes) == ["g000001", "g000000", "g000003", "g000002"]
    assert [int(numbers[0]) for _, numbers in bodies] == [1, 1, 1, 2]


def test_what_would_be_too_many_groups_is_blended_first_the_frictions_then_the_densities(tmp_path, caplog):
    pair = two_grains()
    rows = np.arange(102) % 2
    many = subset(pair, rows)
    many = replace(many, positions=many.positions + np.arange(102)[:, None] * [8e-3, 0, 0],
                   domain=Domain.box((102 * 8e-3, 8e-3, 16e-3)))  # fmt: skip
    rough = replace(many, frictions=np.linspace(0.1, 0.7, 102), densities=2500.0 + 500 * rows)
    written(rough, tmp_path / "rough.conf")
    settings, _, shapes = read_conf(tmp_path / "rough.conf")
    assert set(law(settings, "muContact").values()) == {0.4}
    assert "the file has their mean, 0.4" in caplog.text
    assert shapes["g000001"]["volume"] == pytest.approx(32e-9)
    heavy = replace(many, densities=np.linspace(2500.0, 5000.0, 102))
    written(heavy, tmp_path / "heavy.conf")
    settings, _, shapes = read_conf(tmp_path / "heavy.conf")
    assert {density for _, density in settings["density"]} == {"2500"}
    assert shapes["g000101"]["volume"] == pytest.approx(2 * 32e-9)


def test_a_bed_that_is_periodic_along_all_axes_has_a_cell_that_holds_every_image_once(tmp_path):
    domain = Domain((1e-3, 2e-3, 3e-3), (5e-3, 7e-3, 9e-3), (True, True, True))
    bed = shrink(carve(tessellate(poisson(domain, 400, rng=1), domain)), scale=0.9)
    written(bed, tmp_path / "bed.conf", rounding=0.005)
    settings, bodies, shapes = read_conf(tmp_path / "bed.conf")
    cell = np.array(settings["h"][0], float).reshape(3, 3)
    assert np.diag(cell) == pytest.approx([4e-3, 5e-3, 6e-3])
    assert [name for name, _ in bodies] == [f"g{i:06d}" for i in range(len(bed))]
    # Where they were, but for whole cells and the place of the box.
    places = np.array([numbers[3:6] for _, numbers in bodies])
    steps = (places - (bed.positions - domain.lower)) / domain.lengths
    assert np.abs(steps - steps.round()).max() < 1e-9
    assert len(np.unique(steps.round())) > 1
    assert ((places >= 0) & (places < domain.lengths)).all()
    # Two grains within reach of each other are so by the image that is nearest by their centres.
    reach = [np.linalg.norm(shape["nv"], axis=1).max() + shape["radius"][0] for shape in shapes.values()]
    assert 2 * max(reach) + float(settings["DVerlet"][0][0]) < np.diag(cell).min() / 2
    written(bed, tmp_path / "walls.conf", rounding=0.005, periodic=False)
    settings, _, _ = read_conf(tmp_path / "walls.conf")
    assert settings["nDriven"] == [["5"]]
    assert "h" not in settings


def test_grains_too_wide_for_a_periodic_cell_are_named(tmp_path):
    bed = replace(two_grains(), domain=Domain((0, 0, 0), (8e-3, 8e-3, 16e-3), (True, True, True)))
    with pytest.raises(InputError, match=r"narrower than half of Rockable's periodic cell.*periodic=false.*: 0, 1"):
        exporters.write(bed, tmp_path / "bed.conf")
    assert list(tmp_path.iterdir()) == []


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
    wrapped = Domain.box((3e-3, 3e-3, 3e-3), periodic=(True, True, False))
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
