from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem import survey
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, MissingFileError, WriteError
from grainsdem.measures.planform.files import image_content, labels_content
from grainsdem.recipe.views import ImagesTable
from grainsdem.survey import imaging, picturing

pytestmark = pytest.mark.unit

BASE = {
    "rng": 5,
    "domain": {"lengths": [3, 3, 2], "periodic": "xy"},
    "seeds": {"process": "poisson", "count": 60},
    "grains": {"porosity": 0.4, "keep": "all", "median_diameter": 0.02},
}
DRAWN = {
    "size": [40, 32], "per_bed": 2, "stones": 20, "labels": ["png"], "blur": [0, 1.5], "wet": 0.5, "noise": 0.01,
    "light_azimuth": [1.0, 2.0], "lens": [[-0.2, 0.1], 0], "colors": ["granite", {"slate": 1, "quartz": 2}],
    "texture": [0, 0.3], "gradient": [[-0.3, 0.3], 0.1],
}  # fmt: skip


def recipe(**changes):
    return gd.recipe.make(**{**BASE, "images": {**DRAWN, **changes}})


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A set of five, taken by one process without a pause."""
    folder = tmp_path_factory.mktemp("whole") / "set"
    gd.images(recipe(), folder, count=5, workers=1)
    return folder


def test_an_image_and_its_row_are_those_of_the_bed_and_the_seeds_that_the_row_names(whole):
    rows = survey.load(whole / "truth.csv")
    assert rows["file"].tolist() == [f"image_000{k}.png" for k in range(1, 6)]
    assert rows["bed"].tolist() == [1, 1, 2, 2, 3]
    assert np.unique(rows["rng"]).size == 5
    row, table = rows[3], recipe().images
    bed = gd.recipe.grow(gd.recipe.make(**{**BASE, "rng": int(row["bed_rng"])}))
    rng = np.random.default_rng(int(row["rng"]))
    camera = table.draw(rng).camera
    # The picture fills the bed along y, and lies anywhere along x.
    pixel = bed.domain.lengths[0] / 40
    lower = np.array([row["lower_x"], row["lower_y"]])
    assert lower[0] == 0
    assert 0 <= lower[1] <= bed.domain.lengths[1] - 32 * pixel
    view = gd.planform(bed, pixel=pixel, region=(lower, lower + pixel * np.array([40, 32])))
    image = gd.photograph(view, bed, **camera, rng=rng)
    assert (whole / row["file"]).read_bytes() == image_content(image, "png")
    lens = gd.CameraLens(camera["lens"][0], 0.0, (32, 40))
    assert (whole / "image_0004.labels.png").read_bytes() == labels_content(lens.nearest(view.labels), "png")
    assert row["scale"] == pytest.approx(pixel * lens.scale)
    truth = gd.planform_table(view, bed)
    stones = gd.pebble_count(view, bed, 20, rng=rng)
    assert (row["n_grains"], row["n_seen"], row["n_counted"]) == (60, truth.size, stones.size)
    for name, value in gd.size_percentiles(truth, bed, stones).items():
        assert row[name] == value
    assert row["porosity"] == pytest.approx(gd.porosity(bed))
    assert row["blur"] == camera["blur"]
    assert row["light_azimuth"] == pytest.approx(np.arctan2(camera["light"][1], camera["light"][0]))
    assert json.loads(row["colors"]) == camera["colors"]


@pytest.mark.slow
def test_sets_are_the_same_bytes_on_one_process_and_on_three(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(imaging, "PAUSE", 0.0)
    gd.images(recipe(), tmp_path / "three", count=5, workers=3)
    assert content(tmp_path / "three") == content(whole)


def test_sets_are_the_same_bytes_in_pieces(whole, tmp_path):
    assert len(gd.images(recipe(), tmp_path / "pieces", count=3, workers=1)) == 3
    (tmp_path / "pieces" / "image_0001.labels.png").unlink()
    told = []
    gd.images(recipe(), tmp_path / "pieces", count=5, workers=1, progress=lambda *done: told.append(done))
    assert told == [(2, 5), (3, 5), (4, 5), (5, 5)]  # the second bed has its second photograph taken, and so on
    assert content(tmp_path / "pieces") == content(whole)
    # A smaller count takes nothing away.
    assert len(gd.images(recipe(), tmp_path / "pieces", count=1, workers=1)) == 5


def test_an_interrupted_set_keeps_what_it_had_and_goes_on(whole, tmp_path, monkeypatch):
    take = imaging.take

    def interrupt(sitting):
        if sitting.bed == 2:
            raise KeyboardInterrupt
        return take(sitting)

    monkeypatch.setattr(imaging, "take", interrupt)
    with pytest.raises(KeyboardInterrupt):
        gd.images(recipe(), tmp_path / "set", count=5, workers=1)
    assert len(survey.load(tmp_path / "set" / "truth.csv")) == 2
    monkeypatch.setattr(imaging, "take", take)
    gd.images(recipe(), tmp_path / "set", count=5, workers=1)
    assert content(tmp_path / "set") == content(whole)


@pytest.mark.slow
def test_a_killed_set_goes_on_to_what_an_undisturbed_one_is(tmp_path):
    code = (
        "import grainsdem as gd; from grainsdem.survey import imaging; imaging.PAUSE = 0.3;"
        f"gd.images(gd.recipe.make(**{BASE!r}, images={DRAWN!r}), {str(tmp_path / 'set')!r}, count=40, workers=2)"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    end = time.monotonic() + 120
    while len(list((tmp_path / "set").glob("*.png"))) < 10 and time.monotonic() < end:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "set" / "truth.csv").exists() or len(survey.load(tmp_path / "set" / "truth.csv")) < 40
    time.sleep(1)  # its own processes end when their pipes do
    gd.images(recipe(), tmp_path / "set", count=40, workers=2)
    gd.images(recipe(), tmp_path / "other", count=40, workers=2)
    left = {name: data for name, data in content(tmp_path / "set").items() if not name.startswith(".")}
    assert left == content(tmp_path / "other")


def test_a_photograph_that_cannot_be_taken_is_a_row_that_says_why(tmp_path, caplog):
    # The bed is 0.1 m wide or so: pixels from 1 to 5 mm do not all fit forty times.
    made = recipe(pixel=[1e-3, 5e-3], per_bed=4, tables=["h5", "parquet"])
    rows = gd.images(made, tmp_path / "set", count=8, workers=1)
    failed = rows["error"] != ""
    assert 0 < failed.sum() < 8
    assert all("does not fit into the bed" in error for error in rows["error"][failed])
    assert np.isnan(rows["d50_counted"][failed]).all()
    assert "photographs could not be taken" in caplog.text
    for row in rows:
        assert (tmp_path / "set" / row["file"]).exists() == (row["error"] == "")
    assert (rows["scale"][~failed] * 40 < 0.2).all()
    with h5py.File(tmp_path / "set" / "truth.h5") as file:
        assert [text.decode() for text in file["table"]["error"]] == rows["error"].tolist()  # with its ×
    # One whose bed cannot be grown, too.
    none = gd.recipe.make(
        **{**BASE, "domain": {}, "seeds": {"process": "poisson", "count": 2}, "grains": {"scale": 0.9}}
    )
    rows = gd.images(none, tmp_path / "none", count=2, workers=1)
    assert all("all 2 cells touch a wall" in error for error in rows["error"])
    assert not list((tmp_path / "none").glob("*.png"))


def test_a_full_disk_ends_a_set_instead_of_filling_it_with_errors(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise WriteError("image_0001.png: cannot be written: No space left on device")

    monkeypatch.setattr(picturing, "write_all", fail)
    with pytest.raises(WriteError, match="No space left"):
        gd.images(recipe(), tmp_path / "set", count=2, workers=1)


def test_numbers_are_drawn_from_their_ranges_and_no_key_moves_anothers(whole):
    rows = survey.load(whole / "truth.csv")
    assert ((rows["blur"] >= 0) & (rows["blur"] <= 1.5)).all()
    assert np.unique(rows["blur"]).size == 5
    assert ((rows["lens_k1"] >= -0.2) & (rows["lens_k1"] <= 0.1)).all()
    assert (rows["gradient_y"] == 0.1).all()
    assert ((rows["light_azimuth"] >= 1) & (rows["light_azimuth"] <= 2)).all()
    table = ImagesTable(**DRAWN)
    drawn = [table.draw(np.random.default_rng(k)).camera for k in range(400)]
    # A uniform number on [0, 1.5] has the mean 0.75 and the standard deviation 1.5 / √12; half of them are wet.
    assert np.mean([camera["blur"] for camera in drawn]) == pytest.approx(0.75, abs=5 * 1.5 / np.sqrt(12 * 400))
    assert np.mean([camera["wet"] for camera in drawn]) == pytest.approx(0.5, abs=5 * 0.5 / 20)
    assert np.mean(["slate" in camera["colors"] for camera in drawn]) == pytest.approx(0.5, abs=5 * 0.5 / 20)
    other = ImagesTable(**{**DRAWN, "blur": 3.0, "wet": 1.0, "light": [0, 0, 1], "light_azimuth": None, "colors": None})
    for k in range(3):
        one, two = drawn[k], other.draw(np.random.default_rng(k)).camera
        assert {key for key in one if one[key] != two[key]} <= {"blur", "wet", "light", "colors"}


def test_keys_of_the_recipe_are_varied_from_bed_to_bed(tmp_path):
    vary = {"grains": {"median_diameter": [0.01, 0.03], "about": ["centroid", "seed"]}, "seeds.count": [50, 70]}
    made = recipe(vary=vary)
    rows = gd.images(made, tmp_path / "set", count=6, workers=1)
    assert (rows["error"] == "").all()
    for name in ("grains_median_diameter", "seeds_count", "d50_bed_by_mass"):
        assert np.unique(rows[name]).size == 3  # two of each bed
    assert set(rows["grains_about"]) <= {"centroid", "seed"}
    np.testing.assert_array_equal(rows["n_grains"], rows["seeds_count"])
    values = {key: rows[key.replace(".", "_")][4].item() for key in made.images.vary}
    own = gd.recipe.varied(gd.recipe.make(**{**BASE, "rng": int(rows["bed_rng"][4])}), values)
    bed = gd.recipe.grow(own)
    assert gd.percentiles(gd.diameters(bed), (50,), weights=gd.masses(bed))[0] == pytest.approx(
        values["grains.median_diameter"]
    )
    b = gd.ellipsoid_axes(bed.grains)[:, 1]
    assert rows["d50_bed_by_number"][4] == pytest.approx(np.percentile(b, 50, method="hazen"), rel=1e-12)
    drawn = [made.images.draw_bed(np.random.default_rng(k))["seeds.count"] for k in range(300)]
    assert (min(drawn), max(drawn)) == (50, 70)


def test_a_share_of_the_photographs_is_shaded():
    table = ImagesTable(shadow=[0.2, 0.6], shaded=0.25)
    drawn = [table.draw(np.random.default_rng(k)).camera["shadow"] for k in range(400)]
    assert np.mean([value > 0 for value in drawn]) == pytest.approx(0.25, abs=5 * np.sqrt(0.25 * 0.75 / 400))
    assert min(value for value in drawn if value) >= 0.2


def test_without_a_table_of_images_there_are_sensible_ones(tmp_path):
    rows = gd.images(gd.recipe.make(**BASE), tmp_path / "set", count=2, workers=1)
    with Image.open(tmp_path / "set" / "image_0001.png") as picture:
        assert picture.size == (512, 512)
        assert picture.mode == "L"
    assert rows["bed"].tolist() == [1, 2]
    assert (rows["blur"] >= 0.3).all()
    assert np.unique(rows["light_azimuth"]).size == 2
    assert sorted(path.name for path in (tmp_path / "set").iterdir()) == [
        "image_0001.png", "image_0002.png", "images.json", "truth.csv"
    ]  # fmt: skip


def test_a_recipes_other_commands_pass_its_images_by(tmp_path):
    made = recipe()
    assert "images" not in gd.recipe.make(**BASE).model_dump()
    (_, _, one), (_, _, two) = (next(survey.Survey(base).jobs()) for base in (BASE, {**BASE, "images": DRAWN}))
    assert one.rng == two.rng
    np.testing.assert_array_equal(gd.recipe.grow(made).positions, gd.recipe.grow(gd.recipe.make(**BASE)).positions)


def test_all_formats_of_images_labels_and_tables_are_written(tmp_path):
    import pyarrow.parquet
    import tifffile

    made = recipe(
        formats=["npy", "tif", "png"], labels=["npy", "tif"], grains=["csv", "parquet"], tables=["parquet", "h5"]
    )
    rows = gd.images(made, tmp_path / "set", count=1, workers=1)
    names = {path.name for path in (tmp_path / "set").iterdir()}
    assert {f"image_0001.{kind}" for kind in ("npy", "tif", "png", "labels.npy", "labels.tif", "grains.csv")} <= names
    labels = np.load(tmp_path / "set" / "image_0001.labels.npy")
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "set" / "image_0001.labels.tif"), labels)
    grains = np.genfromtxt(tmp_path / "set" / "image_0001.grains.csv", delimiter=",", names=True)
    assert grains.size == rows["n_seen"][0]
    assert set(np.unique(labels)) - {0} <= set(grains["id"].astype(int) + 1)
    table = pyarrow.parquet.read_table(tmp_path / "set" / "truth.parquet")
    assert table.column("d50_counted").to_pylist() == rows["d50_counted"].tolist()
    assert (tmp_path / "set" / "truth.h5").exists()


HALTON = {**BASE, "rng": 0, "seeds": {"process": "halton", "count": 60}}


def test_beds_without_chance_are_photographed_as_one(tmp_path):
    made = gd.recipe.make(**HALTON, images={**DRAWN, "per_bed": 3})
    rows = gd.images(made, tmp_path / "set", count=3, workers=1)
    assert rows["bed_rng"].tolist() == [0, 0, 0]
    with pytest.raises(InputError, match=r"beds of 4 photographs, 3 of each, would be copies of one: Halton's"):
        gd.images(made, tmp_path / "set", count=4, workers=1)


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"blur": [1.5, 0.0]}, r"images.blur: a range goes from its lower to its upper end; got \[1.5, 0.0\]"),
        (
            {"blur": [0, 1, 2]},
            r"images.blur: a number or a range \[low, high\], each of which should be a valid number",
        ),
        ({"vignette": [0, 1]}, r"each of which should be less than 1; got \[0, 1\]"),
        ({"light_elevation": [20, 70]}, r"of rad, each of which should be less than or equal to 1.57"),
        ({"light_azimuth": 1, "light": [0, 0, 1]}, "give light, or light_azimuth and light_elevation; got both"),
        ({"light": [0, [0, 1], [-1, 1]]}, "above the horizon"),
        ({"gradient": [[-2, 0], 1]}, "no light may be below zero"),
        ({"lens": [[-0.5, 0], 0]}, "farther out farther out"),
        ({"pixel": 1e-3, "per_diameter": [9, 10]}, "give pixel or per_diameter, not both"),
        ({"wet": 1.5}, "images.wet: .*less than or equal to 1"),
        ({"colors": ["granite", "gold"]}, "stones must be among .*; got gold"),
        ({"size": [0, 512]}, "images.size.0: .*greater than or equal to 1"),
        ({"formats": []}, "images.formats"),
        ({"per_bed": 0}, "images.per_bed"),
        ({"vary": {"seeds.count": 50}}, r"each key has a range \[low, high\] of numbers, or a list of values"),
        ({"vary": {"seeds.count": []}}, r"each key has a range \[low, high\] of numbers, or a list of values"),
        ({"vary": {"seeds.count": [70, 50]}}, "from its lower to its upper end; seeds.count does not"),
        ({"haze": 1}, "images.haze: unknown key; allowed are size, pixel, .*, noise"),
        ({"noise": float("nan")}, "images.noise: .*finite"),
    ],
)
def test_an_impossible_table_is_refused(tables, words):
    with pytest.raises(InputError, match=words):
        gd.recipe.make(**BASE, images=tables)


def test_folders_of_something_else_are_left_alone(whole, tmp_path):
    with pytest.raises(InputError, match=r"holds another set of images; images.blur was .* give another folder"):
        gd.images(recipe(blur=0.2), whole, count=9, workers=1)
    with pytest.raises(InputError, match=r"recipe.rng was 5 and is 6"):
        gd.images(recipe().model_copy(update={"rng": 6}), whole, count=9, workers=1)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "image_0001.png").write_text("my own")
    with pytest.raises(InputError, match=r"holds image_0001.png, and no set of images to go on with"):
        gd.images(recipe(), tmp_path / "mine", count=1, workers=1)
    (tmp_path / "mine" / "images.json").write_text("{")
    with pytest.raises(InputError, match=r"its images.json cannot be read"):
        gd.images(recipe(), tmp_path / "mine", count=1, workers=1)
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="cannot be made a folder"):
        gd.images(recipe(), tmp_path / "file", count=1, workers=1)
    for count in (0, -1, 2.0, True):
        with pytest.raises(InputError, match="count must be a whole number"):
            gd.images(recipe(), tmp_path / "new", count=count)
    for vary, words in (
        ({"rng": [1, 2]}, r"images\.vary: rng is no part of a bed"),
        ({"seeds.colour": [1, 2]}, r"seeds\.colour: unknown key"),
        ({"seeds.count": [0, 9]}, r"seeds\.count: .*greater than or equal to 1"),
    ):
        with pytest.raises(InputError, match=words):
            gd.images(recipe(vary=vary), tmp_path / "new", count=1)
    loose = gd.recipe.make(grains={"shapes": {"kinds": [{"shape": "rock"}], "count": 20, "diameter": 0.01}})
    with pytest.raises(InputError, match="laid out loose, and no bed to photograph: add a settle table"):
        gd.images(loose, tmp_path / "new", count=1)
    assert not (tmp_path / "new").exists()


def test_the_command_takes_the_recipes_table_and_its_options_and_draws_a_sheet(tmp_path):
    path = tmp_path / "r.toml"
    path.write_text(
        'rng = 5\n[domain]\nlengths = [3, 3, 2]\nperiodic = "xy"\n[seeds]\nprocess = "poisson"\ncount = 60\n'
        '[grains]\nporosity = 0.4\nkeep = "all"\n[images]\nsize = [30, 30]\nblur = [0, 1]\nwet = 0.5\n'
    )

    def call(*words):
        return CliRunner().invoke(app, ["images", str(path), str(tmp_path / "set"), *map(str, words)])

    words = ["--workers", 1, "--set", "blur=[2, 3]", "--per-bed", 2, "--labels", "npy", "--stones", 9, "--rng", 7]
    result = call("--count", 3, *words, "--sheet", tmp_path / "sheet.png")
    assert result.exit_code == 0, result.output
    assert "3 images, 0 could not be taken" in result.output
    rows = survey.load(tmp_path / "set" / "truth.csv")
    assert (rows["blur"] >= 2).all()
    assert rows["bed"].tolist() == [1, 1, 2]
    assert (rows["n_counted"] <= 9).all()
    assert (tmp_path / "set" / "image_0003.labels.npy").exists()
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size[0] == round(3 * 1.6 * 130)  # as many columns as images
    told = json.loads(call("--count", 4, *words, "--json").stdout)
    assert told == {"rows": 4, "failed": 0, "files": [str(tmp_path / "set" / "truth.csv")]}
    for wrong, match in (
        (["--count", 0], "count must be a whole number, 1 or more; got 0"),
        (["--count", 3, "--set", "blur=[3, 2]"], "images: blur: a range goes from its lower to its upper end"),
        (["--count", 3, "--set", "blur"], "written as key=value"),
        (["--count", 3, "--set", 'formats=["npy"]', "--sheet", tmp_path / "s.png"], "a sheet is drawn from png"),
        (["--count", 3], "holds another set of images"),
    ):
        result = call(*wrong)
        assert result.exit_code == 2
        assert match in " ".join(result.output.split())


def test_the_example_and_the_page_hold_tables_that_can_be_read(tmp_path):
    root = Path(__file__).parent.parent
    example = gd.recipe.read(root / "examples" / "images.toml")
    assert example.images.per_bed == 4
    small = gd.recipe.varied(gd.recipe.with_images(example, size=[48, 48]), {"seeds.count": 300})
    assert gd.images(small, tmp_path / "set", count=1, workers=1)["error"].tolist() == [""]
    page = (root / "docs" / "photographs.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    assert gd.recipe.make(**BASE, **tomllib.loads(block)).images.wet == 0.3


def test_a_sheet_needs_images(whole, tmp_path):
    with pytest.raises(InputError, match="got 0 images, 4 columns"):
        gd.figures.contact_sheet([], tmp_path / "s.png")
    with pytest.raises(MissingFileError, match=r"none\.png: no such file"):
        gd.figures.contact_sheet([whole / "image_0001.png", tmp_path / "none.png"], tmp_path / "s.png")
    with pytest.raises(FileFormatError):
        gd.figures.contact_sheet([whole / "image_0001.png"], tmp_path / "s.jpg")
    gd.figures.contact_sheet([whole / "image_0001.png"], tmp_path / "s.png", columns=1, titles=["one"])


@pytest.mark.slow
def test_beds_settle_before_they_are_photographed_where_the_recipe_says_so(tmp_path):
    made = gd.recipe.make(
        rng=1,
        seeds={"process": "poisson", "count": 90},
        grains={"porosity": 0.4, "median_diameter": 0.02},
        settle={"start": "pour", "max_time": 0.05},
        images={"size": [40, 40], "per_bed": 2},
    )
    rows = gd.images(made, tmp_path / "set", count=2, workers=1)
    assert (rows["error"] == "").all()
    own = made.model_copy(update={"rng": int(rows["bed_rng"][0])})
    fresh = gd.recipe.grow(own)
    settled = gd.recipe.come_to_rest(fresh, own).packing
    for bed, is_it in ((settled, True), (fresh, False)):
        view = gd.planform(bed, pixel=float(bed.domain.lengths[0]) / 40)
        found = gd.size_percentiles(gd.planform_table(view, bed), bed, gd.pebble_count(view, bed, rng=1))
        assert (rows["d50_seen_by_area"][0] == pytest.approx(found["d50_seen_by_area"], rel=1e-9)) == is_it
