"""MuJoCo's MJCF: every grain a free body with a convex mesh, the container, and the settings that suit them.

The text is in grain units (`exporters.units`) unless told: lengths in median grain diameters, density and gravity one.
MuJoCo refuses bodies whose inertia is below 1e-15, which quartz in SI is under about 0.45 mm. The factors
back to SI stand in the file's ``<custom>`` element and in a comment.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.check import check_name
from exporters.mjcf.document import grains_alone, including, walls_alone, whole
from exporters.mjcf.grains import measure
from exporters.mjcf.log import quiet
from exporters.mjcf.options import MjcfOptions
from exporters.mjcf.settings import fields_of, settings
from exporters.units import GrainUnits, chosen_units, factors_of, units
from grainsdem.geometry.integrals import volumes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from grainsdem.model import Packing

__all__ = ["GrainUnits", "MjcfOptions", "files", "options_for", "text", "units"]

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
    content: dict[str, bytes | Iterable[bytes]] = {}
    if options.split:
        walls, grains = f"{name}.walls{suffix}", f"{name}.grains{suffix}"
        container = walls_alone(bed, options)
        parts = [walls, grains] if container else [grains]
        content[f"{name}{suffix}"] = including(bed, options, name, parts).encode()
        content[grains] = (part.encode() for part in grains_alone(bed, options))
        if container:
            content[walls] = container.encode()
    else:
        content[f"{name}{suffix}"] = (part.encode() for part in whole(bed, options, name))
    if options.compiled:
        content[f"{name}.mjb"] = _compiled("".join(whole(bed, options, name)))
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
    return "".join(whole(measure(packing, options), options, name))


def options_for(packing: Packing, options: MjcfOptions | None = None) -> dict[str, Any]:
    """Return the settings that a model needs which the packing becomes a part of: those that its own file has.

    An include of grains, or ``MjSpec.attach``, brings no ``option`` with it, and contacts are as stiff as their time
    step.

    Parameters
    ----------
    packing : Packing
        Grains to write.
    options : MjcfOptions, optional
        With which they are written; the units are theirs, too.

    Returns
    -------
    dict of str to any
        Fields of ``MjSpec.option`` and ``MjModel.opt`` of the installed MuJoCo, and their values.

    Raises
    ------
    InputError
        As `text`.

    Examples
    --------
    >>> for name, value in options_for(packing).items():  # doctest: +SKIP
    ...     setattr(spec.option, name, value)
    """
    options = options or MjcfOptions()
    return fields_of(settings(measure(packing, options), options).option)


def _compiled(text: str) -> bytes:
    """Return the model that the installed MuJoCo compiles from a text."""
    import mujoco

    with quiet():
        model = mujoco.MjModel.from_xml_string(text)
    buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()
