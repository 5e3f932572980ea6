from __future__ import annotations

import numpy as np
import pytest

from grainsdem.errors import FileFormatError, InputError, MissingFileError, ShapeError
from grainsdem.measures import SieveSheet, fit_sieves, read_sieves, sieve_statistics
from grainsdem.measures.distributions.sheets.reading import parse_sieves
from grainsdem.measures.distributions.sheets.sheet import ASTM, opening

pytestmark = pytest.mark.unit

OPENINGS = [0.25e-3, 0.5e-3, 1e-3, 2e-3, 4e-3]
PASSING = [2, 20, 70, 96.5, 100]


@pytest.mark.parametrize(
    "content",
    [
        "opening (mm),passing (%)\n4,100\n2,96.5\n1,70\n0.5,20\n0.25,2\n",
        "0.25 2\n0.5 20\n1 70\n2 96.5\n4 100\n",
        "µm;percent finer\n250;2\n500;20\n1000;70\n2000;96,5\n4000;100\n",
        "phi\tcumulative passing\n-2\t100\n-1\t96.5\n0\t70\n1\t20\n2\t2\n",
        "sieve,% passing\nNo. 5,100\nNo. 10,96.5\n#18,70\n35 mesh,20\nNo. 60,2\n",
        "mesh,passing\n5,100\n10,96.5\n18,70\n35,20\n60,2\n",
        "sieve,mass retained [g],remark\n4 mm,0,\n2 mm,7,\n1 mm,53,shells\n500 µm,100,\n250 microns,36,\npan,4,\n",
        "% a laboratory's sheet\nmm,retained %\n0.25,18\n0.5,50\n1,26.5\n2,3.5\n4,0\npan,2\n",
    ],
)
def test_a_sheet_is_read_in_every_unit_and_kind(content):
    sheet = parse_sieves(content)
    assert sheet.openings == pytest.approx(OPENINGS, rel=1e-12)
    assert sheet.passing == pytest.approx(PASSING, abs=1e-9)
    assert sheet.bounds[[0, -1]].tolist() == [0.0, np.inf]


def test_units_and_kinds_may_be_told():
    assert parse_sieves("1 10\n2 40\n", unit="phi", kind="retained").openings == pytest.approx([0.25e-3, 0.5e-3])
    assert parse_sieves("1 10\n2 40\n", unit="um").openings == pytest.approx([1e-6, 2e-6])
    with pytest.raises(InputError, match="unit must be one of m, mm, um, phi, astm; got 'inch'"):
        parse_sieves("1 10\n2 40\n", unit="inch")


@pytest.mark.parametrize(
    ("word", "size"),
    [
        ("3/8 in", 9.525e-3),
        ('1 1/2"', 38.1e-3),
        ("0.75 in", 19.05e-3),
        ("#200", 0.075e-3),
        ("No. 4", 4.75e-3),
        ("2.5 φ", 2**-2.5 * 1e-3),
        ("63 μm", 63e-6),
        ("Pan", 0.0),
        ("0", 0.0),
        ("1e-1 mm", 1e-4),
    ],
)
def test_names_of_sieves_have_their_openings(word, size):
    assert opening(word) == pytest.approx(size, rel=1e-9)


def test_numbered_sieves_fall_and_are_those_of_the_standard():
    # ISO 565's R 40/3, which E11 follows from 75 µm to 4.75 mm: each second one a factor of √2, within the rounding.
    sizes = np.array(list(ASTM.values()))
    assert (np.diff(sizes) < 0).all()
    coarse = sizes[sizes >= 0.075]
    assert coarse[:-2] / coarse[2:] == pytest.approx(np.sqrt(2), rel=0.025)
    assert opening(0, "phi") == 1e-3
    with pytest.raises(InputError, match="'11' is no sieve of ASTM E11; numbers are 4, 5"):
        opening(11, "astm")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "no line holds a sieve"),
        ("1\n2\n", "line 1: two columns are read"),
        ("mm,passing\n1,x\n2,3", "line 2: 'x' is no number"),
        ("mm,passing\nwide,1\n2,3", "line 2: 'wide' is no opening; give a number in mm, or a name such as 'No. 40'"),
        ("mm,passing\n1,50\n2,40", "must not fall from one opening to a wider one; 50 % pass 1 mm, 40 % pass 2 mm"),
        ("mm,passing\n1,50\n2,140", "lie from 0 to 100; got 50, 140"),
        ("mm,passing\n-1,5\n2,14", "openings must be above zero; got -0.001 m"),
        ("mm,passing\n1,5\n1.0,14", "no two sieves are alike; got 1 mm twice"),
        ("mm,passing\n1,5", "two sieves or more; got 1"),
        ("mm,retained %\n1,60\n2,70", "per cent retained sum to 130, at most 100"),
        ("mm,retained\n1,-60\n2,70", "zero or more, and not all zero; got"),
        ("mm,retained\n1,0\n2,0", "zero or more, and not all zero; got"),
        ("1,60\n2,50", "Name it in a first line, 'passing' or 'retained'"),
        ("mm,cumulative retained\n1,60\n2,50", "give 100 less that as per cent passing"),
        ("mm,passing\n1,nan\n2,50", "passing must be finite"),
    ],
)
def test_what_is_no_sheet_gets_one_line(tmp_path, content, words):
    path = tmp_path / "sheet.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises((FileFormatError, ShapeError), match=words) as refused:
        read_sieves(path)
    assert "\n" not in str(refused.value)


def test_missing_files_and_other_suffixes_are_refused(tmp_path):
    with pytest.raises(MissingFileError, match="no such file"):
        read_sieves(tmp_path / "none.csv")
    with pytest.raises(FileFormatError, match=r"read from \.csv, \.txt, \.tsv; got '\.xlsx'"):
        read_sieves(tmp_path / "none.xlsx")


def test_open_ends_reach_as_far_as_is_told_or_as_the_class_beside_them():
    sheet = SieveSheet.from_passing([0.1e-3, 0.15e-3, 1e-3], [5, 40, 90])
    curve = sheet.grading()
    # The class beside the pan is a factor of 1.5 wide, that below the widest sieve more than one φ.
    assert curve.openings == pytest.approx([0.1e-3 / 1.5, 0.1e-3, 0.15e-3, 1e-3, 2e-3])
    assert curve.passing == pytest.approx([0, 0.05, 0.4, 0.9, 1])
    assert curve.diameter == "sieve"
    finer, coarser = sheet.open_ends()
    assert finer.startswith(
        "5 % of the mass is finer than the last sieve, 0.1 mm: taken to reach to 0.06667 mm; finest"
    )
    assert "10 % of the mass is coarser than the last sieve, 1 mm: taken to reach to 2 mm; widest" in coarser
    told = sheet.grading(finest=0.05e-3, widest=1.5e-3, diameter="equal-volume")
    assert told.openings[[0, -1]] == pytest.approx([0.05e-3, 1.5e-3])
    closed = SieveSheet.from_passing([0.1e-3, 0.2e-3, 0.4e-3, 0.8e-3], [0, 0, 100, 100])
    assert closed.open_ends() == []
    assert closed.grading().openings == pytest.approx([0.2e-3, 0.4e-3])
    for bounds, words in (({"finest": 1e-3}, "below the last sieve"), ({"widest": 1e-4}, "above the last sieve")):
        with pytest.raises(InputError, match=words):
            sheet.grading(**bounds)
    with pytest.raises(InputError, match="0 % are finer"):
        closed.grading(finest=1e-5)


def test_a_sheet_goes_into_statistics_and_fits_as_it_is():
    sheet = SieveSheet.from_retained([0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3], [1, 1, 1, 1, 0])
    assert sieve_statistics(sheet.bounds, sheet.weights).folk_ward.sorting == pytest.approx(1.2255, abs=1e-4)
    assert fit_sieves(sheet.bounds, sheet.weights, "lognormal").distribution.cdf(2e-3) == pytest.approx(0.5, abs=0.01)
    with pytest.raises(InputError, match="weights must be finite"):
        SieveSheet([0, 1, 2, np.inf], [1, np.nan, 0])
    with pytest.raises(InputError, match="rise from 0 to infinity"):
        SieveSheet([1, 2, 3, np.inf], [1, 1, 0])
    with pytest.raises(ShapeError, match="one number passing for each opening; got 1 for 2"):
        SieveSheet.from_passing([1, 2], [50])
