from __future__ import annotations

import itertools
import json
import subprocess
import sys

import numpy as np
import pytest
from conftest import cube_packing
from scipy.spatial import ConvexHull, cKDTree
from solids import blob, centred, place, polyhedra
from typer.testing import CliRunner

import grainsdem
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, MissingPackageError, WriteError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.raster.lattice import Lattice, label_blocks
from grainsdem.geometry.rotations import random_quaternions, world_vertices
from grainsdem.measures.voxels import (
    Voxels,
    chord_lengths,
    exact_specific_surface,
    specific_surface,
    two_point_correlation,
    voxelize,
    write_voxels,
)
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.storage import save
from grainsdem.tessellation import relax, tessellate


@pytest.fixture(scope="module")
def periodic():
    """Sixty grains of a periodic unit cube with wide gaps between them."""
    domain = Domain.cube(1.0, periodic=True)
    return shrink(carve(tessellate(relax(poisson(domain, 60, rng=5), domain, iterations=3), domain)), scale=0.7)


@pytest.fixture(scope="module")
def flat():
    """A planar bed, periodic in its plane."""
    domain = Domain.slab([1.0, 1.0], 0.1, periodic=True)
    return shrink(carve(tessellate(poisson(domain, 80, rng=6), domain)), scale=0.8)


def image(labels, *, spacing=(1.0, 1.0, 1.0), periodic=(False, False, False)):
    return Voxels(labels, np.zeros(3), spacing, periodic)


@pytest.mark.unit
def test_a_cube_is_the_voxels_whose_middles_lie_in_it():
    packing = cube_packing([[2.0, 3.0, 1.0]], domain=Domain.box((6.0, 5.0, 4.0)))
    voxels = voxelize(packing, size=0.5)
    assert voxels.labels.shape == (8, 10, 12)
    expected = np.zeros((8, 10, 12), dtype=np.int32)
    expected[0:4, 4:8, 2:6] = 1
    np.testing.assert_array_equal(voxels.labels, expected)
    assert voxels.porosity() == pytest.approx(1 - 8 / 120)
    np.testing.assert_array_equal(voxels.phase(), expected > 0)


@pytest.mark.unit
def test_middles_on_a_shared_face_belong_to_one_of_the_two_grains_and_to_no_void():
    packing = cube_packing([[1, 1, 1], [3, 1, 1]], domain=Domain.box((4.0, 2.0, 2.0)))
    labels = voxelize(packing, size=4 / 3).labels  # the middle of the second column is the face
    np.testing.assert_array_equal(labels[0, 0], [1, 1, 2])


@pytest.mark.property
def test_grains_turned_at_random_hold_the_voxels_that_qhulls_half_spaces_hold():
    rng = np.random.default_rng(3)
    shapes = centred(polyhedra(*(blob(rng) for _ in range(4))))
    positions = rng.uniform(0.3, 1.7, (4, 3))
    packing = place(shapes, positions, quaternions=random_quaternions(4, rng), domain=Domain.cube(2.0))
    labels = voxelize(packing, size=0.05).labels
    middles = (np.stack(np.meshgrid(*[np.arange(40)] * 3, indexing="ij"), axis=-1)[..., ::-1] + 0.5) * 0.05
    expected = np.zeros(labels.shape, dtype=np.int32)
    vertices = world_vertices(packing)
    for i in reversed(range(4)):  # of grains that overlap, the first
        hull = ConvexHull(vertices[shapes.vertex_offsets[i] : shapes.vertex_offsets[i + 1]]).equations
        expected[(middles @ hull[:, :3].T + hull[:, 3] <= 0).all(axis=-1)] = i + 1
    np.testing.assert_array_equal(labels, expected)


@pytest.mark.property
def test_voxels_of_a_periodic_tessellation_are_of_their_nearest_seed():
    domain = Domain.box((1.0, 0.8, 0.9), periodic=True)
    seeds = poisson(domain, 50, rng=2)
    voxels = voxelize(carve(tessellate(seeds, domain)), size=0.031)
    middles = (np.stack(np.meshgrid(*map(np.arange, voxels.labels.shape), indexing="ij"), axis=-1)[..., ::-1] + 0.5) * (
        voxels.spacing
    )
    _, nearest = cKDTree(seeds, boxsize=domain.lengths).query(middles.reshape(-1, 3))
    np.testing.assert_array_equal(voxels.labels.ravel(), nearest + 1)
    assert voxels.porosity() == 0


@pytest.mark.statistical
@pytest.mark.parametrize("bed", ["periodic", "flat"])
def test_volumes_counted_by_voxels_scatter_as_the_law_of_lattices_says(bed, request):
    packing = request.getfixturevalue(bed)
    measured, domain = integrate(packing.grains), packing.domain
    if domain.is_planar:
        thick = domain.lengths[2]
        size, extent = measured.volumes / thick, (measured.areas - 2 * measured.volumes / thick) / thick
    else:
        size, extent = measured.volumes, measured.areas
    rng = np.random.default_rng(8)
    for n in (16, 32):
        h, ratios = 1 / n, []
        for _ in range(12):
            # The box moves within a voxel, and the lattice with it; it stays a whole period.
            move = rng.random(3) * h * [1, 1, not domain.is_planar]
            voxels = voxelize(packing, size=h, region=(domain.lower + move, domain.upper + move))
            cell = voxels.spacing[:2].prod() if domain.is_planar else voxels.spacing.prod()
            errors = np.bincount(voxels.labels.ravel(), minlength=len(packing) + 1)[1:] * cell - size
            law = 0.0728 * h**3 if domain.is_planar else 0.0667 * h**4
            ratios.append(np.mean(errors**2 / (law * extent)))
        assert np.mean(ratios) == pytest.approx(1, abs=5 * np.std(ratios) / np.sqrt(12) + 0.05)


@pytest.mark.unit
def test_what_lies_outside_the_container_is_marked_and_does_not_count():
    # Its facets are one from the axis: voxels of a twentieth end with the walls and the cube.
    domain = Domain.cylinder(np.sqrt(16 / np.pi * np.tan(np.pi / 16)), 1.0, sides=16)
    packing = cube_packing([[0.0, 0.0, 0.5]], half=0.25, domain=domain)
    voxels = voxelize(packing, size=0.05)
    inside = np.count_nonzero(voxels.labels >= 0) * 0.05**3
    assert inside == pytest.approx(domain.volume, rel=0.01)
    assert voxels.porosity() == pytest.approx(1 - 0.125 / inside)
    beyond = voxelize(packing, size=0.1, region=([-2, -0.1, 0], [2, 0.1, 1.2])).labels
    assert (beyond[:10, :, 10:30] >= 0).all()
    assert (beyond[10:] == -1).all()
    assert (beyond[:, :, :10] == -1).all()


@pytest.mark.property
def test_labels_do_not_depend_on_the_blocks_or_on_the_threads(periodic):
    import numba

    lattice = Lattice(np.zeros(3), np.full(3, 1 / 40), (40, 40, 40))
    whole = voxelize(periodic, size=1 / 40).labels
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        blocks = list(label_blocks(periodic, lattice, most=5000))
    finally:
        numba.set_num_threads(before)
    assert [len(block) for block in blocks] == [3] * 13 + [1]
    np.testing.assert_array_equal(np.concatenate(blocks), whole)


@pytest.mark.client
def test_files_are_read_back_by_numpy_tifffile_and_pyvista(periodic, tmp_path):
    import pyvista
    import tifffile

    voxels = voxelize(periodic, per_diameter=8)
    files = {
        suffix: write_voxels(periodic, tmp_path / f"a{suffix}", per_diameter=8) for suffix in (".npy", ".vti", ".tif")
    }
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), voxels.labels)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tif"), voxels.labels)
    grid = pyvista.read(tmp_path / "a.vti")
    np.testing.assert_array_equal(grid.cell_data["label"].reshape(voxels.labels.shape), voxels.labels)
    np.testing.assert_allclose(grid.spacing, voxels.spacing)
    assert {file.porosity for file in files.values()} == {voxels.porosity()}
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert len(file.pages) == len(voxels.labels)
        assert file.shaped_metadata[0]["spacing"] == pytest.approx(voxels.spacing)


@pytest.mark.client
def test_nrrd_and_raw_voxels_are_read_by_vtk_and_as_bare_bytes(periodic, tmp_path):
    import pyvista

    voxels = voxelize(periodic, per_diameter=8)
    write_voxels(periodic, tmp_path / "a.nrrd", per_diameter=8)
    write_voxels(periodic, tmp_path / "b.raw", per_diameter=8)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.nrrd", "b.nhdr", "b.raw"]
    nz, ny, nx = voxels.labels.shape
    # As a lattice-Boltzmann code in C reads it: x fastest.
    bare = np.fromfile(tmp_path / "b.raw", dtype="<i4")
    assert bare[1 + nx * (2 + ny * 3)] == voxels.labels[3, 2, 1]
    np.testing.assert_array_equal(bare.reshape(nz, ny, nx), voxels.labels)
    for name in ("a.nrrd", "b.nhdr"):
        grid = pyvista.read(tmp_path / name)
        assert grid.dimensions == (nx, ny, nz)
        np.testing.assert_allclose(grid.spacing, voxels.spacing)
        np.testing.assert_allclose(grid.origin, np.array(voxels.lower) + 0.5 * np.array(voxels.spacing))
        np.testing.assert_array_equal(grid.active_scalars.reshape(nz, ny, nx), voxels.labels)
    write_voxels(periodic, tmp_path / "c.nrrd", size=0.05, phase=True)
    np.testing.assert_array_equal(
        pyvista.read(tmp_path / "c.nrrd").active_scalars, voxelize(periodic, size=0.05).phase().ravel()
    )


@pytest.mark.client
@pytest.mark.parametrize("phase", [True, False])
def test_pynrrd_reads_both_headers_with_place_size_and_what_the_numbers_are(periodic, tmp_path, phase):
    import nrrd

    voxels = voxelize(periodic, per_diameter=6)
    expected = voxels.phase() if phase else voxels.labels
    for name in ("a.nrrd", "b.raw"):
        write_voxels(periodic, tmp_path / name, per_diameter=6, phase=phase)
        found, head = nrrd.read(str(tmp_path / name.replace(".raw", ".nhdr")))
        np.testing.assert_array_equal(found, expected.T)  # pynrrd's first axis is the fastest
        np.testing.assert_array_equal(head["space directions"], np.diag(voxels.spacing))
        np.testing.assert_allclose(head["space origin"], np.array(voxels.lower) + 0.5 * np.array(voxels.spacing))
        assert head["space units"] == ["m", "m", "m"]
        assert ("1 in grains, 0 elsewhere" if phase else "grain id + 1, 0 in the void") in head["content"]


@pytest.mark.client
@pytest.mark.slow
def test_porespy_finds_the_porosity_and_one_void_and_openpnm_takes_its_network(periodic, tmp_path, environment):
    write_voxels(periodic, tmp_path / "phase.raw", per_diameter=12, phase=True)
    script = """if True:
        import json, sys
        import numpy, openpnm, porespy
        rows = dict(row.split(": ", 1) for row in open("phase.nhdr").read().splitlines() if ": " in row)
        shape = [int(word) for word in rows["sizes"].split()]
        size = float(rows["space directions"][1:].split(",")[0])
        void = numpy.fromfile("phase.raw", dtype=rows["type"]).reshape(shape, order="F") == 0
        parts = porespy.filters.find_disconnected_voxels(void)
        network = openpnm.io.network_from_porespy(porespy.networks.snow2(void, voxel_size=size).network)
        health = openpnm.utils.check_network_health(network)
        print(json.dumps({
            "porosity": float(porespy.metrics.porosity(void)), "closed": int(parts.sum()),
            "pores": network.Np, "throats": network.Nt, "apart": len(health["disconnected_pores"]),
            "diameters": network["pore.inscribed_diameter"].tolist(),
            "places": network["pore.coords"].tolist(),
        }))
    """
    python = environment("porespy", "porespy", "openpnm")
    told = subprocess.run([python, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path)
    found = json.loads(told.stdout.splitlines()[-1])
    voxels = voxelize(periodic, per_diameter=12)
    assert found["porosity"] == pytest.approx(voxels.porosity(), abs=1e-12)
    assert found["closed"] == found["apart"] == 0  # gaps of three voxels and more: the void is one
    # Of Voronoi cells some seven corners and fourteen faces to each, of which neighbours share the most.
    assert found["pores"] > 2 * len(periodic)
    assert found["throats"] > found["pores"]
    # In metres; the network has pores outside its faces, three voxels away.
    places, radii = np.array(found["places"]), np.array(found["diameters"]) / 2
    assert (np.abs(places - 0.5) < 0.5 + 5 * max(voxels.spacing)).all()
    assert 0.02 < np.median(radii) < 0.2


@pytest.mark.unit
def test_the_exact_surface_is_that_of_the_faces_and_coarse_voxels_are_told(periodic, tmp_path, caplog):
    exact = exact_specific_surface(periodic)
    assert exact == pytest.approx(integrate(periodic.grains).areas.sum() / periodic.domain.volume)
    slab = Domain.slab((1.0, 1.0), 0.1)
    flat = carve(tessellate([[0.5, 0.5]], slab), keep="all")
    assert exact_specific_surface(flat) == pytest.approx(4.0)
    save(periodic, tmp_path / "bed.h5")
    for per_diameter, is_wrong in ((5, True), (40, False)):
        caplog.clear()
        words = ["phases", str(tmp_path / "bed.h5"), "--per-diameter", str(per_diameter), "--json"]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, result.output
        found = json.loads(result.stdout)
        assert found["specific_surface_exact"] == pytest.approx(exact)
        assert any("is off by" in record.getMessage() for record in caplog.records) is is_wrong
        assert is_wrong or found["specific_surface"] == pytest.approx(exact, rel=0.05)


@pytest.mark.unit
@pytest.mark.parametrize("region", [None, ((0.1, 0.1, 0.1), (0.8, 0.7, 0.9))])
def test_the_surface_counted_while_voxels_are_written_is_that_of_the_voxels(periodic, tmp_path, region):
    file = write_voxels(periodic, tmp_path / "a.npy", per_diameter=8, region=region, surface=True)
    voxels = voxelize(periodic, per_diameter=8, region=region)
    assert file.specific_surface == pytest.approx(specific_surface(voxels, method="crofton"), rel=1e-12)
    # Counted once more, all pairs of all voxels at once, wrapped by NumPy.
    if region is None:
        phase = voxels.phase()
        views = [(phase != np.roll(phase, 1, axis)).mean() / voxels.spacing[2 - axis] for axis in range(3)]
        assert file.specific_surface == pytest.approx(2 * np.mean(views), rel=0.1)
    assert np.isnan(write_voxels(periodic, tmp_path / "a.npy", per_diameter=8).specific_surface)


@pytest.mark.unit
def test_voxels_warn_where_they_are_too_coarse_for_the_surface(periodic, tmp_path, caplog):
    save(periodic, tmp_path / "bed.h5")
    for per_diameter, is_wrong in ((3, True), (24, False)):
        caplog.clear()
        words = ["voxels", str(tmp_path / "bed.h5"), str(tmp_path / "a.raw"), "--per-diameter", str(per_diameter)]
        result = CliRunner().invoke(app, [*words, "--json"])
        assert result.exit_code == 0, result.output
        found = json.loads(result.stdout)
        assert (abs(found["specific_surface"] / found["exact_specific_surface"] - 1) > 0.05) is is_wrong
        assert any("specific surface is off by" in record.getMessage() for record in caplog.records) is is_wrong


@pytest.mark.client
def test_the_two_phase_function_is_written_in_one_byte_a_voxel(periodic, tmp_path):
    import pyvista

    write_voxels(periodic, tmp_path / "a.npy", size=0.05, phase=True)
    written = np.load(tmp_path / "a.npy")
    assert written.dtype == np.uint8
    np.testing.assert_array_equal(written, voxelize(periodic, size=0.05).phase())
    write_voxels(periodic, tmp_path / "a.vti", size=0.05, phase=True)
    np.testing.assert_array_equal(pyvista.read(tmp_path / "a.vti").cell_data["phase"], written.ravel())


@pytest.mark.unit
def test_a_broken_off_file_leaves_nothing_and_other_suffixes_are_refused(periodic, tmp_path, monkeypatch):
    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_voxels(periodic, tmp_path / "a.npy", size=0.1, progress=stop)
    with pytest.raises(WriteError, match="cannot be written"):
        write_voxels(periodic, tmp_path / "no" / "a.npy", size=0.1)
    with pytest.raises(FileFormatError, match=r"\.npy, \.nrrd, \.raw, \.tif, \.tiff, \.vti; got '\.bin'"):
        write_voxels(periodic, tmp_path / "a.bin", size=0.1)
    monkeypatch.setitem(sys.modules, "tifffile", None)
    with pytest.raises(MissingPackageError, match=r'pip install "grainsdem\[images\]"'):
        write_voxels(periodic, tmp_path / "a.tif", size=0.1)
    assert list(tmp_path.iterdir()) == []


def s2_by_hand(labels, periodic, offset):
    """Return S₂ at an offset (z, y, x), pair by pair."""
    solid = pairs = 0
    for start in np.ndindex(labels.shape):
        end = [a + b for a, b in zip(start, offset, strict=True)]
        end = [e % n if wraps else e for e, n, wraps in zip(end, labels.shape, periodic, strict=True)]
        if all(0 <= e < n for e, n in zip(end, labels.shape, strict=True)):
            a, b = labels[start], labels[tuple(end)]
            pairs += a >= 0 and b >= 0
            solid += a > 0 and b > 0
    return solid, pairs


@pytest.mark.property
@pytest.mark.parametrize("periodic", [(False, False, False), (True, False, True)])
def test_the_two_point_correlation_counts_each_pair_of_voxels(periodic):
    labels = np.random.default_rng(1).integers(-1, 3, (7, 8, 9)).astype(np.int32)
    found = two_point_correlation(image(labels, periodic=periodic), farthest=3.0)
    zyx = periodic[::-1]
    for row, unit in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0))):
        for k in range(4):
            solid, pairs = s2_by_hand(labels, zyx, tuple(k * u for u in unit))
            assert found.along[row, k] == pytest.approx(solid / pairs, rel=1e-12)
    ring = [o for o in itertools.product(range(-3, 4), repeat=3) if round(np.linalg.norm(o)) == 2]
    counts = np.array([s2_by_hand(labels, zyx, o) for o in ring])
    assert found.values[2] == pytest.approx(counts[:, 0].sum() / counts[:, 1].sum(), rel=1e-12)
    assert found.distances[2] == pytest.approx(
        np.average([np.linalg.norm(o) for o in ring], weights=counts[:, 1]), rel=1e-12
    )


@pytest.mark.property
def test_the_two_point_correlation_begins_at_phi_and_tends_to_its_square(periodic):
    voxels = voxelize(periodic, size=1 / 48)
    found = two_point_correlation(voxels, farthest=0.5)
    solid = 1 - voxels.porosity()
    assert found.solid_fraction == found.values[0] == pytest.approx(solid, rel=1e-12)
    assert found.values[-5:] == pytest.approx(solid**2, rel=0.05)


@pytest.mark.property
@pytest.mark.parametrize("wraps", [False, True])
def test_chords_are_the_runs_between_voxels_of_the_other_phase(wraps):
    rng = np.random.default_rng(4)
    rows = rng.choice([-1, 0, 0, 1, 1], size=(1, 50, 12)).astype(np.int32)
    found = chord_lengths(image(rows, periodic=(wraps, False, False)), "x")
    expected = {0: [], 1: []}
    for row in rows[0].tolist():
        if wraps:
            if len(set(row)) == 1:
                continue
            start = next(k for k in range(12) if row[k] != row[k - 1])
            row = row[start:] + row[:start]  # noqa: PLW2901  (the same row, begun elsewhere)
        runs = [(value, len(list(group))) for value, group in itertools.groupby(row)]
        for k, (value, length) in enumerate(runs):
            if not wraps and k in (0, len(runs) - 1):
                continue
            if min(value, runs[k - 1][0], runs[(k + 1) % len(runs)][0]) >= 0:
                expected[value].append(length)
    for value, counts in ((0, found.void), (1, found.solid)):
        np.testing.assert_array_equal(counts, np.bincount(expected[value], minlength=len(counts)))


@pytest.mark.unit
def test_chords_run_along_the_axis_that_is_asked_for():
    packing = cube_packing([[3, 3, 3]], half=1.0, domain=Domain.box((6.0, 7.0, 8.0)))
    for axis, size in (("x", 2), ("y", 2), ("z", 2)):
        chords = chord_lengths(voxelize(packing, size=0.5), axis)
        assert chords.mean("solid") == size
        assert np.isnan(chords.mean("void"))
        assert chords.solid.sum() == 16


@pytest.mark.statistical
def test_surface_and_chords_come_nearer_to_the_exact_ones_at_their_rates(periodic):
    measured = integrate(periodic.grains)
    exact, solid = measured.areas.sum(), measured.volumes.sum()
    surfaces, chords = [], []
    for n in (36, 72):
        voxels = voxelize(periodic, size=1 / n)
        surfaces.append([specific_surface(voxels, method=m) / exact - 1 for m in ("correlation", "crofton")])
        means = [np.mean([chord_lengths(voxels, axis).mean(phase) for axis in "xyz"]) for phase in ("solid", "void")]
        chords.append([means[0] * exact / (4 * solid) - 1, means[1] * exact / (4 * (1 - solid)) - 1])
    (by_slope, by_lines), (by_slope_fine, by_lines_fine) = surfaces
    assert abs(by_slope) < 0.02
    assert abs(by_slope_fine) < 0.005
    assert -0.08 < by_lines < -0.04
    assert by_lines / by_lines_fine == pytest.approx(2, abs=0.3)
    # Lines along three axes see the sixty grains a little other than lines from all sides: 1 %.
    assert np.all(np.abs(chords[0]) < 0.07)
    assert np.all(np.abs(chords[1]) < 0.04)


# Shares of the sphere nearest to each of the 26 directions to the nearest voxels (Ohser and Schladitz 2009).
SHARES = {1: 0.0457778912, 2: 0.0369806250, 3: 0.0351956310}


def seen(normal, *, is_plane=False):
    """Return how much is seen of faces: all directions to the nearest voxels, each with its share, along the normal."""
    directions = [d for d in itertools.product((-1, 0, 1), repeat=3) if any(d) and not (is_plane and d[2])]
    shares = np.array([1 / 8 if is_plane else SHARES[sum(map(abs, d))] for d in directions])
    units = np.array([np.array(d) / np.linalg.norm(d) for d in directions])
    assert sum(shares) == pytest.approx(1)
    along = np.abs(np.array(normal) @ units.T) / np.linalg.norm(normal, axis=-1, keepdims=True)
    return (np.pi / 2 if is_plane else 2) * along @ shares


@pytest.mark.unit
@pytest.mark.parametrize("method", ["correlation", "crofton"])
@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 1, 1), (1, 1, 1), (0, 1, 2), (1, 2, 5)])
@pytest.mark.parametrize("is_plane", [False, True])
def test_layers_are_seen_as_large_as_their_direction_says_at_every_size_of_voxel(method, normal, is_plane):
    # Layers of solid and of void in turns, thicker than two steps in any direction.
    normal = (*normal[::-1][:2], 0) if is_plane else normal
    for half in (18, 27):
        n = 2 * half
        places = np.stack(np.meshgrid(*[np.arange(n)] * 2, np.arange(1 if is_plane else n), indexing="ij"), axis=-1)
        labels = ((places @ np.array(normal)) % n < half).astype(np.int32).T
        exact = 2 * np.linalg.norm(normal) / n
        found = specific_surface(image(labels, periodic=(True, True, True)), method=method)
        assert found / exact == pytest.approx(seen(normal, is_plane=is_plane), rel=1e-3)


@pytest.mark.unit
def test_the_bias_of_direction_has_the_bounds_that_the_docs_give_and_none_over_all_directions():
    rng = np.random.default_rng(2)
    for is_plane, least, most, spread in ((False, 0.927, 1.023, 0.016), (True, 0.948, 1.026, 0.023)):
        normals = rng.standard_normal((100_000, 3)) * (1, 1, not is_plane)
        found = seen(np.vstack([[1, 0, 0], normals]), is_plane=is_plane)
        assert found.min() == pytest.approx(least, abs=5e-4) == pytest.approx(found[0], abs=5e-4)
        assert found.max() == pytest.approx(most, abs=5e-4)
        assert found.mean() == pytest.approx(1, abs=5 * spread / np.sqrt(100_000))
        assert found.std() == pytest.approx(spread, rel=0.1)


@pytest.mark.unit
@pytest.mark.parametrize("h", [0.1, 0.05])
def test_aligned_cubes_and_squares_keep_the_bias_of_direction_and_a_ball_and_a_disc_have_none(h):
    cubes = voxelize(cube_packing([[2.0, 2.0, 2.0]], domain=Domain.cube(4.0)), size=h)
    assert specific_surface(cubes) / (24 / 64) == pytest.approx(seen((0, 0, 1)), abs=3e-3)  # 0.927
    middles = np.arange(h / 2, 4, h) - 2
    square = (np.abs(middles)[None, :, None] < 1) & (np.abs(middles) < 1)
    flat = seen((1, 0, 0), is_plane=True)
    assert specific_surface(image(square, spacing=(h, h, h))) / (8 / 16) == pytest.approx(flat, abs=3e-3)  # 0.948
    x, y, z = np.meshgrid(middles + 0.013, middles + 0.029, middles + 0.041, indexing="ij")
    ball = specific_surface(image(x**2 + y**2 + z**2 < 1, spacing=(h, h, h)))
    assert ball / (4 * np.pi / 64) == pytest.approx(1, abs=0.01)
    disc = specific_surface(image((x**2 + y**2 < 1)[None, :, :, 0], spacing=(h, h, h)))
    assert disc / (2 * np.pi / 16) == pytest.approx(1, abs=0.02)
    chords = chord_lengths(cubes, "y").mean("solid")
    assert chords == pytest.approx(1.5 * 4 * 8 / 24, rel=1e-12)


@pytest.mark.statistical
def test_the_perimeter_of_a_planar_bed_is_read_from_its_one_layer(flat):
    measured, thick = integrate(flat.grains), flat.domain.lengths[2]
    exact = (measured.areas - 2 * measured.volumes / thick).sum() / thick
    voxels = voxelize(flat, size=1 / 400)
    assert voxels.labels.shape == (1, 400, 400)
    assert specific_surface(voxels) == pytest.approx(exact, rel=0.02)
    assert specific_surface(voxels, method="crofton") == pytest.approx(exact, rel=0.03)
    assert voxels.porosity() == pytest.approx(1 - measured.volumes.sum() / 0.1, abs=2e-3)


@pytest.mark.unit
def test_odd_requests_are_refused(periodic):
    voxels = voxelize(periodic, size=0.1)
    for options, match in (
        ({"size": 0.1, "per_diameter": 3}, "size or per_diameter, not both"),
        ({"size": np.nan}, "size must be 1e-30 to 1e.30 m; got nan"),
        ({"per_diameter": -1}, "per_diameter must be positive"),
        ({"size": 1e-4}, "at most 4294967296 voxels are held in memory; got 10000 × 10000 × 10000"),
        ({"size": 1e-12}, "at most 2147483647 voxels along an axis"),
        ({"region": ([0, 0, 0], [1, 1, -1])}, "upper corner must lie above"),
        ({"region": 3}, "2 values, each an array of numbers or None; got 3"),
    ):
        with pytest.raises(InputError, match=match):
            voxelize(periodic, **options)
    with pytest.raises(InputError, match="'x', 'y' or 'z'; got 'w'"):
        chord_lengths(voxels, "w")
    with pytest.raises(InputError, match="'correlation' or 'crofton'; got 'guess'"):
        specific_surface(voxels, method="guess")
    with pytest.raises(InputError, match="three voxels along each axis"):
        specific_surface(voxelize(periodic, size=0.5))
    with pytest.raises(InputError, match=r"farthest must be between a voxel, 0\.1 m, and half"):
        two_point_correlation(voxels, farthest=0.7)
    with pytest.raises(InputError, match="voxels must be one at least"):
        image(np.zeros((0, 1, 1)))
    outside = image(np.full((4, 4, 4), -1))
    with pytest.raises(InputError, match="no voxel lies in the domain"):
        outside.porosity()
    with pytest.raises(InputError, match="no voxel lies in the domain"):
        two_point_correlation(outside)


@pytest.mark.unit
def test_the_command_line_writes_voxels_and_measures_phases(periodic, tmp_path):
    bed, table, figure = tmp_path / "bed.h5", tmp_path / "s2.csv", tmp_path / "s2.png"
    grainsdem.save(periodic, bed)

    def call(*words):
        return CliRunner().invoke(app, [str(word) for word in words])

    result = call("voxels", bed, tmp_path / "a.npy", "--resolution", 0.05, "--json")
    told = json.loads(result.stdout)
    assert told["counts"] == [20, 20, 20]
    assert told["porosity"] == pytest.approx(told["exact_porosity"], abs=0.01)
    assert np.load(tmp_path / "a.npy").shape == (20, 20, 20)
    result = call("phases", bed, "--resolution", 0.02, "--table", table, "--figure", figure, "--json")
    told = json.loads(result.stdout)
    assert told["specific_surface"] == pytest.approx(integrate(periodic.grains).areas.sum(), rel=0.02)
    assert np.genfromtxt(table, delimiter=",", names=True)["s2"][0] == pytest.approx(1 - told["porosity"])
    assert figure.stat().st_size > 10_000
    result = call("voxels", bed, tmp_path / "b.jpg")
    assert result.exit_code == 2
    assert "voxels are written as" in result.stderr
    assert call("phases", bed, "--per-diameter", 6).output.count("mean chord") == 6
