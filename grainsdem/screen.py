"""What the command line shows a person: progress bars and tables."""

from __future__ import annotations

from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Any, Self

from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from grainsdem.errors import name_offenders, printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console

    from grainsdem.model import Report
    from grainsdem.recipe import Result


LEAST_SHARE = 0.02
"""Share of a stage that must have been seen before its rest is told: less says little of the pace."""


class Pace:
    """How long a stage will take, from how fast it has gone so far.

    What was done before it was first looked at, in a run that goes on, and the time in which nothing could be told of
    it, while a bed comes to rest, do not count.
    """

    def __init__(self) -> None:
        self._begun: tuple[float, float] | None = None

    def left(self, fraction: float, now: float) -> float | None:
        """Return the time [s] that is left by the fraction done at a time [s], or None while too little was seen."""
        if self._begun is None or fraction <= self._begun[1]:
            self._begun = now, fraction
            return None
        since, first = self._begun
        share = fraction - first
        return (now - since) * (1.0 - fraction) / share if share >= LEAST_SHARE else None


def rough_time(seconds: float) -> str:
    """Return a time in words, as roughly as it is known.

    Examples
    --------
    >>> rough_time(40.0), rough_time(400.0), rough_time(9000.0)
    ('40 s', '7 min', '2.5 h')
    """
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class ChainProgress:
    """A bar for each stage of a chain; the monitor that `grainsdem.recipe.run` tells.

    Parameters
    ----------
    console : Console
        Where bars are drawn.
    shown : bool
        Whether they are; only a terminal shows any.
    """

    def __init__(self, console: Console, *, shown: bool = True) -> None:
        self._bars = Progress(
            SpinnerColumn(finished_text=Text("✓", style="green")),
            TextColumn("{task.description:<15}", markup=False),
            BarColumn(bar_width=8),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}", markup=False),
            TextColumn("{task.fields[words]}", markup=False),
            console=console,
            disable=not (shown and console.is_terminal),
        )

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    @contextmanager
    def stage(self, title: str) -> Iterator[Callable[[float, str], None]]:
        """Show a bar while the block runs; what is yielded takes the fraction done and a few words."""
        task, pace = self._bars.add_task(title, total=None, words="", left=""), Pace()

        def tell(fraction: float, words: str) -> None:
            seconds = pace.left(fraction, monotonic())
            left = "" if seconds is None else f"{rough_time(seconds)} left"
            self._bars.update(task, total=1.0, completed=min(fraction, 1.0), words=words, left=left)

        yield tell
        self._bars.update(task, total=1.0, completed=1.0, left="")


def print_result(console: Console, name: str, result: Result) -> None:
    """Print what a recipe made: measures before and after, and the files."""
    columns = {"as grown": result.summaries["bed"]}
    if result.settled is not None:
        columns["settled, one run"] = result.summaries["settled"]
    overlaps = {title: _overlap(result.reports[key]) for title, key in zip(columns, result.reports, strict=True)}
    table = Table(title=Text(name), title_justify="left", title_style="bold")
    table.add_column("")
    for title in columns:
        table.add_column(title, justify="right")
    rows = _rows(list(columns.values()))
    rows.append(("largest overlap, grain volumes", *overlaps.values()))
    if result.settled is not None:
        report = result.settled.report
        rows.append(("largest overlap, d", "–", f"{report.overlap_max:.1e}"))
        rows.append(("time to rest, s", "–", f"{report.time:.4g}{'' if report.at_rest else ' (not at rest)'}"))
    for row in rows:
        table.add_row(*row)
    console.print(table)
    if result.settled is not None:
        console.print(
            "Grains that move are chaotic: with another rng, and on another processor,\n"
            "another bed of the same kind settles. What is grown is the same.",
            highlight=False,
        )
    console.print(f"{len(result.files)} files written to {result.files[0].parent}:", highlight=False)
    console.print("  " + "  ".join(path.name for path in result.files), highlight=False)


def print_summary(console: Console, title: str, summary: dict[str, Any]) -> None:
    """Print the measures of one bed."""
    table = Table(title=Text(title), title_justify="left", title_style="bold", show_header=False)
    for row in _rows([summary]):
        table.add_row(*row)
    console.print(table)


def print_settling(console: Console, title: str, summary: dict[str, Any]) -> None:
    """Print the measures of a settled bed and how it settled."""
    table = Table(title=Text(title), title_justify="left", title_style="bold", show_header=False)
    rest = "" if summary["at_rest"] else " (time was up: not at rest)"
    rows = [
        *_rows([summary]),
        ("time, s", f"{summary['time']:.4g}{rest}"),
        ("fall of a grain, mean, m", f"{summary['drop_height']:.4g}"),
        ("kinetic energy of a grain, m g d", f"{summary['kinetic_energy']:.1e}"),
        ("largest overlap, d", f"{summary['overlap_max']:.1e}"),
        ("borne by the floor, weight", f"{summary['floor_force']:.4f}"),
        ("borne by the walls, weight", f"{summary['wall_force']:.4f}"),
    ]
    for row in rows:
        table.add_row(*row)
    console.print(table)


def print_report(console: Console, title: str, report: Report) -> None:
    """Print every check of a validation, the offenders of those that failed, and the verdict."""
    table = Table(title=Text(title), title_justify="left", title_style="bold")
    for column in ("check", "", "worst", "allowed", "offenders"):
        table.add_column(column, justify="right" if column in ("worst", "allowed") else "left")
    for check in report.checks:
        offenders = ["–".join(map(str, o)) if isinstance(o, tuple) else str(o) for o in check.offenders]
        table.add_row(
            check.name,
            Text("ok", style="green") if check.ok else Text("FAILED", style="red"),
            f"{check.worst:.3g} {check.unit}".strip(),
            f"{check.threshold:.3g} {check.unit}".strip(),
            name_offenders(offenders) + (f" ({check.note})" if check.note and not check.ok else ""),
        )
    console.print(table)


def print_info(console: Console, title: str, facts: dict[str, Any]) -> None:
    """Print what a file holds and the steps that made it."""
    table = Table(title=Text(title), title_justify="left", title_style="bold", show_header=False)
    for key, value in facts.items():
        if key != "provenance":
            table.add_row(key.replace("_", " "), str(value))
    for step in facts["provenance"]:
        options = ", ".join(f"{k} = {v}" for k, v in step.items() if k != "step" and v is not None)
        table.add_row(printable(f"step: {step['step']}"), printable(options))
    console.print(table)


def print_facts(console: Console, title: str, facts: dict[str, str]) -> None:
    """Print names and values."""
    table = Table(title=title, title_justify="left", title_style="bold", show_header=False)
    for name, value in facts.items():
        table.add_row(printable(name), printable(value))
    console.print(table)


def print_pattern(console: Console, title: str, pattern: dict[str, Any], *, is_planar: bool) -> None:
    """Print what pattern seeds make: how far the nearest are, and K and g by distance."""
    power = 2 if is_planar else 3
    print_facts(
        console,
        title,
        {
            "seeds": str(pattern["seeds"]),
            f"intensity, 1/m^{power}": f"{pattern['intensity']:.5g}",
            "nearest neighbour, mean, m": f"{pattern['nearest_mean']:.4g}",
            "nearest neighbour, least, m": f"{pattern['nearest_least']:.4g}",
            "Clark and Evans's index (1 at random)": f"{pattern['clark_evans']:.3f}",
        },
    )
    table = Table()
    for column in ("r, m", f"K(r), m^{power}", "of Poisson's", "g(r) up to r"):
        table.add_column(column, justify="right")
    rows = zip(*(pattern[key] for key in ("radii", "ripley_k", "poisson_k", "pair_correlation")), strict=True)
    for r, k, random, g in rows:
        table.add_row(f"{r:.4g}", f"{k:.4g}", f"{k / random:.3f}", f"{g:.3f}")
    console.print(table)


def print_distribution(console: Console, title: str, found: dict[str, Any]) -> None:
    """Print what is said of the sizes of a bed: statistics by number and by volume, and the fits, best first."""
    by = (found["by_number"], found["by_volume"])
    names = {"sieve": "square holes passed", "area": "equal-area diameters", "volume": "equal-volume diameters"}
    table = Table(title=Text(f"{title}: {names[found['diameter']]}"), title_justify="left", title_style="bold")
    for column in ("", "by number", "by volume"):
        table.add_column(column, justify="right" if column else "left")
    for mark in by[0]["percentiles"]:
        table.add_row(f"{mark}, mm", *(f"{kind['percentiles'][mark] * 1e3:.4g}" for kind in by))
    statistics = {"mean": "size", "sorting": "sorting", "skewness": "skewness", "kurtosis": "kurtosis"}
    for key, named in statistics.items():
        values = [(kind["folk_ward"][key], kind[f"{named}_class"]) for kind in by]
        table.add_row(f"{key}, graphic", *("–" if v is None else f"{v:.3f} ({word})" for v, word in values))
    for key in statistics:
        values = [kind["moments"][key] for kind in by]
        table.add_row(f"{key}, moments", *("–" if v is None else f"{v:.3f}" for v in values))
    console.print(table)
    if found["fits"] is not None:
        _print_fits(console, "fits by number, best first", found["fits"])


def print_sheet(console: Console, title: str, found: dict[str, Any]) -> None:
    """Print a sieve sheet, how well a bed has it, its graphic statistics, and the fits, best first."""
    bed = found["bed"]
    table = Table(title=Text(title), title_justify="left", title_style="bold")
    for column in (
        "opening, mm",
        "passing, %",
        *([] if bed is None else [f"of the bed's {bed['n_grains']} grains, %"]),
    ):
        table.add_column(column, justify="right")
    for k in reversed(range(len(found["openings"]))):
        held = [] if bed is None else [f"{bed['passing'][k]:.2f}"]
        table.add_row(f"{found['openings'][k] * 1e3:.4g}", f"{found['passing'][k]:.2f}", *held)
    console.print(table)
    if bed is not None:
        console.print(f"largest difference {bed['deviation']:.2f} % of the mass, {bed['diameter']} diameters")
    if found["statistics"] is None:
        console.print(f"no percentiles: {found['no_statistics']}")
    else:
        told = found["statistics"]
        marks = ", ".join(
            f"{mark} {told['percentiles'][mark] * 1e3:.4g}" for mark in ("d10", "d16", "d50", "d84", "d90")
        )
        console.print(f"{marks} mm")
        graphic, words = told["folk_ward"], {"mean": "size", "sorting": "sorting", "skewness": "skewness"}
        line = ", ".join(f"{key} {graphic[key]:.3f} ({told[f'{word}_class']})" for key, word in words.items())
        console.print(f"in φ, by Folk and Ward: {line}")
    if found["fits"]:
        _print_fits(console, "fits by mass, best first", found["fits"])


def _print_fits(console: Console, title: str, fits: dict[str, Any]) -> None:
    best = min(fit["aic"] for fit in fits.values())
    table = Table(title=Text(title), title_justify="left")
    for column in ("family", "AIC", "K–S", "parameters (95 %)"):
        table.add_column(column, no_wrap=True)
    for family, fit in sorted(fits.items(), key=lambda item: item[1]["aic"]):
        lines = []
        for name, value in fit["parameters"].items():
            low, high = fit["intervals"][name]
            known = "" if low is None or high is None else f" ({low:.4g} to {high:.4g})"
            lines.append(f"{name} {value:.4g}{known}")
        edge = f"\n{fit['edge']} edge" if fit["edge"] else ""
        distance = f"{fit['ks']:.4f}" + ("" if fit["ks_p_value"] is None else f"\np {fit['ks_p_value']:.1g}")
        table.add_row(family + edge, f"+{fit['aic'] - best:.1f}", distance, "\n".join(lines), end_section=True)
    console.print(table)


def _rows(summaries: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return the measures that every summary shares, as text."""

    def row(title: str, show: Callable[[dict[str, Any]], str]) -> tuple[str, ...]:
        return (title, *(show(summary) for summary in summaries))

    def number(key: str, digits: int) -> Callable[[dict[str, Any]], str]:
        return lambda s: "–" if s[key] is None else f"{s[key]:.{digits}f}"

    def millimetres(key: str) -> Callable[[dict[str, Any]], str]:
        return lambda s: f"{s[key] * 1e3:.4g}"

    def porosity(summary: dict[str, Any]) -> str:
        return "–" if summary["porosity"] is None else f"{summary['porosity']:.4f} ({summary['porosity_region']})"

    def throats(when: str) -> Callable[[dict[str, Any]], str]:
        def show(summary: dict[str, Any]) -> str:
            widths = summary.get("throats", {}).get(when)
            return f"{widths['mean'] * 1e3:.4g} ± {widths['std'] * 1e3:.4g}" if widths else "–"

        return show

    moved = [
        row(f"throat widths {when} grains were moved, mm", throats(when))
        for when in ("before", "after")
        if any(summary.get("throats") for summary in summaries)
    ]
    return [
        row("grains", lambda s: str(s["n_grains"])),
        row("porosity (of what region)", porosity),
        row("d10 by mass, mm", millimetres("d10")),
        row("d50 by mass, mm", millimetres("d50")),
        row("d90 by mass, mm", millimetres("d90")),
        row("mean sphericity", number("mean_sphericity", 3)),
        row("mean neighbours in the tessellation", number("mean_neighbors", 2)),
        row("mean coordination", number("mean_coordination", 2)),
        row("mass, g", lambda s: f"{s['total_mass'] * 1e3:.4g}"),
        *moved,
    ]


def _overlap(report: Report) -> str:
    check = next(check for check in report.checks if check.name == "overlaps")
    return f"{check.worst:.1e}"
