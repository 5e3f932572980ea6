"""Grains as rigid bodies: masses about principal axes, and cores for programs that put a skin around every grain."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from exporters.check import measured, stretches
from grainsdem.errors import InputError
from grainsdem.geometry.blunt import blunt
from grainsdem.geometry.edges import edge_lengths, edges
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.geometry.principal import principal_inertia
from grainsdem.geometry.rotations import multiply, to_matrices
from grainsdem.packing import inset
from grainsdem.packing.blunting import refuse_gone
from grainsdem.ragged import sum_rows
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from exporters.dem.options import SkinOptions
    from grainsdem.geometry.edges import Edges
    from grainsdem.model import Packing, Polyhedra

    Floats = NDArray[np.float64]

_logger = logging.getLogger(__name__)


class Bodies(NamedTuple):
    """What moves when a grain moves.

    Parameters
    ----------
    volumes : ndarray, shape (n,)
        Volumes [m³] of the grains as they are, without any skin or inset.
    masses : ndarray, shape (n,)
        Masses [kg] of those.
    moments : ndarray, shape (n, 3)
        Their principal moments of inertia [kg m²], smallest first.
    axes : ndarray, shape (n, 4)
        Rotation (w, x, y, z) from the principal axes to each grain's frame.
    centroids : ndarray, shape (n, 3)
        Centres of mass [m] in each grain's frame.
    centres : ndarray, shape (n, 3)
        Centres of mass [m] in the world.
    orientations : ndarray, shape (n, 4)
        Rotation (w, x, y, z) from the principal axes to the world.
    """

    volumes: Floats
    masses: Floats
    moments: Floats
    axes: Floats
    centroids: Floats
    centres: Floats
    orientations: Floats

    @property
    def diameters(self) -> Floats:
        """Diameters [m] of the spheres of equal volume, shape (n,)."""
        return np.asarray(cube_roots(6 / np.pi * self.volumes))


def bodies(packing: Packing) -> Bodies:
    """Return the grains of a packing as rigid bodies.

    Raises
    ------
    InputError
        If the packing is empty, holds numbers that are not finite, or grains without volume.
    """
    integrals = measured(packing)
    moments, axes = principal_inertia(integrals.inertias * packing.densities[:, None, None])
    turned = np.einsum("nij,nj->ni", to_matrices(packing.quaternions), integrals.centroids)
    return Bodies(
        integrals.volumes,
        integrals.volumes * packing.densities,
        moments,
        axes,
        integrals.centroids,
        packing.positions + turned,
        multiply(packing.quaternions, axes),
    )


def vertices_in(shapes: Polyhedra, origins: Floats, quaternions: Floats, digits: Floats) -> Floats:
    """Return the vertices [m] as seen from frames at ``origins``, turned by ``quaternions``, shape (n_vertices, 3).

    Parameters
    ----------
    shapes : Polyhedra
        Grains in their own frames.
    origins : ndarray, shape (n, 3)
        Where each frame lies [m] in the grain's own.
    quaternions : ndarray, shape (n, 4)
        Rotation (w, x, y, z) from each frame to the grain's own.
    digits : ndarray, shape (n,)
        Lengths [m] of which the result has twelve decimals: noise around zero is not written as numbers of its own.
    """
    counts = np.diff(shapes.vertex_offsets)
    matrices = np.repeat(to_matrices(quaternions), counts, axis=0)
    seen = np.einsum("nji,nj->ni", matrices, shapes.vertices - np.repeat(origins, counts, axis=0))
    unit = np.repeat(digits, counts)[:, None]
    return np.asarray((seen / unit).round(12) * unit)


class Rounded(NamedTuple):
    """Grains as a core and a sphere that is swept over it: what programs with a skin move.

    Parameters
    ----------
    cores : Polyhedra
        Every face moved inward by the radius, each in its grain's own frame.
    edges : Edges
        Those of the cores.
    radii : ndarray, shape (n,)
        Radius [m] of each grain's sphere.
    core_volumes, volumes : ndarray, shape (n,)
        Volumes [m³] of the cores, and of the swept cores.
    """

    cores: Polyhedra
    edges: Edges
    radii: Floats
    core_volumes: Floats
    volumes: Floats


def rounded(packing: Packing, sizes: Bodies, rounding: float, *, min_edge: float | None = None) -> Rounded:
    """Return the grains with rounded edges, inside what they were: their faces stay, and no gap becomes smaller.

    Parameters
    ----------
    packing : Packing
        Convex grains.
    sizes : Bodies
        The same grains as bodies.
    rounding : float
        Radius of the sphere in diameters of each grain.
    min_edge : float, optional
        Shortest edge of a core, likewise; `grainsdem.merge_edges` says what becomes of shorter ones.

    Raises
    ------
    InputError
        If a grain is so flat that nothing is left of it, or not convex.

    Notes
    -----
    A core of volume V, surface A and edges of length l between faces whose normals are an angle θ apart, swept by a
    sphere of radius r, has the volume V + A r + r²/2 Σ l θ + 4/3 π r³ (Steiner 1840).
    """
    radii = rounding * sizes.diameters
    # The upper and lower faces of a planar bed have a skin too.
    solid = replace(packing, domain=replace(packing.domain, is_planar=False), links=None)
    try:
        moved = inset(solid, radii)
    except InputError as error:
        raise InputError(f"rounding by {rounding:g} of a diameter: {error}") from error
    steps = np.einsum("nji,nj->ni", to_matrices(packing.quaternions), moved.positions - packing.positions)
    shapes = moved.grains
    cores = replace(shapes, vertices=shapes.vertices + np.repeat(steps, np.diff(shapes.vertex_offsets), axis=0))
    if min_edge is not None:
        made = blunt(cores, min_edge * grain_diameters(packing), are_prisms=packing.domain.is_planar)
        refuse_gone(made.is_gone, min_edge)
        cores = made.shapes
    found = edges(cores)
    lengths = edge_lengths(cores, found)
    a, b = (face_planes(cores).normals[found.faces[:, side]] for side in range(2))
    angles = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
    bends = sum_rows(lengths * angles, found.offsets)
    core = integrate(cores)
    swept = core.volumes + core.areas * radii + bends / 2 * radii**2 + 4 / 3 * np.pi * radii**3
    return Rounded(cores, found, radii, core.volumes, swept)


class Skin(NamedTuple):
    """What is known of all grains once they are rounded, without their shapes.

    Parameters
    ----------
    radii : ndarray, shape (n,)
        Radius [m] of each grain's sphere.
    core_volumes, volumes : ndarray, shape (n,)
        Volumes [m³] of the cores, and of the swept cores.
    n_vertices, n_edges, n_quads : ndarray of int64, shape (n,)
        Vertices and edges of each core, and how many pieces its faces are cut into that have four corners at most.
    """

    radii: Floats
    core_volumes: Floats
    volumes: Floats
    n_vertices: NDArray[np.int64]
    n_edges: NDArray[np.int64]
    n_quads: NDArray[np.int64]


def skin(packing: Packing, sizes: Bodies, options: SkinOptions) -> Skin:
    """Return what rounding makes of the grains, found a stretch of grains at a time.

    Raises
    ------
    InputError
        As `rounded`.
    """
    rows: list[tuple[NDArray[Any], ...]] = []
    try:
        for _, _, one in rounded_parts(packing, sizes, options):
            pieces = (np.diff(one.cores.face_vertex_offsets) - 1) // 2
            counts = (np.diff(one.cores.vertex_offsets), np.diff(one.edges.offsets))
            rows.append((one.radii, one.core_volumes, one.volumes, *counts, sum_rows(pieces, one.cores.face_offsets)))
    except InputError:
        rounded(
            packing, sizes, options.rounding, min_edge=options.min_edge
        )  # the same error, of all grains under their own numbers
        raise
    found = Skin(*(np.concatenate(column) for column in zip(*rows, strict=True)))
    _logger.info("rounding takes %.3g of the grains' volume", _lost(found, sizes)["volume_lost"])
    return found


def rounded_parts(packing: Packing, sizes: Bodies, options: SkinOptions) -> Iterator[tuple[slice, Bodies, Rounded]]:
    """Yield the grains a stretch at a time: which of all they are, as bodies, and rounded."""
    for rows, part in parts(packing):
        mine = Bodies(*(values[rows] for values in sizes))
        yield rows, mine, rounded(part, mine, options.rounding, min_edge=options.min_edge)


def report(packing: Packing, options: SkinOptions) -> dict[str, float]:
    """Return what the rounding does to the grains: radii [m], and what cores and swept cores lack of volume."""
    sizes = bodies(packing)
    return _lost(skin(packing, sizes, options), sizes)


def rounding_comment(found: Skin, sizes: Bodies) -> str:
    """Return the same as one sentence for a file's comments."""
    told = _lost(found, sizes)
    return (
        f"Rounding the edges by {told['smallest_rounding_radius']:.6g} to {told['largest_rounding_radius']:.6g} m took "
        f"{100 * told['volume_lost']:.4g} % of the volume, {100 * told['largest_volume_lost_by_a_grain']:.4g} % of one "
        "grain at most; masses and inertias are those of the sharp grains."
    )


def core_comment(found: Skin, sizes: Bodies) -> str:
    """Return as one sentence for a file's comments how much smaller the polyhedra in it are than the grains."""
    told = _lost(found, sizes)
    return (
        f"The polyhedra here are cores, without the sphere that rounds them: {100 * told['core_volume_lost']:.4g} % "
        f"less volume than the grains, {100 * told['largest_core_volume_lost_by_a_grain']:.4g} % less than one at most."
    )


def _lost(found: Skin, sizes: Bodies) -> dict[str, float]:
    told = {
        "smallest_rounding_radius": float(found.radii.min()),
        "largest_rounding_radius": float(found.radii.max()),
    }
    for word, left in (("volume_lost", found.volumes), ("core_volume_lost", found.core_volumes)):
        told[word] = float(1 - left.sum() / sizes.volumes.sum())
        told[f"largest_{word}_by_a_grain"] = float((1 - left / sizes.volumes).max())
    return told


def kinds_of(packing: Packing) -> tuple[list[int], list[int]]:
    """Return the classes that grains have, rising, and the number from 1 of each grain's; without classes all are 1."""
    if packing.classes is None:
        return [], [1] * len(packing)
    numbers, index = np.unique(packing.classes, return_inverse=True)
    return numbers.tolist(), (index.ravel() + 1).tolist()


def parts(packing: Packing) -> Iterator[tuple[slice, Packing]]:
    """Yield the grains a stretch at a time: which of all they are, and a packing of them."""
    for first, part in stretches(packing):
        yield slice(first, first + len(part)), part
