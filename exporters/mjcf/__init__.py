"""MuJoCo's MJCF: every grain a free body with a convex mesh, the container, and the settings that suit them.

The text is in grain units (`exporters.units`) unless told: lengths in median grain diameters, density and gravity one.
MuJoCo refuses bodies whose inertia is below 1e-15, which quartz in SI is under about 0.45 mm. The factors
back to SI stand in the file's ``<custom>`` element and in a comment.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exporters.check import check_name
from exporters.mjcf.document import around
from exporters.mjcf.grains import bodies, measure, shapes
from exporters.mjcf.log import quiet
from exporters.mjcf.options import MjcfOptions
from exporters.units import GrainUnits, chosen_units, factors_of, units
from grainsdem.geometry.integrals import volumes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from exporters.mjcf.grains import Bed
    from grainsdem.model import Packing

__all__ = ["GrainUnits", "MjcfOptions", "files", "text", "units"]

Options = MjcfOptions

LOSES = (
    "Polygons are cut into triangles; MuJoCo keeps vertices in single precision, about each grain's centre.",
    "Periodic axes become walls; MuJoCo has none.",
    "With shapes='spheres' nothing is left of the shapes but their volumes.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".xml", options: MjcfOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the file that MuJoCo reads, the grains' own beside it where it is split, and the compiled model.

    Raises
    ------
    InputError
        As `text`.
    """
    check_name(name)
    options = options or MjcfOptions()
    bed = measure(packing, options)
    main, grains = f"{name}{suffix}", f"{name}.grains{suffix}"
    content: dict[str, bytes | Iterable[bytes]] = {}
    if options.split:
        before, between, after = around(bed, options, name, include=grains)
        content[main] = (before + between + after).encode()
        content[grains] = (part.encode() for part in _grains_alone(bed))
    else:
        content[main] = (part.encode() for part in _whole(bed, options, name))
    if options.compiled:
        content[f"{name}.mjb"] = _compiled("".join(_whole(bed, options, name)))
    return content


def factors(packing: Packing, options: MjcfOptions) -> dict[str, float]:
    """Return the factors from the file's units to SI: lengths in m, masses in kg, times in s."""
    sizes = volumes(packing.grains)
    return factors_of(chosen_units(options.units, sizes, packing.densities, options.gravity))


def text(packing: Packing, options: MjcfOptions | None = None, *, name: str = "bed") -> str:
    """Return the packing as MJCF, in one file whether ``options.split`` or not.

    Parameters
    ----------
    packing : Packing
        Grains to write. Body ``g000007`` is grain 7, and its frame is the grain's own.
    options : MjcfOptions, optional
        Friction, solver, container and the like.
    name : str
        Name of the model.

    Returns
    -------
    str
        A file that MuJoCo 3.17 to 4.x compiles as it stands.

    Raises
    ------
    InputError
        If the packing is empty, holds numbers that are not finite, or grains too small for MuJoCo in the units that
        were asked for.
    """
    options = options or MjcfOptions()
    return "".join(_whole(measure(packing, options), options, name))


def _whole(bed: Bed, options: MjcfOptions, name: str) -> Iterator[str]:
    """Yield the file as one, a stretch of grains at a time."""
    before, between, after = around(bed, options, name)
    yield before
    yield from shapes(bed)
    yield between
    yield from bodies(bed)
    yield after


def _grains_alone(bed: Bed) -> Iterator[str]:
    """Yield the file that another one includes."""
    yield "<mujoco>\n  <asset>\n"
    yield from shapes(bed)
    yield "  </asset>\n  <worldbody>\n"
    yield from bodies(bed)
    yield "  </worldbody>\n</mujoco>\n"


def _compiled(text: str) -> bytes:
    """Return the model that the installed MuJoCo compiles from a text."""
    import mujoco

    with quiet():
        model = mujoco.MjModel.from_xml_string(text)
    buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()
