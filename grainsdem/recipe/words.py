"""Who is told of the progress and of what was refused, and in what words."""

from __future__ import annotations

import json
import math
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, Protocol

from grainsdem.errors import GrainsDEMError, WriteError
from grainsdem.gate import gated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager

    from grainsdem.dynamics import Progress
    from grainsdem.model import Packing


class Monitor(Protocol):
    """Who is told what a chain is doing."""

    def stage(self, title: str) -> AbstractContextManager[Callable[[float, str], None]]:
        """Begin a stage; what is returned is called with the fraction done and a few words."""
        ...


class Silent:
    """A monitor that tells nobody."""

    @gated
    def stage(self, title: str) -> AbstractContextManager[Callable[[float, str], None]]:  # noqa: ARG002  (the protocol's)
        """Begin a stage that nobody hears of."""
        return nullcontext(lambda _fraction, _words: None)


@contextmanager
def noting(refused: dict[str, str], name: str) -> Iterator[None]:
    """Note why a file cannot be made of a bed, and go on; a disk that cannot be written is an error all the same."""
    try:
        yield
    except WriteError:
        raise
    except GrainsDEMError as error:
        refused[name] = str(error)


@gated
def counting_words(tell: Callable[[float, str], None], things: str) -> Callable[[int, int], None]:
    """Return a callback that tells how many of how many things are done."""
    return lambda done, total: tell(done / max(total, 1), f"{done} of {total} {things}")


@gated
def settling_words(tell: Callable[[float, str], None]) -> Callable[[Progress], None]:
    """Return a callback for `settle` that tells the fraction done and what is being waited for.

    The energy falls by orders of magnitude: the fraction is how many of them are done since its peak, or the share
    of the time limit where that is more.
    """
    peak, best = 0.0, 0.0

    def hear(now: Progress) -> None:
        nonlocal peak, best
        peak = max(peak, now.energy)
        fallen = 0.0
        if peak > now.goal and now.energy > 0:
            fallen = math.log(peak / now.energy) / math.log(peak / now.goal)
        best = min(1.0, max(best, fallen, now.time / now.limit))
        tell(best, f"{now.time:.3f} s, {now.energy:.0e} → {now.goal:.0e} mgd, {now.n_contacts} contacts")

    return hear


@gated
def throat_widths_told(packing: Packing) -> dict[str, Any]:
    """Return ``throats``: mean, standard deviation and percentiles [m] of their widths before and after grains moved.

    Nothing is returned of a packing whose grains were not.
    """
    steps = [step for step in map(json.loads, packing.provenance) if step["step"] == "jitter_throats"]
    if not steps:
        return {}
    return {"throats": {"before": steps[0]["throats_before"], "after": steps[-1]["throats_after"]}}
