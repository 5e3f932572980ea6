"""Compiled models kept on disk: the time that compiling takes grows with the square of the number of grains."""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from grainsdem.atomic import replacing
from grainsdem.errors import WriteError

LEAST_SIZE = 2_000_000
"""Shortest text [bytes] that is kept compiled, of 1100 grains or so; others compile in two seconds."""

MOST_MODELS = 8
"""Models that are kept; the oldest go."""

VARIABLE = "GRAINSDEM_CACHE"
"""Environment variable with the folder to keep models in; nothing is kept where it is empty."""


def place_of(text: str, version: str) -> Path | None:
    """Return where the compiled model of a text is kept, or nothing where it is not to be."""
    folder = os.environ.get(VARIABLE)
    if folder == "" or len(text) < LEAST_SIZE:
        return None
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    name = hashlib.sha256(f"{version}\n{text}".encode()).hexdigest()
    return (Path(folder) if folder else home / "grainsdem") / f"{name[:40]}.mjb"


def find(place: Path | None) -> Any:
    """Return the model kept there, or nothing where there is none or it is damaged."""
    import mujoco

    if place is None or not place.is_file():
        return None
    with suppress(ValueError, mujoco.FatalError):
        return mujoco.MjModel.from_binary_path(str(place))
    return None


def keep(model: Any, place: Path | None) -> None:
    """Keep a model, and let go of the oldest; a folder that cannot be written keeps none."""
    import mujoco

    if place is None:
        return
    with suppress(OSError, WriteError):
        place.parent.mkdir(parents=True, exist_ok=True)
        with replacing(place) as temporary:
            mujoco.mj_saveModel(model, str(temporary), None)
        for path in _oldest(place):
            path.unlink(missing_ok=True)


def _oldest(place: Path) -> list[Path]:
    """Return the models beside the one just kept that are too many."""
    times = {path: path.stat().st_mtime for path in place.parent.glob("*.mjb") if path != place}
    now = place.stat().st_mtime
    # What is of later than now was kept before the clock was set back: it would never become the oldest.
    return sorted(times, key=lambda path: (times[path] <= now, times[path]))[: max(len(times) + 1 - MOST_MODELS, 0)]
