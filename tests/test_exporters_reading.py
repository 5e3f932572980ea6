"""Files written, read back as their clients read them, and certified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from typer.testing import CliRunner

import exporters
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import random_quaternions
from grainsdem.measures import diameters
from grainsdem.packing import rescale
from grainsdem.storage import save
from grainsdem.validation import compare, validate

SUFFIXES = [".xml", ".usda", ".usdc", ".stl", ".obj"]


@pytest.fixture(scope="module")
def tilted(fresh):
    """The fresh grains, each turned in place."""
    return replace(fresh, quaternions=random_quaternions(len(fresh), np.random.default_rng(3)), links=None)


def certified(path, **options):
    """Read a file and return it with its report, shapes being as exact as the file is."""
    packing = exporters.read(path)
    shape = exporters.rounding(packing, path.suffix) / diameters(packing.grains).mean()
    return packing, validate(packing, shape=max(1e-9, shape), **options)


@pytest.mark.client
@pytest.mark.parametrize("diameter", [0.2e-3, 1e-3, 0.1])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_bed_survives_its_file(fresh, tmp_path, suffix, diameter):
    bed = rescale(fresh, diameter / diameters(fresh.grains).mean())
    [path, *_] = exporters.write(bed, tmp_path / f"bed{suffix}")
    packing, report = certified(path)
    assert report.ok, report.failed
    assert all(check.ok for check in compare(packing, bed, tolerance=1e-5))
    gap = next(check.worst for check in report.checks if check.name == "smallest gap")
    assert gap > 0


@pytest.mark.client
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_turned_grains_come_back_where_they_were_in_si(poured, tmp_path, suffix):
    [path, *_] = exporters.write(poured, tmp_path / f"bed{suffix}")
    packing = exporters.read(path)
    assert all(check.ok for check in compare(packing, poured, tolerance=1e-5))
    np.testing.assert_allclose(packing.densities, poured.densities, rtol=1e-5)


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".xml", ".usda", ".usdc"])
def test_formats_with_a_container_keep_the_domain_and_the_masses(tilted, tmp_path, suffix):
    heavy = replace(tilted, densities=np.linspace(1000, 8000, len(tilted)))
    [path] = exporters.write(heavy, tmp_path / f"bed{suffix}")
    packing = exporters.read(path)
    np.testing.assert_allclose(packing.domain.lower, heavy.domain.lower, atol=1e-12)
    np.testing.assert_allclose(packing.domain.upper, heavy.domain.upper, rtol=1e-9)
    np.testing.assert_allclose(packing.densities, heavy.densities, rtol=1e-5)


@pytest.mark.unit
def test_ascii_stl_and_binary_without_its_table_have_the_same_grains(tilted, tmp_path):
    exporters.write(tilted, tmp_path / "text.stl", binary=False)
    exporters.write(tilted, tmp_path / "bare.stl")
    (tmp_path / "bare.grains.csv").unlink()
    for name in ("text.stl", "bare.stl"):
        assert all(check.ok for check in compare(exporters.read(tmp_path / name), tilted, tolerance=1e-5))


def ascii_cubes(tmp_path):
    """Return the path of an ASCII STL of three cubes, and its text."""
    cubes = cube_packing([[2.0, 2.0, 2.0], [5.0, 2.0, 2.0], [8.0, 2.0, 2.0]])
    [path] = exporters.write(cubes, tmp_path / "bed.stl", binary=False)
    return path, path.read_text()


def facet(text, solid, number):
    """Return one facet of one solid, as it stands in the text."""
    body = text.split(f"solid g{solid:06d}\n")[1]
    return "  facet" + body.split("  facet")[number + 1].split("endsolid")[0]


def broken_files(tmp_path):
    """Deliberate faults of grain 1: what is written, and the check that names it."""
    path, text = ascii_cubes(tmp_path)
    hit = facet(text, 1, 4)
    lines = hit.splitlines()
    flipped = "\n".join([*lines[:2], lines[3], lines[2], *lines[4:]]) + "\n"
    corner = lines[2].split("vertex ")[1]
    before, body = text.split("solid g000001\n", 1)
    body, after = body.split("endsolid g000001", 1)
    dented = body.replace(f"vertex {corner}\n", "vertex 5 2 2\n")
    shifted = "\n".join(
        f"      vertex {float(w[1]) - 1.5:.9g} {w[2]} {w[3]}" if (w := line.split())[:1] == ["vertex"] else line
        for line in body.splitlines()
    )
    return path, {
        "closed": text.replace(hit, ""),
        "outward": text.replace(hit, flipped),
        "convex": f"{before}solid g000001\n{dented}endsolid g000001{after}",
        "finite": text.replace(f"vertex {corner}\n", "vertex nan 1 1\n", 1),
        "overlaps": f"{before}solid g000001\n{shifted}\nendsolid g000001{after}",
    }


@pytest.mark.unit
@pytest.mark.parametrize("check", ["closed", "outward", "convex", "finite", "overlaps"])
def test_a_broken_surface_is_refused_with_the_grain_named(tmp_path, check):
    path, contents = broken_files(tmp_path)
    path.write_text(contents[check])
    _, report = certified(path)
    failed = {found.name: found.offenders for found in report.failed}
    assert failed[check] in ((1,), ((0, 1),), ((1, 0),))


@pytest.mark.client
def test_usd_with_a_flipped_face_or_shifted_grain_is_refused_with_the_grain_named(tmp_path):
    cubes = cube_packing([[2.0, 2.0, 2.0], [5.0, 2.0, 2.0], [8.0, 2.0, 2.0]])
    [path] = exporters.write(cubes, tmp_path / "bed.usda")
    text = path.read_text()
    head, tail = text.split('def Xform "g000001"', 1)
    path.write_text(head + 'def Xform "g000001"' + tail.replace("[0, 2, 3, 1,", "[0, 1, 3, 2,", 1))
    assert {c.name: c.offenders for c in certified(path)[1].failed}["outward"] == (1,)
    path.write_text(head + 'def Xform "g000001"' + tail.replace("(5, 2, 2)", "(3.5, 2, 2)", 1))
    assert {c.name: c.offenders for c in certified(path)[1].failed}["overlaps"] == ((0, 1),)


@pytest.mark.client
def test_mjcf_with_a_shifted_grain_or_a_nan_is_refused_with_the_grain_named(tmp_path, capfd):
    cubes = cube_packing([[2.0, 2.0, 2.0], [5.0, 2.0, 2.0], [8.0, 2.0, 2.0]])
    [path] = exporters.write(cubes, tmp_path / "bed.xml")
    text = path.read_text()
    body = '<body name="g000001" pos="'
    old = text.split(body)[1].split('"')[0]
    x, y, z = old.split()
    path.write_text(text.replace(f"{body}{old}", f"{body}{0.7 * float(x):.9g} {y} {z}"))
    assert {c.name: c.offenders for c in certified(path)[1].failed}["overlaps"] == ((0, 1),)
    path.write_text(text.replace(f"{body}{old}", f"{body}nan {y} {z}"))
    assert {c.name: c.offenders for c in certified(path)[1].failed}["finite"] == (1,)
    assert "NaN" not in capfd.readouterr().err


@pytest.mark.unit
def test_a_lost_grain_is_told_by_the_comparison(fresh, tmp_path):
    exporters.write(fresh, tmp_path / "bed.obj")
    text = (tmp_path / "bed.obj").read_text()
    kept = text.split("o g000086")[0]
    (tmp_path / "bed.obj").write_text(kept)
    packing = exporters.read(tmp_path / "bed.obj")
    assert [check.ok for check in compare(packing, fresh)] == [False]
    save(fresh, tmp_path / "bed.h5")
    words = ["validate", str(tmp_path / "bed.obj"), "--against", str(tmp_path / "bed.h5")]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 1
    assert "grains: worst 1 too few" in result.stderr


@pytest.mark.unit
def test_a_moved_or_shrunk_grain_is_named_by_the_comparison(fresh):
    positions = fresh.positions.copy()
    positions[7] += 1e-3 * diameters(fresh.grains).mean()
    moved = compare(replace(fresh, positions=positions), fresh)
    assert [check.offenders for check in moved] == [(), (), (7,)]
    vertices = fresh.grains.vertices.copy()
    vertices[: fresh.grains.vertex_offsets[1]] *= 0.999
    shrunk = compare(replace(fresh, grains=replace(fresh.grains, vertices=vertices)), fresh)
    assert [check.offenders for check in shrunk] == [(), (0,), ()]
    assert volumes(fresh.grains)[0] > 0
    with pytest.raises(InputError, match="tolerance must be positive; got 0"):
        compare(fresh, fresh, tolerance=0)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("bed.gltf", b"", "files are read from .xml, .usda, .usdc, .stl, .obj; got '.gltf'"),
        ("bed.stl", b"solid\nendsolid\n", "holds no triangles"),
        ("bed.stl", b"\x00" * 90, "neither ASCII STL nor binary"),
        ("bed.stl", b"solid a\nvertex 1 2\nendfacet\n", "three numbers"),
        ("bed.obj", b"o a\nv 0 0 0\nf 1 2 3\n", "faces name vertices up to 3; there are 1"),
        ("bed.obj", b"o a\nv 0 0 0\nf 1 1 1 1\n", "faces of three"),
        ("bed.xml", b"<mujoco><worldbody/></mujoco>", "holds no grains"),
        ("bed.xml", b"<mujoco>", "MuJoCo does not compile it"),
        ("bed.usda", b"#usda 1.0\n", "holds no grains"),
        ("bed.usda", b"nothing of the kind", "pxr does not open it"),
    ],
)
def test_files_that_hold_no_bed_get_one_clear_error(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileFormatError) as caught:
        exporters.read(tmp_path / name)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.unit
def test_a_file_that_is_not_there_says_so(tmp_path):
    with pytest.raises(MissingFileError, match="no such file"):
        exporters.read(tmp_path / "none.stl")


@pytest.mark.unit
def test_a_table_of_another_surface_is_refused(tilted, tmp_path):
    exporters.write(tilted, tmp_path / "bed.stl")
    (tmp_path / "bed.grains.csv").write_text("grain,first_triangle,n_triangles\n0,0,12\n1,12,12\n")
    with pytest.raises(FileFormatError, match="are not those of the"):
        exporters.read(tmp_path / "bed.stl")
