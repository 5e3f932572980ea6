"""3MF: one object a grain, its unit said, for printers and slicers."""

from __future__ import annotations

import io
import itertools
import zipfile
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from exporters.check import check_choice, check_name, class_texts, grain_names, measured, stretches
from exporters.text import filled
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import best_apexes, triangles

if TYPE_CHECKING:
    from collections.abc import Iterator

    from grainsdem.model import Packing

UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "meter": 1.0, "inch": 0.0254, "foot": 0.3048}
"""Units that the format knows, and their length [m]."""

_CONTENT_TYPES = """\
<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""

_RELATIONS = """\
<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreeMfOptions:
    """Units and size.

    Parameters
    ----------
    unit : {"micron", "millimeter", "centimeter", "meter", "inch", "foot"}
        What the file's numbers are in; the file says so.

    Raises
    ------
    InputError
        If the unit is not one that the format knows.
    """

    unit: Literal["micron", "millimeter", "centimeter", "meter", "inch", "foot"] = "millimeter"

    def __post_init__(self) -> None:
        check_choice("unit", self.unit, UNITS)


Options = ThreeMfOptions

LOSES = (
    "Polygons are cut into triangles, and vertices have nine significant digits.",
    "Masses, densities and poses are not carried.",
)
"""What the format does not carry."""


def factors(packing: Packing, options: ThreeMfOptions) -> dict[str, float]:  # noqa: ARG001  (the contract of formats)
    """Return the factors from the file's units to SI."""
    return {"length": UNITS[options.unit], "mass": 1.0, "time": 1.0}


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".3mf", options: ThreeMfOptions | None = None
) -> dict[str, bytes]:
    """Return the one file: object ``g000000`` and so on in their places, numbered from 1 as the format demands.

    The part number of an object is the class of its grain, where grains have classes.

    Raises
    ------
    InputError
        If the packing is empty or not finite.
    """
    check_name(name)
    measured(packing)
    unit = (options or ThreeMfOptions()).unit
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr(_entry("[Content_Types].xml"), _CONTENT_TYPES)
        archive.writestr(_entry("_rels/.rels"), _RELATIONS)
        with archive.open(_entry("3D/3dmodel.model"), "w", force_zip64=True) as model:
            for block in _model(packing, unit):
                model.write(block.encode())
    return {f"{name}{suffix}": stream.getvalue()}


def _entry(path: str) -> zipfile.ZipInfo:
    """Return the head of a file in the archive; its date is the format's oldest, the same in every run."""
    entry = zipfile.ZipInfo(path)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _model(packing: Packing, unit: str) -> Iterator[str]:
    """Yield the model's XML."""
    yield (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<model unit="{unit}" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n'
        '<metadata name="Application">grainsdem</metadata>\n<resources>\n'
    )
    names = grain_names(packing)
    for first, part in stretches(packing):
        cut = triangles(part.grains, apexes=best_apexes(part.grains))
        world = world_vertices(part) / UNITS[unit]
        vertices = filled('<vertex x="%.9g" y="%.9g" z="%.9g"/>', world, np.diff(part.grains.vertex_offsets))
        faces = filled('<triangle v1="%d" v2="%d" v3="%d"/>', cut.indices, np.diff(cut.offsets))
        numbers = class_texts(part, ' partnumber="class %d"')
        yield "".join(
            f'<object id="{i + 1}" name="{names[i]}"{number} type="model"><mesh><vertices>{corners}</vertices>'
            f"<triangles>{body}</triangles></mesh></object>\n"
            for i, number, corners, body in zip(itertools.count(first), numbers, vertices, faces)
        )
    items = "".join(f'<item objectid="{i + 1}"/>' for i in range(len(packing)))
    yield f"</resources>\n<build>{items}</build>\n</model>\n"
