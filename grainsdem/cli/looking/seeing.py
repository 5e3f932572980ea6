"""Commands that look into a bed: voxels, phases, section, planform."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import grainsdem
from grainsdem.cli.guard import Written, err, guarded, out
from grainsdem.cli.made import made_command
from grainsdem.cli.options import Bed, Force, Json, Quiet, app, load, print_json
from grainsdem.errors import InputError

LOG = logging.getLogger(__name__)

Size = Annotated[float | None, typer.Option("--resolution", help="Edge of a voxel [m].")]
PerDiameter = Annotated[
    float | None, typer.Option(help="Voxels or pixels along a mean diameter, 20 by default; instead of their edge.")
]
Region = Annotated[
    tuple[float, float, float, float, float, float] | None,
    typer.Option(help="Lower and upper corner of a box [m]; the domain by default."),
]


@app.command()
@guarded
def voxels(
    bed: Bed,
    output: Annotated[
        Path,
        typer.Argument(help="The file to write: .npy, .nrrd, .raw, .tif or .vti.", show_default=False),
        Written("grainsdem.measures.voxels.files:check_suffix"),
    ],
    resolution: Size = None,
    per_diameter: PerDiameter = None,
    region: Region = None,
    phase: Annotated[bool, typer.Option("--phase", help="Write 1 in grains and 0 elsewhere, not which grain.")] = False,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    r"""Write which grain each voxel lies in, layer by layer (TIFF: pip install "grainsdem\[images]")."""
    from grainsdem.screen import ChainProgress, print_facts

    packing, box = load(bed), None if region is None else (region[:3], region[3:])
    with ChainProgress(err, shown=not (quiet or json_)) as progress, progress.stage("Voxels") as tell:
        file = grainsdem.write_voxels(
            packing,
            output,
            size=resolution,
            per_diameter=per_diameter,
            region=box,
            phase=phase,
            surface=box is None,
            progress=lambda share: tell(share, ""),
        )
    surfaces = {} if math.isnan(file.specific_surface) else {
        "specific_surface": file.specific_surface, "exact_specific_surface": grainsdem.exact_specific_surface(packing)
    }  # fmt: skip
    if surfaces:
        _tell_coarse("specific surface", **surfaces)
    exact = grainsdem.porosity(packing, region="domain" if box is None else box)
    if json_:
        facts = {"counts": file.counts, "spacing": file.spacing, "porosity": file.porosity, "exact_porosity": exact}
        print_json({"files": [str(file.path)], **facts, **surfaces})
    elif not quiet:
        counts, edges = (" × ".join(f"{n:.4g}" for n in row) for row in (file.counts, file.spacing))
        told = {"voxels": counts, "edges, m": edges, "porosity": f"{file.porosity:.5f} (exact {exact:.5f})"}
        if surfaces:
            seen, true = surfaces.values()
            told["specific surface, 1/m"] = f"{seen:.5g} (exact {true:.5g})"
        print_facts(out, str(file.path), told)


def _tell_coarse(name: str, specific_surface: float, exact_specific_surface: float) -> None:
    """Warn where the resolution makes a surface wrong."""
    from grainsdem.measures.voxels import WRONG

    error = specific_surface / exact_specific_surface - 1
    if abs(error) > WRONG:
        told = "%s is off by %+.0f %%: the exact value stands beside it; narrow gaps want four voxels"
        LOG.warning(told, name, 100 * error)


@app.command()
@guarded
def phases(
    bed: Bed,
    resolution: Size = None,
    per_diameter: PerDiameter = None,
    region: Region = None,
    table: Annotated[
        Path | None,
        typer.Option(help="Also write the two-point correlation (.csv)."),
        Written("grainsdem.measures.grains.files:check_csv"),
    ] = None,
    figure: Annotated[
        Path | None,
        typer.Option(help="Also draw the correlation and the chords (.png)."),
        Written("grainsdem.figures.frame:check_suffix"),
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Measure grains and void as two phases of voxels: porosity, specific surface, chords, two-point correlation."""
    from grainsdem.screen import print_facts

    box = None if region is None else (region[:3], region[3:])
    packing = load(bed)
    image = grainsdem.voxelize(packing, size=resolution, per_diameter=per_diameter, region=box)
    axes: list[Literal["x", "y", "z"]] = ["x", "y"] if image.is_layer else ["x", "y", "z"]
    chords = {axis: grainsdem.chord_lengths(image, axis) for axis in axes}
    facts: dict[str, Any] = {
        "porosity": image.porosity(),
        "specific_surface": grainsdem.specific_surface(image),
        "specific_surface_crofton": grainsdem.specific_surface(image, method="crofton"),
        **({} if box is not None else {"specific_surface_exact": grainsdem.exact_specific_surface(packing)}),
        **{f"mean_chord_solid_{axis}": found.mean("solid") for axis, found in chords.items()},
        **{f"mean_chord_void_{axis}": found.mean("void") for axis, found in chords.items()},
    }
    if box is None:
        for name in ("specific_surface", "specific_surface_crofton"):
            _tell_coarse(name.replace("_", " "), facts[name], facts["specific_surface_exact"])
    if table is not None or figure is not None:
        correlation = grainsdem.two_point_correlation(image)
        if table is not None:
            grainsdem.write_csv(correlation.table(), table)
        if figure is not None:
            grainsdem.figures.phase_figure(correlation, chords["x"], figure)
    if json_:
        print_json(facts)
    elif not quiet:
        print_facts(out, str(bed), {name.replace("_", " "): f"{value:.5g}" for name, value in facts.items()})


@app.command()
@guarded
def section(
    bed: Bed,
    picture: Annotated[
        Path,
        typer.Argument(help="The picture to write (.png).", show_default=False),
        Written("grainsdem.figures.frame:check_suffix"),
    ],
    plane: Annotated[
        str | None,
        typer.Option(help="Such as z=0.01, or n_x,n_y,n_z,d for n · x = d [m]; by default level, in the middle."),
    ] = None,
    color_by: Annotated[Literal["diameter", "id", "none"], typer.Option(help="What colours the grains.")] = "diameter",
    table: Annotated[
        Path | None,
        typer.Option(help="Also write one row a polygon (.csv)."),
        Written("grainsdem.measures.grains.files:check_csv"),
    ] = None,
    profile: Annotated[
        Path | None,
        typer.Option(help="Also write one row for each of many levels (.csv)."),
        Written("grainsdem.measures.grains.files:check_csv"),
    ] = None,
    levels: Annotated[int, typer.Option(help="Levels of the profile.", min=1)] = 32,
    axis: Annotated[Literal["x", "y", "z"], typer.Option(help="Along which the levels follow one another.")] = "z",
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Cut a bed by a plane: the polygons of its grains, drawn and measured, beside what stereology expects."""
    from grainsdem.screen import print_facts

    packing = load(bed)
    cut = grainsdem.section(packing, **_plane(plane, packing))
    grainsdem.figures.section_figure(cut, picture, color_by=None if color_by == "none" else color_by)
    if table is not None:
        grainsdem.write_csv(grainsdem.section_table(cut), table)
    if profile is not None:
        grainsdem.write_csv(grainsdem.section_profile(packing, levels, axis=axis), profile)
    found, expected = grainsdem.section_summary(cut), grainsdem.expected_section(packing, normal=cut.frame[2])
    if json_:
        print_json({"section": found, "expected": expected})
    elif not quiet:
        facts = {
            name.replace("_", " "): "–"
            if value is None
            else f"{value:.4g}" + (f"  ({expected[name]:.4g} in the mean over the bed)" if name in expected else "")
            for name, value in found.items()
        }
        print_facts(out, str(picture), facts)


FIRST: dict[str, tuple[Any, Any]] = {
    "bed": (Bed, ...),
    "folder": (
        Annotated[
            Path,
            typer.Argument(help="The folder for the image and its truth.", show_default=False),
            Written(is_folder=True),
        ],
        ...,
    ),
    "pixel": (Annotated[float | None, typer.Option(help="Edge of a pixel [m].")], None),
    "per_diameter": (PerDiameter, None),
    "region": (
        Annotated[
            tuple[float, float, float, float] | None, typer.Option(help="Smallest x and y, largest x and y [m].")
        ],
        None,
    ),
}
"""What the command of planforms takes before the options of the photograph."""

LAST: dict[str, tuple[Any, Any]] = {
    "formats": (
        Annotated[
            list[str] | None, typer.Option("--format", help="png, npy or tif; may be repeated. [default: png, npy]")
        ],
        None,
    ),
    "least_pixels": (Annotated[int, typer.Option(help="Grains of which fewer are seen are specks.", min=1)], 1),
    "figure": (
        Annotated[
            Path | None,
            typer.Option(help="Also draw image, grains, depths and sizes (.png)."),
            Written("grainsdem.figures.frame:check_suffix"),
        ],
        None,
    ),
    "rng": (Annotated[int, typer.Option(help="Seed of reflectances, colours, textures and noise.", min=0)], 0),
    "force": (Force, False),
    "json_": (Json, False),
    "quiet": (Quiet, False),
}
"""What it takes behind them."""


def planform_command() -> Any:
    """Return the command that photographs a bed, with the options that `grainsdem.photograph` says."""
    from grainsdem.described import description

    words = "Photograph a bed from above, and write who is seen where, how deep, and how large grains are and seem."
    found = replace(description(grainsdem.photograph), name="planform")
    return made_command(found, _planform, first=FIRST, last=LAST, words=words)


def _planform(
    *,
    bed: Path,
    folder: Path,
    pixel: float | None,
    per_diameter: float | None,
    region: tuple[float, float, float, float] | None,
    formats: list[str] | None,
    least_pixels: int,
    figure: Path | None,
    rng: int,
    force: bool,
    json_: bool,
    quiet: bool,
    **camera: Any,
) -> None:
    """Photograph a bed, write the folder, and print how large grains seem."""
    from grainsdem.screen import print_facts

    packing, corners = load(bed), None if region is None else (region[:2], region[2:])
    view = grainsdem.planform(packing, pixel=pixel, per_diameter=per_diameter, region=corners)
    files = grainsdem.write_planform(
        view,
        packing,
        folder,
        formats=formats or ("png", "npy"),
        least_pixels=least_pixels,
        rng=rng,
        overwrite=force,
        **camera,
    )
    if figure is not None:
        image = grainsdem.photograph(view, packing, rng=rng, **camera)
        grainsdem.figures.planform_figure(view, packing, image, figure, least_pixels=least_pixels)
    seen = grainsdem.planform_table(view, packing)
    whole = seen[~seen["is_cut"] & (seen["n_pixels"] >= least_pixels)]
    rows = grainsdem.planform_bias(whole, packing, least_pixels=least_pixels) if whole.size else whole[:0]
    if json_:
        names = rows.dtype.names or ()
        bias = {row["statistic"]: {name: float(row[name]) for name in names[1:]} for row in rows}
        print_json({"files": [str(path) for path in files], "bias": bias})
    elif not quiet:
        print_facts(out, str(folder), {"grains seen": str(seen.size), "of those whole": str(whole.size)})
        _print_bias(rows)


def _print_bias(rows: Any) -> None:
    """Print the apparent axes b beside the true ones, in millimetres."""
    from rich.table import Table

    columns = {
        "seen, by number": "apparent_by_number",
        "seen, by area": "apparent_by_area",
        "bed, by number": "bed_by_number",
        "bed, by mass": "bed_by_mass",
    }
    table = Table(title="axis b, mm", title_justify="left")
    for title in ("", *columns):
        table.add_column(title, justify="right")
    for row in rows:
        table.add_row(str(row["statistic"]), *(f"{row[name] * 1e3:.4g}" for name in columns.values()))
    out.print(table)


def _plane(text: str | None, packing: grainsdem.Packing) -> dict[str, Any]:
    """Return the plane that a text such as z=0.01 or 1,1,0,0.02 means, as `grainsdem.section` takes it."""
    if text is None:
        domain = packing.domain
        top = float(grainsdem.world_vertices(packing)[:, 2].max(initial=domain.lower[2]))
        return {"z": float(0.5 * (domain.lower[2] + min(top, domain.upper[2])))}
    name, equals, place = text.partition("=")
    try:
        if equals and name.strip() in ("x", "y", "z"):
            return {name.strip(): float(place)}
        return {"plane": [float(number) for number in text.split(",")]}
    except ValueError:
        raise InputError(f"a plane is written as z=0.01, or n_x,n_y,n_z,d; got {text!r}") from None
