"""Commands that load beds: compact, tap, triaxial, shear, collapse, tilt, and ensemble for several seeds."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import grainsdem
from grainsdem.cli.options import Bed, Json, Quiet, Rng, app, err, guarded, keyed, load, out, prepare, print_json
from grainsdem.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from grainsdem.dynamics import Outcome

Output = Annotated[Path, typer.Argument(help="The packing at the end, to write (.h5).", show_default=False)]
Start = Annotated[
    Literal["random", "place"],
    typer.Option(help="Turn the grains at random, reorder them and set them apart first, or start where they are."),
]
Spheres = Annotated[bool, typer.Option("--spheres", help="Replace each grain by the sphere of equal volume.")]
Friction = Annotated[float, typer.Option(help="Coefficient of friction among grains.")]
WallFriction = Annotated[float | None, typer.Option(help="The same with floor and walls; by default as among grains.")]
Compaction = Annotated[
    float | None, typer.Option(help="The same while the bed is compressed: less makes a denser bed.")
]
Inertial = Annotated[float, typer.Option(help="Rate d √(ρ/σ): below 1e-3 loading is quasi-static.")]
Gravity = Annotated[float, typer.Option(help="Acceleration [m/s²].")]
TimeStep = Annotated[float, typer.Option(help="Time step in grain units.")]
History = Annotated[
    Path | None, typer.Option(help="Write the history here while the run goes (.h5); an interrupted run keeps it.")
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with the killed run of that history.")]
Figure = Annotated[Path | None, typer.Option(help="Draw the curves here (.png).")]


@app.command()
@guarded
def compact(
    bed: Bed,
    output: Output,
    pressure: Annotated[float, typer.Option(help="Pressure of the walls [Pa].")] = 1e4,
    porosity: Annotated[
        float | None, typer.Option(help="Void at which walls stop; at the pressure by default.")
    ] = None,
    friction: Friction = 0.5,
    compaction_friction: Compaction = None,
    start: Start = "random",
    spheres: Spheres = False,
    time_step: TimeStep = 0.01,
    max_time: Annotated[float, typer.Option(help="Time limit in units of d √(ρ/P).")] = 200.0,
    history: History = None,
    resume: Resume = False,
    figure: Figure = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compress a bed from all sides by six smooth walls, to a pressure or to a porosity (MuJoCo)."""
    _perform(
        grainsdem.dynamics.compact,
        (bed, output, history, figure),
        pressure=pressure,
        porosity=porosity,
        friction=friction,
        compaction_friction=compaction_friction,
        spheres=spheres,
        time_step=time_step,
        max_time=max_time,
        rng=rng if start == "random" else None,
        resume=resume,
        shown=(json_, quiet),
    )


@app.command()
@guarded
def tap(
    bed: Bed,
    output: Output,
    taps: Annotated[int, typer.Option(help="How many.")] = 50,
    amplitude: Annotated[
        float | None, typer.Option(help="Height of a tap [m]; half a median diameter by default.")
    ] = None,
    acceleration: Annotated[float, typer.Option(help="Its greatest acceleration over gravity.")] = 3.0,
    friction: Friction = 0.5,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    start: Start = "random",
    spheres: Spheres = False,
    time_step: TimeStep = 0.01,
    history: History = None,
    resume: Resume = False,
    figure: Figure = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Shake the container of a bed up and down, tap by tap: porosity against taps (MuJoCo)."""
    _perform(
        grainsdem.dynamics.tap,
        (bed, output, history, figure),
        taps=taps,
        amplitude=amplitude,
        acceleration=acceleration,
        friction=friction,
        wall_friction=wall_friction,
        gravity=gravity,
        spheres=spheres,
        time_step=time_step,
        rng=rng if start == "random" else None,
        resume=resume,
        shown=(json_, quiet),
    )


@app.command()
@guarded
def triaxial(
    bed: Bed,
    output: Output,
    confining_pressure: Annotated[float, typer.Option(help="σ3 [Pa].")] = 1e5,
    strain: Annotated[float, typer.Option(help="Axial strain to go to.")] = 0.4,
    inertial_number: Inertial = 1e-2,
    friction: Friction = 0.5,
    compaction_friction: Compaction = None,
    start: Start = "random",
    spheres: Spheres = False,
    time_step: TimeStep = 0.01,
    history: History = None,
    resume: Resume = False,
    figure: Figure = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compress a bed between six smooth walls and shear it: angles of friction, dilation (MuJoCo)."""
    _perform(
        grainsdem.dynamics.triaxial,
        (bed, output, history, figure),
        confining_pressure=confining_pressure,
        strain=strain,
        inertial_number=inertial_number,
        friction=friction,
        compaction_friction=compaction_friction,
        spheres=spheres,
        time_step=time_step,
        rng=rng if start == "random" else None,
        resume=resume,
        shown=(json_, quiet),
    )


@app.command()
@guarded
def shear(
    bed: Bed,
    output: Output,
    is_ring: Annotated[bool, typer.Option("--ring/--box", help="A ring under a lid that turns, or two halves.")] = True,
    normal_stress: Annotated[float, typer.Option(help="On the lid [Pa].")] = 1e4,
    strain: Annotated[
        float | None,
        typer.Option(help="Shear strain of the ring (2), or way of the upper half over the box's length (0.2)."),
    ] = None,
    inertial_number: Inertial = 1e-2,
    friction: Friction = 0.5,
    compaction_friction: Compaction = None,
    inner_radius: Annotated[float | None, typer.Option(help="Of the ring [m].")] = None,
    outer_radius: Annotated[float | None, typer.Option(help="Of the ring [m].")] = None,
    start: Start = "random",
    spheres: Spheres = False,
    time_step: TimeStep = 0.01,
    history: History = None,
    resume: Resume = False,
    figure: Figure = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Shear a bed in a ring or in a box under a constant normal stress: friction, dilation, profile (MuJoCo)."""
    own: dict[str, Any] = {} if strain is None else {"strain" if is_ring else "displacement": strain}
    if is_ring:
        own |= {"inner_radius": inner_radius, "outer_radius": outer_radius}
        if start == "place":
            raise InputError("grains are always set apart in a ring; --start must be random")
    elif inner_radius is not None or outer_radius is not None:
        raise InputError("--inner-radius and --outer-radius are of a ring; this is a box")
    _perform(
        grainsdem.dynamics.ring_shear if is_ring else grainsdem.dynamics.direct_shear,
        (bed, output, history, figure),
        normal_stress=normal_stress,
        inertial_number=inertial_number,
        friction=friction,
        compaction_friction=compaction_friction,
        spheres=spheres,
        time_step=time_step,
        rng=rng if start == "random" else None,
        resume=resume,
        shown=(json_, quiet),
        **own,
    )


@app.command()
@guarded
def collapse(
    bed: Bed,
    output: Output,
    release: Annotated[
        list[str] | None, typer.Option(help="A wall to take away, such as wall_x1; may be repeated. All by default.")
    ] = None,
    friction: Friction = 0.5,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    max_time: Annotated[float, typer.Option(help="Time limit after the release in units of √(d/g).")] = 100.0,
    start: Start = "random",
    spheres: Spheres = False,
    time_step: TimeStep = 0.01,
    history: History = None,
    resume: Resume = False,
    figure: Figure = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Take walls away from a bed and let it run out to rest: angle of repose, run-out (MuJoCo)."""
    _perform(
        grainsdem.dynamics.collapse,
        (bed, output, history, figure),
        release=release or None,
        friction=friction,
        wall_friction=wall_friction,
        gravity=gravity,
        max_time=max_time,
        spheres=spheres,
        time_step=time_step,
        rng=rng if start == "random" else None,
        resume=resume,
        shown=(json_, quiet),
    )


@app.command()
@guarded
def tilt(
    bed: Bed,
    output: Output,
    friction: Friction = 0.5,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    rate: Annotated[float, typer.Option(help="Angle [rad] by which gravity is turned in √(d/g).")] = 0.01,
    max_angle: Annotated[float, typer.Option(help="Angle [rad] at which a bed that stands is given up.")] = math.pi / 3,
    start: Start = "random",
    spheres: Spheres = False,
    time_step: TimeStep = 0.01,
    history: History = None,
    resume: Resume = False,
    figure: Figure = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Turn gravity slowly, as if the box were tilted, until the bed fails (MuJoCo)."""
    _perform(
        grainsdem.dynamics.tilt,
        (bed, output, history, figure),
        friction=friction,
        wall_friction=wall_friction,
        gravity=gravity,
        rate=rate,
        max_angle=max_angle,
        spheres=spheres,
        time_step=time_step,
        rng=rng if start == "random" else None,
        resume=resume,
        shown=(json_, quiet),
    )


@app.command()
@guarded
def ensemble(
    experiment: Annotated[
        Literal["compact", "tap", "triaxial", "ring_shear", "direct_shear", "collapse", "tilt"],
        typer.Argument(help="What to run.", show_default=False),
    ],
    bed: Bed,
    options: Annotated[
        list[str] | None, typer.Argument(help="Its options, such as strain=0.3 spheres=true.", show_default=False)
    ] = None,
    seeds: Annotated[int, typer.Option(help="How many runs, each with a seed of its own.", min=1)] = 5,
    through: Annotated[
        Literal["auto", "batch", "processes"],
        typer.Option(help="Step runs together (mujoco.batch), or give each a process."),
    ] = "auto",
    workers: Annotated[int | None, typer.Option(help="Threads or processes.", min=1)] = None,
    histories: Annotated[Path | None, typer.Option(help="A folder for the histories of the runs.")] = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run one experiment with several seeds: means and intervals of 95 % confidence (MuJoCo)."""
    from grainsdem.screen import ChainProgress, print_facts

    packing = load(bed)
    with ChainProgress(err, shown=not (quiet or json_)) as bars, bars.stage(experiment) as tell:
        runs = grainsdem.dynamics.ensemble(
            getattr(grainsdem.dynamics, experiment),
            packing,
            seeds=range(rng, rng + seeds),
            through=through,
            workers=workers,
            history_folder=histories,
            progress=lambda done, total: tell(done / total, f"{done} of {total} runs"),
            **keyed(options or []),
        )
    if json_:
        print_json(runs.to_dict())
    elif not quiet:
        widths = runs.half_width()
        facts = {_title(k): f"{_shown(k, v)} ± {_shown(k, widths[k])}" for k, v in runs.mean().items()}
        print_facts(out, f"{experiment}: {seeds} seeds, 95 % intervals", facts)


def _perform(
    function: Callable[..., Outcome[Any]],
    paths: tuple[Path, Path, Path | None, Path | None],
    *,
    shown: tuple[bool, bool],
    **options: Any,
) -> None:
    """Run an experiment on a bed, write what comes of it, and print what it measured."""
    from grainsdem import storage
    from grainsdem.figures.curves import experiment_figure
    from grainsdem.figures.frame import check_suffix
    from grainsdem.recipe import keeping_last_good
    from grainsdem.screen import ChainProgress, print_facts

    (bed, output, history, figure), (json_, quiet) = paths, shown
    storage.check_suffix(output)
    if figure is not None:
        check_suffix(figure)
    prepare("contacts", "shapes", quiet=quiet)
    packing = load(bed)
    with (
        ChainProgress(err, shown=not (quiet or json_)) as bars,
        bars.stage(function.__name__.replace("_", " ").capitalize()) as tell,
        keeping_last_good(output),
    ):
        outcome = function(packing, history_path=history, progress=tell, **options)
    storage.save(outcome.packing, output)
    if figure is not None:
        experiment_figure(outcome.history, figure, profile=outcome.profile)
    report = outcome.report.to_dict()
    if json_:
        print_json(report)
    elif not quiet:
        print_facts(out, str(output), {_title(name): _shown(name, value) for name, value in report.items()})


def _title(name: str) -> str:
    """Return the name of a number with its unit."""
    words = name.replace("_", " ")
    if "angle" in name:
        return f"{words}, °"
    units = {"pressure": "Pa", "stress": "Pa", "height": "m", "run_out": "m", "time": "s"}
    unit = next((u for word, u in units.items() if name.endswith(word) and "half" not in name), "")
    return f"{words}, {unit}" if unit and not name.startswith("relative") else words


def _shown(name: str, value: Any) -> str:
    """Return a number as it is shown: angles in degrees."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{math.degrees(value):.1f}" if "angle" in name else f"{value:.4g}"
