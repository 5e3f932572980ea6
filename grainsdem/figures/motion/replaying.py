"""A run shown again from its history: drawn, or written for other programs, by the suffix of the path."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import exporters
from grainsdem.errors import FileFormatError
from grainsdem.figures.motion.animations import SUFFIXES, animate
from grainsdem.gate import gated
from grainsdem.storage import load_motion, load_moved, load_surroundings

if TYPE_CHECKING:
    import os

    from grainsdem.model import Packing


@gated
def replay(
    history: str | os.PathLike[str],
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = True,
    **look: Any,
) -> list[Path]:
    """Show how grains moved in a run, with what was around them.

    Parameters
    ----------
    history : str or path-like
        The run's history, with frames.
    packing : Packing
        The grains at the end of the run.
    path : str or path-like
        Ends in ``.gif``, ``.webp`` or ``.mp4`` for an animation, or as `exporters.replay` says.
    overwrite : bool
        Whether files for other programs may be replaced; an animation always is.
    **look
        What an animation looks like: options of `animate`.

    Returns
    -------
    list of pathlib.Path
        What was written.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    InputError, ShapeError, MissingFileError, MissingPackageError, WriteError
        As in `animate`, `exporters.replay` and `load_motion`.
    """
    suffix = check_motion(path).suffix.lower()
    packing, motion = load_moved(history, packing), load_motion(history)
    times, positions, quaternions = (motion[name] for name in ("times", "positions", "quaternions"))
    if suffix in exporters.replays.SUFFIXES:
        return exporters.replay(
            packing, path, times=times, positions=positions, quaternions=quaternions, overwrite=overwrite
        )
    around = load_surroundings(history)
    return [animate(packing, path, times=times, positions=positions, quaternions=quaternions, around=around, **look)]


def check_motion(path: str | os.PathLike[str]) -> Path:
    """Return the path of a replay, or raise `FileFormatError` where its suffix is none that motion is written as."""
    target = Path(path)
    allowed = (*SUFFIXES, *exporters.replays.SUFFIXES)
    if target.suffix.lower() not in allowed:
        given = target.suffix.lower() or "no suffix"
        raise FileFormatError(f"{target}: motion is written as {', '.join(allowed)}; got {given!r}")
    return target
