"""Commands that make a bed: demo, run, generate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from grainsdem.cli.guard import Written, err, guarded, out
from grainsdem.cli.options import Json, Quiet, Rng, Sieves, app, keyed, prepare, print_json, show_summary
from grainsdem.errors import InputError, RefusedError
from grainsdem.measures.distributions.fits import Family
from grainsdem.model.grading import Diameter
from grainsdem.tessellation.forms import Orientation

Process = Literal["halton", "poisson", "cluster", "strauss", "strauss_process", "density", "noise", "image", "file"]
VOID, SIZE, AXES, THROATS = "How much void: one of", "Grain size", "Long and flat grains", "Pore throats"
INFILL = "Fine grains in the voids"
"""Groups of options in the help."""


@app.command()
@guarded
def demo(
    folder: Annotated[Path, typer.Option(help="Where the files go."), Written(is_folder=True)] = Path("grainsdem_demo"),
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make the main example: a bed of angular quartz sand of ASTM 20/30 grading, from seeds to grains at rest."""
    from grainsdem.recipe import EXAMPLE

    _run(EXAMPLE, folder, json_=json_, quiet=quiet)


@app.command()
@guarded
def run(
    recipe: Annotated[Path, typer.Argument(help="A recipe (.toml).", show_default=False)],
    folder: Annotated[
        Path | None,
        typer.Option(help="Where the files go; by default a folder named like the recipe."),
        Written(is_folder=True),
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make the bed that a recipe describes: grow, validate, write, settle, validate, write."""
    _run(recipe, folder or Path(recipe.stem), json_=json_, quiet=quiet)


def _run(recipe: Path, folder: Path, *, json_: bool, quiet: bool) -> None:
    from grainsdem import recipe as recipes
    from grainsdem.geometry import ahead
    from grainsdem.screen import ChainProgress, print_result

    wanted, refusal = recipes.read(recipe), None
    # Laying out shapes, and forms of grains' own, have kernels of their own that most recipes do not need.
    is_mixed = wanted.grains.axes is not None and wanted.grains.axes.is_mixed
    idle = {"loose": wanted.grains.shapes is None, "between": not is_mixed}
    prepare(*(step for step in ahead.STEPS if not idle.get(step)), quiet=quiet)
    with ChainProgress(err, shown=not (quiet or json_)) as progress:
        try:
            result = recipes.run(wanted, folder, progress)
        except RefusedError as error:
            result, refusal = error.made, error
    if json_:
        print_json({**result.summaries, "files": [str(path) for path in result.files]})
    elif not quiet:
        print_result(out, wanted.name, result)
    if refusal is not None:
        raise refusal


@app.command()
@guarded
def generate(
    output: Annotated[
        Path,
        typer.Argument(help="The packing to write (.h5).", show_default=False),
        Written("grainsdem.storage:check_suffix"),
    ],
    count: Annotated[int | None, typer.Option(help="Number of seeds.", min=1)] = None,
    process: Annotated[
        Process | None, typer.Option(help="How seeds are placed; by default halton, or file where --seeds is given.")
    ] = None,
    seeds: Annotated[
        Path | None,
        typer.Option(
            help="Your own seeds in metres (.txt, .csv, .xyz, .npy or .npz), "
            "or the image or density (.npy) that the process places them by."
        ),
    ] = None,
    seed_parameter: Annotated[
        list[str] | None,
        typer.Option(
            help="A parameter of the process, as in a recipe's table [seeds]: bases=[5,7,11] of halton, spread=0.1 and "
            "parents=20 of cluster, distance=0.05 and inhibition=0 of strauss, beta=2 of noise, low_pass=0.05 and "
            "light=fine of image, along=y of density, fit=true of file.",
            show_default=False,
        ),
    ] = None,
    shape: Annotated[
        Literal["box", "slab", "cylinder", "hopper"],
        typer.Option(help="What grains grow in; a slab is one grain thick: two-dimensional work."),
    ] = "box",
    side: Annotated[float | None, typer.Option(help="Edge length of a cube [m], instead of --lengths.")] = None,
    lengths: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Edge lengths of a box [m], by default 1 1 1, or of a slab, its thickness last."),
    ] = None,
    periodic: Annotated[str, typer.Option(help="Axes that wrap around, such as xy.")] = "",
    radius: Annotated[float | None, typer.Option(help="Radius of a cylinder [m].")] = None,
    height: Annotated[float | None, typer.Option(help="Height of a cylinder or hopper [m].")] = None,
    top: Annotated[tuple[float, float] | None, typer.Option(help="Lengths of a hopper's upper opening [m].")] = None,
    bottom: Annotated[tuple[float, float] | None, typer.Option(help="Lengths of a hopper's lower opening [m].")] = None,
    relax: Annotated[int, typer.Option(help="Lloyd iterations: more make grains rounder and more alike.", min=0)] = 0,
    keep: Annotated[
        Literal["inside", "all"], typer.Option(help="Whether cells that touch a wall are dropped.")
    ] = "inside",
    porosity: Annotated[
        float | None, typer.Option(help="Void fraction, reached exactly, in [0, 1).", rich_help_panel=VOID)
    ] = None,
    solid_fraction: Annotated[float | None, typer.Option(help="One minus the porosity.", rich_help_panel=VOID)] = None,
    void_ratio: Annotated[
        float | None, typer.Option(help="Volume of void over volume of solid.", rich_help_panel=VOID)
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="Linear factor that grains shrink by, in (0, 1].", rich_help_panel=VOID)
    ] = None,
    gap: Annotated[
        float | None,
        typer.Option(help="Distance [m] between the faces of neighbours, the same everywhere.", rich_help_panel=VOID),
    ] = None,
    relation: Annotated[
        str | None,
        typer.Option(
            help="Relation of void ratio to sphericity or sorting that the bed is to lie on: cho_2006_max, "
            "cho_2006_min, terzaghi_1996.",
            rich_help_panel=VOID,
        ),
    ] = None,
    about: Annotated[
        Literal["centroid", "seed", "vertex_mean"],
        typer.Option(help="What grains shrink about.", rich_help_panel=VOID),
    ] = "centroid",
    region: Annotated[
        Literal["cells", "domain"], typer.Option(help="What the porosity is of.", rich_help_panel=VOID)
    ] = "cells",
    box: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            help="The porosity is that of a box: its lower and its upper corner [m].",
            metavar="X Y Z X Y Z",
            rich_help_panel=VOID,
        ),
    ] = None,
    mean_diameter: Annotated[
        float | None,
        typer.Option(
            help="Mean diameter [m] of the grains. Without --count the number follows, else the size of the bed.",
            rich_help_panel=SIZE,
        ),
    ] = None,
    median_diameter: Annotated[
        float | None, typer.Option(help="The same by the median diameter by mass [m].", rich_help_panel=SIZE)
    ] = None,
    sizes: Annotated[
        str | None,
        typer.Option(
            help="Grain sizes [m] to be had: a law of scipy.stats, such as lognorm, or a file of diameters.",
            rich_help_panel=SIZE,
        ),
    ] = None,
    size_parameter: Annotated[
        list[str] | None,
        typer.Option(help="A parameter of the law, such as s=0.3 or scale=1e-3.", rich_help_panel=SIZE),
    ] = None,
    size_tolerance: Annotated[
        float | None, typer.Option(help="Largest relative error of a cell's volume.", rich_help_panel=SIZE)
    ] = None,
    sieves: Sieves = None,
    sieve_diameter: Annotated[
        Diameter | None,
        typer.Option(
            help="What openings are openings for, by default sieve: square holes, or equal-volume diameters.",
            rich_help_panel=SIZE,
        ),
    ] = None,
    sieve_fit: Annotated[
        Family | None,
        typer.Option(help="Have the curve of this family that fits the sheet best.", rich_help_panel=SIZE),
    ] = None,
    elongation: Annotated[
        float | None,
        typer.Option(help="Mean of b/a, middle over long axis of the grains: long grains.", rich_help_panel=AXES),
    ] = None,
    flatness: Annotated[
        float | None,
        typer.Option(help="Mean of c/b, short over middle axis: flat grains.", rich_help_panel=AXES),
    ] = None,
    elongation_std: Annotated[
        float | None,
        typer.Option(help="Standard deviation of b/a: a normal law of it.", rich_help_panel=AXES),
    ] = None,
    flatness_std: Annotated[
        float | None,
        typer.Option(help="Standard deviation of c/b: a normal law of it.", rich_help_panel=AXES),
    ] = None,
    zingg: Annotated[
        list[str] | None,
        typer.Option(
            help="Share of one of Zingg's classes, such as disc=0.3: once for each of disc, spheroid, blade and rod.",
            show_default=False,
            rich_help_panel=AXES,
        ),
    ] = None,
    orientation: Annotated[
        Orientation | None,
        typer.Option(help="Whether grains of forms of their own lie any way or about one.", rich_help_panel=AXES),
    ] = None,
    spread: Annotated[
        float | None,
        typer.Option(help="Standard deviation [rad] of the turns that part aligned grains.", rich_help_panel=AXES),
    ] = None,
    trend: Annotated[
        float | None,
        typer.Option(help="Direction of the long axes [rad], counter-clockwise from +x.", rich_help_panel=AXES),
    ] = None,
    dip: Annotated[
        float | None,
        typer.Option(
            help="Imbrication: angle [rad] by which flat sides are turned up along the trend.", rich_help_panel=AXES
        ),
    ] = None,
    throats: Annotated[
        float | None,
        typer.Option(
            help="Share of the grains that are moved within their cells: throats of many widths.",
            rich_help_panel=THROATS,
        ),
    ] = None,
    throat_strength: Annotated[
        float | None, typer.Option(help="Share of their slack that they may use.", rich_help_panel=THROATS)
    ] = None,
    throat_axes: Annotated[
        str | None, typer.Option(help="Coordinates that change, such as xy.", rich_help_panel=THROATS)
    ] = None,
    infill: Annotated[
        float | None,
        typer.Option(
            help="Mass of fine grains in the voids over that of all; takes --keep all, or a domain that wraps around.",
            rich_help_panel=INFILL,
        ),
    ] = None,
    infill_diameter: Annotated[
        float | None, typer.Option(help="Diameter [m] of their mean volume.", rich_help_panel=INFILL)
    ] = None,
    infill_density: Annotated[
        float | None, typer.Option(help="Their density [kg/m³], by default that of the others.", rich_help_panel=INFILL)
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

    voids = {
        "porosity": porosity,
        "solid_fraction": solid_fraction,
        "void_ratio": void_ratio,
        "scale": scale,
        "gap": gap,
        "relation": relation,
    }
    if not any(value is not None for value in voids.values()):
        voids["scale"] = 1.0
    axes = {
        "elongation": _ratio("--elongation", elongation, elongation_std),
        "flatness": _ratio("--flatness", flatness, flatness_std),
        "classes": keyed(zingg or []) or None,
        "orientation": orientation,
        "spread": spread,
        "trend": trend,
        "dip": dip,
    }
    sheet = {"path": None if sieves is None else str(sieves), "diameter": sieve_diameter, "fit": sieve_fit}
    moved = {"fraction": throats, "strength": throat_strength, "axes": throat_axes}
    wanted = recipes.make(
        name=output.stem,
        rng=rng,
        domain={
            "shape": shape,
            "side": side,
            "lengths": lengths,
            "periodic": periodic,
            "radius": radius,
            "height": height,
            "top": top,
            "bottom": bottom,
        },
        seeds={
            "process": process or ("file" if seeds else "halton"),
            "count": count,
            "path": None if seeds is None else str(seeds),
            "relax": relax,
            **keyed(seed_parameter or []),
        },
        grains={
            "keep": keep,
            **voids,
            "about": about,
            "region": _region(region, box),
            "mean_diameter": mean_diameter,
            "median_diameter": median_diameter,
            "density": density,
            "infill": _together("--infill", {"share": infill, "diameter": infill_diameter, "density": infill_density}),
            "throats": _together("--throats", moved),
            "sizes": size_table(sizes, size_parameter, size_tolerance),
            "sieves": _together("--sieves", sheet),
            "axes": {name: value for name, value in axes.items() if value is not None} or None,
        },
    )
    prepare("cells", "shapes", "contacts", *(["lloyd"] if relax else []), quiet=quiet)
    with ChainProgress(err, shown=not (quiet or json_)) as progress:
        packing = recipes.grow(wanted, progress)
    storage.save(packing, output)
    more = recipes.throat_widths_told(packing)
    show_summary(packing, json_=json_, quiet=quiet, title=str(output), more=more)


def _ratio(name: str, mean: float | None, std: float | None) -> Any:
    """Return a ratio of axes as a recipe has it: a mean, or a law with a standard deviation."""
    if std is None:
        return mean
    if mean is None:
        raise InputError(f"{name}-std is that of {name}: give {name} too")
    return {"mean": mean, "std": std}


def _region(region: str, box: tuple[float, ...] | None) -> Any:
    """Return the region of a porosity, as a recipe has it."""
    if box is None:
        return region
    if region != "cells":
        raise InputError(f"give --region or --box; got --region {region} and a box")
    return box[:3], box[3:]


def _together(leader: str, values: dict[str, Any]) -> dict[str, Any] | None:
    """Return the table of the options that are given; none has a use without the first."""
    given = {name: value for name, value in values.items() if value is not None}
    if given and next(iter(values)) not in given:
        raise InputError(f"{', '.join(given)} says how something is done that {leader} asks for: give {leader} too")
    return given or None


def size_table(sizes: str | None, parameters: list[str] | None, tolerance: float | None) -> dict[str, Any] | None:
    """Return the table of prescribed sizes: a file has a suffix, a law has none."""
    source = None if sizes is None else {"path" if Path(sizes).suffix else "law": sizes}
    rest = {"source": source, "parameters": keyed(parameters or []) or None, "tolerance": tolerance}
    table = _together("--sizes", rest)
    return None if table is None else {**table.pop("source"), **table}
