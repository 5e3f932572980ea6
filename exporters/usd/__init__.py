"""OpenUSD with UsdPhysics: every grain a rigid body with exact mass properties and a convex-hull collider.

The binary crate is written by `exporters.usd.crate`; OpenUSD itself makes text of that crate.
"""

from __future__ import annotations

import logging
import struct
import tempfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from zipfile import ZipFile, ZipInfo

import numpy as np

from exporters.check import check_name, measured
from exporters.container import colours_of
from exporters.units import chosen_units, factors_of
from exporters.usd.crate import crate
from exporters.usd.options import UsdOptions
from exporters.usd.scene import Bed, metadata, world
from grainsdem.errors import InputError, WriteError, name_offenders
from grainsdem.geometry.integrals import volumes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from exporters.units import GrainUnits, Units
    from grainsdem.model import Packing

__all__ = ["UsdOptions", "files"]

_log = logging.getLogger(__name__)

# What PhysX can hold on the GPU in one hull.
_MOST_VERTICES = 64
_MOST_FACES = 64

Options = UsdOptions

LOSES = (
    "Points are in single precision about each grain's centre, masses and inertias in single precision.",
    "Periodic axes become walls; there are no others.",
    "Where grains have frictions of their own, their mean stands for all.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".usdc", options: UsdOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the one file: the binary crate for ``.usdc``, text for ``.usda``, a package of the crate for ``.usdz``.

    Raises
    ------
    InputError
        If the packing is empty or holds numbers that are not finite, or a grain is too large a hull for PhysX
        and ``hulls`` is ``"physx"``.
    """
    check_name(name)
    options = options or UsdOptions()
    integrals = measured(packing)
    _see_large_hulls(packing, options.hulls)
    colours = colours_of(packing, integrals.volumes, options.colour)
    scales = _scales(packing, integrals.volumes, options.units)
    layer = crate(world(Bed(packing, integrals, options, colours, scales)), metadata(packing, scales, options.root))
    if suffix.lower() == ".usda":
        return {f"{name}{suffix}": _text(layer)}
    return {f"{name}{suffix}": _package(layer, name) if suffix.lower() == ".usdz" else layer}


def factors(packing: Packing, options: UsdOptions) -> dict[str, float]:
    """Return the factors from the stage's units to SI: lengths in m, masses in kg, times in s."""
    return factors_of(_scales(packing, volumes(packing.grains), options.units))


def report(packing: Packing, options: UsdOptions) -> dict[str, Any]:  # noqa: ARG001  (every format's has both)
    """Return which grains PhysX simplifies on the GPU: how many there are, and the first of them."""
    large = _beyond_physx(packing)
    return {
        "most_vertices_of_physx": _MOST_VERTICES,
        "most_faces_of_physx": _MOST_FACES,
        "n_grains_beyond": len(large),
        "first_grains_beyond": large[:5],
    }


def _scales(packing: Packing, grain_volumes: NDArray[np.float64], units: Units) -> GrainUnits:
    """Return the factors to SI; a stage counts time in seconds whatever its other units are."""
    return replace(chosen_units(units, grain_volumes, packing.densities), time=1.0)


def _beyond_physx(packing: Packing) -> list[int]:
    """Return the grains that are larger hulls than PhysX holds on the GPU."""
    grains = packing.grains
    large = (np.diff(grains.vertex_offsets) > _MOST_VERTICES) | (np.diff(grains.face_offsets) > _MOST_FACES)
    found: list[int] = np.flatnonzero(large).tolist()
    return found


def _see_large_hulls(packing: Packing, hulls: Literal["any", "physx"]) -> None:
    """Log which grains PhysX simplifies on the GPU, or refuse them."""
    large = _beyond_physx(packing)
    if not large:
        return
    limit = f"PhysX holds at most {_MOST_VERTICES} vertices and {_MOST_FACES} faces a hull on the GPU"
    beyond = f"{len(large)} of {len(packing)} grains are beyond that: {name_offenders(large)}"
    if hulls == "physx":
        raise InputError(f"{limit}; {beyond}; hulls='any' writes them all the same")
    _log.warning("%s and simplifies what has more; %s", limit, beyond)


def _text(layer: Iterable[bytes]) -> bytes:
    """Return the text that OpenUSD makes of a crate."""
    from pxr import Sdf

    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "layer.usdc"
        try:
            with source.open("wb") as file:
                file.writelines(layer)
        except OSError as error:
            raise WriteError(f"{source}: cannot be written: {error.strerror or error}") from error
        text: str = Sdf.Layer.FindOrOpen(str(source)).ExportToString()
        return text.encode()


def _package(layer: Iterable[bytes], name: str) -> bytes:
    """Return a package with a crate in it: a zip that packs nothing, its content at a multiple of 64 bytes."""
    out = BytesIO()
    # The clock of a zip begins in 1980: the same packing gives the same bytes.
    entry = ZipInfo(f"{name}.usdc", date_time=(1980, 1, 1, 0, 0, 0))
    gap = -(30 + len(entry.filename.encode()) + 4) % 64
    # A field that readers pass over, of the number that OpenUSD itself pads with.
    entry.extra = struct.pack("<HH", 0x1986, gap) + bytes(gap)
    with ZipFile(out, "w") as package:
        package.writestr(entry, b"".join(layer))
    return out.getvalue()
