"""Finite gradients at rest: every measure on every block of the catalogue, where nothing moves and no error is left."""

import inspect
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import one_of_each_kind
from catalogue_case import DT
from measures import MEASURES

import fpjax as fp
import tuning.measures
from fpjax.simulation import metrics
from fpjax.simulation.metrics import safe_root
from fpjax.simulation.solvers import get_solver

STEPS = 2  # the second knows the first, as measures of a change need


def measures_of(loop):
    found = MEASURES | {
        "after": squared_after(0),
        "bins": squared_after(3),
        "fastest": tuning.measures.Fastest(),
    }
    if loop.observer.estimated:
        scales = tuple(jnp.ones(()) for _ in loop.observer.estimated)
        found["noise"] = tuning.measures.NoiseGain(loop.observer, scales, jnp.asarray(1e-3))
    for name in loop.observer.estimated:
        found |= {
            f"{name} error": fp.EstimateError(name, 20.0),
            f"{name} last": fp.EstimateFinal(name),
            f"{name} peak": fp.EstimatePeak(name),
            f"{name} settled": tuning.measures.SettledError(name, jnp.asarray(20.0), jnp.asarray(0.0)),
        }
    return found


def squared_after(bins):
    one = jnp.ones(())
    return tuning.measures.SquaredAfter(fp.velocity_error, None, 0.0 * one, one, 0.0 * one, one * STEPS * DT, bins)


def at_rest(loop, stepping):
    """The sum of all measures over a few steps at rest, evaluated step by step: nothing is compiled as a whole."""
    measures = measures_of(loop)
    state, zero, dt = loop.init(), jnp.zeros(()), jnp.asarray(DT)
    state = loop.sampled(state) if stepping == "sampled" else state
    totals = {name: measure.init(zero) for name, measure in measures.items()}
    solver = get_solver("euler")
    noise = tuple(zero for _ in range(loop.sensor.noise_channels))
    for step in range(STEPS):
        time = jnp.asarray(step * DT)
        if stepping == "continuous":
            state, signals = loop.advance_continuous(state, (zero,) * len(solver.nodes), time, dt, solver)
        else:
            state, signals = loop.advance_sampled(state, zero, time, dt, noise, solver, 1)
        totals = {name: measure.update(totals[name], signals) for name, measure in measures.items()}
    return sum(jnp.sum(measure.final(totals[name], STEPS)) for name, measure in measures.items())


@pytest.mark.parametrize("case", one_of_each_kind(), ids=str)
def test_gradients_at_rest_are_finite(case):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fp.FpjaxWarning)
        loop, _ = case.loop(case.build())
    value, slopes = eqx.filter_value_and_grad(at_rest)(loop, case.stepping)
    assert np.isfinite(value)
    for path, slope in jax.tree_util.tree_leaves_with_path(slopes):
        assert np.all(np.isfinite(slope)), jax.tree_util.keystr(path)


def test_no_measure_is_left_out():
    """A settling time is infinite where nothing settles, and no gradient is taken of it."""
    known = {
        each
        for module in (metrics, tuning.measures)
        for each in vars(module).values()
        if isinstance(each, type) and issubclass(each, fp.AbstractMeasure) and not inspect.isabstract(each)
    }
    observed = fp.ClosedLoop(
        fp.OneMass(10.0, fp.CoulombViscous(20.0, 2.0, steepness=200.0)), fp.Proportional(500.0),
        fp.ClassicalFriedlandPark(10.0, fp.Absolute(1.0)),
    )  # fmt: skip
    assert known - {type(measure) for measure in measures_of(observed).values()} == {fp.SettlingTime}


@pytest.mark.parametrize("kind", [fp.RootMeanSquare, fp.GradientRootMeanSquare, fp.StandardDeviation, None])
def test_forward_mode_too(kind):
    measure = fp.control_effort() if kind is None else kind(fp.velocity_error)

    def cost(gain):
        law = fp.CoulombViscous(20.0, 2.0, steepness=200.0)
        loop = fp.ClosedLoop(fp.OneMass(10.0, law), fp.Proportional(gain))
        return fp.simulate(loop, fp.Constant(0.0), dt=1e-3, samples=20, measures={"m": measure}).measures["m"]

    value, slope = jax.jvp(cost, (jnp.asarray(500.0),), (jnp.asarray(1.0),))
    assert value == 0.0
    assert slope == 0.0


def test_what_is_not_a_number_stays_so():
    """A diverged run must not be taken for one without error."""
    assert np.isnan(safe_root(jnp.asarray(np.nan)))
    assert np.isinf(safe_root(jnp.asarray(np.inf)))
    np.testing.assert_allclose(safe_root(jnp.asarray(9.0)), 3.0)
    assert tuning.measures.safe_root is safe_root
