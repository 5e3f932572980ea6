"""What the formats of discrete-element programs share: bodies, rounding, walls, and how they refuse bad input."""

import json
from dataclasses import replace

import format_table
import numpy as np
import pytest
from beds import small_bed, two_grains
from solids import SOLIDS, centred, place, polyhedra, solid
from typer.testing import CliRunner

import exporters
from exporters.dem.bodies import bodies, edges, rounded
from exporters.dem.scene import springs, walls
from grainsdem.cli import app
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import to_matrices, world_vertices
from grainsdem.model import Domain, Packing
from grainsdem.storage import save

FORMATS = {"rockable": ".conf", "lammps": ".in", "yade": ".py", "3dec": ".3ddat", "sdf": ".sdf"}
each_format = pytest.mark.parametrize(("name", "suffix"), FORMATS.items())


@pytest.mark.unit
@pytest.mark.parametrize("name", SOLIDS)
def test_edges_are_each_there_once_and_known_by_both_their_faces(name):
    shape = solid(name)
    found = edges(shape)
    n_vertices, n_faces = len(shape.vertices), shape.n_faces
    assert n_vertices - len(found.ends) + n_faces == 2
    assert found.offsets.tolist() == [0, len(found.ends)]
    assert len(np.unique(found.ends, axis=0)) == len(found.ends)
    assert (found.ends[:, 0] < found.ends[:, 1]).all()
    faces = shape.faces_of(0)
    for ends, sides in zip(found.ends.tolist(), found.faces.tolist(), strict=True):
        assert all(set(ends) <= set(faces[side].tolist()) for side in sides)
    lengths = np.linalg.norm(np.diff(shape.vertices[found.ends], axis=1)[:, 0], axis=1)
    assert lengths == pytest.approx(np.ones(len(lengths)))


@pytest.mark.unit
@pytest.mark.parametrize("name", ["tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron"])
def test_a_rounded_solid_has_the_volume_of_its_inner_parallel_body_swept_by_the_ball(name):
    bed = place(solid(name), [[5.0, 5.0, 5.0]])
    sizes = bodies(bed)
    skin = rounded(bed, sizes, 0.05)
    [r] = skin.radii
    assert r == pytest.approx(0.05 * sizes.diameters[0])
    volume, area, _ = SOLIDS[name][2]
    # Regular: moving all faces in by r scales by 1 - r over the inner radius, which is 3 V / A.
    f = 1 - r * area / (3 * volume)
    dihedral = {
        "tetrahedron": np.arccos(1 / 3), "cube": np.pi / 2, "octahedron": np.arccos(-1 / 3),
        "dodecahedron": 2 * np.arctan((1 + np.sqrt(5)) / 2), "icosahedron": np.arccos(-np.sqrt(5) / 3),
    }[name]  # fmt: skip
    n_edges = len(skin.edges.ends)
    swept = f**3 * volume + f**2 * area * r + n_edges * f * (np.pi - dihedral) * r**2 / 2 + 4 / 3 * np.pi * r**3
    assert skin.volumes[0] == pytest.approx(swept, rel=1e-9)


@pytest.mark.unit
def test_bodies_have_their_centres_of_mass_where_the_packing_s_frames_do_not():
    shapes = polyhedra(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float))
    turn = np.array([[np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
    bed = Packing(shapes, [[5.0, 5.0, 5.0]], turn, [3.0], Domain.cube(10.0))
    sizes = bodies(bed)
    assert sizes.centroids[0] == pytest.approx([0.25, 0.25, 0.25])
    assert sizes.centres[0] == pytest.approx([4.75, 5.25, 5.25])
    assert sizes.masses == pytest.approx([0.5])
    # About the centroid: 3/40 m on the diagonal and 1/80 m off it, so 1/10 along (1, 1, 1) and 1/16 across.
    assert sizes.moments[0] / 0.5 == pytest.approx([1 / 16, 1 / 16, 1 / 10])
    assert np.abs(to_matrices(sizes.axes)[0][:, 2]) == pytest.approx(np.full(3, np.sqrt(1 / 3)))


@pytest.mark.unit
def test_walls_look_at_the_grains_and_reach_beyond_them():
    bed = small_bed(1e-3)
    vertices = world_vertices(bed)
    container = walls(bed, vertices, "box")
    for point, normal, corners in zip(container.centres, container.normals, container.corners(), strict=True):
        assert ((vertices - point) @ normal).min() > 0
        assert np.abs((corners - point) @ normal).max() < 1e-15
        # Counter-clockwise seen from the grains.
        assert np.cross(corners[1] - corners[0], corners[2] - corners[1]) @ normal > 0
        flat = np.delete(np.arange(3), np.abs(normal).argmax())
        assert (corners.min(axis=0)[flat] < vertices.min(axis=0)[flat]).all()
        assert (corners.max(axis=0)[flat] > vertices.max(axis=0)[flat]).all()


@pytest.mark.unit
def test_springs_stop_the_grain_that_needs_the_stiffest_within_its_depth():
    sizes = bodies(two_grains())
    law = springs(sizes, np.array([1e-4, 2e-4]), 0.02, 9.81, steps=50)
    deepest = np.sqrt(2 * sizes.masses * 9.81 * 0.02 / law.stiffness)
    assert (deepest <= np.array([1e-4, 2e-4]) * (1 + 1e-12)).all()
    assert deepest[0] == pytest.approx(1e-4)
    assert law.time_step == pytest.approx(0.02 * np.sqrt(sizes.masses.min() / law.stiffness))


def spoilt(kind):
    """Return two grains of which the second is spoilt, or none."""
    bed = two_grains()
    if kind == "empty":
        nothing = replace(bed.grains, vertices=np.empty((0, 3)), vertex_offsets=[0], face_offsets=[0],
                          face_vertices=np.empty(0, int), face_vertex_offsets=[0])  # fmt: skip
        return Packing(nothing, np.empty((0, 3)), np.empty((0, 4)), [], bed.domain)
    if kind == "vertex":
        vertices = np.array(bed.grains.vertices)
        vertices[-1, 0] = np.nan
        return replace(bed, grains=replace(bed.grains, vertices=vertices))
    if kind == "place":
        return replace(bed, positions=[[4e-3] * 3, [np.inf] * 3])
    if kind == "turn":
        return replace(bed, quaternions=[[1.0, 0, 0, 0], [2.0, 0, 0, 0]])
    return replace(bed, densities=[2500.0, 0.0])


@pytest.mark.unit
@each_format
@pytest.mark.parametrize(
    ("kind", "match"),
    [
        ("empty", "at least one grain; got 0"),
        ("vertex", "must be finite; not so: 1"),
        ("place", "must be finite; not so: 1"),
        ("turn", "unit length; not so: 1"),
        ("density", "must be positive; not so: 1"),
    ],
)
def test_bad_packings_are_refused_with_the_grain_and_nothing_is_left_behind(tmp_path, name, suffix, kind, match):
    with pytest.raises(InputError, match=match):
        exporters.write(spoilt(kind), tmp_path / f"bed{suffix}")
    with pytest.raises(InputError, match=match):
        exporters.write(spoilt(kind), tmp_path / "all", formats=name)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.unit
@pytest.mark.parametrize("suffix", FORMATS.values())
def test_names_that_are_not_one_word_are_refused(tmp_path, suffix):
    for word in ("my bed", "bed;", "$bed", "-in", "bäd"):
        with pytest.raises(InputError, match="letters A-Z and a-z"):
            exporters.write(two_grains(), tmp_path / f"{word}{suffix}")
    with pytest.raises(InputError, match=f"{suffix} has no option colour; it has .*walls"):
        exporters.write(two_grains(), tmp_path / f"bed{suffix}", colour="red")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.unit
@each_format
def test_the_same_bed_gives_the_same_bytes_and_the_same_numbers_wherever_its_stretches_end(name, suffix, monkeypatch):
    bed = small_bed(1e-3)
    whole = exporters.files(bed, name)
    assert whole == exporters.files(bed, suffix)
    monkeypatch.setattr("exporters.check.STRETCH", 4)
    # Commands that name grains come after each stretch of them.
    parts = exporters.files(bed, name)
    assert {key: sorted(value.splitlines()) for key, value in parts.items()} == {
        key: sorted(value.splitlines()) for key, value in whole.items()
    }


@pytest.mark.unit
def test_the_command_line_writes_each_by_suffix_and_all_of_them_by_name(tmp_path):
    save(small_bed(1e-3), tmp_path / "bed.h5")
    files = [str(tmp_path / f"out{suffix}") for suffix in FORMATS.values()]
    done = CliRunner().invoke(app, ["export", str(tmp_path / "bed.h5"), *files, "--json"])
    assert done.exit_code == 0, done.output
    assert {path.name for path in tmp_path.iterdir()} == {
        "bed.h5", "out.conf", "out.shp", "out.in", "out.data", "out.py", "out.npz", "out.3ddat", "out.sdf",
        "out-meshes",
    }  # fmt: skip
    words = [word for name in FORMATS for word in ("--to", name)]
    done = CliRunner().invoke(app, ["export", str(tmp_path / "bed.h5"), str(tmp_path / "all"), *words, "--json"])
    assert done.exit_code == 0, done.output
    manifest = json.loads((tmp_path / "all" / "manifest.json").read_text())
    rows = {row["format"]: row for row in manifest["formats"]}
    assert set(rows) == set(FORMATS)
    assert 0 < rows["rockable"]["report"]["volume_lost"] < 0.01
    assert rows["lammps"]["units"]["length"] == pytest.approx(1e-3)
    assert rows["sdf"]["units"] == {"length": 1.0, "mass": 1.0, "time": 1.0}
    again = CliRunner().invoke(app, ["export", str(tmp_path / "bed.h5"), files[0]])
    assert again.exit_code == 2
    assert "exists already" in again.output


@pytest.mark.unit
def test_the_page_of_formats_has_a_row_for_each_with_its_suffixes():
    page = format_table.PAGE.read_text(encoding="utf-8").partition(format_table.BEGIN)[0]
    rows = {line.split("`")[1]: line.split("|")[1] for line in page.splitlines() if line.startswith("| `")}
    assert set(rows) == set(exporters.FORMATS)
    for name, format_ in exporters.FORMATS.items():
        assert [word for word in rows[name].split("`") if word.startswith(".")] == list(format_.suffixes)


@pytest.mark.unit
def test_the_table_of_programs_is_that_of_the_tests_that_passed():
    told = json.loads(format_table.KEPT.read_text(encoding="utf-8"))
    assert format_table.page(told) == format_table.PAGE.read_text(encoding="utf-8")
    assert {row[0] for row in told["rows"]} | set(format_table.NOT_RUN) == set(exporters.FORMATS)
    assert {word for row in told["rows"] for word in row[3:]} <= set(format_table.DONE)


@pytest.mark.unit
def test_grains_without_symmetry_are_rounded_inside_what_they_were():
    rng = np.random.default_rng(8)
    clouds = [rng.standard_normal((20, 3)) for _ in range(5)]
    shapes = centred(polyhedra(*[cloud / np.linalg.norm(cloud, axis=1)[:, None] for cloud in clouds]))
    bed = place(shapes, 5 + 3 * np.eye(5, 3))
    sizes = bodies(bed)
    skin = rounded(bed, sizes, 0.03)
    assert (skin.volumes < sizes.volumes).all()
    # A ball that rolls inside: the core is within, by a radius, and loses less than an inset alone.

    assert (volumes(skin.cores) < skin.volumes).all()
