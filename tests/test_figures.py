from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import FileFormatError, InputError, MissingPackageError, ShapeError, WriteError
from grainsdem.figures import coordination_histogram, energy_plot, render, size_histogram, windows
from grainsdem.figures.scene import EYE
from grainsdem.model import ContactGraph, Domain, Packing, Polyhedra


def pixels(path):
    """Return the picture as floats in [0, 1], shape (height, width, 3), read by matplotlib."""
    from matplotlib.image import imread

    return imread(path)[..., :3]


def is_ink(image, *, saturation=0.05):
    """Return where a picture is coloured: neither white nor a grey line."""
    return np.ptp(image, axis=2) > saturation


def graph(n, pairs):
    m = len(pairs)
    return ContactGraph(n, pairs, np.zeros(m), np.tile([1.0, 0, 0], (m, 1)), np.zeros((m, 3)), np.zeros(m))


def nothing():
    return Packing(Polyhedra(np.empty((0, 3)), [0], [0], [], [0]), np.empty((0, 3)), np.empty((0, 4)), [], Domain())


@pytest.mark.client
def test_a_render_of_a_bed_has_its_size_a_white_ground_and_many_shades(fresh, tmp_path):
    image = pixels(render(fresh, tmp_path / "bed.png", size=(600, 450)))
    assert image.shape == (450, 600, 3)
    np.testing.assert_array_equal(image[[0, 0, -1, -1], [0, -1, 0, -1]], 1)
    share = is_ink(image).mean()
    assert 0.15 < share < 0.7
    assert len(np.unique((image * 255).astype(np.uint8).reshape(-1, 3), axis=0)) > 500


@pytest.mark.client
def test_a_cube_of_twice_the_edge_covers_four_times_the_area(tmp_path, backend):
    # Side by side, across the line of sight, so that perspective shows both alike.
    across = np.array([4.2, 3.0, 0.0]) / np.hypot(4.2, 3.0)
    middle = np.array([5.0, 5.0, 5.0])
    small = cube_packing([middle - 2 * across], half=0.6)
    large = cube_packing([middle + 2 * across], half=1.2)
    shapes = Polyhedra(
        np.vstack([small.grains.vertices, large.grains.vertices]),
        [0, 8, 16],
        [0, 6, 12],
        np.tile(small.grains.face_vertices, 2),
        4 * np.arange(13),
    )
    both = Packing(shapes, [*small.positions, *large.positions], np.eye(4)[[0, 0]], [1, 1], Domain.cube(10.0))
    image = pixels(render(both, tmp_path / f"{backend}.png", color_by="id", size=(800, 600)))
    assert image.shape == (600, 800, 3)
    columns = np.flatnonzero(is_ink(image).any(axis=0))
    gap = columns[np.argmax(np.diff(columns))]
    areas = is_ink(image)[:, : gap + 1].sum(), is_ink(image)[:, gap + 1 :].sum()
    assert areas[1] / areas[0] == pytest.approx(4, rel=0.1)
    assert areas[0] > 1000


@pytest.mark.client
def test_the_nearer_grain_hides_the_farther_one(tmp_path, backend):
    towards = np.array(EYE) / np.linalg.norm(EYE)
    middle = np.array([5.0, 5.0, 5.0])
    near_last = cube_packing([middle - 2 * towards, middle + 2 * towards])
    near_first = cube_packing([middle + 2 * towards, middle - 2 * towards])
    counts = []
    for packing, values in ((near_last, [0.0, 1.0]), (near_first, [1.0, 0.0])):
        image = pixels(render(packing, tmp_path / f"{backend}.png", color_by=values, size=(600, 450)))[:, :420]
        ink = is_ink(image, saturation=0.15)
        # viridis runs from purple, where blue leads, to yellow, where blue is least
        counts.append((np.sum(ink & (image[..., 2] < image[..., 1])), np.sum(ink & (image[..., 2] > image[..., 1]))))
    assert counts[0] == counts[1]
    near, far = counts[0]
    assert near > 3000
    assert far < 0.1 * near


@pytest.mark.golden
def test_a_render_repeats_to_the_byte(fresh, tmp_path, backend):
    a, b = (render(fresh, tmp_path / f"{k}{backend}.png", size=(320, 240)).read_bytes() for k in "ab")
    assert a == b


@pytest.mark.unit
def test_a_window_that_crashes_or_does_not_exist_does_not_work():
    assert not windows._works("vtkNoSuchWindow")
    assert windows.find_window() in {
        "",
        None,
        "vtkEGLRenderWindow",
        "vtkOSOpenGLRenderWindow",
        "vtkXOpenGLRenderWindow",
    }


@pytest.mark.client
def test_ids_are_told_apart_by_colour(tmp_path):
    packing = cube_packing([[2, 2, 2], [5, 2, 2], [8, 2, 2]], domain=Domain.box((10.0, 4.0, 4.0)))
    image = pixels(render(packing, tmp_path / "a.png", color_by="id", size=(600, 450)))
    colours = (image[is_ink(image, saturation=0.2)] * 8).astype(int)
    hues = {tuple(c) for c in np.unique(colours, axis=0)}
    assert len(hues) >= 6  # three grains with three visible faces each, some shades alike


@pytest.mark.client
@pytest.mark.parametrize("color_by", ["diameter", "sphericity", "height", "class"])
def test_every_quantity_can_colour_the_grains(fresh, tmp_path, color_by):
    bed = replace(fresh, classes=np.arange(len(fresh)) % 3)
    assert is_ink(pixels(render(bed, tmp_path / "a.png", color_by=color_by, size=(300, 200)))).any()


@pytest.mark.unit
def test_grains_of_one_size_and_very_small_grains_can_be_drawn(tmp_path):
    packing = cube_packing([[3e-7, 3e-7, 3e-7]], half=1e-7, domain=Domain.cube(1e-6))
    assert is_ink(pixels(render(packing, tmp_path / "a.png", size=(300, 200)))).any()
    assert size_histogram(packing, tmp_path / "b.png").is_file()


@pytest.mark.unit
def test_without_pyvista_a_render_says_how_to_install_it(fresh, tmp_path, monkeypatch):
    original = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "pyvista" else original(name, *a))
    with pytest.raises(MissingPackageError, match=r'pip install "grainsdem\[viz\]"'):
        render(fresh, tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.golden
def test_plots_repeat_to_the_byte_and_hold_no_version(fresh, tmp_path):
    history = {"time": [0, 1, 2, 3], "kinetic_energy": [1, 1e-2, 0, 1e-6]}
    pairs = [[0, 1], [1, 2], [2, 3], [1, 3]]
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        size_histogram(fresh, tmp_path / name / "sizes.png", sieves=[8e-4, 1e-3, 1.2e-3])
        coordination_histogram(graph(5, pairs), tmp_path / name / "coordination.png")
        energy_plot(history, tmp_path / name / "energy.png")
    for file in ("sizes.png", "coordination.png", "energy.png"):
        content = (tmp_path / "a" / file).read_bytes()
        assert content == (tmp_path / "b" / file).read_bytes()
        assert b"atplotlib" not in content
        assert is_ink(pixels(tmp_path / "a" / file)).mean() > 0.002


@pytest.mark.client
def test_drawing_leaves_matplotlib_as_it_was(tmp_path):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    energy_plot({"time": [0, 1], "kinetic_energy": [1, 0.1]}, tmp_path / "a.png")
    assert dict(mpl.rcParams) == before


@pytest.mark.unit
def test_the_curve_carries_the_percentiles_by_mass(fresh, tmp_path, monkeypatch):
    from matplotlib.axes import Axes

    from grainsdem.measures import diameters, masses, percentiles

    texts = []
    monkeypatch.setattr(Axes, "annotate", lambda _, text, *args, **kwargs: texts.append(text))  # noqa: ARG005
    size_histogram(fresh, tmp_path / "a.png")
    d = percentiles(diameters(fresh.grains), (10, 50, 90), weights=masses(fresh)) * 1e3
    assert [t.split(" = ")[1] for t in texts] == [f"{x:#.3g} mm" for x in d]


def gradings():
    """Beds of cubes by what is odd about their sizes, with sieves to draw or none."""

    def of(diameters):
        halves = 0.5 * np.cbrt(np.pi / 6) * np.asarray(diameters)
        cubes = [cube_packing([[0, 0, 0]], half=half) for half in halves]
        shapes = Polyhedra(
            np.vstack([cube.grains.vertices for cube in cubes]),
            8 * np.arange(len(cubes) + 1),
            6 * np.arange(len(cubes) + 1),
            np.tile(cubes[0].grains.face_vertices, len(cubes)),
            4 * np.arange(6 * len(cubes) + 1),
        )
        n = len(cubes)
        return Packing(shapes, np.zeros((n, 3)), np.eye(4)[np.zeros(n, int)], np.ones(n), Domain())

    share = (np.arange(200) + 0.5) / 200
    sieves = [8e-4, 1e-3, 1.2e-3]
    return {
        "narrow": (of(1e-3 * (1 + 0.02 * share)), None),
        "wide": (of(1e-4 * 300**share), None),
        "steep on the left": (of(np.append(1e-3 * (1 + 0.01 * share), [4e-3])), sieves),
        "two sizes": (of(np.append(np.full(800, 1e-4), np.full(2, 7e-4))), None),
        "one grain": (of([2e-5]), None),
        "boulders": (of(1.0 + 0.9 * share), [0.5, 3.0]),
    }


@pytest.mark.unit
@pytest.mark.parametrize("name", gradings())
def test_on_a_plot_of_sizes_no_text_lies_on_another_on_the_curve_or_outside_its_frame(name, tmp_path, monkeypatch):
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation, Text

    drawn = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: (drawn.append(self), save(self, *a, **k)))
    packing, sieves = gradings()[name]
    size_histogram(packing, tmp_path / "a.png", sieves=sieves)
    (figure,) = drawn
    passing, shares, top = figure.axes
    assert passing.get_xscale() == shares.get_xscale() == "log"
    limits = np.array(passing.get_xlim())
    unit = shares.get_xlabel().split("[")[1].rstrip("]")
    millimetres = {"m": 1e3, "mm": 1.0, "µm": 1e-3}[unit]
    np.testing.assert_allclose(top.get_xlim(), -np.log2(limits * millimetres), rtol=1e-12, atol=1e-12)
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text()]
    # Ticks beyond the limits have labels that are never drawn.
    for axis in (passing.xaxis, shares.xaxis, top.xaxis, passing.yaxis, shares.yaxis, top.yaxis):
        low, high = sorted(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            if not low <= tick.get_loc() <= high:
                texts = [t for t in texts if t not in {tick.label1, tick.label2}]
    boxes = [t.get_window_extent() for t in texts]
    assert all(np.all(box.min >= figure.bbox.min) and np.all(box.max <= figure.bbox.max) for box in boxes)
    clashes = [
        (texts[i].get_text(), texts[j].get_text())
        for i in range(len(texts))
        for j in range(i)
        if boxes[i].overlaps(boxes[j])
    ]
    assert clashes == []
    assert sum(bool(label.get_text()) for label in shares.get_xticklabels()) >= 2
    names = [t for t in texts if isinstance(t, Annotation)]
    assert len(names) == 3
    curve = passing.lines[0].get_path().interpolated(20)
    steps = passing.transData.transform(np.vstack([curve.vertices, _risers(curve.vertices)]))
    for named in names:
        box = Text.get_window_extent(named)
        assert np.all(box.min >= passing.bbox.min)
        assert np.all(box.max <= passing.bbox.max)
        assert not ((steps > box.min) & (steps < box.max)).all(axis=1).any()


def _risers(vertices):
    """Return points along the vertical parts of a stepped line."""
    tops = np.repeat(vertices[1:], 21, axis=0)
    tops[:, 1] = np.linspace(vertices[:-1, 1], vertices[1:, 1], 21, axis=1).ravel()
    return tops


@pytest.mark.unit
def test_other_suffixes_and_folders_that_are_not_there_are_refused(fresh, tmp_path):
    for draw in (
        lambda p: render(fresh, p),
        lambda p: size_histogram(fresh, p),
        lambda p: coordination_histogram(graph(2, [[0, 1]]), p),
        lambda p: energy_plot({"time": [0], "kinetic_energy": [1]}, p),
    ):
        with pytest.raises(FileFormatError, match=r"written as \.png; got '\.jpg'"):
            draw(tmp_path / "a.jpg")
        with pytest.raises(WriteError, match="cannot be written"):
            draw(tmp_path / "nowhere" / "a.png")


@pytest.mark.unit
def test_what_cannot_be_drawn_is_refused(fresh, tmp_path):
    path = tmp_path / "a.png"
    with pytest.raises(InputError, match="no grains"):
        render(nothing(), path)
    with pytest.raises(InputError, match="no grains"):
        size_histogram(nothing(), path)
    with pytest.raises(InputError, match="no grains"):
        coordination_histogram(graph(0, np.empty((0, 2))), path)
    with pytest.raises(
        InputError, match=r"color_by must be diameter, .*, id, class, layers, columns, halves or one value"
    ):
        render(fresh, path, color_by="mood")
    with pytest.raises(InputError, match="no classes to be coloured by"):
        render(fresh, path, color_by="class")
    with pytest.raises(InputError, match="one finite value a grain"):
        render(fresh, path, color_by=[1.0, 2.0])
    with pytest.raises(InputError, match="16 to 16384 pixels"):
        render(fresh, path, size=(0, 100))
    with pytest.raises(InputError, match="sieve openings must be positive"):
        size_histogram(fresh, path, sieves=[0.0, 1e-3])
    with pytest.raises(InputError, match="it lacks kinetic_energy"):
        energy_plot({"time": [0.0]}, path)
    with pytest.raises(ShapeError, match=r"got \(2,\) and \(1,\)"):
        energy_plot({"time": [0.0, 1.0], "kinetic_energy": [1.0]}, path)
    with pytest.raises(InputError, match="no sample of the history has kinetic energy"):
        energy_plot({"time": [0.0], "kinetic_energy": [0.0]}, path)
    assert list(tmp_path.iterdir()) == []
