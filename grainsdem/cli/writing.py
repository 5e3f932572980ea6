"""Commands that hand a bed on: export, render."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import grainsdem
from grainsdem.cli.options import Bed, Json, Quiet, app, guarded, load, out, print_json


@app.command()
@guarded
def export(
    bed: Bed,
    outputs: Annotated[
        list[Path], typer.Argument(help="Files to write; the suffix picks the format.", show_default=False)
    ],
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write a bed for other programs: .xml (MuJoCo), .usda or .usdc (OpenUSD), .stl, .obj."""
    import exporters

    packing = load(bed)
    for output in outputs:
        exporters.module_for(output.suffix)  # all are known before the first is written
    files = [path for output in outputs for path in exporters.write(packing, output)]
    if json_:
        print_json({"files": [str(path) for path in files]})
    elif not quiet:
        for path in files:
            out.print(f"wrote {path}", highlight=False)


@app.command()
@guarded
def render(
    bed: Bed,
    picture: Annotated[Path, typer.Argument(help="The picture to write (.png).", show_default=False)],
    color_by: Annotated[str, typer.Option(help="What colours the grains.")] = "diameter",
    quiet: Quiet = False,
) -> None:
    r"""Draw a bed (needs PyVista: pip install "grainsdem\[viz]")."""
    path = grainsdem.figures.render(load(bed), picture, color_by=color_by)
    if not quiet:
        out.print(f"wrote {path}", highlight=False)
