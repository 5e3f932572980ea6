"""What every command shares: the application, its options, and how it prints."""

from __future__ import annotations

import json
import logging
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import grainsdem
from grainsdem.cli.guard import err, out
from grainsdem.errors import FileFormatError, InputError, printable
from grainsdem.foreign import toml

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from grainsdem.model import ContactGraph, Packing

LOG = logging.getLogger(__name__)

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="""Grow realistic granular material, prove that nothing overlaps, and hand it to physics.

    Start with **grainsdem demo**: a bed of angular sand, grown, checked, written, poured and settled.""",
    context_settings={"help_option_names": ["-h", "--help"]},
)
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.")]
Bed = Annotated[
    Path,
    typer.Argument(help="A packing: .h5, or a file we exported (.xml, .usda, .usdc, .stl, .obj).", show_default=False),
]
Sieves = Annotated[
    Path | None,
    typer.Option(
        help="A sieve sheet that the grains are to have (.csv, .txt, .tsv): openings, and per cent passing or mass "
        "retained.",
        rich_help_panel="Grain size",
    ),
]
Rng = Annotated[int, typer.Option(help="Seed of everything that is random.", min=0)]


@contextmanager
def telling(*, shown: bool) -> Iterator[None]:
    """Print what the library logs while the block runs, such as what a run will take."""
    handler = logging.Handler(logging.INFO)
    handler.emit = lambda record: err.print(printable(record.getMessage()), highlight=False)  # type: ignore[method-assign]
    handler.addFilter(lambda record: record.levelno < logging.WARNING)  # those are printed already
    logger = logging.getLogger("grainsdem")
    before = logger.level
    if shown:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)


def prepare(*steps: str, quiet: bool) -> None:
    """Compile the kernels that a command needs, and say so; most often they are in numba's cache."""
    from grainsdem.geometry import ahead
    from grainsdem.screen import ChainProgress

    lacking = ahead.missing(*steps)
    if not lacking:
        return
    if not quiet:
        spent = ahead.seconds(lacking)
        err.print(f"compiling kernels, the first time on this machine: about {spent} s", highlight=False)
    try:
        with ChainProgress(err, shown=not quiet) as progress, progress.stage("Compiling") as tell:
            ahead.compile_kernels(lacking, lambda done, n: tell(done / n, ""))
    except Exception as error:  # noqa: BLE001  (nothing is lost: numba compiles each kernel where it is called)
        LOG.debug("kernels were not compiled in advance: %s", error)


def load(path: Path) -> Packing:
    """Return a packing from HDF5, or from a format that we can read back."""
    import exporters

    return exporters.read(path) if path.suffix.lower() in exporters.READERS else grainsdem.load(path)


def keyed(items: list[str]) -> dict[str, Any]:
    """Return what texts such as ``key=value`` say; a value is read as TOML, or is a word."""
    found: dict[str, Any] = {}
    for item in items:
        key, equals, value = item.partition("=")
        if not (key and equals):
            raise InputError(f"an option is written as key=value; got {item!r}")
        try:
            found[key] = toml(f"value = {value}")["value"]
        except FileFormatError:
            found[key] = value
    return found


def show_summary(
    packing: Packing,
    *,
    json_: bool,
    quiet: bool,
    title: str,
    graph: ContactGraph | None = None,
    more: dict[str, Any] | None = None,
) -> None:
    """Print what a bed measures, and what more is known; who touches whom is searched where it is not given."""
    from grainsdem.screen import print_summary

    if quiet and not json_:
        return
    summary = grainsdem.summary(packing, grainsdem.contacts(packing) if graph is None else graph) | (more or {})
    if json_:
        print_json(summary)
    else:
        print_summary(out, title, summary)


def print_json(value: Any) -> None:
    """Print one JSON document."""
    sys.stdout.write(json.dumps(value, indent=2) + "\n")


def show_files(files: Sequence[Path], *, json_: bool, quiet: bool) -> None:
    """Name the files that were written."""
    if json_:
        print_json({"files": [str(path) for path in files]})
    elif not quiet:
        for path in files:
            out.print(f"wrote {path}", highlight=False)
