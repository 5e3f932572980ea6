"""Every grain an asset of its own, one rigid body, and a stage that puts them where they are."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from exporters.check import grain_names
from exporters.text import table_of_text
from exporters.usd.columns import shape_of
from exporters.usd.crate import crate
from exporters.usd.prims import Attribute, Column, Prim
from exporters.usd.scene import asset, bare_world, metadata
from exporters.usd.text import crate_of, text_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from exporters.usd.scene import Bed

FOLDER = "%s.grains"
"""Of the assets, beside the stage."""

_PLACED = """\
        def Xform "%s" (
            prepend references = @./%s/%s.usdc@
        )
        {
            double3 xformOp:translate = (%s)
            quatd xformOp:orient = (%s)
            uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
        }
"""


def assembled(bed: Bed, name: str, suffix: str) -> dict[str, bytes | Iterable[bytes]]:
    """Return the stage, and the assets that it refers to.

    Parameters
    ----------
    bed : Bed
        What is written.
    name, suffix : str
        Of the stage, ``.usdc`` or ``.usda``.
    """
    folder = FOLDER % name
    layer = text_of(crate(bare_world(bed), metadata(bed.packing, bed.scales, bed.options.root))).decode()
    # The text ends with the prim that holds all.
    head = layer.rstrip().removesuffix("}")
    text = "".join([head, '\n    def Xform "Grains"\n    {\n', *_placed(bed, folder), "    }\n}\n"]).encode()
    content: dict[str, bytes | Iterable[bytes]] = {f"{name}{suffix}": text if suffix == ".usda" else crate_of(text)}
    for k, grain in enumerate(grain_names(bed.packing)):
        content[f"{folder}/{grain}.usdc"] = _asset(bed, k, grain)
    return content


def _placed(bed: Bed, folder: str) -> Iterator[str]:
    """Yield where each asset goes."""
    names = grain_names(bed.packing)
    places = table_of_text(bed.packing.positions / bed.scales.length, digits=17)
    turns = table_of_text(bed.packing.quaternions, digits=17)
    for name, place, turn in zip(names, places, turns, strict=True):
        yield _PLACED % (name, folder, name, place.replace(" ", ", "), turn.replace(" ", ", "))


def _asset(bed: Bed, k: int, name: str) -> Iterator[bytes]:
    """Yield the file of one grain."""
    told = metadata(bed.packing, bed.scales, name)
    told["documentation"] = Attribute("string", f"Grain {k} of {len(bed.packing)}.")
    del told["customLayerData"]  # the domain is the bed's
    yield from crate(_single(asset(bed, name), k), told)


def _single(prim: Prim, k: int) -> Prim:
    """Return a prim whose columns are the values of one grain."""
    attributes = {name: attribute._replace(value=_value(attribute, k)) for name, attribute in prim.attributes.items()}
    return replace(prim, attributes=attributes, children=tuple(_single(child, k) for child in prim.children))


def _value(attribute: Attribute, k: int) -> Any:
    if not isinstance(attribute.value, Column):
        return attribute.value
    rows = attribute.value.rows(k, k + 1)
    return rows if shape_of(attribute.kind).is_list else rows[0]
