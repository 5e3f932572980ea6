"""Answers from programs that are not ours: cells by mirrored seeds and by half-spaces, through Qhull; Voro++."""

import numpy as np


def images(sites, domain, at_wall=None):
    """Return the sites, their mirror images in every wall and their periodic copies, with what each is.

    Copies are (site, shift) and mirror images (wall id, no shift); mirrors of copies keep the copies' cells right.
    ``at_wall``, {wall id: sites}, limits the mirrored sites to those whose cells touch that wall: a cell whose mirror
    is missing is cut wrongly or is open, and never the cell that it should be.
    """
    points = [(np.asarray(sites, float), np.arange(len(sites)), np.zeros((len(sites), 3), int))]
    for axis in np.flatnonzero(domain.periodic):
        step = np.eye(3, dtype=int)[axis]
        for p, ids, shifts in list(points):
            points += [(p + s * step * domain.lengths, ids, shifts + s * step) for s in (-1, 1)]
    for axis in np.flatnonzero(~domain.periodic):
        base = list(points)
        for side, wall in enumerate((domain.lower[axis], domain.upper[axis])):
            wall_id = -1 - 2 * axis - side
            for p, ids, shifts in base:
                kept = slice(None) if at_wall is None else np.isin(ids, at_wall[wall_id])
                mirrored = p[kept].copy()
                mirrored[:, axis] = 2 * wall - mirrored[:, axis]
                points.append((mirrored, np.full(len(mirrored), wall_id), shifts[kept] * 0))
    return tuple(np.concatenate(column) for column in zip(*points, strict=True))


def voronoi_faces(sites, domain, at_wall=None):
    """Return {(cell, neighbour, shift): polygon area} and the cells' volumes, by `scipy.spatial.Voronoi` (Qhull)."""
    from scipy.spatial import Voronoi

    points, ids, shifts = images(sites, domain, at_wall)
    n = len(sites)
    diagram = Voronoi(points)
    pairs = diagram.ridge_points
    kept = np.flatnonzero(pairs.min(axis=1) < n)
    ridges = [diagram.ridge_vertices[k] for k in kept]
    counts = np.array([len(ridge) for ridge in ridges])
    corners = np.concatenate(ridges)
    assert corners.min() >= 0, "a cell is open"
    starts = np.cumsum(counts) - counts
    arms = diagram.vertices[corners] - np.repeat(diagram.vertices[corners[starts]], counts, axis=0)
    # The last corner of a face crosses with the first, which is the origin: nothing.
    following = np.arange(1, len(corners) + 1)
    following[starts + counts - 1] = starts
    area = 0.5 * np.linalg.norm(np.add.reduceat(np.cross(arms, arms[following]), starts), axis=1)
    height = 0.5 * np.linalg.norm(points[pairs[kept, 0]] - points[pairs[kept, 1]], axis=1)
    areas, volumes = {}, np.zeros(n)
    for a, b in ((0, 1), (1, 0)):
        mine, other = pairs[kept, a], pairs[kept, b]
        inner = mine < n
        np.add.at(volumes, mine[inner], (area * height)[inner] / 3)
        keys = zip(
            mine[inner].tolist(), ids[other[inner]].tolist(), map(tuple, shifts[other[inner]].tolist()), strict=True
        )
        areas.update(zip(keys, area[inner].tolist(), strict=True))
    return areas, volumes


def laguerre_volumes(sites, weights, domain):
    """Return the volumes of Laguerre cells without periodic axes: each cell an intersection of half-spaces by Qhull."""
    from scipy.spatial import ConvexHull

    volumes = np.zeros(len(sites))
    for i, site in enumerate(sites):
        others = np.delete(np.arange(len(sites)), i)
        normals = sites[others] - site
        offsets = 0.5 * (np.sum(normals**2, axis=1) + weights[i] - weights[others])
        planes = np.concatenate(
            [
                np.column_stack([normals, -offsets]),
                np.column_stack([np.eye(3), site - domain.upper]),
                np.column_stack([-np.eye(3), domain.lower - site]),
                np.column_stack([domain.planes[:, :3], domain.planes[:, :3] @ site - domain.planes[:, 3]]),
            ]
        )
        vertices = half_space_vertices(planes)
        if vertices is not None:
            volumes[i] = ConvexHull(vertices).volume
    return volumes


def half_space_vertices(planes):
    """Return the vertices of {x: n · x + d <= 0} for rows (n, d), or None where there is no inside."""
    from scipy.optimize import linprog
    from scipy.spatial import HalfspaceIntersection

    norms = np.linalg.norm(planes[:, :3], axis=1)
    rows = np.column_stack([planes[:, :3], norms])
    centre = linprog([0, 0, 0, -1], A_ub=rows, b_ub=-planes[:, 3], bounds=[(None, None)] * 3 + [(0, None)])
    # 1e-9: a cell thinner than that is empty for every purpose of these tests.
    if centre.status != 0 or centre.x[3] < 1e-9:
        return None
    return HalfspaceIntersection(planes, centre.x[:3]).intersections


def voropp(sites, domain, weights=None):
    """Return volumes and sorted neighbours (walls negative) of every cell, by Voro++ through the multivoro wheel."""
    import multivoro
    from scipy.spatial import ConvexHull

    weights = np.zeros(len(sites)) if weights is None else weights
    cells = multivoro.compute_voronoi(
        np.asarray(sites, float),
        limits=np.stack([domain.lower, domain.upper]),
        periodic_boundaries=tuple(domain.periodic.tolist()),
        radii=np.sqrt(weights - weights.min()),
    )
    volumes = np.zeros(len(sites))
    neighbors = []
    for i, cell in enumerate(cells):
        vertices = np.asarray(cell.get_vertices())
        if len(vertices) >= 4:
            volumes[i] = ConvexHull(vertices).volume
        neighbors.append(sorted(np.asarray(cell.get_neighbors()).tolist()))
    return volumes, neighbors
