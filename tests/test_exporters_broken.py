"""A deliberately broken file of each kind is refused on the command line, with the grain named."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
from conftest import cube_packing
from typer.testing import CliRunner

import exporters
from exporters.meshes.stl import RECORD
from grainsdem.cli import app
from grainsdem.storage import save

pytestmark = pytest.mark.client

# The check that each fault fails, and whom it names: grain 1 of three cubes in a row, or the pair that it is in.
FAULTS = {
    "flipped face": ("outward", [1]),
    "missing triangle": ("closed", [1]),
    "not convex": ("convex", [1]),
    "not a number": ("finite", [1]),
    "shifted into another": ("overlaps", [[0, 1]]),
}
STEP = -1.5
"""How far grain 1 is shifted along x; there is one unit between the cubes of edge two."""


def break_h5(path, fault):
    with h5py.File(path, "r+") as file:
        grains = file["grains"]
        v, f, c = 8, 6, 24  # of each cube
        if fault == "flipped face":
            grains["face_vertices"][c : c + 4] = grains["face_vertices"][c : c + 4][::-1]
        elif fault == "missing triangle":
            # One quad becomes a triangle: half of it is gone.
            rest = {
                "face_vertices": np.delete(grains["face_vertices"][:], c),
                "face_vertex_offsets": grains["face_vertex_offsets"][:] - (np.arange(3 * f + 1) > f),
            }
            for name, values in rest.items():
                del grains[name]
                grains[name] = values
        elif fault == "shifted into another":
            file["positions"][1, 0] += STEP
        else:
            grains["vertices"][v + 7] = 0.1 if fault == "not convex" else np.nan


def break_xml(path, fault):
    text = path.read_text()
    mesh = text.split('<mesh name="g000001" ')[1].split("/>")[0]
    place = text.split('<body name="g000001" pos="')[1].split('"')[0]
    vertices = mesh.split('vertex="')[1].split('"')[0]
    faces = mesh.split('face="')[1].split('"')[0]
    words, corners = vertices.split(), faces.split()
    if fault == "flipped face":
        changed = mesh.replace(faces, " ".join([*corners[2::-1], *corners[3:]]))
    elif fault == "missing triangle":
        changed = mesh.replace(faces, " ".join(corners[3:]))
    elif fault == "not convex":
        changed = mesh.replace(vertices, " ".join([*words[:-3], "0.1", "0.1", "0.1"]))
    else:
        x, *rest = place.split()
        x = "nan" if fault == "not a number" else f"{float(x) * (5 + STEP) / 5:.9g}"
        path.write_text(text.replace(place, " ".join([x, *rest])))
        return
    path.write_text(text.replace(f'<mesh name="g000001" {mesh}', f'<mesh name="g000001" {changed}'))


def break_usd(path, fault):
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    body = stage.GetPrimAtPath("/World/Grains/g000001")
    mesh = UsdGeom.Mesh(body.GetChild("shape"))
    points, corners = mesh.GetPointsAttr(), mesh.GetFaceVertexIndicesAttr()
    if fault == "flipped face":
        indices = list(corners.Get())
        corners.Set([*indices[3::-1], *indices[4:]])
    elif fault == "missing triangle":
        corners.Set(list(corners.Get())[1:])
        mesh.GetFaceVertexCountsAttr().Set([3, 4, 4, 4, 4, 4])
    elif fault == "shifted into another":
        move = body.GetAttribute("xformOp:translate")
        move.Set(move.Get() + Gf.Vec3d(STEP, 0, 0))
    else:
        points.Set([*list(points.Get())[:-1], Gf.Vec3f(0.1 if fault == "not convex" else np.nan)])
    stage.GetRootLayer().Save()


def break_binary_stl(path, fault):
    content = path.read_bytes()
    records = np.frombuffer(content, RECORD, offset=84).copy()
    corners = records["corners"][12:24]
    if fault == "flipped face":
        corners[0] = corners[0, ::-1]
    elif fault == "missing triangle":
        records = np.delete(records, 12)
        # The table beside it goes: which triangles are one grain's follows from the vertices that they share.
        path.with_name("bed.triangles.csv").unlink()
    elif fault == "shifted into another":
        corners[..., 0] += STEP
    elif fault == "not convex":
        corners[(corners == corners.max(axis=(0, 1))).all(axis=2)] = [5.1, 2.1, 2.1]
    else:
        corners[3, 1, 2] = np.nan
    path.write_bytes(content[:80] + len(records).to_bytes(4, "little") + records.tobytes())


def break_lines(path, fault, start, stop, vertex, face):
    """Break a text file between two marks: vertices are words after ``vertex``, faces what ``face`` finds."""
    before, rest = path.read_text().split(start, 1)
    body, after = rest.split(stop, 1)
    lines = body.splitlines(keepends=True)
    if fault in ("flipped face", "missing triangle"):
        lines = face(lines, fault)
    corners = [k for k, line in enumerate(lines) if line.split()[:1] == [vertex]]
    for k in corners:
        x, y, z = map(float, lines[k].split()[1:])
        if fault == "shifted into another":
            lines[k] = f"{vertex} {x + STEP:.9g} {y:.9g} {z:.9g}\n"
        elif fault == "not convex" and (x, y, z) == (6, 3, 3):
            lines[k] = f"{vertex} 5.1 2.1 2.1\n"
    if fault == "not a number":
        lines[corners[2]] = f"{vertex} nan 1 1\n"
    path.write_text("".join([before, start, *lines, stop, after]))


def break_text_stl(path, fault):
    def face(lines, fault):
        # A facet is seven lines; its corners are the third to the fifth.
        return [*lines[:2], *lines[4:1:-1], *lines[5:]] if fault == "flipped face" else lines[7:]

    break_lines(path, fault, "solid g000001\n", "endsolid g000001", "vertex", face)


def break_obj(path, fault):
    def face(lines, fault):
        first = next(k for k, line in enumerate(lines) if line.startswith("f"))
        _, a, b, c = lines[first].split()
        return [*lines[:first], *([f"f {a} {c} {b}\n"] if fault == "flipped face" else []), *lines[first + 1 :]]

    break_lines(path, fault, "o g000001\n", "o g000002", "v", face)


KINDS = {
    "bed.h5": (break_h5, {}),
    "bed.xml": (break_xml, {}),
    "bed.usda": (break_usd, {}),
    "bed.usdc": (break_usd, {}),
    "bed.stl": (break_binary_stl, {}),
    "text.stl": (break_text_stl, {"binary": False}),
    "bed.obj": (break_obj, {}),
}


def written(folder, kind):
    """Write three sound cubes and return the file's path."""
    cubes = cube_packing([[2.0, 2.0, 2.0], [5.0, 2.0, 2.0], [8.0, 2.0, 2.0]])
    path = folder / kind
    if path.suffix == ".h5":
        save(cubes, path)
    else:
        exporters.write(cubes, path, **KINDS[kind][1])
    return path


def judged(path):
    return CliRunner().invoke(app, ["validate", str(path), "--json"])


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_file_unbroken_passes(tmp_path, kind):
    assert judged(written(tmp_path, kind)).exit_code == 0


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_broken_file_is_refused_with_the_grain_named(tmp_path, kind, fault):
    path = written(tmp_path, kind)
    KINDS[kind][0](path, fault)
    result = judged(path)
    assert result.exit_code == 1, result.output
    check, named = FAULTS[fault]
    found = {each["name"]: each for each in json.loads(result.stdout)["checks"]}
    assert not found[check]["ok"]
    assert found[check]["offenders"] == named
    assert f"{check}:" in result.stderr
    if fault == "missing triangle":
        assert found[check]["worst"] == 3
