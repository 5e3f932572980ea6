"""MuJoCo's warnings, kept off the screen and out of the working folder."""

from __future__ import annotations

import os
import warnings
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def quiet() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings; left alone it writes them to the screen and to a file in the working folder."""
    import mujoco

    messages: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    try:
        yield messages
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def compiling() -> Iterator[list[str]]:
    """Collect all that is said while a file of others is compiled; not for threads, whose warnings it would take."""
    said: list[str] = []
    with quiet() as messages, _mute(), warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        yield said
        said += [*messages, *(" ".join(str(one.message).split()) for one in heard)]


@contextmanager
def _mute() -> Iterator[None]:
    """Keep what C code writes to the error stream off it: Qhull tells of every flat mesh in forty lines."""
    try:
        kept = os.dup(2)
    except OSError:  # there is none
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
