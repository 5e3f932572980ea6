"""3DEC, which cannot be installed: a strict reader of its own holds the commands to the rules of its manual."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from beds import SIZES, check_golden, small_bed, two_grains, written

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import random_quaternions
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink, subset
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate

pytestmark = pytest.mark.client

GROUP = re.compile(r"block group '(g\d+)' slot 'grain' range pos-x (\S+ \S+) pos-y (\S+ \S+) pos-z (\S+ \S+)")
POINT = re.compile(r"[^ ,]+,[^ ,]+,[^ ,]+")


def read(path):
    """Return faces of every polyhedron, bricks, groups of grains and the other commands; continued lines are joined."""
    lines = path.read_text().splitlines()
    assert max(map(len, lines)) < 256
    commands, begun = [], ""
    for line in lines:
        if line.startswith(";"):
            continue
        begun += line.removesuffix("&")
        if not line.endswith("&"):
            commands.append(" ".join(begun.split()))
            begun = ""
    assert not begun, "the last line is not continued"
    polyhedra, bricks, groups, others = [], [], {}, []
    for command in commands:
        if command.startswith("block create polyhedron "):
            _, *faces = command.split(" face ")
            assert all(POINT.fullmatch(word) for face in faces for word in face.split())
            polyhedra.append([[tuple(map(float, word.split(","))) for word in face.split()] for face in faces])
        elif command.startswith("block create brick "):
            bricks.append(np.array(command.split()[3:], float).reshape(3, 2).T)
        elif match := GROUP.fullmatch(command):
            groups[match[1]] = np.array([axis.split() for axis in match.groups()[1:]], float).T
        elif command:
            others.append(command)
    return polyhedra, bricks, groups, others


def read_joints(path):
    """Return the angle of friction of grain and grain, and of grain and wall, by name: of joints that are and will be.

    Every group that a pair is of has members, no pair is named twice, and what holds for the joints that there are is
    what the material table says of those that will be.
    """
    _, bricks, grains, others = read(path)
    groups, angles, table = {}, {}, {}
    for command in others:
        assert command.count(" range ") <= 1
        if match := re.fullmatch(
            r"block group '(friction_\d+)' slot 'friction' range group '(g\d+)' slot 'grain'", command
        ):
            assert not angles, "groups are made before they are asked for"
            assert match[2] in grains
            groups.setdefault(match[1], []).append(match[2])
        elif match := re.fullmatch(
            r"block group '(wall_\w+)' slot 'wall' range pos-x (\S+) (\S+) pos-y (\S+) (\S+) pos-z (\S+) (\S+)", command
        ):
            lower, upper = np.array(match.groups()[1:], float).reshape(3, 2).T
            assert sum(((lower < brick.mean(axis=0)) & (brick.mean(axis=0) < upper)).all() for brick in bricks) == 1
            groups[match[1]] = [match[1]]
        elif match := re.fullmatch(
            r"block contact (property|material-table (?:default|add jmodel mohr) property) "
            r"(?:stiffness-normal (\S+) stiffness-shear \2 )?friction (\S+)"
            r"(?: range group-intersection '(\w+)' '(\w+)')?",
            command,
        ):
            word, stiffness, angle, *pair = match.groups()
            told = angles if word == "property" else table
            assert frozenset(pair) not in told
            assert (stiffness is None) == (word == "property" and pair != [None, None])
            assert pair == [None, None] or set(pair) <= set(groups)
            told[frozenset(pair)] = float(angle)
        else:
            assert "friction" not in command
    assert angles == table
    found = {}
    for a, mine in groups.items():
        for b, theirs in groups.items():
            angle = angles.get(frozenset((a, b)), angles[frozenset((None,))])
            found |= {frozenset((one, other)): angle for one in mine for other in theirs if one != other}
    return found, angles[frozenset((None,))]


def weigh(faces):
    """Return volume and centroid of a polyhedron, after asserting that it is closed, planar, and wound clockwise."""
    edges = Counter()
    volume, moment = 0.0, np.zeros(3)
    middle = np.mean([point for face in faces for point in face], axis=0)
    for face in faces:
        assert len(face) >= 3
        edges.update(zip(face, face[1:] + face[:1], strict=True))
        ring = np.array(face) - middle
        normal = np.sum([np.cross(ring[k - 1], ring[k]) for k in range(len(ring))], axis=0)
        assert np.abs((ring - ring[0]) @ normal).max() < 1e-8 * np.linalg.norm(normal) ** 1.5, "planar"
        # Clockwise seen from outside: the right hand's normal points into the block.
        assert normal @ ring[0] < 0
        for k in range(1, len(ring) - 1):
            det = -np.linalg.det(ring[[0, k, k + 1]])
            volume += det / 6
            moment += det * ring[[0, k, k + 1]].sum(axis=0) / 24
    assert all(edges[b, a] == count == 1 for (a, b), count in edges.items()), "closed, each edge once each way"
    return volume, middle + moment / volume


@pytest.mark.parametrize("diameter", SIZES)
def test_every_grain_is_a_closed_block_wound_clockwise_that_its_group_finds(tmp_path, diameter):
    bed = replace(small_bed(diameter), links=None)
    bed = replace(bed, quaternions=random_quaternions(len(bed), np.random.default_rng(3)))
    written(bed, tmp_path / "bed.3ddat")
    polyhedra, bricks, groups, _ = read(tmp_path / "bed.3ddat")
    assert len(polyhedra) == len(bed)
    assert len(bricks) == 5
    weights = [weigh(faces) for faces in polyhedra]
    assert [volume for volume, _ in weights] == pytest.approx(integrate(bed.grains).volumes, rel=1e-9)
    centres = np.array([centre for _, centre in weights])
    assert np.abs(centres - bed.positions).max() < 1e-9 * diameter
    for i, (name, (lower, upper)) in enumerate(groups.items()):
        assert name == f"g{i:06d}"
        assert np.flatnonzero(((centres > lower) & (centres < upper)).all(axis=1)).tolist() == [i]


def test_the_commands_come_in_the_order_that_3dec_needs_them(tmp_path):
    bed = replace(two_grains(), densities=[2500.0, 3000.0])
    written(bed, tmp_path / "bed.3ddat", friction=1.0)
    _, _, _, others = read(tmp_path / "bed.3ddat")
    joint = others[7].removeprefix("block contact property ")
    assert joint.endswith("friction 45")
    assert others == [
        "model new",
        "model large-strain on",
        "block group 'walls'",
        "block property density 2500",
        "block property density 3000 range group 'g000001' slot 'grain'",
        "block contact generate-subcontacts",
        "block contact jmodel assign mohr",
        f"block contact property {joint}",
        f"block contact material-table default property {joint}",
        "model gravity 0 0 -9.81",
        "block fix range group 'walls'",
        "block mech damp local 0.8",
    ]


def test_the_walls_are_bricks_that_do_not_overlap_each_other_or_a_grain(tmp_path):
    planar = Domain.slab((4e-3, 4e-3), 1e-3)
    seeds = poisson(planar, 60, rng=1)
    seeds[:, 2] = 0.5e-3
    layer = shrink(carve(tessellate(seeds, planar)), scale=0.9)
    for bed, count in ((two_grains(), 5), (layer, 5)):
        written(bed, tmp_path / "bed.3ddat")
        polyhedra, bricks, _, _ = read(tmp_path / "bed.3ddat")
        assert len(bricks) == count
        for k, (lower, upper) in enumerate(bricks):
            assert (lower < upper).all()
            for other_lower, other_upper in bricks[:k]:
                shared = np.minimum(upper, other_upper) - np.maximum(lower, other_lower)
                assert shared.min() <= 0
            points = np.array([point for faces in polyhedra for face in faces for point in face])
            assert not ((points > lower) & (points < upper)).all(axis=1).any()


def test_the_golden_file_keeps_the_rules_and_holds_its_two_grains(tmp_path):
    [content] = check_golden(two_grains(), "3dec", "two.3ddat").values()
    (tmp_path / "two.3ddat").write_bytes(content)
    polyhedra, _, _, _ = read(tmp_path / "two.3ddat")
    assert [weigh(faces)[0] for faces in polyhedra] == pytest.approx([48e-9, 32e-9])


def side_by_side(**changes):
    """Return four grains, two of the golden pair beside two more of it."""
    four = subset(two_grains(), [0, 1, 0, 1])
    places = four.positions + np.array([[0, 0, 0], [0, 0, 0], [8e-3, 0, 0], [8e-3, 0, 0]])
    return replace(four, positions=places, domain=Domain.box((16e-3, 8e-3, 16e-3)), **changes)


@pytest.mark.parametrize("rule", ["max", "min"])
def test_joints_have_the_friction_of_the_rougher_or_smoother_grain_and_of_walls_their_own(tmp_path, rule):
    own = [0.2, 0.6, 0.2, 0.6]
    bed = side_by_side(frictions=own, densities=[2500.0, 5000.0, 5000.0, 2500.0])
    written(bed, tmp_path / "bed.3ddat", mixing=rule, wall_friction={"floor": 1.0})
    found, _ = read_joints(tmp_path / "bed.3ddat")
    grains = [f"g{i:06d}" for i in range(4)]
    expected = {
        frozenset((a, b)): max(own[i], own[j]) if rule == "max" else min(own[i], own[j])
        for i, a in enumerate(grains)
        for j, b in enumerate(grains[:i])
    }
    expected |= {frozenset((a, "wall_z0")): 1.0 for a in grains}
    expected |= {frozenset((a, "wall_x1")): own[i] for i, a in enumerate(grains)}
    assert {pair: found[pair] for pair in expected} == pytest.approx(
        {pair: np.degrees(np.arctan(friction)) for pair, friction in expected.items()}
    )
    _, _, _, others = read(tmp_path / "bed.3ddat")
    dense = [command for command in others if command.startswith("block property density 5000")]
    assert dense == [
        f"block property density 5000 range group '{name}' slot 'grain'" for name in ("g000001", "g000002")
    ]


def test_a_bed_of_one_friction_has_no_groups_of_it_and_one_of_too_many_has_their_mean(tmp_path, caplog):
    written(two_grains(), tmp_path / "bed.3ddat", friction=1.0)
    assert read_joints(tmp_path / "bed.3ddat") == ({}, 45.0)
    many = subset(two_grains(), np.arange(102) % 2)
    places = many.positions + np.arange(102)[:, None] * [8e-3, 0, 0]
    domain = Domain.box((102 * 8e-3, 8e-3, 16e-3))
    many = replace(many, positions=places, domain=domain, frictions=np.linspace(0.5, 1.5, 102))
    written(many, tmp_path / "many.3ddat")
    assert read_joints(tmp_path / "many.3ddat") == ({}, 45.0)
    assert "the file has their mean, 1" in caplog.text
    with pytest.raises(InputError, match="the container has no lid to have a wall_friction"):
        written(two_grains(), tmp_path / "no.3ddat", wall_friction={"lid": 0.5})


@pytest.mark.parametrize("walls", ["floor", "none"])
def test_the_container_may_be_a_floor_or_nothing(tmp_path, walls):
    written(two_grains(), tmp_path / "bed.3ddat", walls=walls)
    _, bricks, _, others = read(tmp_path / "bed.3ddat")
    assert len(bricks) == (1 if walls == "floor" else 0)
    assert ("block fix range group 'walls'" in others) is (walls == "floor")


@pytest.mark.parametrize(
    ("options", "match"), [({"depth": 0.0}, "depth"), ({"friction": -1.0}, "friction"), ({"walls": "cup"}, "walls")]
)
def test_options_out_of_range_are_refused(tmp_path, options, match):
    with pytest.raises(InputError, match=match):
        written(two_grains(), tmp_path / "bed.3ddat", **options)
    assert list(tmp_path.iterdir()) == []
