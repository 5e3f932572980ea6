"""How MuJoCo is to simulate a bed: its step and solver, and the stiffness of contacts that goes with the step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from exporters.mjcf.bouncing import BOUNCING_START, BOUNCING_STEPS, DAMPED_START, DAMPED_STEPS, damping_of
from exporters.mjcf.log import quiet
from exporters.mjcf.options import ITERATIONS, NOSLIP_AT_REST
from exporters.rest import down, rest_of, restitution, time_step
from exporters.text import rows_of_text

if TYPE_CHECKING:
    from exporters.mjcf.grains import Bed
    from exporters.mjcf.options import MjcfOptions

_OPTION = """\
  <option timestep="%.9g" gravity="%s" integrator="implicitfast" cone="elliptic" impratio="%.9g"
          solver="%s" iterations="%d" tolerance="%.9g" noslip_iterations="%d"
          jacobian="sparse">
    <flag multiccd="enable"%s/>
  </option>"""

_CONTACT = 'solref="%.9g %.9g" solimp="%g 0.95 %.9g"'

CARRIED = (
    "timestep", "gravity", "integrator", "cone", "impratio", "solver", "iterations", "tolerance", "noslip_iterations",
    "jacobian", "enableflags", "disableflags",
)  # fmt: skip
"""Fields of MuJoCo's options that the file sets."""


class Settings(NamedTuple):
    """What a file says of the simulation.

    Parameters
    ----------
    option : str
        Its ``option`` element.
    contact : str
        Attributes of a shape: stiffness and damping of its contacts.
    """

    option: str
    contact: str


def settings(bed: Bed, options: MjcfOptions) -> Settings:
    """Return what a file says of the simulation of a bed."""
    packing = bed.packing
    gravity = options.gravity / bed.scales.acceleration
    step = time_step(packing, options.time_step)
    if options.units != "grain":
        step *= np.sqrt(bed.diameter / gravity)
    bounce = restitution(packing, options.restitution)
    if bounce is None:
        contact_steps, damping, start = DAMPED_STEPS, 1.0, DAMPED_START
    else:
        contact_steps, damping, start = BOUNCING_STEPS, damping_of(bounce), BOUNCING_START
    noslip = options.noslip_iterations
    if noslip is None:
        noslip = NOSLIP_AT_REST if rest_of(packing) is not None and options.solver == "PGS" else 0
    option = _OPTION % (
        step, rows_of_text(gravity * down(packing), [3])[0], options.impratio, options.solver,
        options.iterations or ITERATIONS[options.solver], options.tolerance, noslip,
        "" if options.autoreset else ' autoreset="disable"',
    )  # fmt: skip
    width = options.contact_width * bed.diameter
    return Settings(option, _CONTACT % (contact_steps * step / damping, damping, start, width))


def fields_of(option: str) -> dict[str, Any]:
    """Return what an ``option`` element sets as the fields of the installed MuJoCo's options."""
    import mujoco

    with quiet():
        model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}</mujoco>")
    return {name: np.copy(value) if np.ndim(value := getattr(model.opt, name)) else value for name in CARRIED}
