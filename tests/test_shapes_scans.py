"""Shapes from files: what a hull adds, what is cut off, and odd files."""

import logging

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grainsdem as gd
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.geometry.hulls import convex_hull, outline
from grainsdem.shapes.simplifying import simplified


def _stone(seed=0, subdivisions=4, rough=0.015):
    """Return a bumpy stone as trimesh's mesh: not convex."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    rng = np.random.default_rng(seed)
    waves = np.sin(ball.vertices @ rng.normal(0, 9, (3, 4)) + rng.uniform(0, 6, 4)).sum(axis=1)
    points = ball.vertices * (1 + rough * waves[:, None]) * [2.0, 1.5, 1.0] + [30.0, -20.0, 5.0]
    return trimesh.Trimesh(points, ball.faces, process=False)


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_a_scan_becomes_a_shape_as_heavy_whose_changes_are_those_that_trimesh_finds(tmp_path, suffix):
    import trimesh

    stone = _stone()
    stone.export(tmp_path / f"stone{suffix}")
    found = gd.shapes.read(tmp_path / f"stone{suffix}", unit=1e-3, n_vertices=40)
    assert found.names == (f"stone{suffix}",)
    assert found.volumes[0] == pytest.approx(stone.volume * 1e-9, rel=1e-5)
    assert found.added[0] == pytest.approx(stone.convex_hull.volume / stone.volume - 1, abs=1e-5)
    assert 0.01 < found.added[0] < 0.1
    assert len(found.shapes.vertices) <= 40
    assert gd.volumes(found.shapes)[0] == pytest.approx(found.volumes[0], rel=1e-12)
    assert np.abs(gd.centroids(found.shapes)).max() < 1e-12
    # Corners of the scan itself: the share cut off is that of the two hulls.
    left = gd.shapes.read(tmp_path / f"stone{suffix}", unit=1e-3, n_vertices=40, keep="corners")
    inner = trimesh.Trimesh(left.shapes.vertices * 1e3, process=False).convex_hull
    assert left.cut[0] == pytest.approx(1 - inner.volume / stone.convex_hull.volume, abs=1e-5)
    shifts = left.shapes.vertices[0] * 1e3 - stone.vertices
    on_scan = [np.abs(stone.vertices + s - left.shapes.vertices[1] * 1e3).max(axis=1).min() for s in shifts]
    assert min(on_scan) < 1e-4


@pytest.mark.unit
def test_a_convex_file_of_few_corners_is_read_as_it_is(tmp_path):
    shape = gd.shapes.platonic("dodecahedron")
    _written(tmp_path / "die.stl", shape)
    found = gd.shapes.read(tmp_path / "die.stl")
    assert len(found.shapes.vertices) == 20
    assert (found.added[0], found.cut[0]) == pytest.approx((0.0, 0.0), abs=1e-6)
    near = np.linalg.norm(found.shapes.vertices[:, None] - shape.vertices, axis=2).min(axis=1)
    assert near.max() < 1e-6


@pytest.mark.property
@settings(max_examples=20)
@given(st.integers(0, 2**32), st.integers(4, 60))
def test_what_is_cut_off_is_exact_falls_with_corners_and_the_shape_lies_inside(seed, most):
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((300, 3)) * [3.0, 2.0, 1.0]
    whole = outline(points)
    shape, cut = simplified(whole, most)
    assert len(shape.vertices) <= most
    assert cut == pytest.approx(1 - gd.volumes(shape)[0] / whole.volume, abs=1e-12)
    assert 0 <= cut < 1
    planes = gd.face_planes(convex_hull(points))
    beyond = (shape.vertices @ planes.normals.T - planes.heights).max()
    assert beyond < 1e-9
    assert simplified(whole, most + 10).cut <= cut + 1e-12


@pytest.mark.unit
def test_a_folder_is_a_library_and_bodies_of_a_file_are_shapes_each(tmp_path):
    cubes = gd.shapes.together(gd.shapes.platonic("cube"), gd.shapes.box(3, 2, 1))
    _written(tmp_path / "b.stl", cubes, [[0, 0, 0], [9, 0, 0]])
    _written(tmp_path / "a.ply", gd.shapes.platonic("octahedron"))
    (tmp_path / "notes.txt").write_text("nothing")
    found = gd.shapes.read(tmp_path)
    assert found.names == ("a.ply", "b.stl#0", "b.stl#1")
    assert len(found) == 3
    assert found.volumes == pytest.approx([np.pi / 6, np.pi / 6, 6.0], rel=1e-6)


@pytest.mark.unit
def test_bodies_that_touch_at_a_corner_are_two(tmp_path):
    both = gd.shapes.together(gd.shapes.box(1, 1, 1), gd.shapes.box(1, 1, 1))
    _written(tmp_path / "two.stl", both, [[0, 0, 0], [1, 1, 1]])
    assert len(gd.shapes.read(tmp_path / "two.stl")) == 2


@pytest.mark.unit
def test_what_is_inside_out_is_turned_and_said(tmp_path, caplog):
    _written(tmp_path / "out.stl", gd.shapes.box(1, 2, 3), inward=True)
    with caplog.at_level(logging.WARNING, logger="grainsdem"):
        found = gd.shapes.read(tmp_path / "out.stl")
    assert gd.volumes(found.shapes)[0] == pytest.approx(6.0)
    assert "out.stl: inside out, and turned" in caplog.text


@pytest.mark.unit
def test_a_file_in_millimetres_is_wondered_at(tmp_path, caplog):
    _written(tmp_path / "big.stl", gd.shapes.platonic("cube", diameter=40.0))
    gd.shapes.read(tmp_path / "big.stl")
    assert "unit=1e-3 says millimetres" in caplog.text


@pytest.mark.unit
def test_what_is_not_convex_is_refused_or_hulled(tmp_path):
    import trimesh

    flat = [trimesh.creation.box((1, 1, 1)).apply_translation(t) for t in ([0, 0, 0], [1, 0, 0], [0, 1, 0])]
    bracket = trimesh.boolean.union(flat, engine="manifold")
    bracket.export(tmp_path / "l.stl")
    with pytest.raises(InputError, match=r"l\.stl: not convex: its hull adds 17% to its volume, and 10% may be"):
        gd.shapes.read(tmp_path / "l.stl")
    found = gd.shapes.read(tmp_path / "l.stl", concave="hull")
    assert found.added[0] == pytest.approx(1 / 6)
    assert gd.volumes(found.shapes)[0] == pytest.approx(3.0)


@pytest.mark.unit
def test_odd_files_are_refused_in_a_line(tmp_path):
    brick = gd.shapes.box(1, 2, 3)
    _written(tmp_path / "open.stl", brick, leave_out=1)
    _written(tmp_path / "twisted.stl", brick, twist=3)
    flat = brick.vertices * [1, 1, 0]
    _written(tmp_path / "flat.ply", gd.Polyhedra(flat, *_rest(brick)))
    inner = gd.shapes.together(gd.shapes.platonic("cube", diameter=3.0), gd.shapes.platonic("cube"))
    _written(tmp_path / "hollow.stl", inner, [[0, 0, 0], [0, 0, 0]], inward=[False, True])
    (tmp_path / "empty.stl").write_bytes(b"")
    (tmp_path / "none.stl").write_bytes(bytes(84))
    (tmp_path / "words.obj").write_text("these are no faces\n")
    (tmp_path / "broken.ply").write_text("ply\nformat ascii 1.0\nelement vertex three\n")
    (tmp_path / "far.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    (tmp_path / "nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "nothing").mkdir()
    cases = {
        "open.stl": "open: edges that do not part two faces",
        "twisted.stl": "wound both ways",
        "flat.ply": "flat: it encloses no volume",
        "hollow.stl": "of 2 bodies 1: hollow",
        "empty.stl": "holds no faces",
        "none.stl": "holds no faces",
        "words.obj": "words.obj",
        "broken.ply": "not a PLY file that can be read",
        "far.obj": "far.obj",
        "nan.obj": "not finite",
        "a.docx": r"read from .stl, .obj, .ply or a folder; got '.docx'",
    }
    for name, words in cases.items():
        with pytest.raises(FileFormatError, match=words) as caught:
            gd.shapes.read(tmp_path / name)
        assert "\n" not in str(caught.value)
        assert name in str(caught.value)
    for name, words in {"gone.stl": "no such file", "nothing": "a folder without shapes"}.items():
        with pytest.raises(MissingFileError, match=words):
            gd.shapes.read(tmp_path / name)
    for options, words in (
        ({"unit": 0}, "unit must be positive"),
        ({"n_vertices": 3}, "4 corners or more"),
        ({"concave": "yes"}, "concave must be 'refuse' or 'hull'"),
        ({"keep": "all"}, "keep must be 'volume' or 'corners'"),
    ):
        with pytest.raises(InputError, match=words):
            gd.shapes.read(tmp_path / "open.stl", **options)


@pytest.mark.unit
@pytest.mark.slow
def test_a_scan_of_a_million_triangles_has_the_volume_of_its_hull_within_a_ten_thousandth(tmp_path):
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=8)
    ball.vertices *= [1.0, 0.7, 0.05]
    ball.export(tmp_path / "ball.stl")
    found = gd.shapes.read(tmp_path / "ball.stl", keep="corners")
    cut = 1 - gd.volumes(found.shapes)[0] / ball.volume
    assert found.cut[0] == pytest.approx(cut, abs=1e-4)


def _rest(shape):
    return shape.vertex_offsets, shape.face_offsets, shape.face_vertices, shape.face_vertex_offsets


def _written(path, shapes, shifts=None, *, inward=False, leave_out=0, twist=None):
    """Write shapes as triangles by trimesh: some turned inside out, some without their last faces, one turned."""
    import trimesh

    n = len(shapes)
    shifts = np.zeros((n, 3)) if shifts is None else np.asarray(shifts, float)
    points, triangles, first = [], [], 0
    for i in range(n):
        own = [[f[0], f[k], f[k + 1]] for f in shapes.faces_of(i) for k in range(1, len(f) - 1)]
        own = np.array(own)[:, ::-1] if np.broadcast_to(inward, n)[i] else np.array(own)
        points.append(shapes.vertices_of(i) + shifts[i])
        triangles.append(own + first)
        first += len(points[-1])
    faces = np.concatenate(triangles)
    if twist is not None:
        faces[twist] = faces[twist][::-1]
    trimesh.Trimesh(np.concatenate(points), faces[: len(faces) - leave_out], process=False).export(path)
