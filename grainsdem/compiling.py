"""How each step of `grainsdem.geometry.ahead` is taken: on a tiny bed, or through a function that is compiled alone.

A large kernel calls many others. Some of them are compiled apart, by functions that call them as the kernel does and
are never run, so that two processes share the work.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from grainsdem import shapes
from grainsdem.geometry.bounds import near_images
from grainsdem.geometry.cells.cutting import cut, polish, start_box
from grainsdem.geometry.cells.emitting import emit
from grainsdem.geometry.clipping import solid_volume
from grainsdem.geometry.defects import find_defects
from grainsdem.geometry.integrals import face_planes, volumes
from grainsdem.geometry.pairs.bodies import Bodies, bodies
from grainsdem.geometry.pairs.gjk import closest_points, descend, make_simplex
from grainsdem.geometry.pairs.patches import (
    find_facing,
    find_feature,
    make_patch,
    share_patch,
    take_face,
)
from grainsdem.geometry.pairs.penetration import along, search_faces, solve_near
from grainsdem.geometry.triangles import best_apexes, facets
from grainsdem.measures import roundness, sieve_diameters
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import contacts
from grainsdem.tessellation import relax, tessellate
from grainsdem.tessellation.ellipsoids import grown
from grainsdem.tessellation.engine.frame import Frame
from grainsdem.tessellation.engine.full import copy_none
from grainsdem.tessellation.engine.growing import gather, grow
from grainsdem.tessellation.engine.light import list_arrays, work_arrays
from grainsdem.tessellation.engine.tree import Tree, build
from grainsdem.validation import validate

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


def _two_cubes() -> Packing:
    """Return two unit cubes, one turned, a little apart, whose boxes meet."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    offsets = (np.array(ends, dtype=np.int64) for ends in ([0, 8, 16], [0, 6, 12], range(0, 49, 4)))
    of_vertices, of_faces, of_corners = offsets
    cubes = Polyhedra(np.tile(corners, (2, 1)), of_vertices, of_faces, np.ravel(faces * 2).astype(np.int32), of_corners)
    places = np.array([[1.0, 1.0, 1.0], [1.86, 1.86, 1.0]])
    turns = np.array([[1.0, 0, 0, 0], [np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)]])
    return Packing(cubes, places, turns, np.full(2, 2650.0), Domain(np.zeros(3), np.full(3, 3.0)))


def _sites() -> NDArray[np.float64]:
    return np.random.default_rng(0).random((8, 3))


def _compile(function: Callable[..., Any], *arguments: Any) -> None:
    """Compile a function for arguments of the types of these; it is not called."""
    numba.njit(function).compile(tuple(numba.typeof(argument) for argument in arguments))  # type: ignore[no-untyped-call]


def _no_bodies() -> Bodies:
    """Return bodies of the types that kernels get, without a kernel's help."""
    points, pairs, corners = np.empty((0, 3)), np.empty((0, 2), np.int64), np.empty(0, np.int32)
    edges, offsets, lengths = np.empty((0, 4), np.int32), np.empty(0, np.int64), np.empty(0)
    return Bodies(points, pairs, pairs, pairs, corners, offsets, points, lengths, lengths, edges, lengths)


def _pair() -> tuple[Any, ...]:
    """Return what kernels of pairs take: bodies, two ids, a vector, a number."""
    return _no_bodies(), np.int32(0), np.int32(0), np.empty(3), 0.0


def _approaching() -> None:
    def approach(solids, a, b, t, x):  # type: ignore[no-untyped-def]  # pragma: no cover  (compiled, never called)
        simplex = make_simplex()
        _, count, _ = descend(solids, a, b, t, x, simplex)
        closest_points(solids, count, t, simplex, t, t)
        along(solids, a, b, t, x, x, x)
        search_faces(solids, a, b, t, t, t, x, t)

    _compile(approach, *_pair())


def _touching() -> None:
    def touch(solids, a, b, t, x):  # type: ignore[no-untyped-def]  # pragma: no cover
        face, _ = find_facing(solids, a, b, t, t)
        patch = make_patch(face)
        take_face(solids, a, face, patch.polygon_a)
        count = find_feature(solids, a, x, x, x, patch.polygon_a)
        share_patch(solids, count, count, t, t, patch)

    _compile(touch, *_pair())


def _searching() -> None:
    def search(solids, a, b, t, x):  # type: ignore[no-untyped-def]  # pragma: no cover
        solve_near(solids, a, b, t, t, t, x, t, np.empty(2, dtype=np.int64), np.empty((4, 3)))

    _compile(search, *_pair())


def _volumes() -> None:
    grains = _two_cubes().grains
    volumes(grains)
    face_planes(grains)


def _near() -> None:
    packing = _two_cubes()
    near_images(packing, 0.1)
    bodies(packing)


def _contacts() -> None:
    contacts(_two_cubes())


def _walls() -> None:
    contacts(_two_cubes(), walls=True)


def _shapes() -> None:
    packing = _two_cubes()
    solid_volume(packing, np.array([[1.0, 0.0, 0.0, 1.0]]))
    find_defects(packing.grains)


def _proof() -> None:
    validate(_two_cubes())


def _cell() -> tuple[Any, ...]:
    """Return what kernels of cells take: a place, a tree, a frame, banned neighbours, a size, a number."""
    ids, lengths = np.empty(0, np.int64), np.empty(0)
    tree = Tree(ids, np.empty((0, 3)), lengths, np.empty((0, 7)), 0)
    return 0, tuple(tree), Frame.of(Domain.cube()).kernel, ids, 0, 0.0


def _cutting() -> None:
    def shorten(place, tree, frame, banned, size, x):  # type: ignore[no-untyped-def]  # pragma: no cover
        geo, tri, planes, tags, _ = work_arrays(size)
        cut(geo, tri, planes, tags, size, size, x, x, x, x, x)

    _compile(shorten, *_cell())


def _starting() -> None:
    def start(place, tree, frame, banned, size, x):  # type: ignore[no-untyped-def]  # pragma: no cover
        geo, tri, planes, tags, _ = work_arrays(size)
        start_box(geo, tri, planes, tags, x, x, x, frame[0], frame[1], tree[0][place])
        polish(geo, tri, planes, size, x)

    _compile(start, *_cell())


def _emitting() -> None:
    def close(place, tree, frame, banned, size, x):  # type: ignore[no-untyped-def]  # pragma: no cover
        geo, tri, _, tags, stack = work_arrays(size)
        around, named = list_arrays()
        gather(size, tree, frame, around, named, stack)
        small, tiny = np.empty(size, dtype=np.int32), np.empty(size, dtype=np.int8)
        emit(geo, tri, tags, size, size, x, tree[1], small, small, tiny, small)

    sites = _sites()
    build(sites, np.zeros(len(sites)))
    _compile(close, *_cell())


def _growing() -> None:
    def enlarge(place, tree, frame, banned, size, x):  # type: ignore[no-untyped-def]  # pragma: no cover
        around, named = list_arrays()
        grow(place, tree, frame, banned, around, named, size, x, work_arrays(size))

    _compile(enlarge, *_cell())


def _copying() -> None:
    copy_none()


def _cells() -> None:
    tessellate(_sites(), Domain.cube())


def _lloyd() -> None:
    relax(_sites(), Domain.cube(), iterations=1)


def _facets() -> None:
    grains = _two_cubes().grains
    facets(grains, best_apexes(grains))


def _between() -> None:
    sites, forms = _sites(), np.repeat(np.eye(3)[None], 8, axis=0)
    grown(Domain.cube(), sites, np.zeros(8), forms, np.ones((8, 3)))


def _loose() -> None:
    shapes.pack(_two_cubes().grains, 1.0, n=2, rng=0)


def _outlines() -> None:
    roundness(_two_cubes())


def _holes() -> None:
    sieve_diameters(_two_cubes())


TAKEN: dict[str, Callable[[], None]] = {
    "cutting": _cutting, "starting": _starting, "emitting": _emitting, "growing": _growing, "volumes": _volumes,
    "copying": _copying, "cells": _cells, "near": _near, "approaching": _approaching, "touching": _touching,
    "searching": _searching, "contacts": _contacts, "shapes": _shapes, "lloyd": _lloyd, "proof": _proof,
    "walls": _walls, "facets": _facets, "loose": _loose, "between": _between,
    "outlines": _outlines, "holes": _holes,
}  # fmt: skip
"""What each step does."""
