"""The command that lays out grains of given shapes: pack."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from grainsdem.cli.guard import Written, err, guarded
from grainsdem.cli.making import SIZE, size_table
from grainsdem.cli.options import Json, Quiet, Rng, Sieves, app, keyed, prepare, show_summary

_COMMA = re.compile(r",(?![^\[]*\])")
"""A comma that stands in no list."""


@app.command()
@guarded
def pack(
    output: Annotated[
        Path,
        typer.Argument(help="The packing to write (.h5).", show_default=False),
        Written("grainsdem.storage:check_suffix"),
    ],
    shape: Annotated[
        list[str],
        typer.Option(
            help="A kind of grain: a shape, or a file (.stl, .obj, .ply) or folder of such, and its keys, as in a "
            "recipe's table [grains.shapes]: rock:elongation=0.7,flatness=0.6,share=2, or scan.stl:concave=hull.",
            show_default=False,
        ),
    ],
    count: Annotated[int | None, typer.Option(help="Number of grains.", min=1)] = None,
    diameter: Annotated[
        float | None,
        typer.Option(help="Diameter [m] of the sphere of equal volume, the same for all.", rich_help_panel=SIZE),
    ] = None,
    sizes: Annotated[
        str | None,
        typer.Option(
            help="Diameters [m]: a law of scipy.stats, such as lognorm, or a file of them.", rich_help_panel=SIZE
        ),
    ] = None,
    size_parameter: Annotated[
        list[str] | None,
        typer.Option(help="A parameter of the law, such as s=0.3 or scale=1e-3.", rich_help_panel=SIZE),
    ] = None,
    sieves: Sieves = None,
    by: Annotated[Literal["number", "mass"], typer.Option(help="What shares are of.")] = "number",
    side: Annotated[float | None, typer.Option(help="Edge length of a cube [m], instead of --lengths.")] = None,
    lengths: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Edge lengths [m] of the box; without, one that suits the grains."),
    ] = None,
    radius: Annotated[float | None, typer.Option(help="Radius of a cylinder [m], instead of a box.")] = None,
    height: Annotated[float | None, typer.Option(help="Height of the cylinder [m].")] = None,
    periodic: Annotated[str, typer.Option(help="Axes that wrap around, such as xy.")] = "",
    higher: Annotated[bool, typer.Option(help="Make the box higher where the grains do not fit.")] = True,
    solid_fraction: Annotated[
        float | None, typer.Option(help="Of the part of the box that is filled, at most.")
    ] = None,
    density: Annotated[float, typer.Option(help="Density [kg/m³] of kinds without their own.")] = 2650.0,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Lay out grains of given shapes and sizes loose, none overlapping, and write them as HDF5: ready to settle."""
    from grainsdem import recipe as recipes
    from grainsdem import storage
    from grainsdem.screen import ChainProgress

    table = {"count": count, "diameter": diameter, "by": by, "higher": higher, "solid_fraction": solid_fraction}
    where = {"side": side, "lengths": lengths, "radius": radius, "height": height, "periodic": periodic}
    wanted = recipes.make(
        name=output.stem,
        rng=rng,
        domain={"shape": "box" if radius is None else "cylinder", **where},
        grains={
            "density": density,
            "sizes": size_table(sizes, size_parameter, None),
            "sieves": None if sieves is None else {"path": str(sieves)},
            "shapes": {"kinds": [_kind(text) for text in shape], **table},
        },
    )
    prepare("loose", "contacts", quiet=quiet)
    with ChainProgress(err, shown=not (quiet or json_)) as progress:
        packing = recipes.grow(wanted, progress)
    storage.save(packing, output)
    show_summary(packing, json_=json_, quiet=quiet, title=str(output))


def _kind(text: str) -> dict[str, Any]:
    """Return what a text such as ``rock:flatness=0.6,share=2`` says, as the table of a kind."""
    # A colon of a drive letter is no end of a path: keys come after the last one.
    source, colon, rest = text.rpartition(":")
    if not colon or "=" not in rest:
        source, rest = text, ""
    name = "path" if Path(source).suffix or "/" in source or Path(source).is_dir() else "shape"
    return {name: source, **keyed(_COMMA.split(rest) if rest else [])}
