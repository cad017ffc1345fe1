"""Objectives: what they say of a run, and how they add up over cases."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from tuning_loops import CONSTANT, DEGREE, GAINS, PLAIN, SINE, THESIS, efp

import fpjax
import tuning
from fpjax import InputError
from tuning import problem as problem_module
from tuning.lanes import Lanes
from tuning.problem import make_problem

pytestmark = pytest.mark.usefixtures("unoptimised")
# Compiled by structure and shapes: called as they are, each call would compile its scan anew.
case_costs = eqx.filter_jit(problem_module.case_costs)
lane_cost = eqx.filter_jit(problem_module.lane_cost)
lane_residuals = eqx.filter_jit(problem_module.lane_residuals)


def test_the_thesis_cost_is_the_final_error_in_the_thesis_units():
    problem, start, _ = make_problem(efp(), SINE, GAINS, objective=THESIS, **PLAIN)
    run = fpjax.simulate(efp(), SINE, record=("estimates.coulomb", "estimates.viscous"), **PLAIN)
    expected = abs(20.0 - run.signals["estimates.coulomb"][-1]) + abs(
        2.0 - run.signals["estimates.viscous"][-1] / DEGREE
    )
    np.testing.assert_allclose(lane_cost(start, None, problem), expected, rtol=1e-9)


@pytest.mark.parametrize("start_time", [pytest.param(0.0, marks=pytest.mark.long), 0.02])
def test_the_estimation_cost_is_the_mean_of_squares_and_the_residuals_sum_to_it(start_time):
    objective = tuning.Estimation(start=start_time, noise=0.01, noise_weight=0.5)
    problem, start, _ = make_problem(efp(150.0), SINE, GAINS, objective=objective, **PLAIN)
    names = ("time", "velocity", "estimates.coulomb", "estimates.viscous")
    run = fpjax.simulate(efp(150.0), SINE, record=names, **PLAIN)
    late = np.asarray(run.time) >= start_time
    k, b = (np.asarray(run.signals[f"estimates.{name}"]) for name in ("coulomb", "viscous"))
    w = np.asarray(run.signals["velocity"])
    expected = np.mean(((k - 20.0) / 20.0)[late] ** 2) + np.mean((b / (2.0 * DEGREE) - 1.0)[late] ** 2)
    gain = np.mean((10.0 * np.tanh(150.0 * w) * 0.01 / 20.0) ** 2 + (100.0 * DEGREE * w * 0.01 / (2.0 * DEGREE)) ** 2)
    np.testing.assert_allclose(lane_cost(start, None, problem), expected + 0.5 * gain, rtol=1e-9)
    residuals = lane_residuals(start, None, problem)
    assert residuals.shape == (1, 2 * 2 * 16 + 1)  # two estimates, mean and spread in 16 bins, the noise
    np.testing.assert_allclose(jnp.sum(residuals**2), expected + 0.5 * gain, rtol=1e-9)


def test_tracking_is_the_mean_square_and_its_residuals_sum_to_it():
    problem, start, _ = make_problem(efp(150.0), SINE, GAINS, objective=tuning.Tracking(scale=0.1), **PLAIN)
    run = fpjax.simulate(efp(150.0), SINE, measures={"e": fpjax.MeanSquare()}, **PLAIN)
    np.testing.assert_allclose(lane_cost(start, None, problem), run.measures["e"] * 100.0, rtol=1e-9)
    np.testing.assert_allclose(jnp.sum(lane_residuals(start, None, problem) ** 2), run.measures["e"] * 100.0, rtol=1e-9)


def test_cases_are_references_x_plants_and_each_is_its_own_run():
    plants = {"plant.friction.viscous": [1.0 * DEGREE, 5.0 * DEGREE], "plant.inertia": [0.17, 0.2]}
    problem, start, labels = make_problem(
        efp(150.0), {"a": SINE, "b": CONSTANT}, GAINS, objective=THESIS, plants=plants, **PLAIN
    )
    costs = case_costs(start, None, problem)
    assert costs.shape == (2, 2, 1)
    assert labels == ("a", "b")
    for row, reference in enumerate((SINE, CONSTANT)):
        np.testing.assert_allclose(case_costs(start, jnp.asarray(row), problem)[0], costs[row], rtol=1e-12)
        for column, (viscous, inertia) in enumerate(zip(*plants.values(), strict=True)):
            loop = fpjax.blocks.parameters.set_parameters(
                efp(150.0), {"plant.friction.viscous": viscous, "plant.inertia": inertia}
            )
            alone, begin, _ = make_problem(loop, reference, GAINS, objective=THESIS, **PLAIN)
            np.testing.assert_allclose(lane_cost(begin, None, alone), costs[row, column, 0], rtol=1e-9)
    worst, _, _ = make_problem(
        efp(150.0), [SINE, CONSTANT], GAINS, objective=THESIS, plants=plants, aggregate="worst", **PLAIN
    )
    np.testing.assert_allclose(lane_cost(start, None, worst), np.max(costs), rtol=1e-12)
    np.testing.assert_allclose(lane_cost(start, None, problem), np.mean(costs), rtol=1e-12)


def test_noise_seeds_are_runs_with_that_noise():
    loop = efp(150.0, sensor=fpjax.Gyro(noise=0.01))
    sampled = {**PLAIN, "stepping": "sampled"}
    problem, start, _ = make_problem(loop, SINE, GAINS, objective=THESIS, noise_seeds=(1, 2), **sampled)
    costs = case_costs(start, None, problem)
    assert costs.shape == (1, 1, 2)
    assert costs[0, 0, 0] != costs[0, 0, 1]
    with pytest.raises(InputError, match="sensor with noise"):
        make_problem(efp(150.0), SINE, GAINS, noise_seeds=(1,), **PLAIN)


def test_single_precision_stays_single_and_says_the_same():
    loop, reference = (fpjax.astype(tree, jnp.float32) for tree in (efp(150.0), SINE))
    problem, start, _ = make_problem(loop, reference, GAINS, objective=THESIS, **PLAIN)
    cost = lane_cost(start, None, problem)
    double, begin, _ = make_problem(efp(150.0), SINE, GAINS, objective=THESIS, **PLAIN)
    assert cost.dtype == jnp.float32
    np.testing.assert_allclose(cost, lane_cost(begin, None, double), rtol=1e-3)


def test_a_diverged_run_costs_infinity():
    problem, _, _ = make_problem(efp(150.0), SINE, GAINS, objective=THESIS, **PLAIN)
    assert np.isinf(lane_cost(jnp.array([1e9, 1e9]), None, problem))


def test_nothing_recompiles_when_gains_references_plants_or_dt_change():
    from tuning import lanes

    before = None
    for dt, viscous, reference in ((1e-4, 2.0, SINE), (5e-5, 3.0, CONSTANT)):
        problem, start, _ = make_problem(
            efp(150.0, viscous=viscous), reference, GAINS, objective=THESIS, dt=dt, samples=200
        )
        each = Lanes(problem, np.asarray(start)[None], None)
        each.costs(np.asarray(start)[None, None])
        each.value_and_gradient(problem.space.coordinates(np.asarray(start)[None]), "auto")
        before = len(lanes._PROGRAMS) if before is None else before
    assert len(lanes._PROGRAMS) == before


@pytest.mark.parametrize(
    ("loop", "settings", "words"),
    [
        (efp(viscous=0.0), {}, "viscous is 0"),
        (efp(), {"objective": "mae"}, "not known"),
        (efp(), {"aggregate": "median"}, "not known"),
        (efp(), {"plants": {"observer.gain_1": [1.0, 2.0]}}, "both tuned and varied"),
        (efp(), {"plants": {"plant.inertia": [1.0, 2.0], "plant.friction.coulomb": [1.0]}}, "shapes"),
    ],
)
def test_what_cannot_be_is_said_in_one_sentence(loop, settings, words):
    with pytest.raises(InputError, match=words):
        make_problem(loop, SINE, GAINS, **PLAIN, **settings)


def test_a_loop_without_an_observer_or_a_truth_is_refused():
    bare = fpjax.ClosedLoop(efp().plant, efp().controller)
    with pytest.raises(InputError, match="no observer"):
        make_problem(bare, SINE, ["controller.kp"], **PLAIN)
    with pytest.raises(InputError, match="no reference"):
        make_problem(efp(), [], GAINS, **PLAIN)
    untold = fpjax.ClosedLoop(fpjax.OneMass(0.17, fpjax.Coulomb(20.0)), efp().controller, efp().observer)
    with pytest.raises(InputError, match="no viscous"):
        make_problem(untold, SINE, GAINS, **PLAIN)
