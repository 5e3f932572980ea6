"""Which engine moves a bed: by name, or by how many grains it has."""

from __future__ import annotations

import logging
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Literal

from grainsdem.options import option

if TYPE_CHECKING:
    from grainsdem.dynamics.engine.contract import Engine

LARGE = 1500
"""Number of grains from which on ``"auto"`` takes Box3D."""

EngineName = Annotated[
    Literal["mujoco", "box3d", "auto"],
    option(
        "What moves the grains: MuJoCo, whose overlaps are shallow and whose forces are exact; Box3D, ten times as fast "
        "and with overlaps of some thousandths of d, for beds of thousands; or by their number.",
    ),
]

_LOG = logging.getLogger(__name__)


def choose_engine(name: str, n_grains: int) -> Literal["mujoco", "box3d"]:
    """Return the engine that a name and a number of grains ask for."""
    if name == "auto":
        is_large = n_grains >= LARGE
        if is_large and find_spec("robox3d") is None:
            _LOG.warning(
                "%d grains are moved by MuJoCo, which takes ten times as long as Box3D: "
                'pip install "grainsdem[box3d]" brings it', n_grains
            )  # fmt: skip
            return "mujoco"
        return "box3d" if is_large else "mujoco"
    return "box3d" if name == "box3d" else "mujoco"


def load(text: str, engine: str = "mujoco") -> Engine:
    """Return an engine with a model's text.

    Raises
    ------
    InputError
        If the engine refuses it.
    MissingPackageError
        If the engine is not installed.
    """
    if engine == "box3d":
        from grainsdem.dynamics.engine import box3d

        return box3d.load(text)
    from grainsdem.dynamics.engine import mujoco_engine
    from grainsdem.dynamics.engine.lockstep import joined

    return joined(mujoco_engine.load(text))
