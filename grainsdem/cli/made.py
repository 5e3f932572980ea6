"""Commands that are made from what a function says of its options."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin

import typer
from typer.main import get_command_from_info
from typer.models import CommandInfo

from grainsdem.cli.guard import Written, err, guarded
from grainsdem.cli.options import app, telling

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from grainsdem.described import Described
    from grainsdem.options import Told

History = Annotated[
    Path | None,
    typer.Option(help="Write the history here while the run goes (.h5); an interrupted run keeps it."),
    Written("grainsdem.storage:check_suffix"),
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with the killed run of that history.")]
MaxHours = Annotated[float, typer.Option(help="Refuse a run that would take longer by estimate.")]


@contextmanager
def running(title: str, output: Path, *, shown: bool) -> Iterator[Any]:
    """Show how a run gets on while the block lasts, and keep its last good state beside its output if it goes wrong.

    Yields what is told the share that is done, and a few words.
    """
    from grainsdem.recipe import keeping_last_good
    from grainsdem.screen import ChainProgress

    with (
        ChainProgress(err, shown=shown) as bars,
        bars.stage(title) as tell,
        telling(shown=shown),
        keeping_last_good(output),
    ):
        yield tell


def made_command(
    found: Described,
    perform: Callable[..., None],
    *,
    first: Mapping[str, tuple[Any, Any]],
    last: Mapping[str, tuple[Any, Any]],
    words: str = "",
) -> Any:
    """Return the command of a function.

    Parameters
    ----------
    found : Described
        The function.
    perform : callable
        What the command does; takes everything as keywords, the options checked.
    first, last : dict of str to tuple
        Parameters of the command before the options and behind them: annotation, and default or ``...``.
    words : str
        What its help says; by default what the function does, and that MuJoCo does it.
    """
    parameters = {**first, **{told.name: (_annotation(told), told.default) for told in found.told()}, **last}

    def command(**given: Any) -> None:
        from grainsdem.options import checked

        options = {told.name: given.pop(told.name) for told in found.told()}
        perform(**given, **checked(found.options, options))

    command.__annotations__ = {name: kind for name, (kind, _) in parameters.items()}
    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if default is ... else default,
                annotation=kind,
            )
            for name, (kind, default) in parameters.items()
        ]
    )
    words = words or f"{found.summary.removesuffix('.')} (MuJoCo)."
    info = CommandInfo(name=found.name.replace("_", "-"), callback=guarded(command), help=words)
    return get_command_from_info(info, pretty_exceptions_short=False, rich_markup_mode=app.rich_markup_mode)


def _annotation(told: Told) -> Any:
    """Return what typer needs to know of an option."""
    words = f"{told.help.removesuffix('.')} [{told.unit}]." if told.unit else told.help
    flags = [f"--{told.name.replace('_', '-')}"] if told.annotation is bool else []
    kind = told.annotation
    for part in (kind, *get_args(kind)):
        if get_origin(part) is Sequence:
            [item] = get_args(part)
            kind, words = list[item] | None, f"{words} May be repeated."  # type: ignore[valid-type]
        elif get_origin(part) is Mapping:  # as one text, which the option's type reads
            kind = str | None
    return Annotated[kind, typer.Option(*flags, help=words)]
