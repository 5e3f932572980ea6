"""A balanced k-d tree over the seeds: the search adapts to their density, in clusters and in voids alike.

The tree is implicit. Node 1 is the root, the children of node k are 2k and 2k + 1; on level l, node 2^l + k holds the
seeds k·n // 2^l up to (k + 1)·n // 2^l of the tree's order. Every node knows the tight box of its seeds and their
largest weight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.threads import LEAST, in_blocks, inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEAF_SIZE = 6
"""Seeds in a leaf, at most: fewer visit more boxes, more try more seeds in vain."""

SERIAL_LEVELS = 4
"""Levels that are split one node after another before the branches are shared out."""


class Tree(NamedTuple):
    """Seeds in the order of their leaves, and the boxes of the nodes.

    Parameters
    ----------
    order : ndarray of int64, shape (n,)
        Seed that stands at each place of the tree's order.
    points : ndarray, shape (n, 3)
        Seeds in the tree's order.
    weights : ndarray, shape (n,)
        Their weights.
    boxes : ndarray, shape (2^(depth + 1), 7)
        Lower corner, upper corner and largest weight of every node; row 0 is not used.
    depth : int
        Level of the leaves.
    """

    order: NDArray[np.int64]
    points: NDArray[np.float64]
    weights: NDArray[np.float64]
    boxes: NDArray[np.float64]
    depth: int


@inner
def _select(order, points, axis, first, last, middle):  # type: ignore[no-untyped-def]
    """Reorder first … last so that ``middle`` is where sorting would put it (Hoare's selection)."""
    left, right = first, last
    while left < right:
        a = points[order[left], axis]
        b = points[order[(left + right) >> 1], axis]
        c = points[order[right], axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = left, right
        while i <= j:
            while points[order[i], axis] < pivot:
                i += 1
            while points[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@inner
def _split(points, weights, order, boxes, level, k, depth):  # type: ignore[no-untyped-def]
    """Measure node ``k`` of a level, and part its seeds along its longest axis unless it is a leaf."""
    n = len(points)
    first, last = (k * n) >> level, ((k + 1) * n) >> level
    node = (1 << level) + k
    for axis in range(3):
        boxes[node, axis] = np.inf
        boxes[node, 3 + axis] = -np.inf
    boxes[node, 6] = -np.inf
    for p in range(first, last):
        i = order[p]
        for axis in range(3):
            boxes[node, axis] = min(boxes[node, axis], points[i, axis])
            boxes[node, 3 + axis] = max(boxes[node, 3 + axis], points[i, axis])
        boxes[node, 6] = max(boxes[node, 6], weights[i])
    if level < depth:
        longest: Any = np.int64(0)  # typed: a literal would have numba compile the callee twice
        for other in range(1, 3):
            if boxes[node, 3 + other] - boxes[node, other] > boxes[node, 3 + longest] - boxes[node, longest]:
                longest = other
        _select(order, points, longest, first, last - 1, ((2 * k + 1) * n) >> (level + 1))


@njit(cache=True, nogil=True)
def _build(first, last, points, weights, order, boxes, top, end, depth):  # type: ignore[no-untyped-def]
    """Split what some nodes of level ``top`` hold, down to the level before ``end``."""
    # Whole subtrees, one after another: a barrier at each level would cost more than it gives.
    for branch in range(first, last):
        for level in range(top, end):
            width = 1 << (level - top)
            for k in range(branch * width, (branch + 1) * width):
                _split(points, weights, order, boxes, level, k, depth)


def build(points: NDArray[np.float64], weights: NDArray[np.float64]) -> Tree:
    """Return the tree of seeds, shape (n, 3), with weights, shape (n,)."""
    n = len(points)
    depth = 0
    while n > LEAF_SIZE << depth:
        depth += 1
    order = np.arange(n)
    boxes = np.zeros((2 << depth, 7))
    top = min(depth, SERIAL_LEVELS)
    _build(0, 1, points, weights, order, boxes, 0, top, depth)
    # Threads are worth their start where a branch holds many seeds.
    least = 1 if n > LEAST else 1 << top
    in_blocks(_build, 1 << top, points, weights, order, boxes, top, depth + 1, depth, least=least)
    return Tree(order, points[order], weights[order], boxes, depth)


def reweighted(tree: Tree, weights: NDArray[np.float64]) -> Tree:
    """Return the tree of the same seeds with other weights, shape (n,)."""
    n, width = len(tree.order), 1 << tree.depth
    boxes = tree.boxes.copy()
    ordered = weights[tree.order]
    boxes[width:, 6] = np.maximum.reduceat(ordered, (np.arange(width) * n) >> tree.depth)
    while width > 1:
        width >>= 1
        boxes[width : 2 * width, 6] = np.maximum(
            boxes[2 * width : 4 * width : 2, 6], boxes[2 * width + 1 : 4 * width : 2, 6]
        )
    return tree._replace(weights=ordered, boxes=boxes)
