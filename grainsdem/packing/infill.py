"""Fine grains in the voids between coarse ones.

Seeds are placed in the voids. Each fine grain's cell is that of its seed among the seeds, cut by one face's plane of
every coarse grain that it might reach: the face that the seed lies farthest beyond. The cell lies behind it, so that it
never meets the grain, and is convex. Seeds then go to the centroids of their cells, and the cells are shrunk until the
fine grains have the mass asked for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.ahead import compiled
from grainsdem.geometry.bounds import boxes, near_in
from grainsdem.geometry.integrals import face_planes, integrate, volumes
from grainsdem.geometry.rotations import identity_quaternions, to_matrices
from grainsdem.geometry.selection import select
from grainsdem.model import DROPPED, Packing, Polyhedra
from grainsdem.model.arrays import check_length
from grainsdem.points.poisson import uniform
from grainsdem.ragged import offsets_from_counts, owners, take_indices
from grainsdem.roots import cube_roots
from grainsdem.tessellation.ellipsoids import grown
from grainsdem.tessellation.lloyd import check_rounds

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

COARSE, FINE = 0, 1
"""Classes of the grains of a bed with an infill."""

MOST = 1_000_000
"""Fine grains at most: a mistaken unit asks for billions."""

_CLEAR = 0.05
"""Least distance of a seed from a coarse grain, in fine diameters: nearer ones grow slivers."""

_BATCHES = 200
"""Times that seeds are thrown into the domain until enough are in its voids."""


@gated
def infill(
    packing: Packing,
    *,
    share: float,
    diameter: float,
    density: float | None = None,
    relaxations: int = 8,
    rng: np.random.Generator | int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Packing:
    """Return a bed with fine grains in its voids.

    Parameters
    ----------
    packing : Packing
        Coarse grains, shrunk to leave voids, that make up the whole of their domain: carved with ``keep="all"``, or of
        a domain that wraps around, and so far not moved.
    share : float
        Mass of the fine grains over that of all, in (0, 1): had exactly.
    diameter : float
        Diameter [m] of the sphere of the fine grains' mean volume: there are as many as make up the mass.
    density : float, optional
        Density [kg/m³] of the fine grains; by default the mean of the coarse ones by volume.
    relaxations : int
        How many times seeds of fine grains move to the centroids of their cells: they fill the voids better, and are
        rounder and more alike.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    progress : callable, optional
        Called with the number of relaxations done and of all.

    Returns
    -------
    Packing
        The coarse grains as they are, of class 0, then the fine ones, of class 1. None overlap. The porosity of the
        domain is what it was, less the fine grains' share of it.

    Raises
    ------
    InputError
        If the voids cannot hold so much, which is told with the most that they can; if the coarse grains do not make up
        their domain, or a value is out of range.
    """
    bed = _checked(packing)
    if not 0 < share < 1:
        raise InputError(f"share, the fine grains' part of the mass, must lie between 0 and 1; got {share}")
    check_length("diameter", diameter)
    check_rounds("relaxations", relaxations)
    content = volumes(bed.grains)
    coarse = float((bed.densities * content).sum())
    own = coarse / float(content.sum()) if density is None else float(density)
    if not (np.isfinite(own) and own > 0):
        raise InputError(f"density must be positive and finite; got {density}")
    wanted = share / (1 - share) * coarse / own
    void = bed.domain.volume - float(content.sum())
    _refuse_more(wanted, void, coarse, own, share)
    n = max(1, round(wanted / (np.pi / 6 * diameter**3)))
    if n > MOST:
        raise InputError(f"the infill would be of {n} grains, at most {MOST} are allowed; is its diameter in metres?")
    compiled("between")
    grains = _Coarse.of(bed)
    generator = np.random.default_rng(rng)
    sites = _seeds(bed.domain, grains, n, _CLEAR * diameter, generator)
    cells = _cells(bed.domain, grains, sites, relaxations, progress)
    had = float(volumes(cells.shapes).sum())
    if wanted > had:
        _refuse_more(wanted, had, coarse, own, share)
    factor = float(cube_roots(wanted / had))
    fine = replace(cells.shapes, vertices=cells.shapes.vertices * factor)
    return Packing(
        _together(bed.grains, fine),
        np.concatenate([bed.positions, cells.sites]),
        np.concatenate([bed.quaternions, identity_quaternions(len(fine))]),
        np.append(bed.densities, np.full(len(fine), own)),
        bed.domain,
        provenance=bed.provenance,
        classes=np.repeat(np.array([COARSE, FINE], dtype=np.int32), [len(bed), len(fine)]),
    ).with_step("infill", share=share, diameter=diameter, n_grains=len(fine))


def coarse_solid_fraction(porosity: float, share: float, density: float, own: float) -> float:
    """Return the solid fraction of coarse grains whose bed, with its infill, has a porosity.

    Parameters
    ----------
    porosity : float
        Of the bed with its infill.
    share : float
        Mass of the fine grains over that of all.
    density, own : float
        Densities [kg/m³] of the coarse and of the fine grains.
    """
    fine, coarse = share / own, (1 - share) / density
    return (1 - porosity) * coarse / (fine + coarse)


def _refuse_more(wanted: float, held: float, coarse: float, own: float, share: float) -> None:
    """Raise `InputError` where more volume [m³] is wanted than is held."""
    if wanted > held:
        most = held * own / (held * own + coarse)
        raise InputError(
            f"the voids cannot hold an infill of {share:g} of the mass: the most that grains of such a size can be "
            f"there is {most:.3g}; ask for less, smaller grains, or more void between the coarse ones"
        )


def _checked(packing: Packing) -> Packing:
    if packing.domain.is_planar:
        raise InputError("a slab is one grain thick: its voids hold no infill")
    if len(packing) == 0 or packing.links is None:
        raise InputError("an infill goes between coarse grains that are where they grew; these have left their cells")
    if (packing.links.neighbors == DROPPED).any():
        raise InputError(
            "an infill fills the voids of a whole domain, and cells at its walls were dropped: carve with keep='all', "
            "or in a domain that wraps around"
        )
    return packing


class _Coarse(NamedTuple):
    """Coarse grains: their boxes [m], and the planes of their faces, relative to their centroids."""

    positions: Floats
    lower: Floats
    upper: Floats
    offsets: NDArray[np.int64]
    normals: Floats
    heights: Floats

    @classmethod
    def of(cls, bed: Packing) -> _Coarse:
        planes = face_planes(bed.grains)
        turns = to_matrices(bed.quaternions)[owners(bed.grains.face_offsets)]
        # Not a matrix product, whose last bit is the processor's.
        normals = (turns * planes.normals[:, None, :]).sum(axis=2)
        return cls(bed.positions, *boxes(bed), bed.grains.face_offsets, normals, planes.heights)

    def beyond(self, domain: Domain, sites: Floats, reach: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return which site each plane is for, and the planes: of each grain near a site the face farthest behind it.

        Rows are unit normals from the site to the grain, and distances [m], below zero where the site is in the grain.
        """
        n = len(self.positions)
        lower = np.concatenate([self.lower, sites - reach])
        upper = np.concatenate([self.upper, sites + reach])
        pairs, shifts = near_in(domain, lower, upper)
        mixed = (pairs[:, 0] < n) & (pairs[:, 1] >= n)
        grain, site = pairs[mixed, 0].astype(np.int64), pairs[mixed, 1].astype(np.int64) - n
        away = sites[site] + shifts[mixed] * domain.lengths - self.positions[grain]
        faces, starts = take_indices(self.offsets, grain)
        row = owners(starts)
        distances = (self.normals[faces] * away[row]).sum(axis=1) - self.heights[faces]
        if not grain.size:
            return site, np.empty((0, 4))
        farthest = np.maximum.reduceat(distances, starts[:-1])
        # The first of the faces that are as far.
        is_best = np.flatnonzero(distances == farthest[row])
        best = is_best[np.searchsorted(row[is_best], np.arange(grain.size))]
        return site, np.column_stack([-self.normals[faces[best]], farthest])


def _seeds(domain: Domain, grains: _Coarse, n: int, clear: float, rng: np.random.Generator) -> Floats:
    """Return n seeds [m] at random in the voids, shape (n, 3)."""
    found: list[Floats] = []
    for _ in range(_BATCHES):
        points = uniform(domain, 2 * n, rng)
        site, planes = grains.beyond(domain, points, np.full((len(points), 3), clear))
        is_free = np.ones(len(points), dtype=bool)
        is_free[site[planes[:, 3] < clear]] = False
        found.append(points[is_free])
        if sum(map(len, found)) >= n:
            return np.concatenate(found)[:n]
    raise InputError("there is no room for an infill: the coarse grains leave no voids as wide as its grains")


class _Fine(NamedTuple):
    """Fine cells about their centroids, and where these lie [m]."""

    shapes: Polyhedra
    sites: Floats


def _cells(
    domain: Domain, grains: _Coarse, sites: Floats, relaxations: int, progress: Callable[[int, int], None] | None
) -> _Fine:
    """Return the cells of the seeds in the voids, after their relaxations."""
    n = len(sites)
    weights, forms = np.zeros(n), np.repeat(np.eye(3)[None], n, axis=0)
    reach = np.full((n, 3), float(cube_roots(domain.volume / (n + len(grains.positions)))))

    def cuts(reach: Floats) -> tuple[NDArray[np.int64], Floats]:
        site, planes = grains.beyond(domain, sites, reach)
        order = np.argsort(site, kind="stable")
        return offsets_from_counts(np.bincount(site, minlength=n)), planes[order]

    for done in range(relaxations + 1):
        cells, reach = grown(domain, sites, weights, forms, reach, cuts=cuts)
        measured = integrate(cells.cells)
        if progress is not None:
            progress(done, relaxations)
        if done < relaxations:
            # The centroid of a convex cell lies in it, and so in the voids.
            sites = sites + measured.centroids
            sites = np.where(domain.periodic, domain.lower + (sites - domain.lower) % domain.lengths, sites)
    moves = measured.centroids[owners(cells.cells.vertex_offsets)]
    centred = replace(cells.cells, vertices=cells.cells.vertices - moves)
    kept = np.flatnonzero(measured.volumes > 0)
    return _Fine(select(centred, kept)[0], (sites + measured.centroids)[kept])


def _together(*shapes: Polyhedra) -> Polyhedra:
    """Return polyhedra as one set, in their order."""
    counts = [
        np.concatenate([np.diff(getattr(each, name)) for each in shapes])
        for name in ("vertex_offsets", "face_offsets", "face_vertex_offsets")
    ]
    return Polyhedra(
        np.concatenate([each.vertices for each in shapes]),
        offsets_from_counts(counts[0]),
        offsets_from_counts(counts[1]),
        np.concatenate([each.face_vertices for each in shapes]),
        offsets_from_counts(counts[2]),
    )
