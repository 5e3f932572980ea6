from __future__ import annotations

import numpy as np
import pytest

from grainsdem.errors import InputError, ShapeError
from grainsdem.model import Domain
from grainsdem.points import noise_field, pink_noise
from grainsdem.points.fields.tones import spread

pytestmark = pytest.mark.unit

BETAS = [0.0, 0.5, 1.0, 2.5, 5.0]


def slope(amplitudes):
    """Return the exponent of amplitudes at frequencies 1, 2, 3, …."""
    return np.polyfit(np.log(np.arange(1, len(amplitudes) + 1)), np.log(amplitudes), 1)[0]


@pytest.mark.parametrize("beta", BETAS)
@pytest.mark.parametrize("shape", [(64, 64), (48, 48, 48), (33, 47, 20)])
def test_the_amplitude_falls_by_its_exponent_along_every_axis(shape, beta):
    field = noise_field(shape, beta, lengths=np.ones(len(shape)), rng=7)
    amplitudes = np.abs(np.fft.fftn(field))
    for axis in range(field.ndim):
        line = np.moveaxis(amplitudes, axis, 0)[(slice(1, shape[axis] // 2), *[0] * (field.ndim - 1))]
        assert abs(slope(line) + beta) < 0.1


@pytest.mark.parametrize("beta", BETAS)
@pytest.mark.parametrize("shape", [(64, 64), (48, 48, 48)])
def test_the_radially_averaged_amplitude_falls_by_its_exponent(shape, beta):
    amplitudes = np.abs(np.fft.fftn(noise_field(shape, beta, rng=3)))
    k = np.stack(np.meshgrid(*[np.fft.fftfreq(size, 1 / size) for size in shape], indexing="ij"))
    radius = np.sqrt((k**2).sum(axis=0)).ravel()
    ring = np.rint(radius).astype(int)
    # The innermost rings are as wide as they are far from the middle: their mean says little of their radius.
    rings = slice(4, shape[0] // 2)
    mean, at = (np.bincount(ring, values)[rings] / np.bincount(ring)[rings] for values in (amplitudes.ravel(), radius))
    assert abs(np.polyfit(np.log(at), np.log(mean), 1)[0] + beta) < 0.1


@pytest.mark.statistical
def test_beta_zero_is_white():
    field = noise_field((64, 64, 64), 0.0, rng=1)
    for axis in range(3):
        for lag in (1, 2, 5):
            assert abs(np.mean(field * np.roll(field, lag, axis))) < 5 / np.sqrt(field.size)


@pytest.mark.parametrize("shape", [(96, 96), (48, 48, 48)])
def test_no_axis_alternates_in_sign(shape):
    # A spectrum centred on the array's corner makes neighbours along one axis opposite.
    field = noise_field(shape, 2.0, rng=5)
    together = [np.mean(field * np.roll(field, 1, axis)) for axis in range(field.ndim)]
    assert min(together) > 0.5
    assert np.ptp(together) < 0.05


@pytest.mark.parametrize("beta", [1.0, 3.0])
def test_the_field_goes_on_across_opposite_faces(beta):
    field = noise_field((64, 64), beta, rng=2)
    steps = np.abs(np.diff(field, axis=0)).mean()
    assert 0.5 * steps < np.abs(field[0] - field[-1]).mean() < 2 * steps


def test_lengths_make_it_isotropic_in_metres():
    # Twice as many voxels along x as along y, for the same length: as alike two voxels apart as one.
    field = noise_field((128, 64), 2.0, lengths=(1.0, 1.0), rng=2)
    lag_x, lag_y = (np.mean(field * np.roll(field, lag, axis)) for lag, axis in ((8, 0), (4, 1)))
    assert abs(lag_x - lag_y) < 0.03


@pytest.mark.parametrize("shape", [(10,), (9, 8), (1, 12), (6, 5, 4)])
@pytest.mark.parametrize("beta", [-500.0, 0.0, 1.0, 500.0])
def test_mean_and_deviation_are_those_of_the_standard_normal(shape, beta):
    field = noise_field(shape, beta, rng=1)
    assert field.shape == shape
    assert field.mean() == pytest.approx(0.0, abs=1e-12)
    assert field.std() == pytest.approx(1.0)


def test_the_same_rng_gives_the_same_bytes_and_another_gives_others():
    one, two, other = (noise_field((20, 20), 1.0, rng=k).tobytes() for k in (3, 3, 4))
    assert one == two != other
    one, two, other = (pink_noise(Domain.cube(), 50, resolution=16, rng=k).tobytes() for k in (3, 3, 4))
    assert one == two != other


@pytest.mark.statistical
@pytest.mark.parametrize("domain", [Domain.cube(), Domain.slab((1.0, 1.0), 0.1)], ids=["3-D", "2-D"])
def test_seeds_are_as_dense_as_the_noise_is_strong(domain):
    k, n = 2 if domain.is_planar else 3, 30_000
    seeds = pink_noise(domain, n, beta=2.0, resolution=8, rng=6)
    density = spread(noise_field((8,) * k, 2.0, rng=6))
    expected = n * density / density.sum()
    found = np.histogramdd(seeds[:, :k], bins=(8,) * k, range=[(0, 1)] * k)[0]
    assert found[expected == 0].sum() == 0
    some = expected > 5
    error = (found[some] - expected[some]) / np.sqrt(expected[some])
    assert abs((error**2).mean() - 1) < 5 * np.sqrt(2 / some.sum())


def test_larger_exponents_gather_seeds_more():
    def crowding(beta):
        seeds = pink_noise(Domain.cube(), 20_000, beta=beta, resolution=32, rng=1)
        counts = np.histogramdd(seeds, bins=(4, 4, 4), range=[(0, 1)] * 3)[0]
        return counts.var() / counts.mean()

    found = [crowding(beta) for beta in (0.0, 1.0, 2.0, 4.0)]
    assert found == sorted(found)
    assert found[-1] > 10 * found[0]


def test_voxels_are_cubes_in_a_long_domain():
    seeds = pink_noise(Domain.box((4.0, 1.0, 0.5)), 200, resolution=64, threshold=0.5, rng=1)
    assert len(seeds) == 200
    assert seeds[:, 0].max() > 3.0


def test_a_threshold_leaves_the_weaker_half_empty_but_for_the_floor():
    field = spread(noise_field((16, 16), 2.0, rng=3))
    for floor in (0.0, 0.25):
        seeds = pink_noise(
            Domain.slab((1.0, 1.0), 0.1), 20_000, beta=2.0, resolution=16, threshold=0.5, floor=floor, rng=3
        )
        dark = field[tuple((16 * seeds[:, :2]).astype(int).T)] <= 0.5
        share = floor * (field <= 0.5).sum() / (floor * (field <= 0.5).sum() + (field > 0.5).sum())
        assert abs(dark.mean() - share) <= 5 * np.sqrt(share * (1 - share) / 20_000)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"n": 0}, "1 or more; got 0"),
        ({"beta": np.nan}, "beta must be finite; got nan"),
        ({"resolution": 1}, "resolution must be 2 voxels or more; got 1"),
        ({"gain": 5.0, "threshold": 0.5}, "either a gain or a threshold; got gain = 5.0, threshold = 0.5"),
        ({"gain": -1.0}, "gain must be finite and above 0; got -1.0"),
        ({"threshold": 1.5}, "threshold must be between 0 and 1; got 1.5"),
        ({"cutoff": -0.5}, "cutoff must be between 0 and 1; got -0.5"),
        ({"floor": 2.0}, "floor must be between 0 and 1; got 2.0"),
    ],
)
def test_numbers_out_of_range_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        pink_noise(Domain.cube(), **{"n": 5, "resolution": 8, **options})


@pytest.mark.parametrize(
    ("shape", "lengths"), [((), None), ((1, 1), None), ((0, 4), None), ((2,) * 4, None), ((4, 4), (1.0,))]
)
def test_fields_of_another_shape_are_refused(shape, lengths):
    with pytest.raises(ShapeError, match="one to three axes"):
        noise_field(shape, 1.0, lengths=lengths)
    with pytest.raises(InputError, match="above 0 m"):
        noise_field((4, 4), 1.0, lengths=(1.0, 0.0))
