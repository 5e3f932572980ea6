"""The pages of the documentation: what they point to is there, and pictures are light."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest
from PIL import Image

from grainsdem.dynamics.experiments import registry

pytestmark = pytest.mark.unit

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").rglob("*.md"))
FIGURES = ("02", "03_12", "05", "06", "07", "08", "09", "10_11", "13", "14", "15")


def targets(page):
    """Files that a page links to or shows, relative to itself."""
    found = re.findall(r"""(?:\]\(|src="|href=")([^)"#\s]+)""", page.read_text(encoding="utf-8"))
    return [page.parent / target for target in found if "://" not in target]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_page_points_to_is_there(page):
    missing = [str(target.relative_to(ROOT)) for target in targets(page) if not target.exists()]
    assert missing == []


def test_the_gallery_shows_every_figure_of_the_paper_and_its_script():
    shown = {target.resolve() for target in targets(ROOT / "docs" / "gallery.md")}
    for number in FIGURES:
        piece = ROOT / "docs" / "gallery" / f"figure_{number}.md"
        assert piece.resolve() in shown
        scripts = re.findall(r"`python (examples/\S+\.py)", piece.read_text(encoding="utf-8"))
        assert scripts
        assert all((ROOT / script).exists() for script in scripts)


def test_pictures_of_the_gallery_are_light_and_all_of_them_are_shown():
    pictures = {path.resolve() for path in (ROOT / "docs" / "images" / "gallery").glob("*.png")}
    shown = {target.resolve() for page in PAGES for target in targets(page)}
    assert {path.name for path in pictures - shown} == set()
    assert {path.name for path in pictures if path.stat().st_size > 1_000_000} == set()


def test_every_experiment_is_shown_in_motion_by_a_light_animation(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    names = runpy.run_path(str(ROOT / "examples" / "animations.py"))["EXPERIMENTS"]
    modes = {"press", "drop", "roll"}  # those of penetration
    assert {*names} - modes == {"settle", *registry.BUILT_IN} - {"penetration"}
    folder = ROOT / "docs" / "images" / "motion"
    assert {path.stem for path in folder.glob("*.gif")} == {*names}
    shown = {target.resolve() for page in PAGES for target in targets(page)}
    assert {path.name for path in folder.iterdir() if path.resolve() not in shown} == set()
    for path in folder.glob("*.gif"):
        assert path.stat().st_size <= 700_000, path.name
        with Image.open(path) as animation:
            assert animation.size[0] == 360
            assert 10 < animation.n_frames <= 40


def color_type(picture):
    """The kind of colour that a PNG file's header names: 0 grey, 2 RGB, 3 a palette, 4 and 6 with transparency."""
    head = picture.read_bytes()[:26]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    assert head[12:16] == b"IHDR"
    return head[25]


def test_no_picture_of_the_pages_is_reduced_to_a_palette():
    pictures = sorted((ROOT / "docs").rglob("*.png"))
    assert pictures
    assert [path.name for path in pictures if color_type(path) == 3] == []
