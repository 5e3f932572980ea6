"""Cells against Qhull and Voro++, and the laws that every tessellation obeys."""

from collections import Counter

import numba
import numpy as np
import oracles
import pytest

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.model import Domain
from grainsdem.points import halton, poisson
from grainsdem.ragged import owners
from grainsdem.tessellation import tessellate

LATTICES = {
    "cubic": ([[0, 0, 0]], 6, 8),
    "bcc": ([[0, 0, 0], [0.5, 0.5, 0.5]], 14, 24),
    "fcc": ([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]], 12, 14),
}


def lattice(basis, m):
    """Return m³ unit cells of a lattice in the unit cube, a little off its corner."""
    corners = np.stack(np.meshgrid(*[np.arange(m)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return ((corners + np.asarray(basis) + 0.1) / m).reshape(-1, 3)


def check_laws(cells, *, lost=1e-12):
    """Assert what holds for every tessellation; areas may differ by ``lost`` of the domain's longest edge squared."""
    shapes, domain = cells.cells, cells.domain
    measured = integrate(shapes)
    assert measured.volumes.sum() == pytest.approx(domain.volume, rel=1e-12)
    assert np.all(measured.volumes >= 0)
    counts = np.diff(shapes.face_vertex_offsets[shapes.face_offsets])
    euler = np.diff(shapes.vertex_offsets) - counts // 2 + np.diff(shapes.face_offsets)
    assert np.all(euler == np.where(counts > 0, 2, 0))
    planes = face_planes(shapes)
    owner = owners(shapes.face_offsets)
    closure = np.zeros((len(cells), 3))
    np.add.at(closure, owner, planes.areas[:, None] * planes.normals)
    assert np.abs(closure).max() <= 1e-12 * domain.lengths.max() ** 2
    check_edges(shapes)
    keys = np.column_stack([owner, cells.neighbors, cells.shifts])
    inner = cells.neighbors >= 0
    there = keys[inner]
    back = np.column_stack([there[:, 1], there[:, 0], -there[:, 2:]])
    a, b = np.lexsort(there.T[::-1]), np.lexsort(back.T[::-1])
    assert np.array_equal(there[a], back[b])
    areas, normals = planes.areas[inner], planes.normals[inner]
    assert np.all(np.abs(areas[a] - areas[b]) <= 1e-9 * areas[a] + lost * domain.lengths.max() ** 2)
    large = areas[a] > 1e-6 * domain.lengths.max() ** 2
    assert np.abs(normals[a] + normals[b])[large].max(initial=0) < 1e-6


def check_edges(shapes):
    """Assert that every directed edge of a cell runs back exactly once: the cell is closed and wound one way."""
    corners = shapes.face_vertices + np.repeat(
        shapes.vertex_offsets[:-1], np.diff(shapes.face_vertex_offsets[shapes.face_offsets])
    )
    following = np.arange(1, corners.size + 1)
    following[shapes.face_vertex_offsets[1:] - 1] = shapes.face_vertex_offsets[:-1]
    edges = corners.astype(np.int64) * len(shapes.vertices) + corners[following]
    back = corners[following].astype(np.int64) * len(shapes.vertices) + corners
    assert np.array_equal(np.sort(edges), np.sort(back))
    assert np.unique(edges).size == edges.size
    assert np.array_equal(np.unique(corners), np.arange(len(shapes.vertices)))


@pytest.mark.unit
@pytest.mark.parametrize("periodic", [(False,) * 3, (True,) * 3, (True, False, False), (False, True, True)])
def test_volumes_areas_neighbours_and_shifts_are_those_of_qhull(periodic):
    domain = Domain(np.array([-1.0, 2.0, 0.0]), np.array([1.0, 3.5, 1.0]), np.array(periodic))
    seeds = poisson(domain, 150, rng=4)
    cells = tessellate(seeds, domain)
    check_laws(cells)
    areas, volumes = oracles.voronoi_faces(seeds, domain)
    assert integrate(cells.cells).volumes == pytest.approx(volumes, rel=1e-9)
    planes = face_planes(cells.cells)
    rows = zip(
        owners(cells.cells.face_offsets).tolist(),
        cells.neighbors.tolist(),
        map(tuple, cells.shifts.tolist()),
        strict=True,
    )
    ours = dict(zip(rows, planes.areas.tolist(), strict=True))
    assert ours.keys() == areas.keys()
    assert [ours[key] for key in areas] == pytest.approx(list(areas.values()), rel=1e-7, abs=1e-12)


@pytest.mark.unit
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("name", LATTICES)
@pytest.mark.parametrize(("offset", "side"), [(0.0, 1.0), (0.0, 1e-6), (0.0, 1e6), (1000.0, 1.0)])
def test_lattice_cells_have_exactly_their_faces(name, periodic, offset, side):
    basis, faces, vertices = LATTICES[name]
    domain = Domain(np.full(3, offset), np.full(3, offset + side), np.full(3, periodic))
    cells = tessellate(offset + side * lattice(basis, 6 if name == "cubic" else 4), domain)
    inner = np.arange(len(cells))
    if not periodic:
        walls = np.unique(owners(cells.cells.face_offsets)[cells.neighbors < 0])
        near = np.unique(cells.neighbors[np.isin(owners(cells.cells.face_offsets), walls)])
        inner = np.setdiff1d(inner, np.concatenate([walls, near]))
    assert inner.size > 0
    assert set(np.diff(cells.cells.face_offsets)[inner].tolist()) == {faces}
    assert set(np.diff(cells.cells.vertex_offsets)[inner].tolist()) == {vertices}
    check_edges(cells.cells)
    assert integrate(cells.cells).volumes.sum() == pytest.approx(domain.volume, rel=1e-12)


@pytest.mark.unit
def test_one_seed_has_the_domain_and_its_own_images_for_neighbours():
    cells = tessellate([[0.3, 0.4, 0.5]], Domain.cube(periodic=True))
    check_laws(cells)
    assert cells.neighbors.tolist() == [0] * 6
    assert cells.shifts.tolist() == [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]]
    walled = tessellate([[0.3, 0.4, 0.5]], Domain.cube())
    check_laws(walled)
    assert walled.neighbors.tolist() == [-1, -2, -3, -4, -5, -6]


@pytest.mark.unit
@pytest.mark.parametrize("direction", [[1, 0, 0], [1, 1, 0], [1, 1, 1], [0.3, 0.5, 0.7]])
def test_collinear_seeds_cut_the_domain_into_slices(direction):
    seeds = 0.1 + np.linspace(0, 0.8, 9)[:, None] * np.asarray(direction, float)
    check_laws(tessellate(seeds, Domain.cube()))


@pytest.mark.unit
@pytest.mark.parametrize("periodic", [False, True])
def test_coplanar_seeds_make_prisms(periodic):
    seeds = np.column_stack([np.random.default_rng(3).random((60, 2)), np.full(60, 0.25)])
    cells = tessellate(seeds, Domain.cube(periodic=periodic))
    check_laws(cells)
    z = cells.cells.vertices[:, 2]
    assert sorted({round(value, 12) for value in z.tolist()}) == ([-0.5, 0.5] if periodic else [-0.25, 0.75])


@pytest.mark.unit
def test_near_duplicates_are_tessellated_and_duplicates_refused():
    rng = np.random.default_rng(8)
    seeds = rng.random((50, 3))
    near = np.concatenate([seeds, seeds[:20] + 1e-10 * rng.standard_normal((20, 3))])
    # Two bisectors that meet at an angle of 1e-10 meet somewhere within 1e-16 / 1e-10, seen from a third cell.
    check_laws(tessellate(near, Domain.cube()), lost=1e-5)
    with pytest.raises(InputError, match="1 pairs coincide: 0–50"):
        tessellate(np.concatenate([seeds, seeds[:1] + 1e-14]), Domain.cube())


@pytest.mark.unit
def test_a_seed_in_a_shell_of_a_thousand_has_them_all_for_neighbours():
    rng = np.random.default_rng(2)
    shell = rng.standard_normal((1000, 3))
    shell *= 0.4 / np.linalg.norm(shell, axis=1, keepdims=True)
    seeds = np.concatenate([[[0.5, 0.5, 0.5]], 0.5 + shell])
    cells = tessellate(seeds, Domain.cube())
    check_laws(cells)
    mine = cells.neighbors[: cells.cells.face_offsets[1]]
    assert sorted(mine.tolist()) == list(range(1, 1001))
    assert len(cells.cells.vertices_of(0)) == 2 * 1000 - 4


@pytest.mark.unit
def test_the_bytes_do_not_depend_on_the_number_of_threads():
    domain = Domain.cube(0.01, periodic=True)
    seeds = poisson(domain, 3000, rng=5)
    found = []
    before = numba.get_num_threads()
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            cells = tessellate(seeds, domain)
            parts = (cells.cells.vertices, cells.cells.face_vertices, cells.neighbors, cells.shifts)
            found.append(b"".join(np.ascontiguousarray(part).tobytes() for part in parts))
    finally:
        numba.set_num_threads(before)
    assert found[0] == found[1]


@pytest.mark.unit
def test_permuting_the_seeds_permutes_the_cells():
    domain = Domain.cube(2.0)
    seeds = halton(domain, 400)
    order = np.random.default_rng(1).permutation(400)
    volumes = integrate(tessellate(seeds, domain).cells).volumes
    assert integrate(tessellate(seeds[order], domain).cells).volumes == pytest.approx(volumes[order], rel=1e-12)


@pytest.mark.unit
def test_weights_that_are_no_numbers_are_refused():
    seeds = [[0.2, 0.2, 0.2], [0.7, 0.7, 0.7]]
    with pytest.raises(ShapeError, match=r"got shape \(3,\) beside seeds of shape \(2, 3\)"):
        tessellate(seeds, Domain.cube(), weights=[1, 2, 3])
    with pytest.raises(InputError, match=r"weights must be within .* m²; 1 are not: 1"):
        tessellate(seeds, Domain.cube(), weights=[1, np.nan])


@pytest.mark.slow
@pytest.mark.statistical
def test_poisson_cells_have_the_exact_means_and_variance():
    domain = Domain.cube(20_000 ** (1 / 3), periodic=True)
    cells = tessellate(poisson(domain, 20_000, rng=11), domain)
    check_laws(cells)
    measured = integrate(cells.cells)
    faces = np.diff(cells.cells.face_offsets)
    vertices = np.diff(cells.cells.vertex_offsets)
    squares = measured.volumes**2
    for values, exact in (
        (faces, 15.535457),
        (vertices, 27.070915),
        (measured.areas, 5.820873),
        (squares, 1.17903244),
    ):
        assert abs(values.mean() - exact) < 5 * values.std() / np.sqrt(len(values))
    assert np.array_equal(vertices, 2 * faces - 4)
    assert Counter(cells.neighbors.tolist())[-1] == 0
