"""Starts that a search finds by itself: from any gains, or none, to the same optimum; a bound is said loudly."""

import pytest
from tuning_loops import COARSE, stiff

import fpjax as fp
import tuning

GAINS = ("observer.gain_1", "observer.gain_2")


@pytest.fixture(scope="module")
def from_fair_gains():
    return tuning.tune(stiff(), fp.Sine(1.0, 0.5), parameters=GAINS, **COARSE)


def test_gains_far_off_end_where_fair_ones_do(from_fair_gains):
    far = tuning.tune(stiff(1e-5, 1e-5), fp.Sine(1.0, 0.5), parameters=GAINS, **COARSE)
    # Both end in one valley, along which the cost changes by less than a per cent.
    assert far.cost == pytest.approx(from_fair_gains.cost, rel=0.01)
    assert far.starts > 1
    assert far.at_bounds == {}
    assert "NOT AN OPTIMUM" not in str(far)


@pytest.mark.long
def test_more_starts_find_nothing_better(from_fair_gains):
    many = tuning.tune(stiff(), fp.Sine(1.0, 0.5), parameters=GAINS, starts=16, spread=2.0, **COARSE)
    # As in `benchmarks defaults`: within 10 % counts as reached.
    assert from_fair_gains.cost <= 1.1 * many.cost


def test_the_screen_is_counted(from_fair_gains):
    assert from_fair_gains.simulations >= tuning.start_values.SCREENED


def test_a_result_at_a_bound_is_said_first():
    held = [tuning.Parameter(name, 100.0, 90.0, 110.0) for name in GAINS]
    result = tuning.tune(stiff(), fp.Sine(1.0, 0.5), parameters=held, **COARSE)
    assert result.at_bounds
    assert str(result).startswith("NOT AN OPTIMUM: observer.gain")


@pytest.mark.long  # another objective: its Jacobian compiles for four seconds
def test_what_is_there_for_comparing_starts_where_it_is_told():
    result = tuning.tune(stiff(), fp.Sine(1.0, 0.5), parameters=GAINS, objective="thesis", max_simulations=12, **COARSE)
    assert result.starts == 1
