"""The container in a file for MuJoCo: planes, which have no thickness that a grain could pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exporters.container import container_box, plane_frames, wall_names
from exporters.text import rows_of_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.mjcf.grains import Bed
    from exporters.mjcf.options import MjcfOptions
    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

_CLASS = """\
    <default class="%swall">
      <geom type="plane" condim="%d" friction="%s" priority="%d" %s/>
    </default>
"""
_MATERIALS = """\
    <material name="%sfloor" rgba="0.78 0.78 0.76 1" specular="0.1" shininess="0.1"/>
    <material name="%swall" rgba="0.55 0.65 0.72 0.16" specular="0.2" shininess="0.4"/>
"""
_WALL = '      <geom name="%s" class="%swall" pos="%s" quat="%s" size="%s" material="%s"%s/>'


def wall_class(bed: Bed, contact: str) -> str:
    """Return the class of the container's shapes."""
    rough = bed.surfaces.of_walls()
    return _CLASS % (bed.prefix, rough.condim, rough.friction, rough.priority, contact)


def wall_materials(bed: Bed) -> str:
    """Return how floor and walls look."""
    return _MATERIALS % (bed.prefix, bed.prefix)


def container(bed: Bed, options: MjcfOptions, bounds: Floats) -> str:
    """Return the static body of the floor and the walls; nothing where there are none.

    Parameters
    ----------
    bed : Bed
        The grains.
    options : MjcfOptions
        Which walls there are.
    bounds : ndarray, shape (2, 3)
        Lowest and highest corner of the grains [m].
    """
    packing, length = bed.packing, bed.scales.length
    lower, upper = (corner / length for corner in container_box(packing, bounds))
    if not packing.domain.is_planar:
        # Planes have no end for contacts; walls are drawn as high as the grains, that they neither hide nor shade them.
        upper = np.append(upper[:2], min(upper[2], bounds[1, 2] / length))
    found = _found(lower, upper, options, packing.domain.scaled(1 / length), bed)
    bed.surfaces.given.refuse_unknown(found)
    lines = []
    for name, numbers in found.items():
        at, turn, size = rows_of_text(numbers, [3, 4, 3])
        looks = f"{bed.prefix}{'floor' if name == 'floor' else 'wall'}"
        own = bed.surfaces.of_wall(name)
        lines.append(_WALL % (f"{bed.prefix}{name}", bed.prefix, at, turn, size, looks, own))
    return "\n".join([f'    <body name="{bed.prefix}container">', *lines, "    </body>\n"]) if lines else ""


def _found(lower: Floats, upper: Floats, options: MjcfOptions, domain: Domain, bed: Bed) -> dict[str, Floats]:
    """Return place, rotation and size of each wall by name."""
    centre, half = (lower + upper) / 2, (upper - lower) / 2
    # Quaternions that turn a plane's z axis inward, with its x axis along the second size.
    s = float(np.sqrt(0.5))
    sides = {
        "floor": (2, 0, (1.0, 0.0, 0.0, 0.0), (0, 1)),
        "wall_x0": (0, 0, (s, 0.0, s, 0.0), (2, 1)),
        "wall_x1": (0, 1, (s, 0.0, -s, 0.0), (2, 1)),
        "wall_y0": (1, 0, (s, -s, 0.0, 0.0), (0, 2)),
        "wall_y1": (1, 1, (s, s, 0.0, 0.0), (0, 2)),
    }
    planes = {f"wall_p{k}": frame for k, frame in enumerate(zip(*plane_frames(domain), strict=True))}
    found: dict[str, Floats] = {}
    for name in wall_names(domain, options.walls):
        if name in planes:
            point, rotation = planes[name]
            # Drawn a quarter of the box wide: contacts see planes without end.
            numbers = [*rounded(point, bed.diameter), *rotation, half.max() / 4, half[2], bed.diameter]
        else:
            axis, side, quaternion, (a, b) = sides[name]
            place = centre.copy()
            place[axis] = (lower, upper)[side][axis]
            numbers = [*rounded(place, bed.diameter), *quaternion, half[a], half[b], bed.diameter]
        found[name] = np.array(numbers)
    return found


def rounded(place: Floats, diameter: float) -> Floats:
    """Return a place to a billionth of a diameter: noise around zero is not written as numbers of its own."""
    decimals = 9 - round(np.log10(diameter))
    return place.round(decimals)
