"""Files of points as programs write them: the seeds in them are read, or one line says how to write them."""

from __future__ import annotations

import codecs
import csv

import numpy as np
import pandas as pd
import pytest

from grainsdem import recipe as recipes
from grainsdem.errors import FileFormatError
from grainsdem.model import Domain
from grainsdem.points import poisson, read, write
from grainsdem.survey import read as read_survey

pytestmark = pytest.mark.unit

SEEDS = np.round(poisson(Domain.cube(), 12, rng=3), 6)
FRAME = pd.DataFrame(SEEDS, columns=["x", "y", "z"])


def written(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def rows(pattern="{} {} {}", seeds=SEEDS, end="\n"):
    return "".join(pattern.format(*(repr(float(value)) for value in seed)) + end for seed in seeds)


@pytest.mark.parametrize("suffix", [".csv", ".txt"])
@pytest.mark.parametrize(
    ("encoding", "mark"),
    [("utf-8-sig", b""), ("utf-16", b""), ("utf-16-be", codecs.BOM_UTF16_BE), ("utf-32", b""), ("utf-8", b"")],
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_no_seed_is_lost_to_a_byte_order_mark_or_to_the_ends_of_lines(tmp_path, suffix, encoding, mark, end):
    separator = "," if suffix == ".csv" else " "
    text = rows(separator.join(["{}"] * 3), end=end)
    np.testing.assert_array_equal(read(written(tmp_path / f"a{suffix}", mark + text.encode(encoding))), SEEDS)


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".csv", ".txt"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"index": False, "encoding": "utf-8-sig"},
        {"sep": ";", "decimal": ",", "encoding": "utf-16"},
        {"sep": "\t", "decimal": ",", "index": False},
        {"sep": ";", "index_label": "Nr."},
        {"sep": " ", "index_label": "id", "quoting": csv.QUOTE_ALL},
        {"index": False, "header": False, "quoting": csv.QUOTE_ALL},
        {"index": False, "header": False, "sep": ";", "decimal": ","},
        {"index": False, "header": False, "decimal": ",", "quoting": csv.QUOTE_ALL},
    ],
    ids=str,
)
def test_what_pandas_writes_is_read(tmp_path, suffix, options):
    FRAME.to_csv(tmp_path / f"a{suffix}", **options)
    np.testing.assert_array_equal(read(tmp_path / f"a{suffix}"), SEEDS)


@pytest.mark.client
@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        (".csv", {"delimiter": ","}),
        (".txt", {"delimiter": ", ", "header": "made on a Monday, with care\nx y z"}),
        (".dat", {"delimiter": "\t", "fmt": "%+.6e"}),
        (".txt", {"comments": "% ", "header": "a comment of Matlab's"}),
    ],
)
def test_what_numpy_writes_is_read(tmp_path, suffix, options):
    np.savetxt(tmp_path / f"a{suffix}", SEEDS, **options)
    np.testing.assert_allclose(read(tmp_path / f"a{suffix}"), SEEDS, rtol=1e-6)


@pytest.mark.client
def test_points_that_paraview_writes_are_found_among_their_values(tmp_path):
    import pyvista
    from vtkmodules.vtkIOCore import vtkDelimitedTextWriter

    cloud = pyvista.PolyData(SEEDS)
    table = pyvista.Table(np.column_stack([np.arange(12), SEEDS, 7 * SEEDS]))
    for k, name in enumerate(["ids", "Points:0", "Points:1", "Points:2", "v:0", "v:1", "v:2"]):
        table.GetColumn(k).SetName(name)
    writer = vtkDelimitedTextWriter()
    writer.SetInputData(table)
    writer.SetFileName(str(tmp_path / "a.csv"))
    writer.Write()
    assert cloud.n_points == len(SEEDS)
    np.testing.assert_allclose(read(tmp_path / "a.csv"), SEEDS, rtol=1e-6)


HYDROGEN = "".join(f"H {line}\n" for line in rows().splitlines())


@pytest.mark.parametrize(
    "text",
    [
        f"12\na comment, with 1 2 3 and ; and\ttabs\n{HYDROGEN}",
        f"12\n\n{HYDROGEN}\n\n",
        "12\n# of a program\n" + "".join(f"6\t{line}\n" for line in rows("{}\t{}\t{}").splitlines()),
        f"  12\n\n{rows('C {} {} {} -0.25')}",
        f'12\nLattice="1 0 0 0 1 0 0 0 1" Properties=id:I:1:species:S:1:pos:R:3:v:R:1\n{rows("5 Si {} {} {} 9.0")}',
        f"12\n{rows()}",
        f"3 \n12\n{rows()}",
        HYDROGEN,
    ],
    ids=["xyz", "no comment", "atomic numbers", "charges", "extended", "count", "qhull", "no count"],
)
@pytest.mark.parametrize("suffix", [".xyz", ".txt"])
def test_the_xyz_format_is_read(tmp_path, suffix, text):
    np.testing.assert_array_equal(read(written(tmp_path / f"a{suffix}", text)), SEEDS)


@pytest.mark.parametrize(
    "text",
    [
        "id,x,y,z\n" + "".join(f"{k},{line}\n" for k, line in enumerate(rows("{},{},{}").splitlines())),
        "# grain pos_x pos_y pos_z radius\n" + rows("4 {} {} {} 0.5"),
        "z;y;x\n" + rows("{2};{1};{0}"),
        "X [mm],Y [mm],Z [mm],normal x,vx\n" + rows("{},{},{},1,2"),
        "Position X,Position Y,Position Z,Unit,Category\n" + rows("{},{},{},um,Spot"),
        '"x" "y" "z"\n' + rows('"1" {} {} {}'),
        "sep=;\nx;y;z;\n" + rows("{};{};{};"),
        "size of the box in µm\n\n" + rows("   {}   {}  {}"),
        "CentroidX;CentroidY;CentroidZ;d\n" + rows("{};{};{};1").replace(".", ","),
        "a,b,c\n" + rows("{},{},{}"),
        rows("{}D+00 {}d0 {}D0"),
    ],
    ids=["id", "comment", "order", "units", "imaris", "R", "excel", "title", "decimal commas", "no names", "fortran"],
)
def test_columns_are_found_by_their_names(tmp_path, text):
    np.testing.assert_array_equal(read(written(tmp_path / "a.csv", text.encode("latin-1"))), SEEDS)


def test_points_of_two_columns_are_found_beside_ids(tmp_path):
    text = "no;x;y\n" + "".join(f"{k};{x};{y}\n" for k, (x, y, _) in enumerate(SEEDS, 1))
    np.testing.assert_array_equal(read(written(tmp_path / "a.csv", text)), SEEDS[:, :2])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (rows("7 {} {} {}"), r"got 4 columns: which columns are x, y and z\? Name them in a first line, such as 'id x"),
        ("1 0.1 0.2 0.3 0.4\n", "got 5 columns: which"),
        ("0.5\n0.7\n", "got one column: which"),
        ("".join(f"{k} {x} {y}\n" for k, (x, y, _) in enumerate(SEEDS, 1)), "an id, or x.* 'id x y' or 'x y z'"),
        ("31 0.5 0.5\n9 0.25 0.5\n4 0.5 0.75\n", "an id, or x"),
        ("id,a,b\n" + rows("{},{},{}"), "columns 'id', 'a', 'b': which"),
        ("x,y,pos x,X,z\n" + rows("{},{},1,2,{}"), "columns 'x', 'X' could all be x"),
        ("0.1,0.2,n/a\n" + rows("{},{},{}"), "line 1: 'n/a' is no number"),
        (rows("{},{},{}") + "0.1,,0.3\n", "line 13: '' is no number"),
        (rows() + "0.1 0.2\n", "line 13 has 2 columns, line 1 has 3"),
        (rows("{},{},{}").replace(".", ","), "got 6 columns: which"),
        ("1,200 2,300 3,400\n", "'1,200' may have a decimal comma or one of thousands"),
        ("1.234,5;6;7\n", "is no number"),
        ("1,5;6.5;7\n", "numbers have points and commas, such as '1,5'"),
        ('"1,234",5\n"2,345",6\n', "'1,234' may have a decimal comma or one of thousands"),
        ("x y\n" + rows(), "2 columns have names, x, y; line 2 has 3"),
        ("13\n\n" + HYDROGEN, "line 1 says that there are 13 points, and 12 lines follow"),
        (2 * ("12\nt\n" + HYDROGEN), "holds several times, the second at line 15; keep one"),
        ("12\nt\n" + rows("0.5 {} {} {}"), r"XYZ has a species and x, y, z .* which columns"),
        (rows().encode("utf-16-le"), "zero bytes: no text, or UTF-16 without a byte-order mark"),
        ("nobody knows\nwhat this is\n", "no line holds numbers in columns; line 2 is"),
        ("1_0 2_0 3_0\n", "no line holds numbers in columns"),
        ("1e-3 2_0 3\n" + rows(), "line 1: '2_0' is no number"),
    ],
)
@pytest.mark.parametrize("suffix", [".csv", ".xyz"])
def test_what_could_be_read_in_two_ways_is_one_line_that_says_how(tmp_path, suffix, text, words):
    path = written(tmp_path / f"a{suffix}", text)
    with pytest.raises(FileFormatError, match=words) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "\n\n", "\ufeff", "x,y,z\n", "# nothing\n", "0\n\n"])
def test_files_without_points_hold_none(tmp_path, text):
    assert read(written(tmp_path / "a.csv", text)).shape == (0, 3)


def test_a_lattice_needs_no_names(tmp_path):
    lattice = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for seeds in (lattice, np.array([[5.0, 1, 2], [3, 0, 4], [9, 9, 9]])):
        np.savetxt(tmp_path / "a.txt", seeds)
        np.testing.assert_array_equal(read(tmp_path / "a.txt"), seeds)


@pytest.mark.parametrize("suffix", [".txt", ".xyz", ".csv"])
@pytest.mark.parametrize("columns", [2, 3])
def test_seeds_whose_x_counts_come_back_as_they_were_written(tmp_path, suffix, columns):
    seeds = np.column_stack([np.arange(6.0), SEEDS[:6, 1:columns]])
    np.testing.assert_array_equal(read(write(seeds, tmp_path / f"a{suffix}")), seeds)


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf1.5\r\n2.5\r\n3.5\r\n",
        "1.5\n2.5\n3.5\n".encode("utf-16"),
        b"d [mm]\n1.5\n2.5\n3.5\n",
        b"1.5, 2.5, 3.5\n",
        b"1.5;2.5;3.5",
        b"1.5 2.5\n3.5\n",
    ],
)
def test_lists_of_sizes_are_read_as_programs_write_them(tmp_path, content):
    from grainsdem.recipe.grains import SizesTable

    sizes = SizesTable(path=str(written(tmp_path / "d.csv", content)))
    np.testing.assert_array_equal(sizes.listed(), [1.5, 2.5, 3.5])


def test_a_list_of_sizes_with_decimal_commas_is_not_taken_for_twice_as_many(tmp_path):
    from grainsdem.recipe.grains import SizesTable

    sizes = SizesTable(path=str(written(tmp_path / "d.csv", "1,5\n2,5\n3,5\n")))
    with pytest.raises(FileFormatError, match=r"got 2 columns \(in a number the decimals follow a point\)"):
        sizes.listed()


def test_recipes_and_surveys_saved_with_a_byte_order_mark_are_read(tmp_path):
    text = '\ufeffseeds = {process = "poisson", count = 50}\r\ngrains = {porosity = 0.4}\r\n'
    path = written(tmp_path / "bed.toml", text)
    assert recipes.read(path).seeds.count == 50
    assert len(read_survey(path)) == 1
