"""Stiction sticks, holds and breaks away; the exact solver does so without a band."""

import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp
from fpjax.blocks.friction.general import GeneralFriction
from fpjax.blocks.plants import TwoMassState
from fpjax.blocks.plants.sticking import advance_exact
from fpjax.blocks.plants.transmission import Transmission


def _push(torque, solver, stepping, duration=1.0):
    law = fp.CoulombViscousStiction(coulomb=1.0, static=2.0, viscous=0.1, stick_velocity=0.01)
    loop = fp.ClosedLoop(fp.OneMass(0.5, law), fp.TorqueInput())
    reference = fp.Recorded(jnp.asarray(torque), 1e-3, hold=True)
    return fp.simulate(
        loop,
        reference,
        dt=1e-3,
        duration=duration,
        solver=solver,
        stepping=stepping,
        record=("velocity", "position", "friction"),
    )


@pytest.mark.parametrize(("solver", "stepping"), [("rk4", "continuous"), ("exact", "sampled")])
def test_holds_below_the_static_level(solver, stepping):
    run = _push(np.full(1001, 1.5), solver, stepping)
    # RK4 holds by a steep law within the stick band, whose creep has died out by the end.
    assert abs(float(run.signals["velocity"][-1])) < 1e-6
    np.testing.assert_allclose(run.signals["friction"][500:], 1.5, rtol=1e-6 if solver == "rk4" else 1e-12)


@pytest.mark.parametrize(("solver", "stepping"), [("rk4", "continuous"), ("exact", "sampled")])
def test_breaks_away_above_it_and_slides_on_the_coulomb_level(solver, stepping):
    # 2.5 N m for 0.3 s: accelerates by (2.5 - 1 - 0.1 w) / 0.5 once past the band.
    run = _push(np.full(1001, 2.5), solver, stepping, duration=0.3)
    time = np.asarray(run.time)
    sliding = np.asarray(run.signals["velocity"])
    rate = np.gradient(sliding, time)[150]
    assert rate == pytest.approx((2.5 - 1.0 - 0.1 * sliding[150]) / 0.5, rel=1e-3)


@pytest.mark.parametrize(("solver", "stepping"), [("rk4", "continuous"), ("exact", "sampled")])
def test_a_sliding_body_comes_to_rest_and_stays(solver, stepping):
    torque = np.where(np.arange(2001) < 300, 3.0, 0.0)
    run = _push(torque, solver, stepping, duration=2.0)
    position = np.asarray(run.signals["position"])
    assert float(np.max(run.signals["velocity"])) > 0.5
    assert abs(position[-1] - position[-200]) < 1e-6  # no creep in the last 0.2 s


@pytest.mark.parametrize(
    "make",
    [
        lambda: fp.Stribeck(20.0, 15.0, 0.05),
        lambda: fp.LuGre(20.0, 15.0, 0.05, 2000.0),
        lambda: fp.CoulombViscousStiction(20.0, 15.0),
    ],
)
def test_a_body_does_not_break_away_below_what_slides(make):
    with pytest.raises(fp.InputError, match="static must be at least coulomb = 20 N m, got 15 N m"):
        make()


@pytest.mark.parametrize(
    "law",
    [
        GeneralFriction(0.02, 0.05),
        GeneralFriction(0.02, 0.05, stribeck_torque=0.3, stribeck_velocity=2.0),
        GeneralFriction(0.02, 0.05, drag_coefficient=0.03),
    ],
    ids=["viscous", "stribeck", "drag"],
)
def test_two_masses_slide_in_second_order(law):
    # A push without a reversal: half the step, a quarter of the error.
    plant = Transmission(0.05, 0.5, 300.0, 0.05, law)
    start = TwoMassState(*(jnp.float64(value) for value in (3.0, 0.0, 3.0, 0.0)), ())

    def end(substeps):
        after = advance_exact(plant, start, jnp.float64(1.0), jnp.float64(0.0), jnp.float64(0.02), substeps)
        return np.array([after.motor_velocity, after.load_velocity])

    truth = end(2000)
    errors = [np.max(np.abs(end(substeps) - truth)) for substeps in (16, 32, 64)]
    assert errors[0] > 3.5 * errors[1] > 3.5**2 * errors[2] > 0.0
