"""Show each experiment: a short animation of a small bed, and curves of what the same run measured.

Prints how long each took. Run with names of experiments for these alone, and with ``--quick`` for few grains, little
motion and two pictures.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from own_part import PARTS, make_heap
from penetration import make_prisms

import grainsdem as gd
from grainsdem.figures.curves import Panel, curve_figure

if TYPE_CHECKING:
    from collections.abc import Callable

MILLIMETRE = 1e-3
"""About how large the grains are [m]."""


class Shown(NamedTuple):
    """An experiment and how it is shown.

    Parameters
    ----------
    run : callable
        Given how large it is, 1 or less, and where its history goes, returns its outcome.
    color_by : str
        What colours the grains.
    from_stage : bool
        Whether it is shown from its second stage on, when the bed has been compressed or has come to rest.
    outline : bool
        Whether the container is drawn.
    view : str, optional
        From where.
    height : int
        Of the picture [pixels].
    share : float
        Of the time of the run that is shown: what comes to rest does so slowly.
    """

    run: Callable[[float, Path], Any]
    color_by: str
    from_stage: bool = True
    outline: bool = True
    view: str | None = None
    height: int = 270
    share: float = 1.0


def bed(size: float, n: int, shape: tuple[float, float] = (1.3, 1.0), **options: Any) -> gd.Packing:
    """Return about n prisms, poured into a box of such a shape."""
    grains = make_prisms(max(16, round(size * n)), shape)
    return gd.settle(grains, start="pour", time_step=0.02, rng=1, **options).packing


def settle(size: float, path: Path) -> Any:
    """Pour prisms."""
    return gd.settle(
        make_prisms(max(16, round(80 * size)), (2.2, 1.0)), start="pour", time_step=0.02, rng=1, history_path=path
    )


def compact(size: float, path: Path) -> Any:
    """Compress prisms from four sides."""
    grains = make_prisms(max(16, round(70 * size)), (1.0, 1.0))
    return gd.dynamics.compact(grains, compaction_friction=0.0, time_step=0.02, rng=1, history_path=path)


def tap(size: float, path: Path) -> Any:
    """Tap prisms that were poured."""
    return gd.dynamics.tap(
        bed(size, 60), taps=max(1, round(8 * size)), time_step=0.02, amplitude=MILLIMETRE, history_path=path
    )


def triaxial(size: float, path: Path) -> Any:
    """Compress prisms along y, between walls that keep their pressure: a biaxial test."""
    grains = make_prisms(max(30, round(90 * size)), (1.0, 1.3))
    return gd.triaxial(grains, strain=0.3 * size, inertial_number=0.03, time_step=0.02, rng=1, history_path=path)


def ring_shear(size: float, path: Path) -> Any:
    """Turn a lid on a ring of polyhedra."""
    n = max(60, round(130 * size))
    domain = gd.Domain.cube(MILLIMETRE * n ** (1 / 3))
    cells = gd.tessellate(gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=2), domain)
    grains = gd.shrink(gd.carve(cells, keep="all"), porosity=0.4)
    return gd.ring_shear(grains, strain=1.5 * size, inertial_number=0.1, time_step=0.02, rng=1, history_path=path)


def direct_shear(size: float, path: Path) -> Any:
    """Shear prisms in a box of two halves."""
    grains = make_prisms(max(30, round(100 * size)), (1.0, 1.0))
    return gd.direct_shear(
        grains, displacement=0.25 * size, aspect=2.0, inertial_number=0.03, time_step=0.02, rng=1, history_path=path
    )


def collapse(size: float, path: Path) -> Any:
    """Take a wall away from a column."""
    return gd.collapse(bed(size, 90, (0.8, 1.0)), release=["wall_x1"], time_step=0.02, history_path=path)


def tilt(size: float, path: Path) -> Any:
    """Tilt a long bed."""
    return gd.tilt(bed(size, 70, (3.0, 1.0), friction=0.6), friction=0.6, rate=0.05, time_step=0.02, history_path=path)


def discharge(size: float, path: Path) -> Any:
    """Let discs flow through a slot."""
    discs = bed(size, 130, (1.0, 1.2), spheres=True)
    return gd.discharge(discs, spheres=True, friction=0.3, max_time=20 * size, time_step=0.02, history_path=path)


def feed(size: float, path: Path) -> Any:
    """Build a heap from a stream on a table without walls."""
    grains = make_prisms(max(16, round(80 * size)), (1.8, 1.0))
    lower, upper = grains.domain.lower.copy(), grains.domain.upper.copy()
    middle = 0.5 * (lower[0] + upper[0])
    lower[:2] = middle - MILLIMETRE, 1.2 * upper[1]
    upper[:2] = middle + MILLIMETRE, 1.2 * upper[1] + 2 * MILLIMETRE
    return gd.feed(
        grains, inlet=[*lower, *upper], release=["wall_x0", "wall_x1"], rng=1, time_step=0.02, history_path=path
    )


def drum(size: float, path: Path) -> Any:
    """Turn prisms in a drum."""
    grains = make_prisms(max(16, round(70 * size)), (1.0, 1.0))
    return gd.drum(grains, period=0.7, turns=0.75 * size, time_step=0.02, rng=1, history_path=path)


def press(size: float, path: Path) -> Any:
    """Press a plate into discs."""
    return gd.dynamics.penetration(
        bed(size, 100, (1.5, 1.0), spheres=True), body="plate", width=2.5 * size**0.5 * MILLIMETRE,
        depth=3 * size * MILLIMETRE, spheres=True, time_step=0.02, history_path=path,
    )  # fmt: skip


def drop(size: float, path: Path) -> Any:
    """Drop a disc onto discs."""
    return gd.dynamics.penetration(
        bed(size, 100, (1.5, 1.0), spheres=True), body="sphere", mode="drop", width=3 * size**0.5 * MILLIMETRE,
        height=8 * MILLIMETRE, mass=1e-4, spheres=True, time_step=0.02, history_path=path,
    )  # fmt: skip


def roll(size: float, path: Path) -> Any:
    """Roll a wheel over discs."""
    return gd.dynamics.penetration(
        bed(size, 100, (4.0, 1.0), spheres=True), body="wheel", mode="roll", width=4 * size**0.5 * MILLIMETRE,
        load=1.5e-4, slip=0.3, travel=8 * size * MILLIMETRE, spheres=True, time_step=0.02, history_path=path,
    )  # fmt: skip


def own_part(size: float, path: Path) -> Any:
    """Let a scoop lift polyhedra."""
    heap = make_heap(max(15, round(45 * size)))
    return gd.dynamics.own_part(
        heap, model=str(PARTS / "bucket.xml"), motion=str(PARTS / "scoop.csv"), x=-3.5e-3, y=1.7e-3, z=0.2e-3,
        friction=0.3, time_step=0.02, history_path=path,
    )  # fmt: skip


EXPERIMENTS = {
    "settle": Shown(settle, "layers", from_stage=False, height=360, share=0.5),
    "compact": Shown(compact, "layers", from_stage=False, outline=False),
    "tap": Shown(tap, "layers", from_stage=False),
    "triaxial": Shown(triaxial, "layers", outline=False, height=360),
    "ring_shear": Shown(ring_shear, "halves", outline=False, view="corner"),
    "direct_shear": Shown(direct_shear, "columns", outline=False, height=230),
    "collapse": Shown(collapse, "layers", outline=False, height=200),
    "tilt": Shown(tilt, "layers"),
    "discharge": Shown(discharge, "layers", height=360),
    "feed": Shown(feed, "id", from_stage=False, height=200),
    "drum": Shown(drum, "halves", outline=False, height=330),
    "press": Shown(press, "layers"),
    "drop": Shown(drop, "layers", share=0.3),
    "roll": Shown(roll, "layers", height=170),
    "own_part": Shown(own_part, "layers", view="front"),
}
"""Every experiment, `penetration` in its three modes."""


def curves(outcome: Any) -> list[Panel]:
    """Return the panels of an outcome; settling has none of its own."""
    if hasattr(outcome, "panels"):
        return list(outcome.panels)
    series = outcome.history
    moving = series["kinetic_energy"] > 0
    energy = series["time"][moving], np.log10(series["kinetic_energy"][moving])
    return [
        Panel("time  [s]", "log. of the kinetic energy  [m g d]", {"": energy}),
        Panel("time  [s]", "borne / weight", {
            "floor": (series["time"], series["floor_force"]), "walls": (series["time"], series["wall_force"])
        }),
    ]  # fmt: skip


def show(name: str, folder: Path, *, quick: bool) -> None:
    """Run an experiment, and write its animation and its curves."""
    shown, begun = EXPERIMENTS[name], time.perf_counter()
    with tempfile.TemporaryDirectory() as place:
        history = Path(place) / "history.h5"
        outcome = shown.run(0.15 if quick else 1.0, history)
        ran = time.perf_counter() - begun
        times, stages = outcome.history["time"], outcome.history.get("stage")
        since = float(times[stages == 1.0][0] if shown.from_stage and np.any(stages == 1.0) else times[0])
        until = since + shown.share * float(times[-1] - since)
        [picture] = gd.figures.replay(
            history, outcome.packing, folder / f"{name}.gif", color_by=shown.color_by, view=shown.view,
            outline=shown.outline, since=since, until=until, size=(360, shown.height), seconds=3.0,
            n_pictures=2 if quick else 30,
        )  # fmt: skip
    drawn = [curve_figure(curves(outcome), folder / f"{name}.png")] if curves(outcome) else []
    files = " and ".join(str(path) for path in (picture, *drawn))
    print(f"{name}: {len(outcome.packing)} grains, run in {ran:.0f} s, {picture.stat().st_size / 1000:.0f} kB: {files}")


def main() -> None:
    """Show the experiments that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *EXPERIMENTS], metavar="NAME", help="which; by default all")
    parser.add_argument("--quick", action="store_true", help="few grains, little motion, two pictures")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for animations and figures")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name in arguments.names or EXPERIMENTS:
        show(name, arguments.output, quick=arguments.quick)


if __name__ == "__main__":
    main()
