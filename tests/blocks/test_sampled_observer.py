"""The sampled observer: at the true parameters its innovation vanishes, whatever the control period."""

import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp

COULOMB, VISCOUS, INERTIA = 20.0, 2.0, 10.0
OBSERVERS = {
    "efp": lambda: fp.ExtendedFriedlandPark(INERTIA, 300.0, 70.0),
    "cfp": lambda: fp.ClassicalFriedlandPark(INERTIA, fp.Absolute(50.0), VISCOUS),
    "mfp": lambda: fp.ModifiedFriedlandPark(INERTIA, fp.Absolute(50.0), VISCOUS),
    "nfp": lambda: fp.NovelFriedlandPark(INERTIA, fp.Quadratic(50.0), COULOMB),
}


def settled(observer, dt, duration=60.0):
    """Mean estimates over the last period of the reference, with exact sticking and a held torque."""
    loop = fp.ClosedLoop(
        fp.OneMass(INERTIA, fp.CoulombViscous(COULOMB, VISCOUS)), fp.ProportionalIntegral(800.0, 8000.0), observer
    )
    names = tuple(f"estimates.{name}" for name in observer.estimated)
    run = fp.simulate(
        loop, fp.Sine(1.0, 0.5), dt=dt, duration=duration, solver="exact", stepping="sampled", record=names
    )
    # One period of the 0.5 Hz reference.
    last = round(2.0 / dt)
    return {name.removeprefix("estimates."): float(np.mean(run.signals[name][-last:])) for name in names}


@pytest.mark.parametrize("dt", [1e-3, 4e-3])
@pytest.mark.parametrize("name", list(OBSERVERS))
def test_estimates_have_no_bias_of_the_period(name, dt):
    """Held derivatives gave 20.5 and 1.05 for EFP at 1 ms."""
    found = settled(OBSERVERS[name](), dt)
    truth = {"coulomb": COULOMB, "viscous": VISCOUS}
    for estimate, value in found.items():
        assert value == pytest.approx(truth[estimate], rel=1e-3)


def test_a_smooth_compensation_is_within_a_few_per_cent():
    """tanh in the observer where the plant has sign: what is left is the width of the tanh, not the period."""
    found = settled(fp.ExtendedFriedlandPark(INERTIA, 100.0, 100.0, 1000.0), 1e-3)
    assert found["coulomb"] == pytest.approx(COULOMB, rel=0.01)
    assert found["viscous"] == pytest.approx(VISCOUS, rel=0.03)


@pytest.mark.parametrize("name", list(OBSERVERS))
def test_one_period_is_the_algebra(name):
    """The estimates move by slope x (torque dt / J - change of w - compensation dt / J), all in the middle."""
    observer, dt = OBSERVERS[name](), jnp.asarray(1e-3)
    before, after, torque = jnp.asarray(0.4), jnp.asarray(0.43), jnp.asarray(31.0)
    state = observer.carried(observer.init(), jnp.asarray(0.0), before)
    start = observer.readout(state, before)[1]
    end = observer.readout(observer.advance(state, torque, before, after, dt), after)[1]
    middle = 0.5 * (before + after)
    friction = VISCOUS * middle if name in ("cfp", "mfp") else COULOMB * 1.0 if name == "nfp" else 0.0
    for slope, (estimate, value) in zip(observer.slopes(middle), start.items(), strict=True):
        innovation = (torque - friction) * dt / INERTIA - (after - before)
        assert float(end[estimate] - value) == pytest.approx(float(slope * innovation), rel=1e-9)


def test_a_period_that_crosses_rest_moves_nothing():
    observer, dt = OBSERVERS["efp"](), jnp.asarray(1e-3)
    before, after = jnp.asarray(-0.01), jnp.asarray(0.02)
    state = observer.carried(observer.init(), jnp.asarray(0.0), before)
    end = observer.readout(observer.advance(state, jnp.asarray(50.0), before, after, dt), after)[1]
    for value in end.values():
        assert float(value) == pytest.approx(0.0, abs=1e-12)


def test_a_run_goes_on_where_it_ended():
    observer = OBSERVERS["efp"]()
    loop = fp.ClosedLoop(
        fp.OneMass(INERTIA, fp.CoulombViscous(COULOMB, VISCOUS)), fp.ProportionalIntegral(800.0, 8000.0), observer
    )
    settings = {"dt": 1e-3, "solver": "exact", "stepping": "sampled", "record": ("torque",)}
    whole = fp.simulate(loop, fp.Constant(0.5), samples=400, **settings)
    first = fp.simulate(loop, fp.Constant(0.5), samples=200, **settings)
    second = fp.simulate(loop, fp.Constant(0.5), samples=200, initial=first.final_state, **settings)
    np.testing.assert_allclose(whole.signals["torque"][200:], second.signals["torque"], rtol=1e-12)
