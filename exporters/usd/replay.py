"""A recorded motion over a stage that was written: a second layer that says only where grains are, and when."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exporters.usd.crate import crate
from exporters.usd.prims import Attribute, Column, Many, Prim
from grainsdem.atomic import write_all
from grainsdem.errors import FileFormatError, MissingFileError, ShapeError

if TYPE_CHECKING:
    import os
    from typing import Any

    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

_FRAMES_PER_SECOND = 24.0


def write_replay(
    scene: str | os.PathLike[str],
    positions: ArrayLike,
    quaternions: ArrayLike,
    times: ArrayLike,
    *,
    path: str | os.PathLike[str] | None = None,
    overwrite: bool = True,
) -> Path:
    """Write a layer that moves the grains of a stage as they were recorded.

    Parameters
    ----------
    scene : path-like
        The stage, as `exporters.write` wrote it: ``.usdc`` or ``.usda``.
    positions : array_like, shape (t, n, 3)
        Positions [m] of all grains. Where one is absent, NaN, the stage shows it where it came in or was last.
    quaternions : array_like, shape (t, n, 4)
        Rotations (w, x, y, z) of their frames.
    times : array_like, shape (t,)
        When [s], growing. A player shows one time after another, 24 a second; the layer says how long that really took.
    path : path-like, optional
        Where it goes: into the folder of the stage, which it names; ``bed.replay.usdc`` for ``bed.usdc`` by default.
    overwrite : bool
        Whether a file that exists is replaced.

    Returns
    -------
    Path
        What to open: the stage comes with it. Bodies are kinematic in it, so that physics leaves them to the record.

    Raises
    ------
    MissingFileError, FileFormatError
        If there is no such stage, or it holds no grains of ours.
    ShapeError
        If there are not as many poses as grains and times, or times do not grow, or a number is not finite.
    WriteError
        If the file cannot be written.
    """
    scene = Path(scene)
    path = scene.with_name(f"{scene.stem}.replay.usdc") if path is None else Path(path)
    stage = _read(scene)
    places, turns, moments = _checked(positions, quaternions, times, len(stage["names"]), scene)
    spans = moments[-1] - moments[0]
    # One time a frame where times are even, as most are.
    rate = (moments.size - 1) / spans if moments.size > 1 else _FRAMES_PER_SECOND
    codes = ((moments - moments[0]) * rate).round(9)
    body = Prim(name="grain", attributes={
        "xformOp:translate": Attribute("double3", Column(_places(places, stage["length"]), times=codes)),
        "xformOp:orient": Attribute("quatd", Column(_turns(turns), times=codes)),
        "physics:kinematicEnabled": Attribute("bool", True),
    })  # fmt: skip
    grains = Prim(name="Grains", many=Many(stage["names"], body))
    metadata = {
        "defaultPrim": Attribute("token", stage["root"]),
        "metersPerUnit": Attribute("double", stage["length"]),
        "kilogramsPerUnit": Attribute("double", stage["mass"]),
        "upAxis": Attribute("token", "Z"),
        "startTimeCode": Attribute("double", 0.0),
        "endTimeCode": Attribute("double", codes[-1]),
        "timeCodesPerSecond": Attribute("double", rate),
        "framesPerSecond": Attribute("double", _FRAMES_PER_SECOND),
        "subLayers": [f"./{scene.name}"],
    }
    content = crate(Prim(name=stage["root"], children=(grains,)), metadata)
    [written] = write_all(path.parent, {path.name: content}, overwrite=overwrite)
    return written


def _read(scene: Path) -> dict[str, Any]:
    """Return the names of a stage's grains and its units."""
    from pxr import Sdf, Tf

    if not scene.is_file():
        raise MissingFileError(f"{scene}: no such file")
    try:
        layer = Sdf.Layer.FindOrOpen(str(scene))
        grains = layer.GetPrimAtPath(f"/{layer.defaultPrim}/Grains") if layer.defaultPrim else None
    except Tf.ErrorException as error:
        raise FileFormatError(
            f"{scene}: pxr does not open it: {str(error).strip().splitlines()[-1].strip()}"
        ) from error
    if not grains:
        raise FileFormatError(f"{scene}: its default prim holds no Grains")
    root = layer.pseudoRoot
    return {
        "root": layer.defaultPrim,
        "names": [child.name for child in grains.nameChildren],
        "length": root.GetInfo("metersPerUnit"),
        "mass": root.GetInfo("kilogramsPerUnit"),
    }


def _checked(
    positions: ArrayLike, quaternions: ArrayLike, times: ArrayLike, n: int, scene: Path
) -> tuple[Floats, Floats, Floats]:
    """Return the record as arrays, or raise `ShapeError`."""
    places, turns = np.asarray(positions, dtype=np.float64), np.asarray(quaternions, dtype=np.float64)
    moments = np.asarray(times, dtype=np.float64)
    t = moments.size
    if moments.ndim != 1 or t == 0 or places.shape != (t, n, 3) or turns.shape != (t, n, 4):
        raise ShapeError(
            f"positions must be of shape ({t}, {n}, 3) and quaternions of shape ({t}, {n}, 4) for {t} times and the "
            f"{n} grains of {scene.name}; got {places.shape} and {turns.shape}"
        )
    places, turns = _held(places), _held(turns)
    if not (np.isfinite(places).all() and np.isfinite(turns).all() and np.isfinite(moments).all()):
        raise ShapeError("positions, quaternions and times must be finite")
    if np.any(np.diff(moments) <= 0):
        first = int(np.flatnonzero(np.diff(moments) <= 0)[0])
        raise ShapeError(f"times must grow; got {moments[first]} and then {moments[first + 1]}")
    return places, turns, moments


def _held(poses: Floats) -> Floats:
    """Return poses, shape (t, n, k), in which a grain that is absent stays where it was last, or is to come in."""
    is_there = ~np.isnan(poses).all(axis=2)
    if is_there.all():
        return poses
    frames = np.arange(len(poses))[:, None]
    latest = np.maximum.accumulate(np.where(is_there, frames, -1), axis=0)
    chosen = np.where(latest < 0, np.argmax(is_there, axis=0), latest)
    return np.take_along_axis(poses, chosen[:, :, None], axis=0)


def _places(positions: Floats, length: float) -> Any:
    """Return what gives the positions of a stretch of grains in the stage's units, shape (k, t, 3)."""
    return lambda first, last: positions[:, first:last].swapaxes(0, 1) / length


def _turns(quaternions: Floats) -> Any:
    """Return what gives the rotations of a stretch of grains, shape (k, t, 4), of unit length."""

    def rows(first: int, last: int) -> Floats:
        turns = quaternions[:, first:last].swapaxes(0, 1)
        # A rotation has two quaternions: of neighbours in time those that are near, or a player turns the long way.
        flips = np.where(np.einsum("nti,nti->nt", turns[:, 1:], turns[:, :-1]) < 0, -1.0, 1.0)
        signs = np.concatenate([np.ones((len(turns), 1)), np.cumprod(flips, axis=1)], axis=1)
        unit: Floats = turns * (signs / np.linalg.norm(turns, axis=2))[:, :, None]
        return unit

    return rows
