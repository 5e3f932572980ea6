"""The command line: every command is a few lines over the public API.

Exit codes: 0 done, 1 a check failed, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import functools
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console

import grainsdem
from grainsdem.errors import GrainsDEMError, ValidationError

if TYPE_CHECKING:
    from collections.abc import Callable

    from grainsdem.model import Packing

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="""Grow realistic granular material, prove that nothing overlaps, and hand it to physics.

    Start with [bold]grainsdem demo[/bold]: a bed of Ottawa sand, grown, checked, written, poured and settled.""",
    context_settings={"help_option_names": ["-h", "--help"]},
)
out = Console(soft_wrap=True)
err = Console(stderr=True, soft_wrap=True)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Bed = Annotated[
    Path,
    typer.Argument(help="A packing: .h5, or a file we exported (.xml, .usda, .usdc, .stl, .obj).", show_default=False),
]
Rng = Annotated[int, typer.Option(help="Seed of everything that is random.", min=0)]


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Turn errors on purpose into one line and an exit code."""

    @functools.wraps(command)
    def run_guarded(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except ValidationError as error:
            _complain(f"check failed: {error}")
            raise typer.Exit(1) from None
        except GrainsDEMError as error:
            _complain(f"error: {error}")
            raise typer.Exit(2) from None
        except KeyboardInterrupt as interrupt:
            kept = getattr(interrupt, "__notes__", [])
            _complain("; ".join(["interrupted", *kept]))
            raise typer.Exit(130) from None

    return run_guarded


def _complain(line: str) -> None:
    err.print(" ".join(line.split()), markup=False, highlight=False, style="red" if err.is_terminal else None)


@app.command()
@guarded
def demo(
    folder: Annotated[Path, typer.Option(help="Where the files go.")] = Path("grainsdem_demo"),
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make the main example: a bed of ASTM 20/30 Ottawa sand, from seeds to grains at rest."""
    from grainsdem.recipe import EXAMPLE

    _run(EXAMPLE, folder, json_=json_, quiet=quiet)


@app.command()
@guarded
def run(
    recipe: Annotated[Path, typer.Argument(help="A recipe (.toml).", show_default=False)],
    folder: Annotated[
        Path | None, typer.Option(help="Where the files go; by default a folder named like the recipe.")
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make the bed that a recipe describes: grow, validate, write, settle, validate, write."""
    _run(recipe, folder or Path(recipe.stem), json_=json_, quiet=quiet)


def _run(recipe: Path, folder: Path, *, json_: bool, quiet: bool) -> None:
    from grainsdem import recipe as recipes
    from grainsdem.screen import ChainProgress, print_result

    wanted = recipes.read(recipe)
    with ChainProgress(err, shown=not (quiet or json_)) as progress:
        result = recipes.run(wanted, folder, progress)
    if json_:
        _print_json({**result.summaries, "files": [str(path) for path in result.files]})
    elif not quiet:
        print_result(out, wanted.name, result)


@app.command()
@guarded
def generate(
    output: Annotated[Path, typer.Argument(help="The packing to write (.h5).", show_default=False)],
    count: Annotated[int | None, typer.Option(help="Number of seeds.", min=1)] = None,
    process: Annotated[Literal["halton", "poisson"], typer.Option(help="How seeds are placed.")] = "halton",
    seeds: Annotated[
        Path | None, typer.Option(help="Your own seeds: .txt, .csv, .npy or .npz, three columns in metres.")
    ] = None,
    lengths: Annotated[tuple[float, float, float], typer.Option(help="Edge lengths of the box [m].")] = (
        1.0,
        1.0,
        1.0,
    ),
    relax: Annotated[int, typer.Option(help="Lloyd iterations: more make grains rounder and more alike.", min=0)] = 0,
    keep: Annotated[
        Literal["inside", "all"], typer.Option(help="Whether cells that touch a wall are dropped.")
    ] = "inside",
    porosity: Annotated[float | None, typer.Option(help="Void fraction, reached exactly, in [0, 1).")] = None,
    scale: Annotated[float | None, typer.Option(help="Linear factor that grains shrink by, in (0, 1].")] = None,
    median_diameter: Annotated[
        float | None, typer.Option(help="Median diameter by mass [m]: the whole bed is scaled to it.")
    ] = None,
    density: Annotated[float, typer.Option(help="Density [kg/m³].")] = 2650.0,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Grow a bed of grains from seeds and write it as HDF5."""
    from grainsdem import recipe as recipes
    from grainsdem import storage
    from grainsdem.screen import ChainProgress

    storage.check_suffix(output)
    if porosity is None and scale is None:
        scale = 1.0
    wanted = recipes.make(
        name=output.stem,
        rng=rng,
        domain={"lengths": lengths},
        seeds={
            "process": "file" if seeds else process,
            "count": count,
            "path": None if seeds is None else str(seeds),
            "relax": relax,
        },
        grains={
            "keep": keep,
            "porosity": porosity,
            "scale": scale,
            "median_diameter": median_diameter,
            "density": density,
        },
    )
    with ChainProgress(err, shown=not (quiet or json_)) as progress:
        packing = recipes.grow(wanted, progress)
    storage.save(packing, output)
    _print_summary(packing, json_=json_, quiet=quiet, title=str(output))


@app.command()
@guarded
def validate(
    bed: Bed,
    overlap: Annotated[
        float,
        typer.Option(help="Largest overlap volume allowed, relative to the smaller grain; 1e-3 for settled beds."),
    ] = 1e-9,
    against: Annotated[
        Path | None,
        typer.Option(help="Also check that every grain of this packing is there, as large and where it was."),
    ] = None,
    method: Annotated[
        Literal["planes", "manifold3d"],
        typer.Option(help="Prove pairs apart by planes where that is possible, or all by manifold3d."),
    ] = "planes",
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check that every grain is closed and convex, and that no two overlap; exit 1 where a check fails.

    An exported file is read as the program that it is for reads it, rounding included.
    """
    import exporters
    from grainsdem.recipe import counting_words
    from grainsdem.screen import ChainProgress, print_report
    from grainsdem.validation import SHAPE, compare

    packing = _load(bed)
    original = None if against is None else _load(against)
    with ChainProgress(err, shown=not (quiet or json_)) as progress, progress.stage("Validating") as tell:
        told = counting_words(tell, "pairs")
        rounding = exporters.rounding(packing, bed.suffix) / float(grainsdem.diameters(packing.grains).mean())
        report = grainsdem.validate(packing, overlap=overlap, shape=max(SHAPE, rounding), method=method, progress=told)
        if original is not None:
            report = grainsdem.Report((*compare(packing, original), *report.checks))
    if json_:
        _print_json(report.to_dict())
    elif not quiet:
        print_report(out, str(bed), report)
    report.raise_if_failed()


@app.command()
@guarded
def measure(
    bed: Bed,
    within: Annotated[
        float | None,
        typer.Option(help="Gap [m] below which grains count as touching; 1e-3 of a diameter by default."),
    ] = None,
    table: Annotated[Path | None, typer.Option(help="Also write one row a grain to this .csv file.")] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Measure a bed: porosity, grain sizes, sphericity, coordination."""
    packing = _load(bed)
    if table is not None:
        from grainsdem.measures import write_csv

        write_csv(grainsdem.table(packing), table)
    _print_summary(packing, json_=json_, quiet=quiet, title=str(bed), within=within)


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

    packing = _load(bed)
    for output in outputs:
        exporters.module_for(output.suffix)  # all are known before the first is written
    files = [path for output in outputs for path in exporters.write(packing, output)]
    if json_:
        _print_json({"files": [str(path) for path in files]})
    elif not quiet:
        for path in files:
            out.print(f"wrote {path}", highlight=False)


@app.command()
@guarded
def settle(
    bed: Bed,
    output: Annotated[Path, typer.Argument(help="The settled packing to write (.h5).", show_default=False)],
    pour: Annotated[
        bool,
        typer.Option("--pour/--in-place", help="Rotate, reorder and pour the grains, or let them settle in place."),
    ] = True,
    friction: Annotated[float, typer.Option(help="Coefficient of friction among grains.")] = 0.5,
    wall_friction: Annotated[
        float | None, typer.Option(help="The same with the walls; by default as among grains.")
    ] = None,
    time_step: Annotated[float, typer.Option(help="Time step in units of √(d/g).")] = 0.01,
    max_time: Annotated[float, typer.Option(help="Time limit in units of √(d/g).")] = 200.0,
    history: Annotated[
        Path | None,
        typer.Option(help="Write the history here while the run goes (.h5); an interrupted run keeps it."),
    ] = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Let grains fall under gravity in their container until they are at rest (MuJoCo)."""
    from grainsdem import storage
    from grainsdem.recipe import keeping_last_good, settling_words
    from grainsdem.screen import ChainProgress, print_settling

    storage.check_suffix(output)
    packing = _load(bed)
    start = grainsdem.shuffle(packing, rng=rng) if pour else packing
    with (
        ChainProgress(err, shown=not (quiet or json_)) as progress,
        progress.stage("Settling") as tell,
        keeping_last_good(output),
    ):
        settled = grainsdem.settle(
            start,
            friction=friction,
            wall_friction=wall_friction,
            time_step=time_step,
            max_time=max_time,
            history_path=history,
            progress=settling_words(tell),
        )
    storage.save(settled.packing, output)
    summary = {**grainsdem.summary(settled.packing, settled.contacts), **settled.report.to_dict()}
    if json_:
        _print_json(summary)
    elif not quiet:
        print_settling(out, str(output), summary)


@app.command()
@guarded
def render(
    bed: Bed,
    picture: Annotated[Path, typer.Argument(help="The picture to write (.png).", show_default=False)],
    color_by: Annotated[str, typer.Option(help="What colours the grains.")] = "diameter",
    quiet: Quiet = False,
) -> None:
    """Draw a bed (needs PyVista: pip install "grainsdem[viz]")."""
    path = grainsdem.figures.render(_load(bed), picture, color_by=color_by)
    if not quiet:
        out.print(f"wrote {path}", highlight=False)


@app.command()
@guarded
def info(bed: Bed, json_: Json = False, quiet: Quiet = False) -> None:
    """Say what a file holds and what made it."""
    from grainsdem.screen import print_info

    packing = _load(bed)
    facts = {
        "grains": len(packing),
        "vertices": len(packing.grains.vertices),
        "faces": packing.grains.n_faces,
        "domain_lower": packing.domain.lower.tolist(),
        "domain_upper": packing.domain.upper.tolist(),
        "periodic": packing.domain.periodic.tolist(),
        "neighbors_known": packing.links is not None,
        "provenance": [json.loads(step) for step in packing.provenance],
    }
    if json_:
        _print_json(facts)
    elif not quiet:
        print_info(out, str(bed), facts)


def _load(path: Path) -> Packing:
    """Return a packing from HDF5, or from a format that we can read back."""
    import exporters

    return exporters.read(path) if path.suffix.lower() in exporters.READERS else grainsdem.load(path)


def _print_summary(packing: Packing, *, json_: bool, quiet: bool, title: str, within: float | None = None) -> None:
    from grainsdem.screen import print_summary

    if quiet and not json_:
        return
    summary = grainsdem.summary(packing, grainsdem.contacts(packing, within=within))
    if json_:
        _print_json(summary)
    else:
        print_summary(out, title, summary)


def _print_json(value: Any) -> None:
    sys.stdout.write(json.dumps(value, indent=2) + "\n")


def _version(*, asked: bool) -> None:
    if asked:
        out.print(f"grainsdem {grainsdem.__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            help="Print the version and exit.",
            is_eager=True,
            callback=lambda v: _version(asked=v),
        ),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line."""
    app()
