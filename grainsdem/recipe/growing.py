"""From a recipe to a bed as grown; how many seeds it takes where only the grains' size is given."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.memory import A_CELL, allow_memory
from grainsdem.packing.carve import unwarned
from grainsdem.recipe.grains import Layers, SievesTable, laid_out, shape, size_ratio, sized
from grainsdem.recipe.seeds import place
from grainsdem.recipe.words import Monitor, Silent, counting_words
from grainsdem.tessellation import relax, shaped_cells, tessellate
from grainsdem.tessellation.graded import TOLERANCE, Wish
from grainsdem.tessellation.mixed import Asked, reshaped

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from grainsdem.model import Domain, Packing, Tessellation
    from grainsdem.recipe.tables import Recipe
    from grainsdem.tessellation import Forms, Metric

LOG = logging.getLogger(__name__)

MOST_SEEDS = 10_000_000
"""Seeds that a size and a domain may ask for: a mistaken unit asks for billions."""

PILOT = 1000
"""Seeds of the first bed that is grown to find how many are needed."""

_BEDS = 8
"""Beds that are grown to find the number: each is nearer by two digits, until chance decides."""

_MIXED_BEDS, _CLOSE_MIXED = 3, 4e-3
"""The same of beds of forms of grains' own, which take long, and of whose cells chance keeps more or fewer."""

_CLOSE = 5e-4
"""Relative error of the grains' size at which no other number is tried: large beds are as near after two or three."""


@gated
def grow(recipe: Recipe, monitor: Monitor | None = None) -> Packing:
    """Return the bed that a recipe's seeds and grains tables describe, or its shapes laid out loose.

    Raises
    ------
    InputError
        If nothing is left of the cells, or what is asked for cannot be had of them.
    """
    monitor = monitor or Silent()
    is_scaled = not recipe.is_metric
    # The recipe comes first: it is what the other steps follow from.
    first = [json.dumps({"step": "recipe", **recipe.model_dump(mode="json")}, sort_keys=True)]
    sizes, sieves, shapes = recipe.grains.sizes, recipe.grains.sieves, recipe.grains.shapes
    if shapes is not None:
        domain = recipe.domain.make() if recipe.domain.is_measured else None
        rng, density = stream(recipe, _SHAPES), recipe.grains.density
        for line in () if sieves is None else sieves.assumed():
            LOG.warning("%s", line)
        with monitor.stage("Laying out grains") as tell:
            packing = laid_out(
                shapes, sizes or sieves, density, domain, rng=rng, progress=counting_words(tell, "grains")
            )
        return replace(packing, provenance=(*first, *packing.provenance))
    if recipe.seeds.wants_count and recipe.seeds.count is None and sizes is not None and sizes.is_list:
        recipe = _with_count(recipe, len(sizes.listed()))
    if recipe.seeds.count is not None:
        allow_memory(recipe.seeds.count, A_CELL, "cells")  # before their seeds are placed
    is_open = recipe.is_count_open
    if is_open:
        with monitor.stage("Counting seeds") as tell:
            recipe, count = _counted(recipe, tell)
    packing, wanted = _grown(recipe, monitor, is_scaled=is_scaled)
    if is_open:
        if recipe.grains.axes is not None and recipe.grains.axes.is_mixed:
            packing, count = _recounted(recipe, packing, wanted, count, monitor)
        first.append(json.dumps({"step": "count", "count": count}, sort_keys=True))
    if recipe.grains.infill is not None:
        with monitor.stage("Filling voids") as tell:
            packing = recipe.grains.filled(packing, stream(recipe, _INFILL), counting_words(tell, "relaxations"))
    return replace(packing, provenance=(*first, *packing.provenance))


def stream(recipe: Recipe, stage: int) -> np.random.Generator:
    """Return the stage's own random numbers, so that one stage's draws do not move another's."""
    return np.random.default_rng([recipe.rng, stage])


SEEDS, _THROATS, _SIZES, _SHAPES, _FORMS, _INFILL = 0, 2, 3, 5, 6, 7  # stage 1 is pouring


def _grown(
    recipe: Recipe, monitor: Monitor, *, is_scaled: bool, is_pilot: bool = False
) -> tuple[Packing, NDArray[np.float64] | None]:
    """Return the bed, and the diameters [m] asked for, if any; a pilot has a curve only about as well."""
    domain, grains = recipe.domain.make(), recipe.grains
    with monitor.stage("Placing seeds"):
        seeds = place(recipe.seeds, domain, stream(recipe, SEEDS))
    if grains.prescribed is not None and not is_pilot:
        for line in grains.prescribed.assumed():
            LOG.warning("%s", line)
    growth = _Growth(recipe, seeds, monitor, is_pilot=is_pilot)
    if grains.axes is None:
        cells = growth.grow(domain, None)
    elif grains.axes.is_mixed:
        cells = growth.grow(domain, None)
        # The number of seeds that a size takes hangs on no form.
        cells = cells if is_pilot else growth.mix(cells, grains.axes.forms())
    else:
        cells, _ = shaped_cells(domain, grains.axes.shape(), growth.grow, keep=grains.keep)
    packing = shape(
        grains, cells, stream(recipe, _THROATS), wanted=growth.wanted, classes=growth.classes, is_scaled=is_scaled
    )
    return packing, growth.wanted


class _Growth:
    """Cells of a recipe's seeds, in its domain or in one of a space that is stretched."""

    def __init__(self, recipe: Recipe, seeds: NDArray[np.float64], monitor: Monitor, *, is_pilot: bool) -> None:
        self._recipe, self._seeds, self._monitor, self._is_pilot = recipe, seeds, monitor, is_pilot
        self.wanted: NDArray[np.float64] | None = None
        self.classes: NDArray[np.int32] | None = None

    def grow(self, domain: Domain, metric: Metric | None) -> Tessellation:
        """Return the cells; ``wanted`` are the diameters [m] asked of them, if any."""
        recipe, monitor, total = self._recipe, self._monitor, self._recipe.seeds.relax
        seeds = self._seeds if metric is None else metric.back(self._seeds)
        if total:
            with monitor.stage("Relaxing seeds") as tell:
                seeds = relax(
                    seeds,
                    domain,
                    iterations=total,
                    density=self._density(metric),
                    progress=lambda done: tell(done / total, f"iteration {done} of {total}"),
                )
        with monitor.stage("Growing grains") as tell:
            asked = recipe.grains.prescribed
            if asked is None:
                return tessellate(seeds, domain)

            def told(done: int, off: float) -> None:
                tell(done / (done + 1), f"round {done}, curve off by {100 * off:.2g} %")

            rng, keep = stream(recipe, _SIZES), None if self._is_pilot else recipe.grains.keep
            if isinstance(asked, Layers):
                found = asked.cells(domain, len(seeds), rng, keep=keep, metric=metric, progress=told)
                cells, self.wanted, self.classes = found
            else:
                cells, self.wanted = sized(asked, seeds, domain, rng, keep=keep, metric=metric, progress=told)
            return cells

    def mix(self, cells: Tessellation, forms: Forms) -> Tessellation:
        """Return the cells given forms of their own."""
        grains, monitor = self._recipe.grains, self._monitor
        asked = None
        source = grains.prescribed
        if self.wanted is not None and source is not None:
            has_curve = not (isinstance(source, Layers) or source.is_list)
            wish = Wish(source.curve(), cells.domain, None) if has_curve else None  # type: ignore[union-attr]
            tolerance = source.tolerance if isinstance(source, SievesTable) else TOLERANCE
            asked = Asked(self.wanted, wish, tolerance)
        with monitor.stage("Giving grains their forms") as tell:

            def told(done: int, off: float) -> None:
                tell(done / (done + 1), f"round {done}, off by {off:.2g} of what is allowed")

            found = reshaped(
                cells,
                forms,
                keep=grains.keep,
                asked=asked,
                rng=stream(self._recipe, _FORMS),
                progress=told,
            )
        if self.wanted is not None:
            self.wanted = found.diameters
        return found.cells

    def _density(self, metric: Metric | None) -> Callable[[NDArray[np.float64]], NDArray[np.float64]] | None:
        """Return the density that seeds are relaxed by, a function of points [m] of the space that they are in."""
        grade = self._recipe.seeds.grade
        if grade is None:
            return None
        density = grade.grade().density(self._recipe.domain.make())
        return density if metric is None else lambda places: density(metric.forward(places))


def _counted(recipe: Recipe, tell: Callable[[float, str], None]) -> tuple[Recipe, int]:
    """Return the recipe with the number of seeds whose grains come nearest to the size asked for, and that number."""
    power = 2 if recipe.domain.make().is_planar else 3
    most = _room(recipe, power)
    # Without throats, which change no size.
    plain = recipe.model_copy(update={"grains": recipe.grains.model_copy(update={"throats": None})})
    n = max(1, min(round(0.5 * most), PILOT))  # half of what would fill the domain: void and walls take theirs
    tried: dict[int, float] = {}
    while n not in tried and len(tried) < _BEDS:
        tell(len(tried) / _BEDS, f"{n} seeds")
        with unwarned():
            bed, wanted = _grown(_with_count(plain, n), Silent(), is_scaled=False, is_pilot=True)
        tried[n] = size_ratio(recipe.grains, bed, wanted)
        if abs(tried[n] - 1) <= _CLOSE:
            break
        # Cells are as many times smaller as there are more of them.
        needed = n * tried[n] ** power
        _refuse_more(needed)
        n = max(1, round(needed))
    best = min(tried, key=lambda count: abs(np.log(tried[count])))
    return _with_count(recipe, best), best


def _recounted(
    recipe: Recipe, packing: Packing, wanted: NDArray[np.float64] | None, count: int, monitor: Monitor
) -> tuple[Packing, int]:
    """Return a bed of forms of grains' own of the size asked for, and its number of seeds.

    Fewer of its cells touch a wall than of those that the seeds were counted by, so that more grains have the curve.
    """
    best, tried = packing, count
    ratio = nearest = size_ratio(recipe.grains, packing, wanted)
    for _ in range(_MIXED_BEDS - 1):
        if abs(nearest - 1) <= _CLOSE_MIXED:
            break
        count = max(1, round(count * ratio**3))
        _refuse_more(count)
        packing, wanted = _grown(_with_count(recipe, count), monitor, is_scaled=False)
        ratio = size_ratio(recipe.grains, packing, wanted)
        if abs(ratio - 1) < abs(nearest - 1):
            best, tried, nearest = packing, count, ratio
    if abs(nearest - 1) > _CLOSE_MIXED:
        LOG.warning(
            "the grains' diameters are all %.2g %% %s than those asked for, as the domain's size is given, too: with "
            "seeds.count = %d and the domain's proportions alone they are as asked for",
            100 * abs(nearest - 1), "larger" if nearest > 1 else "smaller", tried,
        )  # fmt: skip
    return best, tried


def _room(recipe: Recipe, power: int) -> float:
    """Return how many grains of the size asked for the domain would hold if they filled it."""
    domain, grains = recipe.domain.make(), recipe.grains
    volume = domain.volume / domain.lengths[2] if domain.is_planar else domain.volume
    if grains.diameter is not None:
        mean = grains.diameter[1] ** power
    elif grains.prescribed is not None:
        asked, rng = grains.prescribed, stream(recipe, _SIZES)
        drawn = asked.draw_in(domain, 4096, rng) if isinstance(asked, Layers) else asked.draw(4096, rng)
        mean = float((drawn**power).mean())
    else:
        raise InputError("the number of seeds follows from a size only")
    room = float(volume / mean * (4 / np.pi if domain.is_planar else 6 / np.pi))
    _refuse_more(room)
    if not room >= 1:
        raise InputError(
            f"the domain, {' × '.join(f'{length:g}' for length in domain.lengths)} m, is too small for one grain of "
            f"the size asked for"
        )
    return room


def _refuse_more(count: float) -> None:
    if not count <= MOST_SEEDS:
        raise InputError(
            f"the size asked for takes {count:.3g} seeds in that domain, at most {MOST_SEEDS} are allowed; "
            f"are both in metres?"
        )


def _with_count(recipe: Recipe, count: int) -> Recipe:
    return recipe.model_copy(update={"seeds": recipe.seeds.model_copy(update={"count": count})})
