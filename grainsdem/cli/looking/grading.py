"""Commands that look at what a laboratory measured: sieve sheets, and sections."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grainsdem.cli.guard import Written, err, guarded, out
from grainsdem.cli.options import Json, Quiet, app, load, print_json
from grainsdem.errors import InputError
from grainsdem.measures.distributions.sheets.reading import Kind
from grainsdem.measures.distributions.sheets.sheet import Unit
from grainsdem.model.grading import Diameter

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grainsdem.measures.distributions.fits import SizeFit
    from grainsdem.measures.distributions.sheets.sheet import SieveSheet
    from grainsdem.model import Packing


@app.command()
@guarded
def fit(
    sheet: Annotated[
        Path,
        typer.Argument(
            help="A sieve sheet (.csv, .txt, .tsv): a column of openings, and one of what passes or is retained.",
            show_default=False,
        ),
    ],
    unit: Annotated[
        Unit | None,
        typer.Option(help="What openings are in; by default as the head of the column says, else millimetres."),
    ] = None,
    kind: Annotated[
        Kind | None,
        typer.Option(help="What the second column is: per cent passing, or masses retained; by default as it says."),
    ] = None,
    bed: Annotated[
        Path | None, typer.Option(help="A bed whose curve is held against the sheet (.h5, or a file we exported).")
    ] = None,
    diameter: Annotated[
        Diameter, typer.Option(help="Size of the bed's grains: the square hole they pass, or their volume's.")
    ] = "sieve",
    confidence: Annotated[float, typer.Option(help="How often intervals are to hold the truth.")] = 0.95,
    figure: Annotated[
        Path | None,
        typer.Option(help="Also draw sheet, fits and bed (.png)."),
        Written("grainsdem.figures.frame:check_suffix"),
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Fit normal, lognormal and log-hyperbolic distributions to a sieve sheet, and say how well a bed has its curve."""
    import grainsdem
    from grainsdem.errors import GrainsDEMError
    from grainsdem.measures.distributions import FAMILIES
    from grainsdem.screen import print_sheet

    told = grainsdem.read_sieves(sheet, unit=unit, kind=kind)
    fits: dict[str, SizeFit] = {}
    reasons = {}
    for family in FAMILIES:
        try:
            fits[family] = grainsdem.fit_sieves(told.bounds, told.weights, family, confidence=confidence)
        except InputError as error:
            reasons[family] = str(error)
    packing = None if bed is None else load(bed)
    found: dict[str, Any] = {
        "openings": told.openings.tolist(),
        "passing": told.passing.tolist(),
        "open_ends": told.open_ends(),
        "statistics": None,
        "fits": {family: result.to_dict() for family, result in fits.items()},
        "not_fitted": reasons,
        "bed": None if packing is None else _held_against(told, packing, diameter),
    }
    try:
        found["statistics"] = grainsdem.sieve_statistics(told.bounds, told.weights).to_dict()
    except GrainsDEMError as error:
        found["no_statistics"] = str(error)
    if figure is not None:
        curves = {family: result.distribution for family, result in fits.items()}
        grainsdem.figures.grading_figure(figure, sheet=told, fits=curves, bed=packing, diameter=diameter)
    if json_:
        print_json(found)
    elif not quiet:
        print_sheet(out, str(sheet), found)
    if not json_:
        for line in (*found["open_ends"], *reasons.values()):
            err.print(f"warning: {line}", highlight=False)


def _held_against(sheet: SieveSheet, packing: Packing, diameter: Diameter) -> dict[str, Any]:
    """Return how much of a bed's mass passes each sieve, and how far that is from the sheet."""
    import numpy as np

    import grainsdem

    sizes = grainsdem.sieve_diameters(packing) if diameter == "sieve" else grainsdem.diameters(packing)
    masses = grainsdem.masses(packing)
    passing = [100 * float(masses[sizes < opening].sum() / masses.sum()) for opening in sheet.openings]
    return {
        "n_grains": len(packing),
        "diameter": diameter,
        "passing": passing,
        "deviation": float(np.abs(np.array(passing) - sheet.passing).max()),
    }


@app.command()
@guarded
def unfold(
    sections: Annotated[
        Path,
        typer.Argument(
            help="Equal-area diameters of sections [m], one a line (.txt, .csv), or a table of polygons that `section` "
            "wrote.",
            show_default=False,
        ),
    ],
    kernel: Annotated[
        Path | None,
        typer.Option(
            help="A bed of grains of the same kind, of any sizes: what sections such grains have. By default balls."
        ),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(help="Also write the classes: .csv, .parquet or .h5."),
        Written("grainsdem.measures.grains.files:check_table"),
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Say how large grains are from the sizes of their sections in a plane at random."""
    import grainsdem
    from grainsdem.screen import print_facts

    sizes = _diameters(sections)
    found = grainsdem.unfold(sizes, None if kernel is None else grainsdem.SectionKernel.of(load(kernel)))
    marks = (10, 16, 50, 84, 90)
    told = {
        by: dict(zip([f"d{mark}" for mark in marks], found.percentiles(marks, by=by).tolist(), strict=True))
        for by in ("number", "volume")
    }
    if table is not None:
        grainsdem.write_table(found.table(), table)
    if json_:
        print_json({"n_sections": len(sizes), **told})
    elif not quiet:
        lines = {
            f"by {by}, mm": ", ".join(f"{mark} {1e3 * size:.4g}" for mark, size in sizes.items())
            for by, sizes in told.items()
        }
        print_facts(out, f"{sections}: {len(sizes)} sections", lines)


def _diameters(path: Path) -> NDArray[np.float64]:
    """Return the diameters [m] of a list, or of those polygons of a table that count."""
    import csv

    import numpy as np

    from grainsdem.errors import MissingFileError
    from grainsdem.foreign import refusing
    from grainsdem.points import text

    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    with refusing(path, "not a table of sections"):
        rows = list(csv.DictReader(text.decoded(path.read_bytes()).splitlines()))
        if rows and {"diameter", "is_counted"} <= set(rows[0]):
            return np.array([float(row["diameter"]) for row in rows if row["is_counted"] in ("1", "True", "true")])
        return text.listed(path.read_bytes())
