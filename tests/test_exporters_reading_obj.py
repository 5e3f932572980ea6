"""Wavefront OBJ as other programs write it: what a grain is, and what is refused in one line."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import pyvista

import exporters
from grainsdem.errors import FileFormatError
from grainsdem.geometry.integrals import volumes

pytestmark = pytest.mark.unit

CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
QUADS = [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]]
MIXED = [*QUADS[:4], [1, 5, 7], [1, 7, 3], *QUADS[5:]]
APART = [0.0, 3.0]
"""Where two unit cubes stand along x."""


def vertices(at=0.0):
    return [f"v {x + at:g} {y:g} {z:g}" for x, y, z in CUBE]


def faces(loops=QUADS, shift=0, form="{}"):
    return ["f " + " ".join(form.format(k + shift) for k in loop) for loop in loops]


def read(tmp_path, lines, *, end="\n", mark=b""):
    path = tmp_path / "bed.obj"
    path.write_bytes(mark + end.join([*lines, ""]).encode())
    return exporters.read(path)


def check_two_cubes(packing):
    assert len(packing) == 2
    np.testing.assert_allclose(volumes(packing.grains), 1.0, rtol=1e-12)
    np.testing.assert_allclose(packing.positions, [[at + 0.5, 0.5, 0.5] for at in APART], atol=1e-12)


def two(first, second, *, shift=8, names=("o a", "o b")):
    """Two cubes after one another, their faces given as functions of the number of vertices before them."""
    return [*names[:1], *vertices(APART[0]), *first(0), *names[1:], *vertices(APART[1]), *second(shift)]


@pytest.mark.parametrize("form", ["{}", "{}/1", "{}//1", "{}/1/1", "{}/-1/-1", "{}//-1"])
@pytest.mark.parametrize("shift", [-9, 0])
def test_vertices_counted_back_are_those_before_the_face(tmp_path, form, shift):
    def relative(before):
        return faces(shift=-9 if shift else before, form=form)

    lines = [*two(relative, relative), "vt 0 0", "vn 0 0 1"]
    packing = read(tmp_path, lines)
    check_two_cubes(packing)
    assert packing.grains.n_faces == 12


@pytest.mark.client
def test_vertices_counted_back_are_where_vtk_puts_them(tmp_path):
    packing = read(tmp_path, two(lambda _: faces(shift=-9), lambda _: faces(shift=-9)))
    theirs = pyvista.read(tmp_path / "bed.obj").split_bodies()
    bounds = sorted(np.reshape(body.bounds, (3, 2)).T.tolist() for body in theirs)
    ours = [packing.grains.vertices_of(i) + packing.positions[i] for i in range(2)]
    np.testing.assert_allclose([[points.min(axis=0), points.max(axis=0)] for points in ours], bounds, atol=1e-12)


def test_quads_and_triangles_mixed_are_one_cube_with_the_faces_of_the_file(tmp_path):
    packing = read(tmp_path, ["o a", *vertices(), *faces(MIXED)])
    assert np.diff(packing.grains.face_vertex_offsets).tolist() == [4, 4, 4, 4, 3, 3, 4]
    np.testing.assert_allclose(volumes(packing.grains), 1.0, rtol=1e-12)
    np.testing.assert_allclose(packing.positions, [[0.5, 0.5, 0.5]], atol=1e-12)


def test_a_face_of_many_corners_stays_one_face(tmp_path):
    ring = 2 * np.pi * np.arange(12) / 12
    lines = [f"v {np.cos(a):.9g} {np.sin(a):.9g} {z}" for z in (0, 1) for a in ring]
    sides = [[k + 1, (k + 1) % 12 + 1, (k + 1) % 12 + 13, k + 13] for k in range(12)]
    packing = read(tmp_path, [*lines, *faces([[*range(12, 0, -1)], [*range(13, 25)], *sides])])
    assert sorted(np.diff(packing.grains.face_vertex_offsets).tolist()) == [4] * 12 + [12, 12]
    np.testing.assert_allclose(volumes(packing.grains), 3.0, rtol=1e-6)  # of a regular dodecagon: 3 r²


@pytest.mark.parametrize("names", [("o a",), (), ("g a",), ("g a", "g b"), ("o a", "o b"), ("o a", "o a")])
def test_every_piece_is_a_grain_under_one_object_or_two_or_groups_or_nothing(tmp_path, names):
    check_two_cubes(read(tmp_path, two(lambda k: faces(shift=k), lambda k: faces(shift=k), names=names)))


def test_groups_and_materials_part_no_grain(tmp_path):
    body = [line for k, face in enumerate(faces()) for line in (f"g side{k}", f"usemtl m{k}", "s off", face)]
    packing = read(tmp_path, ["mtllib bed.mtl", *vertices(), *body])
    np.testing.assert_allclose(volumes(packing.grains), [1.0], rtol=1e-12)


def test_faces_with_vertices_of_their_own_are_joined_by_place(tmp_path):
    lines = []
    for at in APART:
        for loop in QUADS:
            lines += [f"v {x + at:g} {y:g} {z:g}" for x, y, z in CUBE[np.array(loop) - 1]]
            lines += ["f -4 -3 -2 -1"]
    packing = read(tmp_path, lines)
    check_two_cubes(packing)
    assert np.diff(packing.grains.vertex_offsets).tolist() == [8, 8]


def test_closed_bodies_that_touch_at_the_bit_stay_two(tmp_path):
    lines = [*vertices(0.0), *faces(), *vertices(1.0), *faces(shift=8)]
    packing = read(tmp_path, lines)
    np.testing.assert_allclose(packing.positions[:, 0], [0.5, 1.5])


def test_an_object_of_several_pieces_is_named_in_the_log(tmp_path, caplog):
    lines = two(lambda k: faces(shift=k), lambda k: faces(shift=k), names=("o twins",))
    with caplog.at_level(logging.WARNING):
        packing = read(tmp_path, [*lines, "o alone", *vertices(6.0), *faces(shift=16)])
    assert len(packing) == 3
    [line] = caplog.messages
    assert line.endswith("bed.obj: every piece is a grain of its own; more than one have objects twins (2)")


def test_faces_before_the_first_object_are_a_grain_of_their_own(tmp_path):
    check_two_cubes(read(tmp_path, [*two(lambda k: faces(shift=k), lambda k: faces(shift=k), names=())]))
    lines = [*vertices(0.0), *faces(), "o b", *vertices(1.0), *faces(shift=8)]
    assert len(read(tmp_path, lines)) == 2


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_marks_tabs_comments_and_lines_that_go_on_are_read(tmp_path, end, mark):
    body = [line.replace(" ", "\t") for line in vertices()]
    body[2:3] = ["v 0 \\", "\t1 \\", "0 # the third"]
    loops = faces()
    loops[0] = "f 1 3\\"
    lines = ["o a", "# a path C:\\", *body, "", "   ", loops[0], "  4 2", *loops[1:-1], "f 2 4 8 6\t# the last \\"]
    packing = read(tmp_path, lines, end=end, mark=mark)
    np.testing.assert_allclose(volumes(packing.grains), [1.0], rtol=1e-12)


def test_weights_and_colours_after_a_vertex_are_passed_over(tmp_path):
    packing = read(tmp_path, [*(f"{line} 1.0 0.5 0.5" for line in vertices()), *faces()])
    np.testing.assert_allclose(volumes(packing.grains), [1.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("f 1 2 9", "line 10: a face names vertex 9; the file has 8"),
        ("f 1 2 0", "line 10: a face names vertex 0; they count from 1, or back from -1 to -8"),
        ("f 1 2 -9", "line 10: a face names vertex -9; they count from 1, or back from -1 to -8"),
        ("f 1 2", "line 10: a face has three corners or more; got 2"),
        ("f 1 2 b", "line 10: a corner is a number of a vertex, as v, v/vt, v//vn or v/vt/vn; got ['1', '2', 'b']"),
        ("f 1 2 /3", "line 10: a corner is a number of a vertex"),
        ("v 1 2", "line 10: a vertex has three numbers; got ['1', '2']"),
        ("v 1 2 \\\nx", "line 10: a vertex has three numbers; got ['1', '2', 'x']"),
    ],
)
def test_what_is_no_face_or_vertex_is_refused_with_its_line(tmp_path, line, words):
    with pytest.raises(FileFormatError) as caught:
        read(tmp_path, ["o a", *vertices(), line, *faces()])
    assert str(caught.value).startswith(f"{tmp_path / 'bed.obj'}, {words}")
    assert "\n" not in str(caught.value)


def test_a_first_line_that_names_no_length_is_refused_and_one_that_speaks_of_units_is_a_comment(tmp_path):
    for head in ("# unit", "# unit ten m", "# unit mm", "# unit abc", "# unit 0x10 m", "# unit 0 m", "# unit -1 m"):
        with pytest.raises(FileFormatError, match="the unit in its first line must be a length above 0"):
            read(tmp_path, [head, *vertices(), *faces()])
    for head in ("# a unit cube", "# in SI units", "# made for a unit test"):
        assert volumes(read(tmp_path, [head, *vertices(), *faces()]).grains)[0] == pytest.approx(1)
    assert volumes(read(tmp_path, ["# unit 0.5 m", *vertices(), *faces()]).grains)[0] == pytest.approx(0.125)
