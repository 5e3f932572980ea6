"""The command that looks at seeds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grainsdem.cli.guard import Written, guarded, out
from grainsdem.cli.options import Json, Quiet, app, print_json
from grainsdem.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grainsdem.model import Domain


@app.command()
@guarded
def seeds(
    source: Annotated[
        Path, typer.Argument(help="A recipe (.toml), or points: .txt, .csv, .npy or .npz.", show_default=False)
    ],
    lengths: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Edge lengths [m] of the box that points lie in; by default 1 1 1. Two columns make a slab."),
    ] = None,
    periodic: Annotated[str, typer.Option(help="Axes along which points wrap around, such as xy.")] = "",
    fit: Annotated[bool, typer.Option("--fit", help="Scale points into the box.")] = False,
    reach: Annotated[
        float | None, typer.Option(help="Largest distance [m] of pairs; by default three mean spacings.")
    ] = None,
    write: Annotated[
        Path | None,
        typer.Option(help="Also write the seeds [m]: .txt, .csv or .npy."),
        Written("grainsdem.points.files:check_written"),
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Place the seeds of a recipe, or read points, and say what pattern they make: nearest neighbours, K and g."""
    from grainsdem import points
    from grainsdem.screen import print_pattern

    if source.suffix.lower() == ".toml":
        if lengths or periodic or fit:
            raise InputError("a recipe has its own domain: --lengths, --periodic and --fit are for points")
        found, domain = _sown(source)
    else:
        found, domain = _read(source, lengths or (1.0, 1.0, 1.0), periodic, fit=fit)
    pattern = points.describe(found, domain, reach=reach)
    if write is not None:
        points.write(found, write)
    if json_:
        print_json(pattern)
    elif not quiet:
        print_pattern(out, str(source), pattern, is_planar=domain.is_planar)


def _sown(path: Path) -> tuple[NDArray[np.float64], Domain]:
    """Return the seeds of a recipe, relaxed as it says, and their domain."""
    from grainsdem import recipe as recipes
    from grainsdem.recipe.growing import SEEDS, stream
    from grainsdem.recipe.seeds import place
    from grainsdem.tessellation import relax

    recipe = recipes.read(path)
    if recipe.grains.shapes is not None:
        raise InputError(f"{path}: grains of shapes grow from no seeds")
    if recipe.is_count_open:
        raise InputError(
            f"{path}: the number of seeds follows from the grains' size, as `generate` finds; give seeds.count"
        )
    domain = recipe.domain.make()
    found = place(recipe.seeds, domain, stream(recipe, SEEDS))
    if recipe.seeds.relax:
        found = relax(found, domain, iterations=recipe.seeds.relax)
    return found, domain


def _read(
    path: Path, lengths: tuple[float, float, float], periodic: str, *, fit: bool
) -> tuple[NDArray[np.float64], Domain]:
    """Return points of a file, and the box that they lie in."""
    from grainsdem import points
    from grainsdem.model import Domain

    if not set(periodic) <= set("xyz"):
        raise InputError(f"periodic axes are any of x, y and z; got {periodic!r}")
    found = points.read(path)
    x, y, z = (axis in periodic for axis in "xyz")
    is_planar = found.ndim == 2 and found.shape[1] == 2
    domain = (
        Domain.slab(lengths[:2], lengths[2], periodic=(x, y)) if is_planar else Domain.box(lengths, periodic=(x, y, z))
    )
    return points.scaled(found, domain) if fit else points.check_seeds(found, domain), domain
