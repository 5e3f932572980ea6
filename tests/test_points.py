from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, qmc

from grainsdem.errors import FileFormatError, InputError, MissingFileError, ShapeError
from grainsdem.model import Domain
from grainsdem.points import check_seeds, halton, poisson, read

pytestmark = pytest.mark.unit

BOX = Domain(np.array([1.0, -2.0, 0.5]), np.array([3.0, -1.0, 4.5]))


@pytest.mark.parametrize("process", [poisson, halton])
def test_seeds_fill_the_domain_they_are_given(process):
    seeds = process(BOX, 400, rng=1)
    assert seeds.shape == (400, 3)
    assert (seeds >= BOX.lower).all()
    assert (seeds <= BOX.upper).all()
    np.testing.assert_allclose(seeds.mean(axis=0), (BOX.lower + BOX.upper) / 2, atol=0.12 * BOX.lengths.max())


@pytest.mark.parametrize("process", [poisson, halton])
def test_the_same_rng_gives_the_same_bytes_and_another_gives_others(process):
    assert process(BOX, 50, rng=3).tobytes() == process(BOX, 50, rng=3).tobytes()
    assert process(BOX, 50, rng=3).tobytes() != process(BOX, 50, rng=4).tobytes()


@pytest.mark.parametrize("process", [poisson, halton])
def test_planar_domains_get_seeds_in_their_mid_plane(process):
    assert (process(Domain.slab((1.0, 1.0), 0.2), 20, rng=1)[:, 2] == 0.1).all()


def test_halton_is_scipys_sequence():
    ours = halton(Domain.cube(), 1000, start=0)
    theirs = qmc.Halton(3, scramble=False).random(1000)
    np.testing.assert_allclose(ours, theirs, atol=1e-15)


def test_halton_in_bases_two_and_three_begins_as_in_the_books():
    first = halton(Domain.cube(), 4, bases=(2, 3, 5))
    np.testing.assert_allclose(first[:, 0], [1 / 2, 1 / 4, 3 / 4, 1 / 8])
    np.testing.assert_allclose(first[:, 1], [1 / 3, 2 / 3, 1 / 9, 4 / 9])


@pytest.mark.statistical
def test_halton_is_more_even_than_random():
    cube = Domain.cube()
    random = [qmc.discrepancy(poisson(cube, 500, rng=k)) for k in range(10)]
    assert qmc.discrepancy(halton(cube, 500)) < 0.2 * min(random)


@pytest.mark.statistical
def test_poisson_counts_in_sub_boxes_are_multinomial():
    n, k = 20_000, 5
    seeds = poisson(Domain.cube(), n, rng=8)
    counts = np.histogramdd(seeds, bins=(k, k, k), range=[(0, 1)] * 3)[0]
    statistic = ((counts - n / k**3) ** 2 / (n / k**3)).sum()
    low, high = chi2.ppf([1e-4, 1 - 1e-4], k**3 - 1)
    assert low < statistic < high


@pytest.mark.parametrize("n", [0, -3])
def test_fewer_than_one_seed_is_refused(n):
    with pytest.raises(InputError, match=f"1 or more; got {n}"):
        poisson(BOX, n)
    with pytest.raises(InputError, match=f"1 or more; got {n}"):
        halton(BOX, n)


@pytest.mark.parametrize("bases", [(2, 4, 5), (1, 3, 5), (2, 3)])
def test_bases_with_a_common_factor_are_refused(bases):
    with pytest.raises(InputError, match="common factor"):
        halton(BOX, 10, bases=bases)


def test_seeds_that_are_not_finite_are_named():
    seeds = poisson(BOX, 20, rng=1)
    seeds[[3, 7], 1] = np.nan
    with pytest.raises(InputError, match="2 of 20 are not: 3, 7"):
        check_seeds(seeds, BOX)


def test_seeds_outside_the_domain_are_named_the_first_five():
    seeds = poisson(BOX, 20, rng=1)
    seeds[4:12, 0] = 9.0
    with pytest.raises(InputError, match="8 of 20 lie outside: 4, 5, 6, 7, 8 and 3 more"):
        check_seeds(seeds, BOX)


def test_seeds_that_coincide_are_named_in_pairs():
    seeds = poisson(BOX, 20, rng=1)
    seeds[17] = seeds[2]
    with pytest.raises(InputError, match="1 pairs coincide: 2–17"):
        check_seeds(seeds, BOX)


def test_seeds_that_coincide_across_a_periodic_face_are_found():
    cube = Domain.cube(periodic=True)
    with pytest.raises(InputError, match="0–1"):
        check_seeds([[0.0, 0.5, 0.5], [1.0, 0.5, 0.5]], cube)
    check_seeds([[0.0, 0.5, 0.5], [1.0, 0.5, 0.5]], Domain.cube())


@pytest.mark.parametrize("seeds", [[], np.empty((0, 3))])
def test_no_seeds_at_all_are_refused(seeds):
    with pytest.raises(InputError, match="at least one seed"):
        check_seeds(seeds, BOX)


@pytest.mark.parametrize("seeds", [[1.0, 2.0, 3.0], [[1.0, 2.0]], [["a", "b", "c"]]])
def test_seeds_of_another_shape_are_refused(seeds):
    with pytest.raises(ShapeError, match=r"seeds must (be an array of numbers|have shape)"):
        check_seeds(seeds, BOX)


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".npy", ".npz"])
def test_seeds_come_back_from_every_kind_of_file(tmp_path, suffix):
    seeds = poisson(BOX, 30, rng=2)
    path = tmp_path / f"seeds{suffix}"
    if suffix == ".txt":
        np.savetxt(path, seeds, fmt="%.17g")
    elif suffix == ".csv":
        np.savetxt(path, seeds, fmt="%.17g", delimiter=",", header="x,y,z", comments="")
    elif suffix == ".npy":
        np.save(path, seeds)
    else:
        np.savez(path, points=seeds, other=np.arange(3))
    np.testing.assert_array_equal(read(path), seeds)


def test_an_empty_file_holds_no_seeds(tmp_path):
    path = tmp_path / "seeds.txt"
    path.write_text("# nothing yet\n")
    with pytest.raises(InputError, match="at least one seed"):
        check_seeds(read(path), BOX)


def test_missing_foreign_and_broken_seed_files_get_one_clear_error(tmp_path):
    with pytest.raises(MissingFileError, match="no such file"):
        read(tmp_path / "none.txt")
    with pytest.raises(FileFormatError, match=r"\.npz; got '\.mat'"):
        read(tmp_path / "seeds.mat")
    for name, content in [("a.txt", b"1 2 3\n4 five 6\n"), ("b.npz", b"PK broken"), ("c.csv", b"1,2,3,4\n")]:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FileFormatError, match=name):
            read(tmp_path / name)
