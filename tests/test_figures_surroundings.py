"""What is around the grains: recorded where it was, stored, and drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from loading import grow_planar
from PIL import Image
from typer.testing import CliRunner

from exporters.mjcf import MjcfOptions
from grainsdem.cli import app
from grainsdem.dynamics import drum
from grainsdem.dynamics.around import bodies_of, places_of
from grainsdem.dynamics.scene import equip, scene_of
from grainsdem.errors import InputError, ShapeError
from grainsdem.figures import animate, render
from grainsdem.figures.scene import set_scene
from grainsdem.model import Domain, Surroundings
from grainsdem.storage import HistoryWriter, load_history, load_surroundings, save


def frames(path):
    """Return the pictures of an animation as integers, shape (n, height, width, 3)."""
    with Image.open(path) as image:
        pictures = []
        for k in range(image.n_frames):
            image.seek(k)
            pictures.append(np.asarray(image.convert("RGB"), int))
    return np.array(pictures)


def middle_of_colour(picture):
    """Return where what is coloured is in the mean, from the middle of the picture: right and up, over its height."""
    rows, columns = np.nonzero(np.ptp(picture, axis=2) > 25)
    height, width = picture.shape[:2]
    return np.array([columns.mean() - width / 2, height / 2 - rows.mean()]) / height


def box(half, place, n_frames=1):
    """Return a cube as the only body, at one place in all frames, under gravity along −z."""
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    triangles = [[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7], [0, 4, 1], [1, 4, 5]]
    triangles += [[2, 3, 6], [3, 7, 6], [0, 2, 4], [2, 6, 4], [1, 5, 3], [3, 5, 7]]
    return Surroundings(
        ("box",), corners, triangles, np.zeros(8), np.tile(place, (n_frames, 1, 1)),
        np.tile([1.0, 0.0, 0.0, 0.0], (n_frames, 1, 1)), np.tile([0.0, 0.0, -1.0], (n_frames, 1)),
    )  # fmt: skip


def still(packing, n_frames=1):
    """Return a record in which grains stay where they are."""
    return {
        "times": np.arange(n_frames) * 0.1,
        "positions": np.tile(packing.positions, (n_frames, 1, 1)),
        "quaternions": np.tile(packing.quaternions, (n_frames, 1, 1)),
    }


def volume(around, number):
    """Return the volume of a body by the divergence theorem: above zero where triangles are wound outward."""
    mine = around.triangles[around.vertex_bodies[around.triangles[:, 0]] == number]
    a, b, c = (around.vertices[mine[:, k]] for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c))) / 6


@pytest.mark.client
def test_bodies_of_every_shape_have_its_volume_in_si_and_their_places():
    packing = cube_packing([[5.0, 5.0, 5.0]], half=0.5e-3, domain=Domain.cube(10.0))
    packing = replace(packing, positions=1e-3 * packing.positions, domain=Domain.cube(10e-3))
    options = MjcfOptions()
    apparatus = equip(packing, options)
    half, tall = 0.5, 1.5
    body = apparatus.add_body("lid", (1.0, 2.0, 3.0), [("lift", "slide", (0.0, 0.0, 1.0))], mass=1.0)
    apparatus.add_shape(body, "lid_plate", "box", (half, 2 * half, 3 * half), position=(0.0, 0.0, 1.0))
    quarter = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
    apparatus.add_shape(None, "post", "cylinder", (half, tall), position=(8.0, 8.0, 5.0), quaternion=quarter)
    apparatus.add_shape(None, "ball", "sphere", (half,), position=(2.0, 8.0, 5.0))
    wedge = np.array([[8, 2, 2], [9, 2, 2], [8, 3, 2], [8, 2, 3]], float)
    apparatus.add_hull(None, "wedge", wedge)
    scene = scene_of(packing, apparatus.text(), options.gravity)
    d = scene.units.length
    around = bodies_of(scene)
    assert set(around.names) == {"lid", "post", "ball", "wedge"}
    volumes = {name: volume(around, k) / d**3 for k, name in enumerate(around.names)}
    # A prism over a polygon of 32 corners has 0.6 % less than a cylinder, such a ball 1.9 % less than a sphere.
    assert volumes["lid"] == pytest.approx(6 * (2 * half) ** 3)
    assert volumes["wedge"] == pytest.approx(1 / 6)
    assert 0.985 < volumes["post"] / (np.pi * half**2 * 2 * tall) < 1
    assert 0.97 < volumes["ball"] / (4 / 3 * np.pi * half**3) < 1
    # The post lies along x.
    post = around.vertices[around.vertex_bodies == around.names.index("post")] / d
    np.testing.assert_allclose(np.ptp(post, axis=0), [2 * tall, 2 * half, 2 * half], rtol=1e-6)
    scene.engine.place("lift", 0.25)
    positions, _, gravity = places_of(scene, around.names)
    np.testing.assert_allclose(positions[around.names.index("lid")], d * np.array([1.0, 2.0, 3.25]), rtol=1e-9)
    np.testing.assert_allclose(gravity, [0.0, 0.0, -1.0])
    scene.engine.remove("lid")
    positions, quaternions, _ = places_of(scene, around.names)
    assert np.isnan(positions[around.names.index("lid")]).all()
    assert np.isnan(quaternions[around.names.index("lid")]).all()
    assert np.isfinite(positions[around.names.index("post")]).all()


@pytest.fixture(scope="module")
def turned(shake, tmp_path_factory):
    """A drum that has turned for a while, and its history."""
    del shake
    path = tmp_path_factory.mktemp("drum") / "history.h5"
    return drum(grow_planar(16), rng=1, turns=0.1, history_path=path), path


@pytest.mark.slow
@pytest.mark.client
def test_a_history_knows_how_far_the_drum_had_turned_in_each_frame(turned):
    outcome, path = turned
    history, around = load_history(path), load_surroundings(path)
    turns = np.interp(history["frame_times"], outcome.history["time"], outcome.history["turns"])
    angles = 2 * np.arctan2(around.quaternions[:, around.names.index("drum"), 3], around.quaternions[:, 0, 0])
    np.testing.assert_allclose(angles, 2 * np.pi * turns, atol=1e-6)
    assert turns[-1] > 0.09
    np.testing.assert_allclose(around.gravity, np.tile([0.0, -1.0, 0.0], (len(turns), 1)))


@pytest.mark.client
def test_the_command_shows_a_drum_in_so_many_pictures_of_a_size_from_a_time_on(turned, tmp_path):
    outcome, path = turned
    bed = save(outcome.packing, tmp_path / "bed.h5")
    since = outcome.history["time"][outcome.history["stage"] == 1.0][0]
    words = ["replay", str(bed), str(path), str(tmp_path / "drum.gif"), "--pictures", "3", "--size", "120", "100"]
    words += ["--color-by", "halves", "--no-outline", "--seconds", "1"]
    done = CliRunner().invoke(app, [*words, "--since", str(since)])
    assert done.exit_code == 0, done.output
    pictures = frames(tmp_path / "drum.gif")
    assert pictures.shape == (3, 100, 120, 3)
    # The glass of the drum is grey, as nothing else is where no outline is drawn.
    grey = (np.ptp(pictures[0], axis=2) < 12) & (pictures[0].max(axis=2) > 100) & (pictures[0].max(axis=2) < 230)
    assert 0.03 < grey.mean() < 0.4
    refused = CliRunner().invoke(app, [*words, "--since", "1e9"])
    assert refused.exit_code == 2
    assert "nothing was recorded between since = 1000000000.0" in " ".join(refused.stderr.split())


@pytest.mark.unit
def test_what_was_written_around_the_grains_is_read_again(tmp_path):
    path, around = tmp_path / "run.h5", box(1e-3, [0.0, 0.0, 2e-3], n_frames=2)
    with HistoryWriter(path, ["time"], n_grains=1, around=around) as writer:
        for k in range(2):
            pose = {"positions": np.zeros((1, 3)), "quaternions": np.eye(4)[:1]}
            writer.append_frame(k, **pose, around=(around.positions[k], around.quaternions[k], around.gravity[k]))
        with pytest.raises(ShapeError, match=r"gravity around the grains must have shape \(3,\); got \(2,\)"):
            writer.append_frame(2, **pose, around=(around.positions[0], around.quaternions[0], [0, 1]))
        with pytest.raises(InputError, match="frames need what is around the grains"):
            writer.append_frame(2, **pose)
    found = load_surroundings(path)
    assert found.names == ("box",)
    for name in ("vertices", "triangles", "vertex_bodies", "positions", "quaternions", "gravity"):
        np.testing.assert_array_equal(getattr(found, name), getattr(around, name))
    with HistoryWriter(tmp_path / "bare.h5", ["time"], n_grains=1) as writer:
        writer.append_frame(0, **pose)
        with pytest.raises(InputError, match="only there"):
            writer.append_frame(1, **pose, around=(around.positions[0], around.quaternions[0], around.gravity[0]))
    assert load_surroundings(tmp_path / "bare.h5") is None


@pytest.mark.unit
def test_surroundings_whose_triangles_have_no_corners_are_refused():
    good = box(1.0, [0.0, 0.0, 0.0])
    with pytest.raises(ShapeError, match="triangles must be 0 to 7; got 0 to 8"):
        replace(good, triangles=np.array([[0, 1, 8]]))
    with pytest.raises(ShapeError, match=r"positions must have shape \(1, 1, 3\)"):
        replace(good, positions=np.zeros((2, 1, 3)))


@pytest.mark.client
@pytest.mark.parametrize(("view", "place"), [("front", (2.0, 3.0)), ("side", (-1.0, 3.0)), ("top", (2.0, -1.0))])
def test_straight_on_a_grain_is_where_it_is_seen_from_there(view, place, backend, tmp_path):
    # From the middle of the box 2 to the right (x), 1 to the front (−y) and 3 up.
    packing = cube_packing([[7.0, 4.0, 8.0]], half=0.5)
    path = render(packing, tmp_path / f"{backend}.png", color_by="layers", size=(300, 300), view=view)
    picture = np.asarray(Image.open(path).convert("RGB"), int)
    upper = set_scene(packing, "id").upper[2]  # the box is drawn to a little above the grain
    height = 10.0 if view == "top" else upper
    offset = middle_of_colour(picture) * picture.shape[0]
    expected = np.array([place[0], place[1] + (0.0 if view == "top" else 5.0 - 0.5 * upper)])
    # Scale: the wider side fills 95 % of the picture, here and there less by the painter's margins.
    scale = 0.95 * 300 / max(10.0, height)
    np.testing.assert_allclose(offset / scale, expected, atol=0.25 if backend == "opengl" else 0.6)


@pytest.mark.client
def test_pictures_turn_with_gravity(tmp_path, backend):
    # Gravity along +x: what is in the middle of the right side is then at the bottom.
    packing = cube_packing([[9.0, 5.0, 5.0]], half=0.5)
    around = replace(box(0.1, [5.0, 5.0, 5.0], n_frames=2), gravity=np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]))
    record, look = still(packing, 2), {"size": (200, 200), "n_pictures": 2, "color_by": "layers", "view": "front"}
    path = animate(packing, tmp_path / f"{backend}.gif", **record, **look, around=around)
    before, after = map(middle_of_colour, frames(path))
    assert before[0] > 0.15
    assert after[1] == pytest.approx(-before[0], abs=0.04)
    assert after[0] == pytest.approx(before[1], abs=0.04)


@pytest.mark.client
def test_bodies_are_drawn_as_glass_and_one_that_was_taken_away_is_not(tmp_path, backend):
    packing = cube_packing([[5.0, 8.0, 5.0]], half=0.5)
    around = box(2.0, [3.0, 2.0, 5.0], n_frames=2)  # seen from the front, before the left half of the grain
    gone = around.positions.copy()
    gone[0] = np.nan
    look = {"size": (200, 200), "n_pictures": 2, "color_by": "layers", "view": "front", "outline": False}
    path = animate(
        packing, tmp_path / f"{backend}.gif", **still(packing, 2), **look, around=replace(around, positions=gone)
    )
    away, there = np.ptp(frames(path), axis=3)
    # Behind glass the grain is seen as well, and is duller.
    assert (there > 15).sum() == pytest.approx((away > 15).sum(), rel=0.1)
    assert 0.3 < (there > away.max() - 5).sum() / (away > away.max() - 5).sum() < 0.7
    is_glass = [
        ((colour < 12) & (picture.max(axis=2) < 252)).mean()
        for colour, picture in zip((away, there), frames(path), strict=True)
    ]
    assert is_glass[0] < 0.01
    assert is_glass[1] > 0.03


@pytest.mark.unit
def test_grains_that_run_out_stay_in_a_picture_that_does_not_move(tmp_path):
    packing = cube_packing([[5.0, 5.0, 1.0], [2.0, 5.0, 1.0]], half=1.0)
    record = still(packing, 3)
    record["positions"] = record["positions"].copy()
    record["positions"][1:, 0, 0] = 6.0, 25.0  # far outside of the box, 10 wide
    path = animate(packing, tmp_path / "a.gif", **record, size=(240, 80), n_pictures=3, color_by="layers", view="front")
    pictures = frames(path)
    columns = [np.flatnonzero((np.ptp(picture, axis=2) > 25).any(axis=0)) for picture in pictures]
    assert columns[0].min() == columns[2].min()  # the grain that stays
    assert columns[2].max() - columns[0].max() > 100
    assert columns[2].max() < 239
    assert all((picture[:, -1] > 250).all() for picture in pictures)


@pytest.mark.unit
@pytest.mark.parametrize(("gravity", "is_seen"), [(-1.0, False), (0.0, True)])
def test_what_is_high_above_is_in_the_picture_from_the_first_only_where_nothing_falls(gravity, is_seen, tmp_path):
    packing = cube_packing([[5.0, 5.0, 1.0]], half=1.0)
    record = still(packing, 2)
    record["positions"] = record["positions"].copy()
    record["positions"][0, 0, 2] = 15.0  # half as high again as the box
    around = replace(box(0.1, [5.0, 5.0, 1.0], n_frames=2), gravity=np.array([[0.0, 0.0, gravity]] * 2))
    look = {"size": (90, 120), "n_pictures": 2, "color_by": "layers", "view": "front", "outline": False}
    first, last = frames(animate(packing, tmp_path / "a.gif", **record, **look, around=around))
    assert bool((np.ptp(first, axis=2) > 25).any()) is is_seen
    assert (np.ptp(last, axis=2) > 25).any()


@pytest.mark.unit
@pytest.mark.parametrize(("kind", "axis"), [("layers", 2), ("columns", 0)])
def test_layers_and_columns_hold_as_many_grains_each_in_their_order(kind, axis):
    rng = np.random.default_rng(3)
    packing = cube_packing(rng.uniform(1.0, 9.0, (40, 3)), half=0.1)
    values = set_scene(packing, kind).values
    np.testing.assert_array_equal(np.bincount(values.astype(int)), np.full(5, 8))
    assert (np.diff(values[np.argsort(packing.positions[:, axis])]) >= 0).all()
    # In planar work up is y.
    flat = replace(packing, domain=replace(packing.domain, is_planar=True))
    along = flat.positions[:, 1 if kind == "layers" else 0]
    assert (np.diff(set_scene(flat, kind).values[np.argsort(along)]) >= 0).all()


@pytest.mark.unit
def test_halves_are_left_and_right_and_what_is_drawn_is_asked_for_by_known_names(tmp_path):
    packing = cube_packing([[2.0, 5.0, 5.0], [8.0, 5.0, 5.0]])
    np.testing.assert_array_equal(set_scene(packing, "halves").values, [0.0, 1.0])
    with pytest.raises(InputError, match="view must be 'corner', 'front', 'side' or 'top' or None; got 'back'"):
        render(packing, tmp_path / "a.png", view="back")
    with pytest.raises(InputError, match="two pictures or more; got 1"):
        animate(packing, tmp_path / "a.gif", **still(packing), n_pictures=1)
    with pytest.raises(ShapeError, match="as many frames as there are times, 3; got 1"):
        animate(packing, tmp_path / "a.gif", **still(packing, 3), around=box(1.0, [0.0, 0.0, 0.0]))
    with pytest.raises(InputError, match=r"between since = 0.25 and until = 0.28: the 3 frames are from 0 to 0.2 s"):
        animate(packing, tmp_path / "a.gif", **still(packing, 3), since=0.25, until=0.28)
    assert list(tmp_path.iterdir()) == []
