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
from grainsdem.packing import carve, shrink
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
