"""Recorded motions: a time series for ParaView, or a USD stage with a layer that moves its grains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from exporters.formats import find_for
from exporters.meshes.vtk import series
from grainsdem.atomic import write_all
from grainsdem.errors import FileFormatError, WriteError
from grainsdem.gate import gated

if TYPE_CHECKING:
    import os

    from numpy.typing import ArrayLike

    from grainsdem.model import Packing

SUFFIXES = (".pvd", ".usdc", ".usda")
"""What recorded motions are written as."""


@gated
def replay(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    times: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    overwrite: bool = True,
) -> list[Path]:
    """Write a recorded motion of a packing; `grainsdem.figures.animate` draws one.

    Parameters
    ----------
    packing : Packing
        The grains that were moved.
    path : str or path-like
        ``.pvd``: a list of times, and beside it a ``.vtp`` file for each, for ParaView. ``.usdc`` or ``.usda``: the
        stage of the packing, and beside it ``bed.replay.usdc``, a layer over it with time samples: what to open.
    times : array_like, shape (t,)
        When [s] each frame was recorded, growing.
    positions : array_like, shape (t, n, 3)
        Centroids [m] in each frame.
    quaternions : array_like, shape (t, n, 4)
        Rotations (w, x, y, z) in each frame.
    overwrite : bool
        Whether files that exist are replaced.

    Returns
    -------
    list of Path
        The files, the one to open first.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    InputError
        If there is no frame, or a packing cannot be written.
    ShapeError
        If the frames are not of the packing's grains.
    WriteError
        If a file cannot be written, or exists and ``overwrite`` is false.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        given = path.suffix or "no suffix"
        raise FileFormatError(f"{path}: recorded motions are written as {', '.join(SUFFIXES)}; got {given!r}")
    if path.suffix.lower() == ".pvd":
        content = series(packing, times, positions, quaternions, name=path.stem)
        return write_all(path.parent, content, overwrite=overwrite)
    from exporters.usd.replay import write_replay  # noqa: PLC0415  (pxr)

    layer = path.with_name(f"{path.stem}.replay.usdc")
    if not overwrite and layer.exists():  # before the stage is written
        raise WriteError(f"{layer}: exists already; pass overwrite=True (--force) to replace it")
    stage = find_for(path).module.files(packing, name=path.stem, suffix=path.suffix)
    written = write_all(path.parent, stage, overwrite=overwrite)
    return [write_replay(path, positions, quaternions, times, overwrite=overwrite), *written]
