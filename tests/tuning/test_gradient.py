"""Gradients of a tuning's cost, and the methods that follow them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tuning_loops import CONSTANT, DEGREE, GAINS, PLAIN, SETUP, SINE, THESIS, efp

import fpjax
import tuning
from fpjax import InputError
from fpjax.compiled.programs import Programs
from tuning import lanes as lanes_module
from tuning.lanes import Lanes, Stopwatch
from tuning.problem import make_problem
from tuning.search import SEARCHES

pytestmark = pytest.mark.usefixtures("unoptimised")
STEPS = (10.0, 50.0 * DEGREE)


def lanes_of(objective, **settings):
    problem, start, _ = make_problem(efp(150.0), [SINE, CONSTANT], GAINS, objective=objective, **PLAIN, **settings)
    return Lanes(problem, np.stack([np.asarray(start)] * 3) * np.array([[1.0], [2.0], [0.7]]), np.array([0, 1, 1]))


OTHERS = (tuning.Estimation(noise=0.01, noise_weight=0.1), tuning.Tracking())


@pytest.mark.parametrize("objective", [THESIS, *(pytest.param(other, marks=pytest.mark.long) for other in OTHERS)])
@pytest.mark.parametrize("mode", ["forward", pytest.param("reverse", marks=pytest.mark.long)])
def test_gradients_are_finite_differences(objective, mode):
    lanes = lanes_of(objective)
    at = lanes.problem.space.coordinates(lanes.start)
    cost, slope = lanes.value_and_gradient(at, mode)
    np.testing.assert_allclose(cost, lanes.costs(lanes.values(at)[:, None])[:, 0], rtol=1e-9)
    for place in range(2):
        move = 1e-5 * np.eye(2)[place]
        above, below = (lanes.costs(lanes.values(at + sign * move)[:, None])[:, 0] for sign in (1.0, -1.0))
        # Central differences of a cost of size c are good to about c 1e-16 / 1e-5 + 1e-10.
        np.testing.assert_allclose(slope[:, place], (above - below) / 2e-5, rtol=1e-5, atol=1e-8 * np.max(cost))


@pytest.mark.long  # its Jacobian alone compiles for ten seconds
def test_residuals_and_their_jacobian_give_cost_and_gradient():
    lanes = lanes_of(tuning.Estimation())
    at = lanes.problem.space.coordinates(lanes.start)
    residuals, slopes, cost = lanes.residuals_and_jacobian(at)
    value, gradient = lanes.value_and_gradient(at, "auto")
    np.testing.assert_allclose(np.sum(residuals**2, axis=1), value, rtol=1e-9)
    np.testing.assert_allclose(cost, value, rtol=1e-9)
    np.testing.assert_allclose(2.0 * np.einsum("lm,lmn->ln", residuals, slopes), gradient, rtol=1e-7)


@pytest.mark.long  # each of the two searches is in a test of the default set
def test_levenberg_marquardt_needs_18_simulations_where_algorithm_1_needs_84():
    """Both with the smooth law, tangents counted."""
    common = {"parameters": GAINS, "objective": THESIS, **SETUP}
    theirs = tuning.tune(efp(150.0), SINE, method=tuning.GridSearch(steps=STEPS, iterations=40), **common)
    ours = tuning.tune(efp(150.0), SINE, method="levenberg_marquardt", target=1e-3, **common)
    assert theirs.cost < 1e-3
    assert theirs.simulations == 84
    assert ours.cost < 1e-3
    # Two gains in forward mode: three simulations an iteration.
    assert ours.simulations == 3 * ours.iterations <= 18


@pytest.mark.parametrize(
    "method", ["levenberg_marquardt", "lbfgs", tuning.Adam(rate=0.3, iterations=60), "nelder_mead"]
)
def test_each_method_finds_the_valley_and_reports_what_it_used(method):
    result = tuning.tune(efp(150.0), SINE, parameters=GAINS, objective=THESIS, method=method, target=2e-2, **SETUP)
    assert result.cost < 2e-2
    assert result.message.startswith("reached the target")
    assert result.history[-1] == (result.simulations, result.cost)
    each = 1 if result.method == "nelder_mead" else 3
    assert result.simulations == each * result.iterations
    assert result.simulated_steps == 5001 * result.simulations
    applied = result.apply(efp(150.0))
    run = fpjax.simulate(applied, SINE, measures={"k": fpjax.EstimateFinal("coulomb")}, **SETUP)
    assert abs(float(run.measures["k"]) - 20.0) < 2e-2
    assert "observer.gain_1" in str(result)
    assert result.to_dict()["gains"] == result.gains


@pytest.mark.long
def test_starts_that_diverge_are_dropped_and_counted():
    loop = efp(150.0, gain_2=10.0, gain_1=100.0)
    wide = [
        tuning.Parameter("observer.gain_2", low=1e-6, high=1e9),
        tuning.Parameter("observer.gain_1", low=1e-6, high=1e9),
    ]
    common = {"parameters": wide, "objective": THESIS, "starts": 8, "spread": 6.0, "seed": 1, **PLAIN}
    for method in (tuning.LevenbergMarquardt(8), tuning.LBFGS(8), tuning.Adam(iterations=8)):
        result = tuning.tune(loop, SINE, method=method, **common)
        assert 0 < result.diverged_starts < 8
        assert np.isfinite(result.cost)
        assert result.cost <= result.start_cost
        assert np.all(np.isfinite(list(result.gains.values())))


@pytest.mark.long  # tests/cli/test_bad_input.py has one such run
def test_where_every_start_diverges_the_result_says_so():
    far = [tuning.Parameter("observer.gain_2", 1e9, 1e8, 1e10), tuning.Parameter("observer.gain_1", 1e9, 1e8, 1e10)]
    result = tuning.tune(efp(150.0), SINE, parameters=far, objective=THESIS, starts=2, method="lbfgs", **PLAIN)
    assert result.diverged
    assert result.diverged_starts == 2
    assert result.message == "diverged"
    assert result.to_dict()["cost"] is None


@pytest.mark.parametrize(
    "method",
    [
        pytest.param("levenberg_marquardt", marks=pytest.mark.long),
        pytest.param("lbfgs", marks=pytest.mark.long),
        pytest.param("adam", marks=pytest.mark.long),
        pytest.param("nelder_mead", marks=pytest.mark.long),  # tests/tuning/test_start_values.py has a bound by default
        pytest.param(tuning.RepairedGridSearch(threshold=0.0), marks=pytest.mark.long),
    ],
)
def test_bounds_hold_and_are_reported(method):
    """Tracking alone wants ever larger gains: the search ends at the bound, and says so."""
    bounded = [tuning.Parameter("observer.gain_2", 10.0, 5.0, 20.0)]
    result = tuning.tune(
        efp(150.0), SINE, parameters=bounded, objective=tuning.Tracking(), method=method, **{**SETUP, "duration": 0.2}
    )
    assert 19.0 < result.gains["observer.gain_2"] <= 20.0
    assert result.identifiability is not None
    assert "high bound" in result.identifiability.verdicts["observer.gain_2"]


@pytest.mark.long
def test_several_starts_and_references_side_by_side():
    common = {"parameters": GAINS, "objective": THESIS, "method": "lbfgs", "max_simulations": 30, **PLAIN}
    both = tuning.tune_each(efp(150.0), {"a": SINE, "b": CONSTANT}, starts=3, **common)
    alone = tuning.tune(efp(150.0), SINE, starts=3, **common)
    np.testing.assert_allclose(both["a"].cost, alone.cost, rtol=1e-6)
    assert both["a"].simulations == alone.simulations <= 90
    assert both["a"].starts == 3


@pytest.mark.long
def test_joint_tuning_serves_all_and_reports_mean_and_worst():
    """One set of gains for both references and a population: never better than each reference's own."""
    plants = tuning.population(
        efp(100.0), {"plant.friction.coulomb": 0.2, "plant.friction.viscous": 0.2, "plant.inertia": 0.2}
    )
    common = {
        "parameters": GAINS,
        "plants": plants,
        "method": tuning.LBFGS(8),
        "starts": 1,
        **{**PLAIN, "duration": 0.03},
    }
    joint = tuning.tune(efp(100.0), {"a": SINE, "b": CONSTANT}, **common)
    own = tuning.tune_each(efp(100.0), {"a": SINE, "b": CONSTANT}, **common)
    cases = np.array(joint.cases)
    assert cases.shape == (2, 9, 1)
    np.testing.assert_allclose([joint.mean, joint.worst, joint.cost], [cases.mean(), cases.max(), cases.mean()])
    assert joint.cost < joint.start_cost
    assert joint.simulations == 3 * 18 * joint.iterations
    assert np.mean([result.cost for result in own.values()]) <= joint.cost * (1.0 + 1e-6)
    worst = tuning.tune(efp(100.0), {"a": SINE, "b": CONSTANT}, aggregate="worst", **common)
    np.testing.assert_allclose(worst.cost, worst.worst, rtol=1e-12)
    assert worst.worst <= joint.worst * (1.0 + 1e-6)


def test_sign_is_not_differentiated_and_what_is_not_known_is_said():
    with pytest.raises(InputError, match="CoulombViscous"):
        tuning.tune(efp(), SINE, parameters=GAINS, objective=THESIS, method="lbfgs", **PLAIN)
    rough = fpjax.ClosedLoop(
        efp(150.0).plant, efp().controller, fpjax.ClassicalFriedlandPark(0.17, fpjax.Absolute(1.0))
    )
    with pytest.raises(InputError, match="ClassicalFriedlandPark"):
        tuning.tune(rough, SINE, parameters=["observer.nonlinearity.gain"], objective=THESIS, method="adam", **PLAIN)
    with pytest.raises(InputError, match="method = 'newton'"):
        tuning.tune(efp(150.0), SINE, parameters=GAINS, method="newton", **PLAIN)
    with pytest.raises(InputError, match="starts must be at least 1, got 0"):
        tuning.tune(efp(150.0), SINE, parameters=GAINS, starts=0, **PLAIN)
    with pytest.raises(InputError, match="worst case"):
        tuning.tune(efp(150.0), SINE, parameters=GAINS, aggregate="worst", **PLAIN)


@pytest.mark.long
def test_float32_tunes_too():
    loop, reference = (fpjax.astype(tree, jnp.float32) for tree in (efp(150.0), SINE))
    for method in ("levenberg_marquardt", "lbfgs", "adam", "grid_repaired"):
        result = tuning.tune(
            loop, reference, parameters=GAINS, objective=THESIS, method=method, max_simulations=30, **PLAIN
        )
        assert result.cost < result.start_cost


@pytest.mark.long
@pytest.mark.parametrize("method", ["lbfgs", "levenberg_marquardt", "adam"])
def test_all_compiling_of_a_search_is_on_the_clock(method, monkeypatch):
    """Else `run_seconds` holds compile time: 2.3 s of a run that takes 0.09 s the second time."""
    jax.clear_caches()
    monkeypatch.setattr(lanes_module, "_PROGRAMS", Programs())
    where, elsewhere, on_the_clock = ["outside"], [], []

    def heard(event, seconds, **_):
        if event.endswith("backend_compile_duration"):
            {"search": elsewhere, "clock": on_the_clock}.get(where[-1], []).append(seconds)

    def inside(place, fn):
        def wrapped(*arguments):
            where.append(place)
            try:
                return fn(*arguments)
            finally:
                where.pop()

        return wrapped

    for name in ("call", "step"):
        monkeypatch.setattr(Stopwatch, name, inside("clock", getattr(Stopwatch, name)))
    for kind, search in list(SEARCHES.items()):
        monkeypatch.setitem(SEARCHES, kind, inside("search", search))
    jax.monitoring.register_event_duration_secs_listener(heard)
    common = {"parameters": GAINS, "objective": THESIS, "method": method, "max_simulations": 12, **PLAIN}
    first = tuning.tune(efp(150.0), SINE, **common)
    assert on_the_clock
    assert elsewhere == []
    assert first.compile_seconds >= sum(on_the_clock[:1])
    assert tuning.tune(efp(150.0), SINE, **common).compile_seconds == 0.0
