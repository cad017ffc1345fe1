"""Sampled stepping is exact for what is linear: a lead, the high-order feed-forward; and says what it cannot do."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

import fpjax as fp
from fpjax.blocks.plants import held_high_order


def test_lead_is_the_zero_order_hold_of_scipy():
    lead, dt = fp.Lead(57.0, 217.0, 2500.0), 1e-3  # dt x pole = 2.5: past Euler's limit
    held = signal.StateSpace([[-2500.0]], [[1.0]], [[57.0 * (217.0 - 2500.0)]], [[57.0]]).to_discrete(dt)
    errors = np.random.default_rng(0).normal(size=200)
    ours, state = [], lead.init()
    for error in errors:
        measured = fp.Measurement(jnp.asarray(0.0), jnp.asarray(0.0))
        ours.append(float(lead.readout(state, jnp.asarray(error), measured)))
        state = lead.step(state, jnp.asarray(error), measured, jnp.asarray(dt))
    _, theirs, _ = signal.dlsim(held, errors)
    np.testing.assert_allclose(ours, theirs[:, 0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("damping", [0.0, 0.5, 8.94427191, 50.0])  # swinging, nearly critical, far beyond
def test_high_order_step_is_the_matrix_exponential(damping):
    plant = fp.SeriesTwoMass(0.02, 10.0, 1000.0, damping, fp.NoFriction())
    # 2 sqrt(k J_r) = 8.94: critical damping.
    reduced = 0.02 * 10.0 / 10.02
    system = signal.StateSpace(
        [[0.0, 1.0], [-1000.0 / reduced, -damping / reduced]], [[0.0], [1.0 / reduced]], np.eye(2), np.zeros((2, 1))
    )
    held = system.to_discrete(1e-3)
    state = np.array([0.002, -0.3])
    expected = held.A @ state + held.B[:, 0] * 7.0
    ours = held_high_order(jnp.asarray(0.002), jnp.asarray(-0.3), jnp.asarray(7.0), plant, jnp.asarray(1e-3))
    np.testing.assert_allclose(ours, expected, rtol=1e-8, atol=1e-12)


def test_sampled_feedforward_agrees_with_the_continuous_one():
    motor, load, stiffness, damping = 0.02, 10.0, 1000.0, 0.5
    friction = fp.CoulombViscous(20.0, 0.0, steepness=200.0)
    observer = fp.HighOrderFeedforward(
        fp.ClassicalFriedlandPark(motor + load, fp.LogCosh(100.0, 200.0), steepness=200.0),
        motor,
        load,
        stiffness,
        damping,
    )
    loop = fp.ClosedLoop(
        fp.SeriesTwoMass(motor, load, stiffness, damping, friction), fp.ProportionalIntegral(40.0, 500.0), observer
    )
    runs = {}
    for stepping, dt, substeps in (("continuous", 1e-4, 1), ("sampled", 5e-4, 5)):
        runs[stepping] = fp.simulate(
            loop,
            fp.Sine(1.0, 1.0),
            dt=dt,
            duration=3.0,
            stepping=stepping,
            substeps=substeps,
            record=("estimates.coulomb",),
        )
    finals = [float(run.signals["estimates.coulomb"][-1]) for run in runs.values()]
    assert finals[0] == pytest.approx(20.0, rel=0.02)
    assert finals[1] == pytest.approx(finals[0], rel=0.01)


def test_the_exact_solver_is_refused_where_time_is_continuous():
    loop = fp.ClosedLoop(fp.OneMass(1.0, fp.Coulomb(1.0)), fp.Proportional(1.0))
    with pytest.raises(fp.InputError, match="sampled"):
        fp.simulate(loop, fp.Constant(1.0), dt=1e-3, duration=0.1, solver="exact")


def test_the_stiffness_number_sees_both_directions():
    law = fp.AsymmetricCoulombViscous(1.0, 50.0, 0.0, 0.0, steepness=100.0)
    loop = fp.ClosedLoop(fp.OneMass(1.0, law), fp.Proportional(1.0))
    number = fp.stiffness_number(loop, 1e-3)
    assert number is not None
    assert number > 2.5  # the steep side alone has a mean level of 25.5 N m at rest: 25.5 x 100 x 1e-3
    with pytest.warns(fp.FpjaxWarning, match="stability limit"):
        fp.simulate(loop, fp.Constant(0.0), dt=2e-3, duration=0.01)


def test_a_chirp_stays_at_its_last_frequency():
    chirp = fp.Chirp(1.0, 1.0, 5.0, 2.0)
    time = jnp.linspace(2.0, 3.0, 2001)
    crossings = int(np.sum(np.diff(np.sign(np.asarray(chirp.readout(time)))) != 0))
    assert crossings in (9, 10, 11)  # 5 Hz over one second


def tracking(controller, dt=1e-3):
    """Rms error of a sampled loop that follows a sine, after its first quarter [rad/s]."""
    loop = fp.ClosedLoop(fp.OneMass(0.05, fp.CoulombViscous(0.0, 0.4, steepness=1.0)), controller)
    run = fp.simulate(
        loop, fp.Sine(2.0, 5.0), dt=dt, duration=0.4, stepping="sampled", substeps=8, record=("reference", "velocity")
    )
    error = np.asarray(run.signals["reference"] - run.signals["velocity"], float)
    return float(np.sqrt(np.mean(error[len(error) // 4 :] ** 2)))


def test_a_feedforward_that_knows_the_next_sample_leaves_nothing_to_the_feedback():
    """Held torques of second order: half the period leaves a quarter of the error; the difference to the sample before
    is half a period late, which leaves inertia x acceleration x dt for the feedback.
    """
    weak = fp.Proportional(0.02)

    def forward(**words):
        return fp.Feedforward(weak, 0.05, 0.0, 0.4, 1.0, **words)

    late = tracking(forward(lag=1e-3, ahead=False))
    ahead = tracking(forward(lag=1e-3))
    assert ahead < 0.05 * late
    assert tracking(forward(lag=5e-4), 5e-4) == pytest.approx(0.25 * ahead, rel=0.3)
    limited = tracking(fp.Limited(forward(lag=1e-3), 1e3))
    assert limited == pytest.approx(ahead, rel=1e-6)


def position_error(controller, dt=1e-3, reference=None):
    """Rms error of a sampled loop that follows a position sine, after its first quarter [rad]."""
    loop = fp.ClosedLoop(fp.OneMass(0.05, fp.CoulombViscous(0.3, 0.4, steepness=20.0)), controller)
    run = fp.simulate(
        loop, reference or fp.Sine(0.5, 2.0), dt=dt, duration=1.0, stepping="sampled", substeps=8,
        record=("reference", "position"),
    )  # fmt: skip
    error = np.asarray(run.signals["reference"] - run.signals["position"], float)
    return float(np.sqrt(np.mean(error[len(error) // 4 :] ** 2)))


def test_a_cascade_that_is_told_the_rate_and_the_torque_of_its_reference_follows_it():
    cascade = fp.PositionLoop(20.0, fp.Proportional(2.0))

    def forward(velocity, share, **words):
        return fp.PositionFeedforward(cascade, velocity, share * 0.05, share * 0.3, share * 0.4, 0.05, 1e-3, **words)

    plain, rate, whole = position_error(cascade), position_error(forward(1.0, 0.0)), position_error(forward(1.0, 1.0))
    assert position_error(forward(0.0, 0.0)) == pytest.approx(plain, rel=1e-5)
    # A ramp's lag is v / kp: 0.5 x 4 pi / 20, rms 0.22 rad. Told its rate, what the motion takes over kp kv is left:
    # mostly 0.05 x 0.5 x (4 pi)^2 N m over 40.
    assert plain > 0.2
    assert rate == pytest.approx(0.07, rel=0.2)
    assert whole < 0.02 * rate
    late = position_error(forward(1.0, 1.0, ahead=False))
    assert whole < 0.3 * late < 0.1 * plain


def test_the_feedforward_of_a_position_holds_its_limit_and_needs_a_cascade():
    cascade = fp.PositionLoop(20.0, fp.ProportionalIntegral(2.0, 5.0, 0.5, 0.02))
    controller = fp.PositionFeedforward(cascade, 1.0, 0.05, 0.3, 0.4, 0.05, 1e-3)
    loop = fp.ClosedLoop(fp.OneMass(0.05, fp.CoulombViscous(0.3, 0.4, steepness=20.0)), controller)
    run = fp.simulate(loop, fp.Sine(0.5, 2.0), dt=1e-3, duration=1.0, stepping="sampled", record=("torque",))
    assert np.max(np.abs(np.asarray(run.signals["torque"]))) == pytest.approx(0.5, rel=1e-6)
    with pytest.raises(fp.InputError, match="must wrap a PositionLoop"):
        fp.PositionFeedforward(fp.Proportional(2.0), 1.0, 0.05, 0.3, 0.4, 0.05, 1e-3)


def test_the_first_sample_of_a_position_gives_no_speed_from_zero():
    cascade = fp.PositionLoop(0.0, fp.Proportional(1.0))
    controller = fp.PositionFeedforward(cascade, 1.0, 1.0, 0.0, 0.0, 1.0, 1e-3)
    state, rest, now = controller.init(), fp.Measurement(jnp.asarray(0.0), jnp.asarray(0.0)), jnp.asarray(3.0)
    assert float(controller.readout(state, now, rest)) == 0.0
    told = controller.knowing(jnp.asarray(3.002))
    assert float(told.readout(state, now, rest)) == pytest.approx(2.0, rel=1e-4)  # its rate, and no acceleration
    state = told.step(state, now, rest, jnp.asarray(1e-3))
    told = controller.knowing(jnp.asarray(3.005))
    # rate 3, at the sample (2 + 3) / 2, acceleration (3 - 2) / 1e-3
    assert float(told.readout(state, jnp.asarray(3.002), rest)) == pytest.approx(1002.5, rel=2e-3)


def test_the_first_sample_gives_no_acceleration_from_zero():
    controller = fp.Feedforward(fp.Proportional(0.0), 1.0, 0.0, 0.0, 1.0, 1e-3)
    state, rest, now = controller.init(), fp.Measurement(jnp.asarray(0.0), jnp.asarray(0.0)), jnp.asarray(3.0)
    assert float(controller.readout(state, now, rest)) == 0.0
    assert float(controller.knowing(jnp.asarray(3.5)).readout(state, now, rest)) == pytest.approx(500.0)
