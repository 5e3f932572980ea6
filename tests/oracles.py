"""Answers from programs that are not ours: cells by mirrored seeds and by half-spaces, through Qhull; Voro++."""

import numpy as np


def images(sites, domain):
    """Return the sites, their mirror images in every wall and their periodic copies, with what each is.

    Copies are (site, shift) and mirror images (wall id, no shift); mirrors of copies keep the copies' cells right.
    """
    points = [(np.asarray(sites, float), np.arange(len(sites)), np.zeros((len(sites), 3), int))]
    for axis in np.flatnonzero(domain.periodic):
        step = np.eye(3, dtype=int)[axis]
        for p, ids, shifts in list(points):
            points += [(p + s * step * domain.lengths, ids, shifts + s * step) for s in (-1, 1)]
    for axis in np.flatnonzero(~domain.periodic):
        base = list(points)
        for side, wall in enumerate((domain.lower[axis], domain.upper[axis])):
            for p, ids, shifts in base:
                mirrored = p.copy()
                mirrored[:, axis] = 2 * wall - mirrored[:, axis]
                points.append((mirrored, np.full(len(ids), -1 - 2 * axis - side), shifts * 0))
    return tuple(np.concatenate(column) for column in zip(*points, strict=True))


def voronoi_faces(sites, domain):
    """Return {(cell, neighbour, shift): polygon area} and the cells' volumes, by `scipy.spatial.Voronoi` (Qhull)."""
    from scipy.spatial import Voronoi

    points, ids, shifts = images(sites, domain)
    n = len(sites)
    diagram = Voronoi(points)
    areas, volumes = {}, np.zeros(n)
    for (p, q), ridge in zip(diagram.ridge_points, diagram.ridge_vertices, strict=True):
        if min(p, q) >= n:
            continue
        polygon = diagram.vertices[ridge]
        normal = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]).sum(axis=0)
        area = 0.5 * np.linalg.norm(normal)
        height = 0.5 * np.linalg.norm(points[p] - points[q])
        for a, b in ((p, q), (q, p)):
            if a < n:
                areas[a, int(ids[b]), tuple(shifts[b].tolist())] = area
                volumes[a] += area * height / 3
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
