"""Files written, read back as their clients read them, and certified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from conftest import cube_packing
from typer.testing import CliRunner

import exporters
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import random_quaternions
from grainsdem.measures import diameters
from grainsdem.model import Domain
from grainsdem.packing import carve, rescale, shrink
from grainsdem.points import poisson
from grainsdem.storage import save
from grainsdem.tessellation import tessellate
from grainsdem.validation import compare, validate

SUFFIXES = [".xml", ".usda", ".usdc", ".usdz", ".stl", ".obj"]


CORNERS = "0 0 0  1 0 0  0 1 0  0 0 1"
TWO_MESHES = f"""<mujoco><asset><mesh name="t" vertex="{CORNERS}"/></asset><worldbody><body name="pair"><freejoint/>
<geom type="mesh" mesh="t"/><geom type="mesh" mesh="t" pos="5 0 0"/></body></worldbody></mujoco>""".encode()
TWO_SHAPES = b"""#usda 1.0
(
    metersPerUnit = 1
)
def Xform "pair" (prepend apiSchemas = ["PhysicsRigidBodyAPI"])
{
    def Mesh "one"
    {
    }
    def Mesh "two"
    {
    }
}
"""


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


@pytest.fixture(scope="module", params=["periodic", "planar"])
def unusual(request):
    """Grains that reach over periodic boundaries, and prisms of a planar bed."""
    domain = {
        "periodic": Domain(np.zeros(3), np.full(3, 6e-3), np.array([True, True, False])),
        "planar": Domain.slab((6e-3, 6e-3), 5e-4),
    }[request.param]
    return shrink(carve(tessellate(poisson(domain, 90, rng=1), domain)), porosity=0.4)


@pytest.mark.client
@pytest.mark.parametrize("units", ["si", "grain"])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_periodic_beds_and_prisms_survive_their_files_in_any_units(unusual, tmp_path, suffix, units):
    [path, *_] = exporters.write(unusual, tmp_path / f"bed{suffix}", units=units)
    packing, report = certified(path)
    assert all(check.ok for check in compare(packing, unusual, tolerance=1e-5))
    wanted = {"overlaps", "overlap depth", "closed", "outward", "convex", "finite"}
    assert all(check.ok for check in report.checks if check.name in wanted)


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
    (tmp_path / "bare.triangles.csv").unlink()
    for name in ("text.stl", "bare.stl"):
        assert all(check.ok for check in compare(exporters.read(tmp_path / name), tilted, tolerance=1e-5))


@pytest.mark.client
def test_mujoco_prints_nothing_of_its_own_where_a_place_is_no_number(tmp_path, capfd):
    [path] = exporters.write(cube_packing([[2.0, 2.0, 2.0], [5.0, 2.0, 2.0]]), tmp_path / "bed.xml")
    text = path.read_text()
    place = text.split('<body name="g000001" pos="')[1].split('"')[0]
    path.write_text(text.replace(place, "nan 1 1"))
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
        ("bed.gltf", b"", "files are read from .xml, .usda, .usdc, .usdz, .stl, .obj; got '.gltf'"),
        ("bed.stl", b"solid\nendsolid\n", "holds no faces"),
        ("bed.stl", b"\x00" * 90, "neither ASCII STL nor binary"),
        ("bed.stl", b"solid a\nvertex 1 2\nendfacet\n", "bed.stl, line 2: a vertex has three numbers; got ['1', '2']"),
        ("bed.stl", b"solid a\nvertex 1 2 x\nendfacet\n", "line 2: a vertex has three numbers; got ['1', '2', 'x']"),
        ("bed.stl", b"solid a\nvertex 1 2 3\nendfacet\n", "bed.stl, line 3: a facet has three vertices"),
        ("bed.obj", b"o a\n", "bed.obj: holds no faces"),
        ("bed.xml", b"<mujoco><worldbody/></mujoco>", "holds no grains"),
        ("bed.xml", b"<mujoco>", "MuJoCo does not compile it"),
        ("bed.xml", TWO_MESHES, "a grain is a body with one mesh; not so: pair"),
        ("bed.usda", b"#usda 1.0\n", "holds no grains"),
        ("bed.usda", TWO_SHAPES, "a grain is a body with one mesh; not so: /pair"),
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
    (tmp_path / "bed.triangles.csv").write_text("grain,first_triangle,n_triangles\n0,0,12\n1,12,12\n")
    with pytest.raises(FileFormatError, match="are not those of the"):
        exporters.read(tmp_path / "bed.stl")


def solid(name, *bodies):
    """Return a solid of ASCII STL, its cubes of edge one standing at the given places along x."""
    triangles = trimesh.creation.box().triangles
    facets = [
        f"facet normal 0 0 0\nouter loop\n{corners}\nendloop\nendfacet"
        for at in bodies
        for triangle in triangles + np.array([at, 0, 0])
        for corners in ["\n".join("vertex {:g} {:g} {:g}".format(*corner) for corner in triangle)]
    ]
    return "\n".join([f"solid {name}", *facets, f"endsolid {name}", ""])


@pytest.mark.unit
@pytest.mark.parametrize("change", [str, str.upper, lambda text: "\ufeff" + text.replace("\n", "\r\n")])
def test_a_solid_that_holds_several_bodies_is_several_grains(tmp_path, caplog, change):
    path = tmp_path / "bed.stl"
    path.write_bytes(change(solid("all", 0, 2, 4)).encode())
    packing = exporters.read(path)
    np.testing.assert_allclose(packing.positions[:, 0], [0, 2, 4], atol=1e-12)
    np.testing.assert_allclose(volumes(packing.grains), 1, rtol=1e-12)
    assert not caplog.messages
    path.write_bytes(change(solid("a", 0, 2) + solid("b", 4)).encode())
    np.testing.assert_allclose(exporters.read(path).positions[:, 0], [0, 2, 4], atol=1e-12)
    [line] = caplog.messages
    assert line.lower().endswith("more than one have solids a (2)")


@pytest.mark.unit
def test_solids_that_touch_at_the_bit_stay_two_grains(tmp_path):
    path = tmp_path / "bed.stl"
    path.write_text(solid("a", 0) + solid("b", 1))
    np.testing.assert_allclose(exporters.read(path).positions[:, 0], [0, 1], atol=1e-12)
