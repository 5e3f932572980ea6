"""From the sizes of sections back to those of the grains that were cut: the kernel inverted, with smoothing.

A plane meets a grain as often as its mean width is large, and cuts it anywhere: of grains of one size sections of all
sizes come. How often of which, relative to the grain's own size, is the kernel: known for balls, and measured on any
bed of grains of the same kind.

References
----------
.. [1] S. A. Saltykov, "The determination of the size distribution of particles in an opaque material from a measurement
   of the size distribution of their sections", in H. Elias (ed.), Stereology, Springer (1967) 163-173: balls, classes
   of equal ratio.
.. [2] B. W. Silverman, M. C. Jones, D. W. Nychka, J. D. Wilson, "A smoothed EM approach to indirect estimation
   problems", J. R. Stat. Soc. B 52 (1990) 271-324.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated, gated_noun
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.geometry.raster.slicing import mean_widths
from grainsdem.geometry.rotations import random_quaternions, to_matrices
from grainsdem.measures.sections.planes import section
from grainsdem.measures.sections.tables import section_table

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

CLASSES = 20
"""Classes of size, of equal ratio."""

SPAN = 12.0
"""Ratio of the largest class's bound to the smallest's: of finer sections there are few, and they tell little."""

ROUNDS = 400
"""Rounds of the smoothed EM; it stands still after some hundred."""

SMOOTHING = 0.06
"""Part of a class's grains that goes to each neighbour in a round."""

MOST_PLANES = 100_000
"""Planes that a kernel may be found by: each takes a section of the whole bed."""

LEAST = 50
"""Sections below which nothing is unfolded."""

INSIDE = 8
"""Sizes within a class that the kernel is averaged over."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class SectionKernel:
    """How large the sections of a grain are, relative to it.

    Parameters
    ----------
    ratios : ndarray, shape (m,)
        Equal-area diameters of sections over the equal-volume diameters of their grains, rising; each as likely.
    width : float
        Mean width of a grain over its equal-volume diameter.
    """

    ratios: Floats
    width: float

    @classmethod
    def ball(cls) -> SectionKernel:
        """Return that of balls, in closed form: a share √(1 - t²) of the sections is larger than t diameters."""
        above = (np.arange(4096) + 0.5) / 4096
        return cls(np.sqrt(1 - above[::-1] ** 2), 1.0)

    @classmethod
    def of(cls, packing: Packing, *, n_planes: int = 60, rng: np.random.Generator | int | None = 0) -> SectionKernel:
        """Return that of the grains of a bed, whatever their sizes, from planes at random.

        Parameters
        ----------
        packing : Packing
            Grains in space, in any number; those whose sections' centroids lie in the domain count.
        n_planes : int
            How many planes cut it.
        rng : numpy.random.Generator, int or None
            Source of randomness, or a seed for one.

        Raises
        ------
        InputError
            If the bed is planar, or planes meet fewer than 50 of its grains.
        """
        if packing.domain.is_planar:
            raise InputError("prisms are cut to what they are: there is nothing to unfold in a planar bed")
        if not 1 <= n_planes <= MOST_PLANES:
            raise InputError(f"n_planes must lie from 1 to {MOST_PLANES}; got {n_planes}")
        generator = np.random.default_rng(rng)
        sizes = grain_diameters(packing)
        found: list[Floats] = [np.empty(0)]
        normals = to_matrices(random_quaternions(n_planes, generator))[:, :, 2]
        places = packing.positions[generator.integers(0, len(packing), n_planes)]
        # Planes go through random points near the grains: any place along the normal is as likely for each grain.
        places = places + generator.uniform(-1, 1, places.shape) * float(sizes.max())
        for normal, place in zip(normals, places, strict=True):
            try:
                rows = section_table(section(packing, plane=[*normal, float(normal @ place)]))
            except InputError:  # it misses the domain
                continue
            rows = rows[rows["is_counted"]]
            found.append(rows["diameter"] / sizes[rows["id"]])
        ratios = np.sort(np.concatenate(found))
        if ratios.size < LEAST:
            raise InputError(f"a kernel needs {LEAST} sections or more; {n_planes} planes met {ratios.size} grains")
        return cls(ratios, float((mean_widths(packing.grains) / sizes).mean()))

    def cdf(self, ratios: Floats) -> Floats:
        """Return the share of sections smaller than so many diameters, shape (...)."""
        return np.searchsorted(self.ratios, ratios) / self.ratios.size


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Unfolded:
    """Sizes of grains, as their sections tell.

    Parameters
    ----------
    bounds : ndarray, shape (k + 1,)
        Bounds [m] of the classes.
    number, volume : ndarray, shape (k,)
        Share of the grains, by number and by volume, in each.
    """

    bounds: Floats
    number: Floats
    volume: Floats

    def percentiles(self, q: ArrayLike, *, by: str = "volume") -> Floats:
        """Return the equal-volume diameters [m] that percentages of the grains are finer than.

        Parameters
        ----------
        q : array_like
            Percentages.
        by : {"volume", "number"}
            What they are of.
        """
        if by not in ("volume", "number"):
            raise InputError(f"by must be 'volume' or 'number'; got {by!r}")
        running = np.append(0.0, np.cumsum(self.volume if by == "volume" else self.number))
        return np.exp(np.interp(0.01 * np.asarray(q, dtype=np.float64), running / running[-1], np.log(self.bounds)))

    def table(self) -> NDArray[np.void]:
        """Return one row a class: its bounds ``lower`` and ``upper`` [m], and the shares ``number`` and ``volume``."""
        rows = np.zeros(len(self.number), dtype=[(name, np.float64) for name in ("lower", "upper", "number", "volume")])
        rows["lower"], rows["upper"], rows["number"], rows["volume"] = (
            self.bounds[:-1], self.bounds[1:], self.number, self.volume,
        )  # fmt: skip
        return rows


@gated
def unfold(diameters: ArrayLike, kernel: SectionKernel | None = None) -> Unfolded:
    """Return the sizes of grains from those of their sections in planes at random.

    Parameters
    ----------
    diameters : array_like, shape (n,)
        Equal-area diameters [m] of sections, all of them: `section_table`, those that count, of one plane or many.
    kernel : SectionKernel, optional
        What sections such grains have; that of balls where not given, which angular grains are not like.

    Raises
    ------
    ShapeError
        If diameters are not of one dimension.
    InputError
        If there are fewer than 50 sections, or one is not positive and finite.

    Notes
    -----
    Expectation and maximisation of the likelihood of the counts in classes, with a little of each class given to its
    neighbours in every round: without it, noise grows with the rounds. Sections below a twelfth of the largest are left
    out, and grains as small.
    """
    d = np.asarray(diameters, dtype=np.float64)
    if d.ndim != 1:
        raise ShapeError(f"diameters must have shape (n,); got {d.shape}")
    if d.size < LEAST:
        raise InputError(f"unfolding needs {LEAST} sections or more; got {d.size}")
    if not (np.isfinite(d).all() and (d > 0).all()):
        raise InputError(f"diameters of sections must be positive and finite; got {float(d.min())}")
    given = kernel or SectionKernel.ball()
    # Sections of the largest grains seldom are their largest: one class more.
    top = float(d.max()) * SPAN ** (1 / CLASSES)
    bounds = np.geomspace(top / SPAN, top, CLASSES + 1)
    counts = np.histogram(d, bounds)[0].astype(np.float64)
    response = _response(bounds, given)
    seen = response.sum(axis=0)
    grains = np.full(CLASSES, counts.sum() / seen.sum())
    for _ in range(ROUNDS):
        expected = response @ grains
        grains = grains / seen * (response.T @ np.where(expected > 0, counts / np.maximum(expected, 1e-300), 0.0))
        moved = SMOOTHING * grains
        grains = grains - 2 * moved + np.append(moved[1:], moved[-1]) + np.append(moved[0], moved[:-1])
    middles = np.sqrt(bounds[1:] * bounds[:-1])
    volume = grains * middles**3
    return Unfolded(bounds, grains / grains.sum(), volume / volume.sum())


def _response(bounds: Floats, kernel: SectionKernel) -> Floats:
    """Return how many sections of each class a unit area has of one grain a volume in each class, shape (k, k)."""
    sizes = bounds[:-1, None] * (bounds[1:] / bounds[:-1])[:, None] ** ((np.arange(INSIDE) + 0.5) / INSIDE)
    below = kernel.cdf(bounds[:, None, None] / sizes)  # bound, class, size within it
    return np.asarray((kernel.width * sizes * np.diff(below, axis=0)).mean(axis=-1))
