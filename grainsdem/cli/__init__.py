"""The command line: every command is a few lines over the public API.

Exit codes: 0 done, 1 a check failed or a format refused the bed, 2 bad input, 130 interrupted, 141 nobody reads what is
printed, 143 told to end.
"""

from __future__ import annotations

from typing import Annotated

import typer

import grainsdem
from grainsdem.cli.guard import out
from grainsdem.cli.options import app

# Each module puts its commands on the application; the help shows them in this order.
# isort: off
import grainsdem.cli.making
import grainsdem.cli.many
import grainsdem.cli.packing
import grainsdem.cli.looking.seeding
import grainsdem.cli.looking.checking
import grainsdem.cli.looking.grading
import grainsdem.cli.looking.seeing
import grainsdem.cli.writing
import grainsdem.cli.moving
import grainsdem.cli.experiments
# isort: on


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
