"""Stiction sticks, holds and breaks away; the exact solver does so without a band."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp
from fpjax.blocks.friction.base import WHOLE, AbstractFriction, Shares
from fpjax.blocks.friction.general import GeneralFriction
from fpjax.blocks.plants import TwoMassState
from fpjax.blocks.plants.sticking import advance_exact
from fpjax.blocks.plants.transmission import Transmission
from fpjax.blocks.signals import Motion


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


SLIDING = {
    "viscous": (GeneralFriction(0.02, 0.05), {}),
    "stribeck": (GeneralFriction(0.02, 0.05, stribeck_torque=0.3, stribeck_velocity=2.0), {}),
    "drag": (GeneralFriction(0.02, 0.05, drag_coefficient=0.03), {}),
    "both sides": (GeneralFriction(0.5, 0.05), {"friction_share": 0.3}),
    "apart": (GeneralFriction(0.5, 0.05), {"friction_share": 0.8, "viscous_share": 0.1}),
    "damped": (GeneralFriction(1.0, 0.05), {"damping": 1.0}),
    "by load": (GeneralFriction(0.5, 0.05, load_coefficient=0.1), {"damping": 0.5}),
}


def _transmission(law, load_share=0.5, stiffness=300.0, damping=0.05, **others):
    return Transmission(0.05, load_share, stiffness, damping, law, **others)


def _end(plant, speed, torque, substeps, duration=0.02):
    start = TwoMassState(*(jnp.float64(value) for value in (speed, 0.0, speed, 0.0)), ())
    step = duration / substeps

    @jax.jit
    def run(start):
        return jax.lax.fori_loop(
            0, substeps, lambda i, state: advance_exact(plant, state, torque, i * step, jnp.float64(step)), start
        )

    after = run(start)
    return np.array([after.motor_velocity, after.load_velocity])


@pytest.mark.parametrize("name", SLIDING)
def test_two_masses_slide_in_second_order(name):
    """A push without a reversal: half the step, a quarter of the error."""
    law, others = SLIDING[name]
    plant, torque = _transmission(law, **others), jnp.float64(1.0)
    truth = _end(plant, 30.0, torque, 20_000)
    errors = [np.max(np.abs(_end(plant, 30.0, torque, substeps) - truth)) for substeps in (40, 80, 160)]
    assert errors[0] > 3.5 * errors[1] > 3.5**2 * errors[2] > 0.0


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_two_masses_at_rest_stick_and_have_slopes(share):
    plant = _transmission(GeneralFriction(1.0, 0.05), friction_share=share)

    def speeds(torque):
        start = TwoMassState(*(jnp.float64(0.0) for _ in range(4)), ())
        after = advance_exact(plant, start, torque, jnp.float64(0.0), jnp.float64(1e-3))
        return after.motor_velocity, after.load_velocity

    # The motor's own share of the level holds it; without any it starts at once.
    motor, load = speeds(jnp.float64(0.5 * (1.0 - share)))
    assert motor == load == 0.0
    assert speeds(jnp.float64(1.5))[0] > 0.0
    for torque in (0.0, 0.01, 1.5):
        slopes = jax.jacfwd(speeds)(jnp.float64(torque)), jax.jacrev(speeds)(jnp.float64(torque))
        assert np.all(np.isfinite(slopes))
        np.testing.assert_allclose(slopes[0], slopes[1], atol=1e-12)


@pytest.mark.parametrize("exact", [True, False])
def test_viscous_friction_may_be_on_the_other_side_than_coulomb(exact):
    """At a constant speed the shaft carries the load's friction, which is its share of each part."""
    law = GeneralFriction(0.5, 0.05, drag_coefficient=0.01)
    plant = _transmission(law, friction_share=0.8, viscous_share=0.1, damping=2.0)
    torque, dt = jnp.float64(0.5 + 0.05 * 6.0 + 0.01 * 36.0), 1e-4

    def period(state, _):
        if exact:
            return advance_exact(plant, state, torque, jnp.float64(0.0), jnp.float64(dt)), None
        slope = plant.derivative(state, torque, jnp.float64(0.0))
        return jax.tree.map(lambda at, by: at + dt * by, state, slope), None

    start = TwoMassState(*(jnp.float64(value) for value in (6.0, 0.0, 6.0, 0.0)), ())
    after, _ = jax.jit(lambda state: jax.lax.scan(period, state, None, 60_000))(start)
    assert float(plant.shaft(after)) == pytest.approx(0.8 * 0.5 + 0.1 * (0.05 * 6.0 + 0.01 * 36.0), rel=1e-6)
    assert float(plant.readout(after, torque, jnp.float64(0.0)).friction) == pytest.approx(float(torque), rel=1e-6)


def test_without_a_viscous_share_both_kinds_are_divided_alike():
    law = GeneralFriction(0.5, 0.05)
    alike = _transmission(law, friction_share=0.3, viscous_share=0.3)
    plain = _transmission(law, friction_share=0.3)
    assert plain.on_load == Shares(plain.friction_share, plain.friction_share)
    np.testing.assert_array_equal(*(_end(plant, 30.0, jnp.float64(1.0), 40) for plant in (alike, plain)))
    # The larger share of either kind on a side counts for how fast the friction may brake it.
    assert float(plain.rubbing_inertia()) == pytest.approx(0.025 / 0.7)
    assert float(_transmission(law, friction_share=0.3, viscous_share=0.9).rubbing_inertia()) == pytest.approx(
        0.025 / 0.9
    )


def test_a_viscous_share_of_a_law_without_a_smooth_part_is_refused():
    class Rubbing(AbstractFriction):
        def readout(self, state, motion, applied):
            return 0.1 * motion.velocity

    with pytest.raises(fp.InputError, match="Rubbing has no smooth part of its own, which a viscous_share"):
        _transmission(Rubbing(), viscous_share=0.5)
    assert _transmission(fp.NoFriction(), viscous_share=0.5).on_load.drag == 0.5  # nothing to divide


def test_the_speed_after_a_step_is_continuous_in_that_before_it():
    """A body that stops just within the step and one that just does not: no jump between neighbours."""
    law = GeneralFriction(0.1, 0.0, stribeck_torque=0.4, stribeck_velocity=0.1)
    speeds = np.linspace(0.05, 0.6, 5501)
    after = jax.vmap(
        lambda v: law.turn(Motion(v, 0.0 * v, 0.0 * v), -20.0 + 0.0 * v, jnp.float64(0.05), WHOLE, jnp.float64(1e-3))
    )(jnp.asarray(speeds))
    assert np.max(np.abs(np.diff(after))) < 3.0 * (speeds[1] - speeds[0])


def test_a_speed_too_small_to_be_squared_is_no_division_by_zero():
    law, none = GeneralFriction(0.0, 0.0), jnp.float64(0.0)
    after = law.turn(Motion(jnp.float64(1e-170), none, none), none, jnp.float64(0.05), WHOLE, jnp.float64(1e-3))
    assert float(after) == 1e-170


@pytest.mark.parametrize("share", ["friction_share", "viscous_share"])
def test_a_share_of_friction_beyond_all_of_it_is_refused(share):
    with pytest.raises(fp.InputError, match=f"Transmission: {share} must be from 0 to 1, got 1.5: it is a share"):
        _transmission(GeneralFriction(0.5, 0.05), **{share: 1.5})
