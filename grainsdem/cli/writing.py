"""Commands that hand a bed on: export, permeability, render, replay."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import grainsdem
from grainsdem.cli.guard import Written, guarded, out
from grainsdem.cli.options import Bed, Force, Json, Quiet, app, keyed, load, print_json, show_files
from grainsdem.errors import InputError, RefusedError, WriteError
from grainsdem.looks import QUANTITIES, View

if TYPE_CHECKING:
    from collections.abc import Sequence

    from grainsdem.model import Packing

ColorBy = Annotated[
    str,
    typer.Option(help=f"What colours the grains: {', '.join(QUANTITIES)}; at the start of a run."),
]
FromWhere = Annotated[
    View | None,
    typer.Option(help="From where one looks: over a corner by default, in planar work from the front."),
]


@app.command()
@guarded
def export(
    bed: Bed,
    outputs: Annotated[
        list[Path],
        typer.Argument(help="Files to write, the suffix picks the format; with --to a folder.", show_default=False),
        Written(is_folder=None),
    ],
    to: Annotated[
        list[str] | None,
        typer.Option(help="A format by name or suffix, into the folder; may be repeated.", show_default=False),
    ] = None,
    for_: Annotated[
        str | None,
        typer.Option(
            "--for", help="A program: it picks format and options, and tells how to open the file.", show_default=False
        ),
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(help="An option of the format, such as binary=false or contact=cap.", show_default=False),
    ] = None,
    force: Force = False,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write a bed for other programs: files by suffix, or with --to a folder of many formats and a manifest."""
    import exporters

    packing, options = load(bed), keyed(option or [])
    if for_ is not None:
        _for_program(packing, outputs, for_, options, to=to, force=force, json_=json_, quiet=quiet)
        return
    # All that can be known to be wrong is, before the first is written.
    for several in [to] if to else [[output.suffix] for output in outputs]:
        exporters.options_for(several, options)
    standing = [] if force or to else [output for output in outputs if output.exists()]
    if standing:
        raise WriteError(f"{standing[0]}: exists already; pass --force to replace it")
    files: list[Path] = []
    refused: dict[str, str] = {}
    for output in outputs:
        try:
            files += exporters.write(packing, output, formats=to or None, overwrite=force, **options)
        except RefusedError as error:
            files += error.made
            refused |= {f"{output}/{name}" if len(outputs) > 1 else name: text for name, text in error.refused.items()}
        except InputError as error:
            if len(outputs) == 1:
                raise
            refused[str(output)] = str(error)
    if not files:
        raise InputError("; ".join(f"{name}: {reason}" for name, reason in refused.items()))
    show_files(files, json_=json_, quiet=quiet)
    if refused:
        raise RefusedError(refused, files)


def _for_program(
    packing: Packing,
    outputs: Sequence[Path],
    program: str,
    options: dict[str, Any],
    *,
    to: Sequence[str] | None,
    force: bool,
    json_: bool,
    quiet: bool,
) -> None:
    """Write one file for a program, and tell how it is opened there."""
    import exporters

    if to or len(outputs) != 1:
        raise InputError("--for takes one output and no --to: the program picks the format")
    files = exporters.write(packing, outputs[0], program=program, overwrite=force, **options)
    own = {key: value for key, value in options.items() if key not in exporters.SHARED}
    lines = exporters.opening(packing, files[0] if files[0].suffix else outputs[0], program, own)
    if json_:
        print_json({"files": [str(path) for path in files], "open": lines})
        return
    show_files(files, json_=False, quiet=quiet)
    if not quiet:
        for line in lines:
            out.print(line, highlight=False, markup=False, soft_wrap=True)


@app.command()
@guarded
def permeability(
    case: Annotated[
        Path, typer.Argument(help="An OpenFOAM case that we exported and its Allrun ran.", show_default=False)
    ],
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Read the permeability from an OpenFOAM case that was run."""
    from dataclasses import asdict

    from exporters.openfoam import flow
    from grainsdem.screen import print_facts

    found = flow(case)
    if json_:
        print_json(asdict(found))
    elif not quiet:
        facts = {
            "permeability, m²": f"{found.permeability:.4g}",
            "by Kozeny and Carman, m²": f"{found.kozeny_carman:.4g}",
            "ratio": f"{found.permeability / found.kozeny_carman:.3f}",
            "seepage velocity, m/s": f"{found.velocity:.4g}",
            "Reynolds number": f"{found.reynolds:.3g}",
            "steady": "yes" if found.is_steady else "no: let it run longer",
        }
        print_facts(out, str(case), facts)


@app.command()
@guarded
def render(
    bed: Bed,
    picture: Annotated[
        Path,
        typer.Argument(help="The picture to write (.png).", show_default=False),
        Written("grainsdem.figures.frame:check_suffix"),
    ],
    color_by: ColorBy = "diameter",
    view: FromWhere = None,
    quiet: Quiet = False,
) -> None:
    r"""Draw a bed (needs PyVista: pip install "grainsdem\[viz]")."""
    path = grainsdem.figures.render(load(bed), picture, color_by=color_by, view=view)
    if not quiet:
        out.print(f"wrote {path}", highlight=False)


@app.command()
@guarded
def replay(
    bed: Bed,
    history: Annotated[Path, typer.Argument(help="The history of its motion (.h5), with frames.", show_default=False)],
    output: Annotated[
        Path,
        typer.Argument(
            help="What to write: .gif, .webp, .mp4 (needs ffmpeg), .pvd (ParaView), .usdc or .usda.", show_default=False
        ),
        Written("grainsdem.figures.motion.replaying:check_motion"),
    ],
    color_by: ColorBy = "id",
    view: FromWhere = None,
    seconds: Annotated[float, typer.Option(help="How long an animation lasts.")] = 5.0,
    pictures: Annotated[
        int | None, typer.Option(help="How many pictures it has; by default twenty a second.", min=2)
    ] = None,
    since: Annotated[float | None, typer.Option(help="Begin with this time of the run [s].")] = None,
    until: Annotated[float | None, typer.Option(help="End with this time of the run [s].")] = None,
    size: Annotated[tuple[int, int], typer.Option(help="Width and height of an animation [pixels].")] = (640, 480),
    outline: Annotated[bool, typer.Option(help="Draw the outline of the container.")] = True,
    force: Force = False,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Show how grains moved in a run: an animation, a time series for ParaView, or USD with time samples."""
    files = grainsdem.figures.replay(
        history, load(bed), output, overwrite=force, color_by=color_by, view=view, seconds=seconds,
        n_pictures=pictures, since=since, until=until, size=size, outline=outline,
    )  # fmt: skip
    show_files(files, json_=json_, quiet=quiet)
