from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from loading import grow
from scipy.stats import t

from grainsdem.dynamics import Ensemble, collapse, ensemble, settle, triaxial
from grainsdem.dynamics.ensembles import half_width
from grainsdem.errors import InputError
from grainsdem.storage import load_history


@pytest.fixture(scope="module")
def runs(tmp_path_factory, shake):
    """The same two runs, stepped together, and each in a process of its own."""
    grains, options = grow(12), {"strain": 0.01, "inertial_number": 0.1, "seeds": [4, 7]}
    folder = tmp_path_factory.mktemp("ensemble")
    together = ensemble(triaxial, grains, through="batch", history_folder=folder / "runs", **options)
    return together, ensemble(triaxial, grains, through="processes", **options), folder / "runs"


@pytest.mark.slow
@pytest.mark.client
def test_runs_that_are_stepped_together_have_the_bits_of_those_that_are_alone(runs):
    together, alone, _ = runs
    assert together.through == "batch"
    assert alone.through == "processes"
    for one, other in zip(together.outcomes, alone.outcomes, strict=True):
        assert one.packing.positions.tobytes() == other.packing.positions.tobytes()
        for name, series in one.history.items():
            np.testing.assert_array_equal(series, other.history[name])


@pytest.mark.slow
@pytest.mark.client
def test_seeds_make_different_runs_and_each_has_its_history(runs):
    together, _, folder = runs
    one, other = together.outcomes
    assert not np.array_equal(one.packing.positions, other.packing.positions)
    for seed, outcome in zip(together.seeds, together.outcomes, strict=True):
        stored = load_history(folder / f"{seed}.h5")
        np.testing.assert_array_equal(stored["axial_stress"], outcome.history["axial_stress"][1:])


@pytest.mark.slow
@pytest.mark.client
def test_an_ensemble_tells_means_and_intervals_of_every_number(runs):
    together = runs[0]
    angles = together.values()["peak_friction_angle"]
    assert together.mean()["peak_friction_angle"] == pytest.approx(angles.mean())
    told = together.to_dict()
    assert told["seeds"] == [4, 7]
    assert "is_compressed" not in told
    assert told["peak_friction_angle"]["half_width"] == pytest.approx(
        t.ppf(0.975, 1) * abs(angles[1] - angles[0]) / 2, rel=1e-9
    )
    assert told["peak_friction_angle"]["n"] == 2
    assert told["dilatancy_angle"] == {"mean": None, "half_width": None, "n": 0}


@pytest.mark.client
def test_a_run_that_fails_ends_the_ensemble_with_its_error():
    with pytest.raises(InputError, match="release"):
        ensemble(collapse, grow(12), seeds=2, release=["roof"])


HEARD = []
"""Seeds of the runs that have told of their progress."""


def fail_later(packing, *, rng):
    """Shear a bed for long, but for seed 1, which fails at its first sample."""

    def hear(_fraction, _words):
        if rng == 1:
            raise InputError("enough")
        HEARD.append(rng)

    return triaxial(packing, rng=rng, strain=0.5, inertial_number=1e-3, progress=hear)


@pytest.mark.client
def test_runs_end_with_the_first_one_that_fails():
    HEARD.clear()
    with pytest.raises(InputError, match="enough"):
        ensemble(fail_later, grow(12), seeds=[0, 1])
    assert len(HEARD) <= 2


@pytest.mark.unit
def test_intervals_hold_the_mean_as_often_as_they_say():
    draws = np.random.default_rng(1).normal(3.0, 2.0, (4000, 5))
    held = np.abs(draws.mean(axis=1) - 3.0) < [half_width(row) for row in draws]
    assert held.mean() == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / 4000))


@pytest.mark.unit
def test_numbers_that_were_not_measured_are_left_out():
    assert half_width(np.array([1.0, np.nan, 3.0])) == pytest.approx(half_width(np.array([1.0, 3.0])))
    assert np.isnan(half_width(np.array([1.0, np.nan])))


@pytest.mark.unit
def test_a_curve_is_the_mean_of_the_second_stages_where_both_have_them():
    def run(slope, end):
        strain = np.concatenate([np.zeros(5), np.linspace(0, end, 30)])
        stage = np.r_[np.zeros(5), np.ones(30)]
        return SimpleNamespace(history={"stage": stage, "strain": strain, "stress": slope * strain + 9 * (1 - stage)})

    x, means, widths = Ensemble((0, 1), (run(1.0, 1.0), run(3.0, 0.5)), "batch").curve("strain", "stress", points=6)
    np.testing.assert_allclose(x, np.linspace(0, 0.5, 6))
    np.testing.assert_allclose(means, 2 * x, atol=1e-12)
    np.testing.assert_allclose(widths, t.ppf(0.975, 1) * x, atol=1e-12)


@pytest.mark.unit
def test_an_experiment_without_a_seed_is_no_ensemble(cube):
    def weigh(packing, *, scale=1.0):
        return packing, scale

    with pytest.raises(InputError, match="does not take rng"):
        ensemble(weigh, cube)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"seeds": 0}, "one at least"),
        ({"seeds": [1, 1]}, "differ"),
        ({"through": "magic"}, "'batch' or 'processes'"),
        ({"strian": 0.1}, "triaxial takes confining_pressure, strain, .*; no such option: strian"),
        ({"resume": True}, "no such option: resume"),
        ({"friction": "high"}, "friction: input should be a valid number; got 'high'"),
    ],
)
def test_what_an_ensemble_cannot_do_is_refused(cube, options, words):
    with pytest.raises(InputError, match=words):
        ensemble(triaxial, cube, **options)


@pytest.mark.unit
@pytest.mark.parametrize("options", [{}, {"start": "place"}, {"density": 2650.0}, {"density": {2650.0: 1.0}}])
def test_runs_that_would_be_copies_of_one_are_no_ensemble(cube, options):
    with pytest.raises(InputError, match=r"start = .place. is the same for every seed: .* .pour. or .rain."):
        ensemble(settle, cube, seeds=2, **options)
    with pytest.raises(InputError, match="friction"):  # the experiment's own word: what is not refused is run
        ensemble(settle, cube, seeds=2, **{**options, "start": "pour", "friction": -1.0})
    with pytest.raises(InputError, match="friction"):
        ensemble(settle, cube, seeds=1, **options, friction=-1.0)
