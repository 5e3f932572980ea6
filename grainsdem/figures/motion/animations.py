"""Animations of a recorded motion: GIF, WebP or MPEG-4, for pages and talks, from the pictures that `render` draws."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError, InputError, ShapeError
from grainsdem.figures.motion.bodies import surrounded
from grainsdem.figures.motion.videos import find_ffmpeg, write_film
from grainsdem.figures.renders import painting
from grainsdem.figures.scene import set_scene
from grainsdem.gate import gated
from grainsdem.looks import View  # noqa: TC001  (read at the door: `grainsdem.gate`)
from grainsdem.measures import diameters
from grainsdem.packing.carve import subset

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.figures.scene import Scene
    from grainsdem.model import Packing, Surroundings

    Floats = NDArray[np.float64]

SUFFIXES = (".gif", ".webp", ".mp4")
"""What animations are written as."""

FRAMES_PER_SECOND = 20
"""Pictures a second: GIF counts hundredths of a second, and viewers slow down what is faster than two."""

SAMPLED = 8
"""From about how many of its pictures the palette of a GIF is made."""

WHITE = 245
"""Least of red, green and blue of a colour of a GIF that becomes white: a palette has means of what it merges."""


@gated
def animate(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    times: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    color_by: str | ArrayLike = "id",
    size: tuple[int, int] = (640, 480),
    seconds: float = 5.0,
    n_pictures: int | None = None,
    since: float | None = None,
    until: float | None = None,
    view: View | None = None,
    around: Surroundings | None = None,
    outline: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Draw a recorded motion as an animation that lasts some seconds.

    Parameters
    ----------
    packing : Packing
        The grains that were moved.
    path : str or path-like
        Ends in ``.gif``, ``.webp`` or, where ffmpeg is found, ``.mp4``; replaced if it exists.
    times : array_like, shape (t,)
        When [s] each frame was recorded, growing.
    positions : array_like, shape (t, n, 3)
        Centroids [m] in each frame; NaN for a grain that is absent.
    quaternions : array_like, shape (t, n, 4)
        Rotations (w, x, y, z) in each frame.
    color_by : {"diameter", "sphericity", "height", "id", "class", "layers", "columns", "halves"} or array_like
        As in `render`, shape (n,); what a grain has in the first picture, or as it comes in, colours it all the time.
    size : tuple of int
        Width and height [pixels].
    seconds : float
        How long the animation lasts, whatever the time that was recorded: the frame nearest to each moment is shown.
    n_pictures : int, optional
        How many pictures it has; twenty a second by default. Fewer make a smaller file.
    since, until : float, optional
        The time [s] of the record that is shown; all of it by default.
    view : {"corner", "front", "side", "top"}, optional
        As in `render`.
    around : Surroundings, optional
        What was recorded around the grains (`load_surroundings`): bodies are drawn as glass, and where gravity turns,
        the pictures do, so that it points down in each.
    outline : bool
        Whether the outline of the container is drawn.
    progress : callable, optional
        Called with the pictures drawn and their number.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    InputError
        If there is no frame, or none between the times that are asked for, ``seconds`` is not positive, there are less
        than two pictures, or as in `render`.
    ShapeError
        If the frames are not of the packing's grains or not as many as those around them, or times do not grow.
    MissingPackageError
        Where PyVista is not installed, or ffmpeg is not found for an ``.mp4``.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        given = target.suffix or "no suffix"
        allowed = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
        raise FileFormatError(f"{target}: animations are written as {allowed}; got {given!r}")
    if not (np.isfinite(seconds) and seconds > 0):
        raise InputError(f"seconds must be positive and finite; got {seconds}")
    if target.suffix.lower() == ".mp4":
        find_ffmpeg()  # before pictures are drawn for nothing
    if n_pictures is not None and n_pictures < 2:
        raise InputError(f"an animation has two pictures or more; got {n_pictures}")
    moments = _checked(packing, times, positions, quaternions)
    if around is not None and len(around.gravity) != len(moments):
        raise ShapeError(
            f"around must have as many frames as there are times, {len(moments)}; got {len(around.gravity)}"
        )
    shown = _between(moments, since, until)
    chosen = shown.start + _even(moments[shown], n_pictures or max(2, round(seconds * FRAMES_PER_SECOND)))
    falls = around is None or bool(around.gravity[chosen].any())
    scenes = _scenes(
        packing, np.asarray(positions), np.asarray(quaternions), chosen, color_by=color_by, view=view, falls=falls
    )
    scenes = [scene if outline else scene._replace(outline=None) for scene in scenes]
    if around is not None:
        scenes = surrounded(scenes, around, chosen)
    with painting((2 * size[0], 2 * size[1]), fine=False) as draw, replacing(target) as temporary:
        pictures = list(_pictures(scenes, draw, size, progress))
        _write(pictures, temporary, target.suffix.lower(), 1000.0 * seconds / len(pictures))
    return target


def _checked(packing: Packing, times: ArrayLike, positions: ArrayLike, quaternions: ArrayLike) -> NDArray[np.float64]:
    """Return the times, or raise where the record is not one of the packing."""
    moments = np.asarray(times, dtype=np.float64)
    t, n = moments.size, len(packing)
    if moments.ndim != 1 or t == 0:
        raise InputError(f"an animation needs at least one recorded frame; got times of shape {moments.shape}")
    found = np.shape(positions), np.shape(quaternions)
    if found != ((t, n, 3), (t, n, 4)):
        raise ShapeError(
            f"positions must be of shape ({t}, {n}, 3) and quaternions of shape ({t}, {n}, 4), for {t} times and the "
            f"packing's {n} grains; got {found[0]} and {found[1]}"
        )
    if np.any(np.diff(moments) < 0):
        raise ShapeError("times must grow")
    return moments


def _between(moments: Floats, since: float | None, until: float | None) -> slice:
    """Return which of the moments, which grow, lie between two times."""
    first = 0 if since is None else int(np.searchsorted(moments, since))
    last = len(moments) if until is None else int(np.searchsorted(moments, until, side="right"))
    if first >= last:
        raise InputError(
            f"nothing was recorded between since = {since} and until = {until}: the {len(moments)} frames are from "
            f"{moments[0]:g} to {moments[-1]:g} s"
        )
    return slice(first, last)


def _even(moments: NDArray[np.float64], n: int) -> NDArray[np.int64]:
    """Return, for moments evenly spread over the record, the frame nearest to each."""
    wanted = np.linspace(moments[0], moments[-1], n if moments.size > 1 else 1)
    after = np.clip(np.searchsorted(moments, wanted), 1, max(moments.size - 1, 1))
    before = after - 1
    is_later = np.abs(moments[np.minimum(after, moments.size - 1)] - wanted) < np.abs(moments[before] - wanted)
    chosen: NDArray[np.int64] = np.where(is_later, after, before)
    return chosen


def _scenes(
    packing: Packing,
    positions: Floats,
    quaternions: Floats,
    chosen: NDArray[np.int64],
    *,
    color_by: str | ArrayLike,
    view: View | None,
    falls: bool,
) -> list[Scene]:
    """Return what each picture shows: one outline, one place for the eye and one scale of colours for all."""
    is_present = np.isfinite(positions[..., 0])
    # Where each grain is first, from the first picture on; before that where it never comes back.
    order = np.roll(np.arange(len(positions)), -int(chosen[0]))
    arrived = order[np.argmax(is_present[order], axis=0)], np.arange(len(packing))
    starts, turns = positions[arrived], quaternions[arrived]
    never = ~is_present.any(axis=0)  # such grains have a colour that no picture shows
    starts[never], turns[never] = packing.domain.lower, (1.0, 0.0, 0.0, 0.0)
    first = set_scene(replace(packing, positions=starts, quaternions=turns), color_by, view)
    # A frame that is shown longer is one scene, drawn once.
    scenes = {}
    for k in np.unique(chosen).tolist():
        moved = replace(packing, positions=positions[k], quaternions=quaternions[k], links=None)
        here = moved if is_present[k].all() else subset(moved, np.flatnonzero(is_present[k]))
        scenes[k] = first._replace(packing=here, values=first.values[is_present[k]])
    ends = [scenes[k].packing for k in (int(chosen[0]), int(chosen[-1]))]
    up = int(np.argmax(first.up))
    tops = [set_scene(state, "id").upper[up] for state in ends if len(state)]
    upper = first.upper.copy()
    upper[up] = max(tops, default=upper[up])
    # Grains may run out of what held them; where there is gravity those that fall from above come into the picture.
    reach = 0.5 * float(diameters(packing.grains).max(initial=0.0))
    places = positions[chosen][is_present[chosen]]
    low = np.minimum(first.lower, places.min(axis=0, initial=np.inf) - reach)
    high = np.maximum(upper, places.max(axis=0, initial=-np.inf) + reach)
    if falls:
        high[up] = upper[up]
    container = first.lower, upper
    return [scenes[k]._replace(lower=low, upper=high, outline=container) for k in chosen.tolist()]


def _pictures(
    scenes: list[Scene],
    draw: Callable[[Scene, Path], None],
    size: tuple[int, int],
    progress: Callable[[int, int], None] | None,
) -> Iterator[Any]:
    """Yield the pictures; a scene that is the one before is not drawn again."""
    from PIL import Image  # noqa: PLC0415  (a fifth of a second, for animations alone)

    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "frame.png"
        picture = None
        before: Scene | None = None
        for k, scene in enumerate(scenes):
            if picture is None or before is None or scene.packing is not before.packing:
                draw(scene, place)
                with Image.open(place) as image:
                    picture = image.convert("RGB").resize(size, Image.Resampling.BOX)
            before = scene
            if progress is not None:
                progress(k + 1, len(scenes))
            yield picture


def _write(pictures: list[Any], path: Path, suffix: str, milliseconds: float) -> None:
    """Write the pictures as one file that runs for ever."""
    from PIL import Image  # noqa: PLC0415  (a fifth of a second, for animations alone)

    if suffix == ".mp4":
        write_film(pictures, path, rate=1000.0 / milliseconds)
        return
    if suffix == ".webp":
        pictures[0].save(
            path, format="WEBP", save_all=True, append_images=pictures[1:], duration=round(milliseconds), loop=0,
            quality=80,
        )  # fmt: skip
        return
    # One palette for all pictures: colours that flicker are worse than colours a little off.
    width, height = pictures[0].size
    some = pictures[:: max(1, len(pictures) // SAMPLED)]
    strip = Image.new("RGB", (width, height * len(some)))
    for k, picture in enumerate(some):
        strip.paste(picture, (0, k * height))
    shared = strip.quantize(128, method=Image.Quantize.MEDIANCUT)
    palette = np.array(shared.getpalette()).reshape(-1, 3)
    palette[palette.min(axis=1) >= WHITE] = 255  # the ground shall be that of the page
    shared.putpalette(palette.ravel().tolist())
    frames = [picture.quantize(palette=shared, dither=Image.Dither.NONE) for picture in pictures]
    frames[0].save(
        path, format="GIF", save_all=True, append_images=frames[1:], duration=round(milliseconds / 10) * 10, loop=0,
    )  # fmt: skip
