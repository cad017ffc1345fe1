"""docs/thesis.md: gains that estimate exist, and the tuning finds them."""

import importlib.util
import pathlib

import jax
import numpy as np
import pytest

import fpjax

EXAMPLE = pathlib.Path(__file__).parents[2] / "examples" / "04_tune_for_estimation.py"


@pytest.fixture(scope="module")
def example():
    """The example as a module: it is the command that the docs name."""
    specification = importlib.util.spec_from_file_location("tune_for_estimation", EXAMPLE)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def estimates(example, gains):
    """(b_hat(30 s), largest |b_hat|) for every true b, in the thesis' units."""
    found = []
    for viscous in example.TRUE_VISCOUS:
        run = fpjax.simulate(
            example.loop_with(*gains, viscous=viscous),
            example.REFERENCE,
            dt=example.DT,
            duration=30.0,
            measures={"final": fpjax.EstimateFinal("viscous"), "peak": fpjax.EstimatePeak("viscous")},
        )
        found.append([float(run.measures[name]) / example.DEGREE for name in ("final", "peak")])
    return np.array(found).T


@pytest.mark.slow
def test_the_estimation_objective_finds_gains_that_follow_every_true_b(example):
    result = example.find_gains()
    tuned = (result.gains["observer.gain_2"], result.gains["observer.gain_1"] / example.DEGREE)
    truth = np.array(example.TRUE_VISCOUS)
    final, peak = estimates(example, tuned)
    # The slow mode settles in seconds, and 30 s are simulated; 5 % is far from the 100 % that the thesis' gains miss.
    np.testing.assert_allclose(final, truth, rtol=0.05)
    # The price: on its way b_hat swings to hundreds of times the truth.
    assert np.all(peak > 500.0)
    theirs, _ = estimates(example, (72.6, 298.0))
    assert np.all(np.abs(theirs - 2.0) < 2.0), "the thesis' gains return about 2 whatever b is"
    by_hand, swing = estimates(example, (10.0, 5e4))
    np.testing.assert_allclose(by_hand, truth, rtol=0.05)
    # To 3,700 with its own step; here the step is twice that and the friction smooth.
    np.testing.assert_allclose(swing, 3700.0, rtol=0.05)


@pytest.mark.slow
def test_noise_is_the_other_price(example):
    """Velocity noise of a thousandth of the amplitude spreads b_hat by more than the truth itself."""
    spread = []
    for gains in ((72.6, 298.0), (10.0, 5e4)):
        run = fpjax.simulate(
            example.loop_with(*gains, noise=example.NOISE),
            example.REFERENCE,
            dt=example.DT,
            duration=30.0,
            stepping="sampled",
            record=("estimates.viscous",),
            key=jax.random.key(0),
        )
        assert not run.diverged
        spread.append(np.std(np.asarray(run.signals["estimates.viscous"])[100_000:]) / example.DEGREE)
    assert spread[1] > 5.0 * spread[0]
    assert spread[1] > 2.0
