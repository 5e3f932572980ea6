"""OpenUSD with UsdPhysics: every grain a rigid body with exact mass properties and a convex-hull collider.

The binary crate is written by `exporters.usd.crate`; OpenUSD itself makes text of that crate.
"""

from __future__ import annotations

import logging
import struct
from dataclasses import replace
from io import BytesIO
from typing import TYPE_CHECKING, Any, Literal
from zipfile import ZipFile, ZipInfo

import numpy as np

from exporters.check import check_name, measured, refuse
from exporters.container import colours_of
from exporters.units import chosen_units, factors_of
from exporters.usd.assets import assembled
from exporters.usd.crate import crate
from exporters.usd.options import UsdOptions
from exporters.usd.scene import Bed, metadata, world
from exporters.usd.text import text_of
from grainsdem.errors import InputError, name_offenders
from grainsdem.geometry.integrals import centroids, face_planes, volumes

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
_MOST_CORNERS = 32
"""Of a face."""
_MOST_OBLONG = 100.0
"""Largest ratio of half the longest side of a hull's box to the least distance of its centre from a face."""

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
    """Return the file: the binary crate for ``.usdc``, text for ``.usda``, a package of the crate for ``.usdz``.

    With ``per_grain`` the assets come after the stage that refers to them.

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
    bed = Bed(packing, integrals, options, colours, scales)
    _refuse_beyond_single(bed)
    if options.per_grain:
        if suffix.lower() == ".usdz":
            raise InputError("per_grain writes files beside the stage, which a .usdz cannot have: take .usdc or .usda")
        return assembled(bed, name, suffix)
    layer = crate(world(bed), metadata(packing, scales, options.root))
    if suffix.lower() == ".usda":
        return {f"{name}{suffix}": text_of(layer)}
    return {f"{name}{suffix}": _package(layer, name) if suffix.lower() == ".usdz" else layer}


def factors(packing: Packing, options: UsdOptions) -> dict[str, float]:
    """Return the factors from the stage's units to SI: lengths in m, masses in kg, times in s."""
    return factors_of(_scales(packing, volumes(packing.grains), options.units))


def report(packing: Packing, options: UsdOptions) -> dict[str, Any]:  # noqa: ARG001  (every format's has both)
    """Return which grains PhysX simplifies on the GPU: how many there are, and the first of them."""
    large, oblong = _beyond_physx(packing)
    return {
        "most_vertices_of_physx": _MOST_VERTICES,
        "most_faces_of_physx": _MOST_FACES,
        "most_corners_of_physx": _MOST_CORNERS,
        "n_grains_beyond": len(large),
        "first_grains_beyond": large[:5],
        "n_grains_oblong": len(oblong),
        "first_grains_oblong": oblong[:5],
    }


def _scales(packing: Packing, grain_volumes: NDArray[np.float64], units: Units) -> GrainUnits:
    """Return the factors to SI; a stage counts time in seconds whatever its other units are."""
    return replace(chosen_units(units, grain_volumes, packing.densities), time=1.0)


def _refuse_beyond_single(bed: Bed) -> None:
    """Raise `InputError` where a mass or a moment of inertia leaves what single precision holds: USD has no other."""
    packing, scales = bed.packing, bed.scales
    least, most = (float(limit) for limit in (np.finfo(np.float32).tiny, np.finfo(np.float32).max))
    masses = packing.densities * bed.integrals.volumes / scales.mass
    moments = np.einsum("nii->ni", bed.integrals.inertias * (packing.densities / scales.inertia)[:, None, None])
    for what, values in {"masses": masses[:, None], "moments of inertia": moments}.items():
        beyond = ((values < least) | (values > most)).any(axis=1)
        refuse(
            f"{what} must be {least:.2g} to {most:.2g} in units of {bed.options.units}, since USD has them in single "
            "precision, as they are with units='grain'",
            beyond,
        )


def _beyond_physx(packing: Packing) -> tuple[list[int], list[int]]:
    """Return the grains that are larger hulls than PhysX holds on the GPU, and those that are too oblong for it."""
    grains = packing.grains
    large = (np.diff(grains.vertex_offsets) > _MOST_VERTICES) | (np.diff(grains.face_offsets) > _MOST_FACES)
    corners = np.maximum.reduceat(np.diff(grains.face_vertex_offsets), grains.face_offsets[:-1])
    large |= corners > _MOST_CORNERS
    starts = grains.vertex_offsets[:-1]
    spans = np.maximum.reduceat(grains.vertices, starts) - np.minimum.reduceat(grains.vertices, starts)
    planes = face_planes(grains)
    owner = np.repeat(np.arange(len(grains)), np.diff(grains.face_offsets))
    depths = planes.heights - np.einsum("ij,ij->i", planes.normals, centroids(grains)[owner])
    depths = np.minimum.reduceat(depths, grains.face_offsets[:-1])
    oblong = 0.5 * spans.max(axis=1) > _MOST_OBLONG * depths
    return np.flatnonzero(large).tolist(), np.flatnonzero(oblong).tolist()


def _see_large_hulls(packing: Packing, hulls: Literal["any", "physx"]) -> None:
    """Log which grains PhysX simplifies or does not take on the GPU, or refuse them."""
    large, oblong = _beyond_physx(packing)
    limits = {
        f"PhysX holds at most {_MOST_VERTICES} vertices and {_MOST_FACES} faces a hull on the GPU, of at most "
        f"{_MOST_CORNERS} corners, and simplifies what has more": large,
        f"PhysX takes no hull on the GPU that is more than {_MOST_OBLONG:g} times as long as thick": oblong,
    }
    for limit, beyond in limits.items():
        if not beyond:
            continue
        told = f"{limit}; {len(beyond)} of {len(packing)} grains are beyond that: {name_offenders(beyond)}"
        if hulls == "physx":
            raise InputError(f"{told}; hulls='any' writes them all the same")
        _log.warning("%s", told)


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
