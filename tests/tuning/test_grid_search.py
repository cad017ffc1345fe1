"""Algorithm 1 against the thesis' printed cells, and the repaired variant."""

import numpy as np
import pytest
from tuning_loops import CONSTANT, DEGREE, GAINS, SETUP, SHORT, SINE, THESIS, efp

import fpjax
import tuning
from fpjax import InputError, set_parameters

STEPS = (10.0, 50.0 * DEGREE)


def units(result):
    return result.gains["observer.gain_2"], result.gains["observer.gain_1"] / DEGREE


def test_algorithm_1_gives_the_gains_and_iterations_of_table_4_2():
    method = tuning.GridSearch(steps=STEPS, iterations=40)
    results = tuning.tune_each(
        efp(), {"sine": SINE, "constant": CONSTANT}, parameters=GAINS, objective=THESIS, method=method, **SETUP
    )
    sine, constant = results["sine"], results["constant"]
    # Printed 72.6, 298 and 28 iterations; docs/thesis.md: 72.5, 298.4 and 30.
    np.testing.assert_allclose(units(sine), (72.5, 298.4375), rtol=1e-6)
    assert sine.iterations == 30
    assert sine.simulations == 4 * 30
    assert sine.cost < 1e-3
    # Printed 59.9, 8.4, 29 iterations, .0124 after 20.
    np.testing.assert_allclose(units(constant), (59.929, 8.459), rtol=1e-4)
    assert constant.iterations == 29
    assert constant.history[19][0] == 80
    np.testing.assert_allclose(constant.history[19][1], 0.01245, rtol=1e-3)


@pytest.mark.long
def test_side_by_side_is_what_each_does_alone():
    method = tuning.GridSearch(steps=STEPS, iterations=6)
    common = {"parameters": GAINS, "objective": THESIS, "method": method, **SHORT}
    both = tuning.tune_each(efp(150.0), {"sine": SINE, "constant": CONSTANT}, **common)
    for label, reference in (("sine", SINE), ("constant", CONSTANT)):
        alone = tuning.tune(efp(150.0), reference, **common)
        np.testing.assert_allclose(units(alone), units(both[label]), rtol=1e-12)
        np.testing.assert_allclose([cost for _, cost in alone.history], [cost for _, cost in both[label].history])


def test_its_quirks_are_kept_and_the_gains_it_reports_have_the_cost_it_reports():
    """It accepts a worse move, so it can stand worse than the best it saw; the repaired one cannot."""
    common = {"parameters": GAINS, "objective": THESIS, **SETUP}
    # With half the steps it has passed the valley after six iterations and is on its way up.
    quirky = [
        tuning.tune(efp(150.0), SINE, method=tuning.GridSearch(steps=STEPS, iterations=n), **common)
        for n in range(6, 13)
    ]
    measures = {"k": fpjax.EstimateFinal("coulomb"), "b": fpjax.EstimateFinal("viscous")}

    def resimulated(gains):
        run = fpjax.simulate(set_parameters(efp(150.0), gains), SINE, measures=measures, **SETUP)
        return abs(float(run.measures["k"]) - 20.0) + abs(float(run.measures["b"]) / DEGREE - 2.0)

    worst = max(quirky, key=lambda result: result.standing_cost - result.cost)
    assert worst.standing_cost > worst.cost
    for result in quirky:
        assert result.cost == result.history[-1][1]
        assert result.cost <= result.standing_cost
    np.testing.assert_allclose(resimulated(worst.gains), worst.cost, rtol=1e-7)
    np.testing.assert_allclose(resimulated(worst.standing), worst.standing_cost, rtol=1e-7)
    assert "not the best it saw" in str(worst)
    repaired = tuning.tune(efp(150.0), SINE, method=tuning.RepairedGridSearch(steps=STEPS, iterations=12), **common)
    assert repaired.cost == repaired.history[-1][1] == min(cost for _, cost in repaired.history)
    assert repaired.standing is None
    assert repaired.cost < min(result.standing_cost for result in quirky)
    # The start once, and eight moves an iteration.
    assert repaired.simulations == 1 + 8 * repaired.iterations


@pytest.mark.parametrize("names", [GAINS[:1], (*GAINS, "controller.kp")])
def test_algorithm_1_moves_exactly_two_parameters(names):
    with pytest.raises(InputError, match="Algorithm 1 moves exactly two parameters"):
        tuning.tune(efp(), SINE, parameters=names, method="grid", objective=THESIS, **SHORT)


@pytest.mark.long  # other parameters, so a program of its own: 5 s
def test_ties_go_to_the_first_move():
    """A cost that no gain moves: (+, +) always, and the steps halve from the second iteration on."""
    loop = efp(150.0)
    result = tuning.tune(
        loop,
        SINE,
        parameters=("plant.inertia", "controller.ki"),
        objective=tuning.Thesis(truths={"coulomb": 1e300, "viscous": 1e300}),
        method=tuning.GridSearch(steps=(0.1, 8.0), iterations=3),
        **SHORT,
    )
    inertia = float(loop.plant.inertia)
    np.testing.assert_allclose(list(result.standing.values()), [inertia + 0.1 + 0.1 + 0.05, 200.0 + 8.0 + 8.0 + 4.0])


def test_steps_must_fit_the_parameters():
    with pytest.raises(InputError, match="one each"):
        tuning.tune(efp(), SINE, parameters=GAINS, method=tuning.GridSearch(steps=(1.0,)), objective=THESIS, **SHORT)


@pytest.mark.parametrize("method", [tuning.GridSearch, pytest.param(tuning.RepairedGridSearch, marks=pytest.mark.long)])
def test_no_simulation_leaves_the_bounds_that_were_given(method, monkeypatch):
    from tuning.lanes import Lanes

    costs, seen = Lanes.costs, []

    def recorded(self, values):
        seen.append(values.reshape(-1, 2))
        return costs(self, values)

    monkeypatch.setattr(Lanes, "costs", recorded)
    bounded = [tuning.Parameter(GAINS[0], low=5.0, high=22.0), tuning.Parameter(GAINS[1], low=DEGREE)]
    result = tuning.tune(
        efp(150.0), SINE, parameters=bounded, objective=THESIS, method=method(steps=STEPS, iterations=5), **SHORT
    )
    visited = np.concatenate(seen)
    assert visited[:, 0].min() >= 5.0
    assert visited[:, 0].max() <= 22.0
    assert visited[:, 1].min() >= DEGREE
    assert 5.0 <= result.gains[GAINS[0]] <= 22.0
