"""Recorded motions: read back by VTK, OpenUSD and Pillow, every grain where it was."""

import subprocess
import sys

import numpy as np
import pytest
import pyvista
from PIL import Image, ImageChops
from pxr import Usd, UsdGeom
from typer.testing import CliRunner

import exporters
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, MissingPackageError, ShapeError, WriteError
from grainsdem.figures import animate
from grainsdem.figures.motion.videos import find_ffmpeg, write_film
from grainsdem.geometry.rotations import world_vertices
from grainsdem.storage import HistoryWriter, load_motion, save


@pytest.fixture(scope="module")
def motion(poured):
    """Grains that fall 3 mm in four frames, uneven in time."""
    times = np.array([0.0, 0.01, 0.02, 0.04])
    fall = np.outer(times / 0.04 * 3e-3, [0, 0, -1.0])
    return {
        "times": times,
        "positions": poured.positions + fall[:, None],
        "quaternions": np.repeat(poured.quaternions[None], 4, axis=0),
    }


@pytest.fixture
def history(poured, motion, tmp_path):
    """The same as a history on disk."""
    path = tmp_path / "history.h5"
    with HistoryWriter(path, {"time": "s"}, n_grains=len(poured)) as writer:
        for k, time in enumerate(motion["times"]):
            writer.append(time=time)
            writer.append_frame(time, positions=motion["positions"][k], quaternions=motion["quaternions"][k])
    return path


@pytest.mark.client
def test_a_time_series_shows_each_time_what_was_recorded(poured, motion, tmp_path):
    paths = exporters.replay(poured, tmp_path / "fall.pvd", **motion)
    reader = pyvista.get_reader(paths[0])
    assert reader.time_values == motion["times"].tolist()
    reader.set_active_time_value(0.04)
    np.testing.assert_allclose(reader.read()[0].points, world_vertices(poured) - [0, 0, 3e-3], atol=1e-12)


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".usdc", ".usda"])
def test_usd_moves_the_grains_of_the_stage(poured, motion, tmp_path, suffix):
    first, scene = exporters.replay(poured, tmp_path / f"fall{suffix}", **motion)
    assert scene == tmp_path / f"fall{suffix}"
    stage = Usd.Stage.Open(str(first))
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    prim = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Grains/g000004"))
    for code, k in ((stage.GetStartTimeCode(), 0), (stage.GetEndTimeCode(), 3)):
        place = prim.ComputeLocalToWorldTransform(code).ExtractTranslation()
        np.testing.assert_allclose(np.array(place) * unit, motion["positions"][k, 4], rtol=1e-6, atol=1e-9)


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_an_animation_falls_and_lasts_as_long_as_it_was_asked_to(poured, motion, tmp_path, suffix):
    path = animate(poured, tmp_path / f"fall{suffix}", **motion, size=(160, 120), seconds=1.0)
    with Image.open(path) as image:
        pictures, milliseconds = [], 0
        for k in range(image.n_frames):
            image.seek(k)
            pictures.append(image.convert("RGB"))
            image.load()
            milliseconds += image.info["duration"]
    assert milliseconds == 1000
    assert pictures[0].size == (160, 120)
    # What is coloured sinks: row of the middle of what is not white or grey.
    rows = [np.mean(np.nonzero(np.ptp(np.asarray(picture, int), axis=2) > 40)[0]) for picture in pictures]
    assert rows[-1] > rows[0] + 3
    assert ImageChops.difference(pictures[0], pictures[-1]).getbbox() is not None


@pytest.mark.slow
@pytest.mark.client
def test_a_film_falls_lasts_as_long_as_it_was_asked_to_and_has_even_sides(poured, motion, tmp_path):
    path = animate(poured, tmp_path / "fall.mp4", **motion, size=(161, 121), seconds=1.0)
    raw = subprocess.run(
        [find_ffmpeg(), "-loglevel", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"],
        capture_output=True,
        check=True,
    ).stdout
    pictures = np.frombuffer(raw, np.uint8).reshape(-1, 122, 162, 3).astype(int)
    assert len(pictures) == 20  # a second, at twenty a second
    rows = [np.mean(np.nonzero(np.ptp(picture, axis=2) > 40)[0]) for picture in pictures]
    assert rows[-1] > rows[0] + 3
    again = animate(poured, tmp_path / "again.mp4", **motion, size=(161, 121), seconds=1.0)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.unit
def test_a_film_without_ffmpeg_is_refused_with_what_to_install_and_nothing_is_written(
    poured, history, motion, tmp_path, monkeypatch
):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    save(poured, tmp_path / "bed.h5")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(MissingPackageError, match=r"put it on the path, or pip install \"grainsdem\[video\]\""):
        animate(poured, tmp_path / "fall.mp4", **motion)
    words = ["replay", str(tmp_path / "bed.h5"), str(history), str(tmp_path / "fall.mp4")]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2
    assert "an .mp4 needs ffmpeg" in refused.stderr
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.unit
def test_what_ffmpeg_says_last_is_why_a_film_cannot_be_written(tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\ncat > /dev/null\necho first >&2\necho no such codec >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    with pytest.raises(WriteError, match=r"film.mp4: ffmpeg cannot write it: no such codec"):
        write_film([Image.new("RGB", (4, 4))], tmp_path / "film.mp4", rate=20)


@pytest.mark.unit
def test_the_command_replays_a_history_and_replaces_files_only_by_force(poured, history, tmp_path):
    save(poured, tmp_path / "bed.h5")

    def call(output, *more):
        return CliRunner().invoke(
            app, ["replay", str(tmp_path / "bed.h5"), str(history), str(tmp_path / output), *more]
        )

    assert call("fall.pvd").exit_code == 0
    assert len(list(tmp_path.glob("fall.*.vtp"))) == 4
    refused = call("fall.pvd")
    assert refused.exit_code == 2
    assert "exists already" in refused.output
    assert call("fall.pvd", "--force").exit_code == 0
    unknown = call("fall.avi")
    assert unknown.exit_code == 2
    assert "motion is written as .gif, .webp, .mp4, .pvd, .usdc, .usda; got '.avi'" in unknown.output


@pytest.mark.unit
def test_motion_comes_back_from_a_history_and_one_without_frames_is_refused(history, motion, tmp_path):
    for key, values in load_motion(history).items():
        np.testing.assert_array_equal(values, motion[key])
    path = tmp_path / "series.h5"
    with HistoryWriter(path, {"time": "s"}) as writer:
        writer.append(time=0.0)
    with pytest.raises(InputError, match="holds no frames of grains that moved, only series: time"):
        load_motion(path)


@pytest.mark.unit
def test_records_that_do_not_fit_are_refused(poured, motion, tmp_path):
    fewer = {**motion, "positions": motion["positions"][:, 1:]}
    nothing = {"times": [], "positions": np.empty((0, 86, 3)), "quaternions": np.empty((0, 86, 4))}
    for write, name in ((exporters.replay, "a.pvd"), (exporters.replay, "a.usdc"), (animate, "a.gif")):
        with pytest.raises(ShapeError, match=r"positions must be of shape \(4, |beside positions of shape \(4, "):
            write(poured, tmp_path / name, **fewer)
    for write, name in ((exporters.replay, "b.pvd"), (animate, "b.gif")):
        with pytest.raises(InputError, match="at least one"):
            write(poured, tmp_path / name, **nothing)
    with pytest.raises(FileFormatError, match=r"written as .pvd, .usdc, .usda; got '.avi'"):
        exporters.replay(poured, tmp_path / "a.avi", **motion)
    with pytest.raises(FileFormatError, match=r"written as .gif, .webp or .mp4; got '.png'"):
        animate(poured, tmp_path / "a.png", **motion)
    with pytest.raises(InputError, match="seconds must be positive"):
        animate(poured, tmp_path / "a.gif", **motion, seconds=0)
    (tmp_path / "c.usdc").write_text("mine")
    with pytest.raises(WriteError, match="exists already"):
        exporters.replay(poured, tmp_path / "c.usdc", **motion, overwrite=False)
    assert (tmp_path / "c.usdc").read_text() == "mine"
