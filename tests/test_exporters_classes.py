"""The class of every grain in every format, asked of who reads the format where there is one."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import exporters
import grainsdem as gd
from exporters.formats import FORMATS
from grainsdem.errors import InputError

CLASSES = [7, 0, 7, 3, 0]


@pytest.fixture(scope="module")
def bed():
    cells = gd.tessellate(gd.points.poisson(gd.Domain.cube(5e-3), 5, rng=2), gd.Domain.cube(5e-3))
    return replace(gd.shrink(gd.carve(cells, keep="all"), porosity=0.4), classes=CLASSES)


@pytest.fixture(scope="module")
def written(bed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("classes")
    exporters.write(bed, folder, formats=[name for name in FORMATS if name != "openfoam"], name="bed")
    return folder


@pytest.mark.unit
@pytest.mark.parametrize("file", ["bed.xml", "bed.usdc", "bed.usda", "bed.stl", "bed.obj"])
def test_what_is_read_back_has_its_classes(bed, written, file):
    path = written / file
    if not path.exists():
        exporters.write(bed, path)
    assert exporters.read(path).classes.tolist() == CLASSES


@pytest.mark.unit
def test_the_validators_of_openusd_have_nothing_to_say(written):
    pxr = pytest.importorskip("pxr.UsdValidation")
    from pxr import Usd

    validators = pxr.ValidationRegistry().GetOrLoadAllValidators()
    errors = pxr.ValidationContext(validators).Validate(Usd.Stage.Open(str(written / "bed.usdc")))
    assert [error.GetMessage() for error in errors] == []


@pytest.mark.unit
def test_ascii_stl_says_them_after_the_name_of_a_solid(bed, tmp_path):
    path = tmp_path / "bed.stl"
    exporters.write(bed, path, binary=False, units="mm")
    again = exporters.read(path)
    assert again.classes.tolist() == CLASSES
    assert gd.volumes(again) == pytest.approx(gd.volumes(bed), rel=1e-4)


@pytest.mark.unit
@pytest.mark.parametrize("binary", [True, False])
def test_files_of_one_grain_each_say_its_own(bed, tmp_path, binary):
    exporters.write(bed, tmp_path / "bed.stl", per_grain=True, binary=binary)
    found = [exporters.read(path).classes.tolist() for path in sorted((tmp_path / "bed").glob("*.stl"))]
    assert found == [[number] for number in CLASSES]


@pytest.mark.unit
@pytest.mark.parametrize("suffix", [".stl", ".obj", ".xml", ".usda"])
def test_a_bed_without_classes_is_read_back_without(bed, tmp_path, suffix):
    path = tmp_path / f"bed{suffix}"
    exporters.write(replace(bed, classes=None), path)
    assert exporters.read(path).classes is None


@pytest.mark.unit
def test_groups_of_others_in_obj_are_no_classes(tmp_path):
    cube = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ng classy_2\nf 1 3 2\nf 1 2 4\nf 2 3 4\ng class_2\nf 1 4 3\n"
    path = tmp_path / "other.obj"
    path.write_text(cube)
    assert exporters.read(path).classes is None


@pytest.mark.unit
def test_ply_has_them_on_every_vertex(bed, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "bed.ply"
    exporters.write(bed, path)
    raw = trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(np.array(CLASSES)[np.ravel(raw["grain"])], np.ravel(raw["class"]))
    assert set(np.ravel(raw["grain"]).tolist()) == set(range(5))


@pytest.mark.unit
def test_ply_has_them_on_every_polygon(bed, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    path = tmp_path / "bed.ply"
    exporters.write(bed, path, polygons=True, double=False, ids="face")
    assert pyvista.read(path).n_cells == bed.grains.n_faces
    body = path.read_bytes().partition(b"end_header\n")[2][12 * len(bed.grains.vertices) :]
    marks, at = [], 0
    while at < len(body):
        at += 1 + 4 * body[at]
        marks.append(np.frombuffer(body, "<i4", 2, at).tolist())
        at += 8
    assert marks == [[grain, CLASSES[grain]] for grain in range(5) for _ in bed.grains.faces_of(grain)]


@pytest.mark.unit
def test_glb_has_them_in_the_extras_of_its_nodes(written):
    content = (written / "bed.glb").read_bytes()
    nodes = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])["nodes"]
    assert [node["extras"]["class"] for node in nodes[1:]] == CLASSES


@pytest.mark.unit
def test_3mf_has_them_as_part_numbers(written):
    lib3mf = pytest.importorskip("lib3mf")
    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(written / "bed.3mf"))
    objects = model.GetMeshObjects()
    found = []
    while objects.MoveNext():
        found.append(objects.GetCurrentMeshObject().GetPartNumber())
    assert found == [f"class {number}" for number in CLASSES]


@pytest.mark.unit
def test_vtk_and_the_tables_have_a_column(written):
    pyvista = pytest.importorskip("pyvista")
    mesh = pyvista.read(written / "bed.vtp")
    assert np.array_equal(np.array(CLASSES)[mesh.cell_data["id"]], mesh.cell_data["class"])
    with (written / "bed.csv").open() as file:
        assert [int(row["class"]) for row in csv.DictReader(file)] == CLASSES


@pytest.mark.unit
def test_contacts_have_those_of_both_ends(bed, tmp_path):
    graph = gd.contacts(bed, within=2e-3, walls=True)
    gd.write_edges(graph, tmp_path / "edges.csv", packing=bed)
    with (tmp_path / "edges.csv").open() as file:
        rows = [(int(r["i"]), int(r["j"]), int(r["class_i"]), int(r["class_j"])) for r in csv.DictReader(file)]
    assert len(rows) == len(graph) > 5
    assert min(i for i, *_ in rows) < 0
    assert all((a, b) == (CLASSES[i] if i >= 0 else -1, CLASSES[j]) for i, j, a, b in rows)
    networkx = pytest.importorskip("networkx")
    gd.write_edges(graph, tmp_path / "edges.graphml", packing=bed)
    nodes = networkx.read_graphml(tmp_path / "edges.graphml").nodes(data=True)
    assert [nodes[str(k)]["class"] for k in range(5)] == CLASSES


@pytest.mark.unit
def test_gmsh_has_a_physical_group_for_each(written):
    # Numbers of groups follow the classes, from the lowest on.
    assert '2 1 "class_0"\n2 2 "class_3"\n2 3 "class_7"\n' in (written / "bed.msh").read_text()
    script = (written / "bed.geo").read_text()
    assert 'Physical Volume("class_0", 1) = {2,5};' in script
    assert 'Physical Volume("class_7", 3) = {1,3};' in script


@pytest.mark.unit
def test_rockable_has_a_group_for_each_and_a_law_for_each_pair(written):
    text = (written / "bed.conf").read_text()
    assert "# group 1 is class 0, group 2 is class 3, group 3 is class 7\n" in text
    found = re.findall(r"^g\d{6} (\d+) ", text, re.MULTILINE)
    assert found == ["3", "1", "3", "2", "1"]
    pairs = re.findall(r"^knContact (\d+) (\d+) ", text, re.MULTILINE)
    assert sorted(pairs) == [(str(a), str(b)) for a in range(4) for b in range(max(a, 1), 4)]


@pytest.mark.unit
def test_lammps_has_a_type_for_each(written):
    text = (written / "bed.data").read_text()
    assert "3 atom types" in text
    assert "type 1 is class 0; type 2 is class 3; type 3 is class 7" in text.partition("\n")[0]
    atoms = text.partition("Atoms # body\n\n")[2].partition("\n\n")[0].splitlines()
    assert [line.split()[1] for line in atoms] == ["3", "1", "3", "2", "1"]


@pytest.mark.unit
def test_yade_3dec_and_sdformat_say_them_in_words_of_their_own(written):
    assert np.load(written / "bed.npz")["classes"].tolist() == CLASSES
    commands = (written / "bed.3ddat").read_text()
    found = re.findall(r"block group 'class_(\d+)' slot 'class' range group 'g(\d+)' slot 'grain'", commands)
    assert [(int(number), int(grain)) for number, grain in found] == list(zip(CLASSES, range(5), strict=True))
    world = (written / "bed.sdf").read_text()
    assert re.findall(r'<visual name="class_(\d+)">', world) == [str(number) for number in CLASSES]


@pytest.mark.unit
def test_every_format_carries_them_or_says_that_it_does_not(bed):
    plain, told = replace(bed, classes=None), []
    for name in FORMATS:
        if name == "openfoam":
            continue
        module = exporters.formats.find(name).module
        contents = [
            {file: content if isinstance(content, bytes) else b"".join(content) for file, content in made.items()}
            for made in (module.files(packing, name="bed") for packing in (plain, bed))
        ]
        told += [name] if contents[0] != contents[1] else []
    assert told == [name for name in FORMATS if name != "openfoam"]
    assert any("class" in line for line in exporters.formats.find("openfoam").module.LOSES)


@pytest.mark.unit
def test_colours_by_class_are_as_many_and_need_classes(bed):
    colours = exporters.container.colours_of(bed, gd.volumes(bed), "class")
    assert len(np.unique(colours, axis=0)) == 3
    assert np.array_equal(colours[0], colours[2])
    with pytest.raises(InputError, match="the grains have no classes to be coloured by"):
        exporters.container.colours_of(replace(bed, classes=None), gd.volumes(bed), "class")


@pytest.mark.unit
def test_a_render_has_a_step_of_its_scale_for_each(bed):
    from grainsdem.figures.scene import set_scene

    scene = set_scene(bed, "class")
    assert scene.steps == ("0", "3", "7")
    assert scene.values.tolist() == [2, 0, 2, 1, 0]
    assert scene.limits == (-0.5, 2.5)
    many = set_scene(replace(bed, classes=[1, 2, 3, 4, 5]), "diameter")
    assert many.steps == ()
