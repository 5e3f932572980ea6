"""Checkpoints: what a killed run goes on from, bit for bit."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import InputError
from grainsdem.foreign import array_of, json_object, refusing
from grainsdem.storage import HistoryWriter, load_history, load_surroundings

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.model import Packing, Surroundings

    Floats = NDArray[np.float64]

VERSION = 3


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Everything that a run was at one sample.

    Parameters
    ----------
    state : ndarray
        The engine's state.
    samples : ndarray, shape (n_samples, n_columns)
        All samples so far, the one at the start included.
    memory : dict of str to JSON value
        What the experiment itself remembers.
    identity : dict of str to JSON value
        Model, engine and options: what must be the same for the run to go on.
    n_frames : int
        Frames written so far.
    """

    state: Floats
    samples: Floats
    memory: dict[str, Any]
    identity: dict[str, Any]
    n_frames: int


def checkpoint_path(history_path: Path) -> Path:
    """Return where the checkpoint of a run lies: beside its history."""
    return history_path.with_name(f"{history_path.stem}.state.npz")


def save_checkpoint(checkpoint: Checkpoint, path: Path) -> None:
    """Write a checkpoint, or leave the one before it whole."""
    words = {
        "version": VERSION,
        "memory": checkpoint.memory,
        "identity": checkpoint.identity,
        "n_frames": checkpoint.n_frames,
    }
    with replacing(path) as temporary:
        np.savez(temporary, state=checkpoint.state, samples=checkpoint.samples, words=np.array(json.dumps(words)))


def load_checkpoint(path: Path, identity: Mapping[str, Any]) -> Checkpoint:
    """Read a checkpoint of the run that ``identity`` describes.

    Raises
    ------
    FileFormatError
        If the file is damaged or of another version.
    InputError
        If it belongs to another packing, engine, or options.
    """
    with refusing(path, "not a checkpoint that a run can go on from"):
        state, samples = array_of(path, "state"), array_of(path, "samples")
        words = json_object(str(array_of(path, "words", kinds="U")))
        found = Checkpoint(state, samples, words["memory"], words["identity"], words["n_frames"])
        if words["version"] != VERSION:
            raise ValueError(f"version {words['version']}; {VERSION} is needed")
    other = sorted(key for key in {*identity, *found.identity} if identity.get(key) != found.identity.get(key))
    if other:
        given = ", ".join(f"{key} {_short(identity.get(key))}, was {_short(found.identity.get(key))}" for key in other)
        raise InputError(f"{path}: the run was begun otherwise and cannot go on: {given}; start it without resume")
    return found


def open_history(
    path: Path,
    columns: Mapping[str, str],
    *,
    n_grains: int,
    attributes: Mapping[str, Any],
    rows: list[dict[str, float]],
    n_frames: int,
    grains: Packing | None = None,
    around: Surroundings | None = None,
) -> HistoryWriter:
    """Open a history anew, with the rows and frames that an interrupted run had written by its checkpoint."""
    # What was written is kept beside the new file until that holds it: a resumed run may be killed, too.
    old = path.with_name(f"{path.stem}.before{path.suffix}")
    if n_frames and not old.exists():
        path.replace(old)
    kept = load_history(old) if n_frames else {}
    before = load_surroundings(old) if n_frames else None
    writer = HistoryWriter(path, columns, n_grains=n_grains, grains=grains, around=around, attributes=attributes)
    for row in rows:
        writer.append(**row)
    for k in range(n_frames):
        pose = {"positions": kept["positions"][k], "quaternions": kept["quaternions"][k]}
        places = None if before is None else (before.positions[k], before.quaternions[k], before.gravity[k])
        writer.append_frame(kept["frame_times"][k], **pose, around=places)
    writer.flush()
    old.unlink(missing_ok=True)
    return writer


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 24 else f"{text[:12]}…"
