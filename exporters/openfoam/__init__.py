"""OpenFOAM: a case that meshes the void between grains and drives fluid through it, ready to run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from exporters.check import check_choice, check_name, check_positive, measured
from exporters.meshes.stl import binary
from exporters.openfoam.dictionaries import SIDES, Case, texts
from exporters.openfoam.flow import Flow, flow, kozeny_carman
from exporters.openfoam.point import void_point
from exporters.void import region as regions
from exporters.void import surface
from exporters.void.solids import TREATMENTS, Frame, Solids, as_manifolds, cut, flow_domain, fused, treat, void
from grainsdem.errors import InputError
from grainsdem.geometry.bounds import boxes
from grainsdem.geometry.triangles import vector_areas
from grainsdem.packing import contacts
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from exporters.void.region import Region
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

__all__ = ["TREATMENTS", "Flow", "OpenFoamOptions", "Options", "files", "flow", "kozeny_carman"]


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenFoamOptions:
    """What the case is of.

    Parameters
    ----------
    region : {"core", "bed", "periodic"} or tuple of two array_like, shape (3,)
        The inside of the bed, away from its walls; the whole bed between its walls, with a diameter of free length
        before and behind it; the whole cell of a bed that is periodic along the flow, its opposite faces ``cyclic`` and
        the fluid driven by a mean pressure gradient, so that flow has no ends; or the corners [m] of a box.
    axis : {"x", "y", "z"}
        Along which fluid flows, from the lower face to the upper.
    contact : {"shrink", "cap", "bridge", "union", "none"}
        What is done where grains are nearer than ``gap``: an exact inset of both grains; both cut off by planes across
        the contact; a prism between them; all grains grown and fused; or nothing.
    gap : float, optional
        Gap [m]; by default a fiftieth of the mean equal-volume diameter.
    cells : float
        Background cells a mean diameter.
    level : int
        How often those cells are halved at the grains.
    reynolds : float
        Reynolds number of the seepage velocity and the mean diameter that the pressure drop is chosen for, by Kozeny
        and Carman.
    viscosity : float
        Kinematic viscosity [m²/s]; by default that of water.
    origin : {"world", "region"}
        Where the case's origin lies: that of the packing, or the region's lower corner.
    void_mesh : bool
        Whether the void is also written as a closed surface of its own, one solid a patch, for other meshers.
    per_grain : bool
        Whether each grain has a patch of its own, ``grains_g000012``, all in the group ``grains``; images of one grain
        share it. Needs grains that stay apart (``"shrink"``, ``"cap"``, ``"none"``), at most `MOST_PATCHES` of them.

    Raises
    ------
    InputError
        If an option is out of range.
    """

    region: Literal["core", "bed", "periodic"] | tuple[ArrayLike, ArrayLike] = "core"
    axis: Literal["x", "y", "z"] = "z"
    contact: Literal["shrink", "cap", "bridge", "union", "none"] = "shrink"
    gap: float | None = None
    cells: float = 20.0
    level: int = 0
    reynolds: float = 0.01
    viscosity: float = 1e-6
    origin: Literal["world", "region"] = "world"
    void_mesh: bool = True
    per_grain: bool = False

    def __post_init__(self) -> None:
        check_choice("axis", self.axis, ("x", "y", "z"))
        check_choice("contact", self.contact, TREATMENTS)
        check_choice("origin", self.origin, ("world", "region"))
        if self.gap is not None:
            check_positive("gap", self.gap)
        for name in ("cells", "reynolds", "viscosity"):
            check_positive(name, getattr(self, name))
        if self.per_grain and self.contact in ("bridge", "union"):
            raise InputError(
                f"per_grain needs grains that stay apart: contact shrink, cap or none; got {self.contact!r}"
            )
        if not (isinstance(self.level, int) and 0 <= self.level <= 5):
            raise InputError(f"level must be a whole number from 0 to 5; got {self.level!r}")


Options = OpenFoamOptions

MOST_PATCHES = 1000
"""Patches of grains that a case may have: every field holds each, and every process tells every other of each."""

LOSES = (
    "Grains are one surface unless told, with contacts treated as the case's report says; classes are not carried.",
    "Masses and poses are not carried.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "case", suffix: str = "", options: OpenFoamOptions | None = None
) -> dict[str, bytes]:
    """Return the files of a case: path in the case's folder to bytes.

    Besides the dictionaries: ``constant/triSurface/grains.stl``, grains cut at the faces of the region;
    ``void.stl``, the region less the grains, closed, its patches inlet, outlet, sides and grains; ``case.json``, the
    report: porosity and surface area of the region before and after the contacts were treated, the smallest gap before
    and the cell size that would resolve it, the point of the void and its clearance, and the flow's numbers.

    Raises
    ------
    InputError
        If the packing is empty or not finite, the region is none or holds no grain or no void, or an option is out of
        range.
    """
    del suffix
    check_name(name)
    options = options or OpenFoamOptions()
    d = float(cube_roots(measured(packing).volumes * 6 / np.pi).mean())
    axis = "xyz".index(options.axis)
    region = regions.choose(packing, options.region, axis, d)
    gap = 0.02 * d if options.gap is None else options.gap
    beyond = regions.BEYOND * d if any(region.cyclic) else 0.0
    # Every grain of a periodic cell with all its neighbours: its images are to be treated alike.
    reach = regions.REACH * gap + beyond + (_widest(packing) if any(region.cyclic) else 0.0)
    grains, numbers = regions.gather(packing, region, reach)
    frame = Frame(region.lower.copy(), d)
    treated = treat(grains, options.contact, gap, frame)
    report = _report(grains, treated, region, frame, gap)
    cells = np.maximum(np.rint((region.upper - region.lower) / d * options.cells), 1).astype(np.int64)
    point, clearance = void_point(grains, treated, region, cells)
    shift = -region.lower if options.origin == "region" else np.zeros(3)
    block = _block(region, cells, axis)
    drop = _pressure_drop(options, report["porosity"], d, region, axis)
    case = Case(
        block[0] + shift,
        block[1] + shift,
        block[2],
        axis,
        "noSlip" if region.is_bed and not packing.domain.is_planar else "slip",
        options.level,
        point + shift,
        options.viscosity,
        drop,
        bool(len(region.planes)),
        region.cyclic,
        options.per_grain,
    )
    content = {path: text.encode() for path, text in texts(case).items()}
    around = region.grown(beyond)
    content["constant/triSurface/grains.stl"] = (
        _named(treated, numbers, around, frame, shift)
        if options.per_grain
        else binary(surface.rounded(cut(treated.bodies, around, frame), frame, shift))
    )
    if len(region.planes):
        # Longer than the region: its ends are those of the background mesh.
        container = flow_domain(region, frame, longer=(axis, d))
        content["constant/triSurface/walls.stl"] = binary(surface.rounded([container], frame, shift))
    if options.void_mesh:
        content["void.stl"] = _void(treated, region, frame, axis, shift)
    report |= {
        "name": name,
        "contact": options.contact,
        "lower": (region.lower + shift).tolist(),
        "upper": (region.upper + shift).tolist(),
        "moved_by": shift.tolist(),
        "axis": options.axis,
        "periodic": region.cyclic[axis],
        "mean_diameter": d,
        "cells": cells.tolist(),
        "cell_size": d / options.cells / 2**options.level,
        "void_point": (point + shift).tolist(),
        "void_point_clearance": clearance,
        "viscosity": options.viscosity,
        "kinematic_pressure_drop": drop,
        "provenance": [json.loads(step) for step in packing.provenance],
    }
    content["case.json"] = (json.dumps(report, indent=2) + "\n").encode()
    return content


def _named(treated: Solids, numbers: NDArray[np.int64], region: Region, frame: Frame, shift: Floats) -> bytes:
    """Return the grains as ASCII STL, one named solid a grain, images of it included."""
    parts: dict[int, list[Floats]] = {}
    for body, number in zip(treated.bodies, numbers.tolist(), strict=True):
        if inside := cut([body], region, frame):
            parts.setdefault(number, []).append(surface.rounded(inside, frame, shift).astype(np.float64))
    if len(parts) > MOST_PATCHES:
        raise InputError(
            f"per_grain makes a patch a grain, at most {MOST_PATCHES}; got {len(parts)} grains in the region"
        )
    return surface.ascii_stl({f"g{number:06d}": np.concatenate(parts[number]) for number in sorted(parts)})


def _widest(packing: Packing) -> float:
    """Return the longest edge [m] of the box around any grain."""
    lower, upper = boxes(packing)
    return float((upper - lower).max())


def _report(grains: Packing, treated: Solids, region: Region, frame: Frame, gap: float) -> dict[str, Any]:
    """Return porosity and surface before and after, and what the gaps ask of the mesh."""
    graph = contacts(grains, within=2 * gap)
    before = _sizes(fused(as_manifolds(grains, frame)), region, frame)
    after = _sizes(treated.bodies, region, frame)
    volume = flow_domain(region, frame).volume() * frame.length**3
    smallest = float(graph.gaps.min()) if len(graph) else None
    return {
        "volume": volume,
        "n_grains": len(grains),
        "gap": gap,
        "near_contacts": int((graph.gaps < gap).sum()),
        "smallest_gap_before": smallest,
        # Two cells across the narrowest gap, the least that a profile of velocity needs.
        "suggested_cell_size": 0.5 * (gap if smallest is None else max(gap, smallest)),
        "porosity_before": 1 - before[0] / volume,
        "porosity": 1 - after[0] / volume,
        "surface_area_before": before[1],
        "surface_area": after[1],
    }


def _sizes(bodies: list[Any], region: Region, frame: Frame) -> tuple[float, float]:
    """Return the volume [m³] of bodies inside a region, and their surface [m²] there without the cuts."""
    inside = cut(bodies, region, frame)
    if len(region.planes):
        container = flow_domain(region, frame)
        inside = [part for body in inside if not (part := body ^ container).is_empty()]
    volume = sum(body.volume() for body in inside) * frame.length**3
    triangles = surface.corners(inside, frame)
    triangles = triangles[surface.on_faces(triangles, region, frame.length) < 0]
    return volume, float(np.linalg.norm(vector_areas(triangles), axis=1).sum())


def _pressure_drop(options: OpenFoamOptions, porosity: float, d: float, region: Region, axis: int) -> float:
    """Return the kinematic pressure drop [m²/s²] that drives the seepage velocity asked for."""
    velocity = options.reynolds * options.viscosity / d
    length = float(region.upper[axis] - region.lower[axis])
    return options.viscosity * velocity * length / kozeny_carman(d, porosity)


def _block(region: Region, cells: NDArray[np.int64], axis: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return corners [m] and cells of the background mesh: one cell wider than a container that is cut out of it."""
    if len(region.planes) == 0:
        return region.lower, region.upper, cells
    wider = np.where(np.arange(3) == axis, 0, 1)
    size = (region.upper - region.lower) / cells * wider
    return region.lower - size, region.upper + size, cells + 2 * wider


def _void(treated: Solids, region: Region, frame: Frame, axis: int, shift: Floats) -> bytes:
    """Return the void as closed ASCII STL, one solid a patch."""
    triangles = surface.rounded([void(treated.bodies, region, frame)], frame, shift).astype(np.float64)
    face = surface.on_faces(triangles, region.moved(shift), frame.length)
    names = [
        SIDES[k] if region.cyclic[k // 2] else ("inlet", "outlet")[k % 2] if k // 2 == axis else "sides"
        for k in range(6)
    ]
    patch_of = np.array([*names, *["walls"] * len(region.planes), "grains"])[face]
    order = [*dict.fromkeys(["inlet", "outlet", *sorted(set(names) - {"inlet", "outlet"}), "walls", "grains"])]
    return surface.ascii_stl({name: part for name in order if len(part := triangles[patch_of == name])})
