"""Linear loops against python-control and scipy: PI, lead, transfer functions, two masses, the sampled PI, the lag."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import linalg, signal

import fpjax as fp
from fpjax.blocks.servo_sensor import ServoSensor

control = pytest.importorskip("control", reason="python-control is not installed: pip install fpjax[control]")

S = control.tf("s")
INERTIA, VISCOUS = 10.0, 2.0
DT, SAMPLES = 1e-3, 401
PLANT = 1.0 / (INERTIA * S + VISCOUS)


def step_response(loop, record="velocity"):
    """Of a unit step of the reference."""
    run = fp.simulate(loop, fp.Constant(1.0), dt=DT, samples=SAMPLES, record=(record,))
    return np.asarray(run.time), np.asarray(run.signals[record])


def one_mass():
    return fp.OneMass(INERTIA, fp.Viscous(VISCOUS))


CONTROLLERS = {
    "p": (fp.Proportional(150.0), control.tf([150.0], [1.0])),
    "pi": (fp.ProportionalIntegral(150.0, 2000.0), 150.0 + 2000.0 / S),
    "lead": (fp.Lead(570.0, 30.0, 90.0), 570.0 * (S + 30.0) / (S + 90.0)),
    "transfer_function": (
        fp.TransferFunction([150.0, 2e3, 9.0], [1.0, 60.0, 90.0]),
        control.tf([150.0, 2e3, 9.0], [1.0, 60.0, 90.0]),
    ),
    "strictly_proper": (fp.TransferFunction([9e3], [1.0, 60.0, 90.0]), control.tf([9e3], [1.0, 60.0, 90.0])),
}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_step_of_a_velocity_loop(name):
    controller, transfer = CONTROLLERS[name]
    time, velocity = step_response(fp.ClosedLoop(one_mass(), controller))
    _, truth = control.step_response(control.feedback(transfer * PLANT, 1), time)
    # RK4: (fastest rate x dt)^4 / 120 with rates up to 100 1/s.
    np.testing.assert_allclose(velocity, truth, rtol=0, atol=1e-6)


def test_step_of_a_position_cascade():
    loop = fp.ClosedLoop(one_mass(), fp.PositionLoop(20.0, fp.Proportional(400.0)))
    time, position = step_response(loop, "position")
    inner = control.feedback(400.0 * PLANT, 1)
    _, truth = control.step_response(control.feedback(20.0 * inner / S, 1), time)
    # RK4 again: the fastest rate, 400 / 10 = 40 1/s, is below those above.
    np.testing.assert_allclose(position, truth, rtol=0, atol=1e-6)


MOTOR, LOAD, STIFFNESS, DAMPING = 4.0, 6.0, 4e4, 40.0
REDUCED = MOTOR * LOAD / (MOTOR + LOAD)
LOW = 1.0 / ((MOTOR + LOAD) * S)
HIGH = (DAMPING * S + STIFFNESS) / (REDUCED * S * S + DAMPING * S + STIFFNESS)


@pytest.mark.parametrize("series", [False, True], ids=["springs", "series"])
def test_without_friction_both_two_mass_forms_are_p_lo_times_p_ho(series):
    """(3.14) = (3.27) x (3.28): torque to load velocity."""
    kind = fp.SeriesTwoMass if series else fp.TwoMass
    loop = fp.ClosedLoop(kind(MOTOR, LOAD, STIFFNESS, DAMPING, fp.NoFriction()), fp.TorqueInput())
    time, velocity = step_response(loop)
    # 20 Hz resonance: the local error of RK4, (130 dt)^5 / 120 = 3e-7, is relative to a swing of 8e-4 rad/s.
    _, truth = control.step_response(LOW * HIGH, time)
    np.testing.assert_allclose(velocity, truth, rtol=0, atol=1e-7)


def test_motor_side_of_two_masses():
    """(3.13): torque to motor velocity has its zeros at the load's own resonance."""
    plant = fp.TwoMass(MOTOR, LOAD, STIFFNESS, DAMPING, fp.NoFriction())
    time, velocity = step_response(fp.ClosedLoop(plant, fp.TorqueInput()), "motor_velocity")
    anti = (LOAD * S * S + DAMPING * S + STIFFNESS) / LOAD
    transfer = anti / (MOTOR * S * (S * S + DAMPING / REDUCED * S + STIFFNESS / REDUCED))
    _, truth = control.step_response(transfer, time)
    np.testing.assert_allclose(velocity, truth, rtol=0, atol=1e-7)
    assert float(plant.resonance()) == pytest.approx(math.sqrt(STIFFNESS / REDUCED) / (2 * math.pi), rel=1e-12)


def test_the_observer_on_two_masses_sees_the_torque_behind_p_ho():
    """HighOrderFeedforward: what reaches the wrapped observer is P_HO u (Fig 3.5)."""
    inner = fp.NovelFriedlandPark(MOTOR + LOAD, fp.Quadratic(50.0))
    observer = fp.HighOrderFeedforward(inner, MOTOR, LOAD, STIFFNESS, DAMPING)
    state = observer.init()
    solver, dt = fp.get_solver("rk4"), jnp.asarray(0.1 * DT)  # RK4 at 20 Hz: (130 dt)^5 / 120 a step
    one = jnp.asarray(1.0)

    def advance(state, _):
        after = solver.advance(lambda node, at: observer.derivative(at, one, one), state, dt)
        return after, state.filtered * STIFFNESS + state.filter_rate * DAMPING

    _, transmitted = jax.lax.scan(advance, state, None, length=10 * SAMPLES)
    _, truth = control.step_response(HIGH, np.arange(SAMPLES) * DT)
    np.testing.assert_allclose(transmitted[::10], truth, rtol=0, atol=1e-7)


@pytest.mark.parametrize("dt", [2e-4, 5e-3])
def test_the_sampled_filter_is_the_exact_discretisation(dt):
    """P_HO under a held torque against scipy's zero-order hold; an Euler step would blow up at 5 ms."""
    observer = fp.HighOrderFeedforward(
        fp.NovelFriedlandPark(MOTOR + LOAD, fp.Quadratic(50.0)), MOTOR, LOAD, STIFFNESS, DAMPING
    )
    state, one = observer.init(), jnp.asarray(1.0)

    def advance(state, _):
        after = observer.step(state, one, one, jnp.asarray(dt))
        return after, after.filtered

    _, filtered = jax.lax.scan(advance, state, None, length=2000)
    form = tuple(np.asarray(m) for m in signal.tf2ss([1.0], [REDUCED, DAMPING, STIFFNESS]))
    a, b, c, *_ = signal.cont2discrete(form, dt, method="zoh")
    x, exact = np.zeros(2), []
    for _ in range(2000):
        x = a @ x + b[:, 0]
        exact.append((c @ x).item())
    np.testing.assert_allclose(filtered, exact, rtol=0, atol=1e-10 / STIFFNESS)


def test_lead_design_against_controls_own_margins():
    """The designed crossover and phase are what python-control measures on the loop (3.16)-(3.26)."""
    loop = lambda s: 1.0 / (INERTIA * s * (1.0 + s / 300.0))  # noqa: E731
    phase = fp.phase_lead_for_margin(loop, 45.0, math.radians(60.0))
    lead = fp.design_lead(loop, 45.0, phase)
    transfer = float(lead.gain) * (S + float(lead.zero)) / (S + float(lead.pole)) / (INERTIA * S * (1.0 + S / 300.0))
    _, margin, _, crossover = control.margin(transfer)
    assert crossover == pytest.approx(2.0 * math.pi * 45.0, rel=1e-6)
    assert margin == pytest.approx(60.0, abs=1e-3)


def test_sampled_pi_on_a_held_plant_is_the_exact_discretisation():
    """The plant's zero-order hold by scipy, the PI's integral one period behind, as a difference equation."""
    dt, kp, ki = 5e-3, 150.0, 2000.0
    loop = fp.ClosedLoop(one_mass(), fp.ProportionalIntegral(kp, ki))
    run = fp.simulate(
        loop, fp.Constant(1.0), dt=dt, samples=200, stepping="sampled", substeps=2, record=("velocity", "torque")
    )
    pole, drive, *_ = signal.cont2discrete(
        tuple(np.asarray([[value]]) for value in (-VISCOUS / INERTIA, 1.0 / INERTIA, 1.0, 0.0)), dt
    )
    # States (w, integral): the loop's own matrix.
    matrix = np.asarray([[pole[0, 0] - drive[0, 0] * kp, drive[0, 0]], [-ki * dt, 1.0]])
    push = np.asarray([drive[0, 0] * kp, ki * dt])
    state, truth = np.zeros(2), []
    for _ in range(200):
        truth.append(state[0])
        state = matrix @ state + push
    # The same difference equation; 200 periods of rounding.
    np.testing.assert_allclose(run.signals["velocity"], truth, rtol=0, atol=1e-10)
    assert np.all(np.abs(linalg.eigvals(matrix)) < 1.0)


def test_sampled_transfer_function_is_scipys_zero_order_hold():
    dt = 5e-3
    numerator, denominator = [150.0, 2e3, 9.0], [1.0, 60.0, 90.0]
    loop = fp.ClosedLoop(one_mass(), fp.TransferFunction(numerator, denominator, period=dt))
    run = fp.simulate(
        loop,
        fp.Sine(1.0, 3.0),
        dt=dt,
        samples=200,
        stepping="sampled",
        record=("reference", "velocity", "torque"),
    )
    error = np.asarray(run.signals["reference"] - run.signals["velocity"])
    discrete = signal.cont2discrete((numerator, denominator), dt)
    truth = signal.lfilter(np.ravel(discrete[0]), discrete[1], error)
    # Equal but for the rounding of two other orders of operations, on a torque of 150 N m.
    np.testing.assert_allclose(run.signals["torque"], truth, rtol=0, atol=1e-8)


@pytest.mark.parametrize("stepping", ["continuous", "sampled"])
def test_actuator_lag_under_a_step(stepping):
    """Sampled, the lag's mean over each period is exact, so the velocity of an inertia is too."""
    lag = 4e-3
    loop = fp.ClosedLoop(fp.OneMass(INERTIA, fp.NoFriction()), fp.TorqueInput(), actuator=fp.Actuator(lag=lag))
    run = fp.simulate(loop, fp.Constant(1.0), dt=DT, samples=50, stepping=stepping, record=("velocity",))
    time = np.asarray(run.time)
    # T(t) = 1 - exp(-t / lag), integrated over the inertia.
    truth = (time - lag * (1.0 - np.exp(-time / lag))) / INERTIA
    np.testing.assert_allclose(run.signals["velocity"], truth, rtol=0, atol=1e-12 if stepping == "sampled" else 1e-6)


@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 1e-3, 2.6e-3])
def test_actuator_delay_shifts_a_ramp(delay):
    """A held ramp delayed by any fraction of a period: the velocity of an inertia lags by exactly that."""
    loop = fp.ClosedLoop(
        fp.OneMass(1.0, fp.NoFriction()), fp.TorqueInput(), actuator=fp.Actuator(delay=delay, longest_delay=4)
    )
    steps = np.arange(60.0)
    run = fp.simulate(loop, fp.Recorded(steps, DT), dt=DT, samples=60, stepping="sampled", record=("velocity",))
    moment = np.arange(60) * DT - delay
    # 1e-9: a delay of whole periods must not lose one to rounding.
    whole = np.floor(moment / DT + 1e-9)
    area = DT * (whole * (whole - 1.0) / 2.0 + whole * (moment / DT - whole))
    np.testing.assert_allclose(run.signals["velocity"][5:], area[5:], rtol=0, atol=1e-12)


def test_a_delay_beyond_the_history_kept_is_delayed_all_the_same():
    """Beyond the history the delayed signal would be zero: a run keeps as much as its delay needs."""
    blocks = (fp.OneMass(1.0, fp.Viscous(0.5)), fp.ProportionalIntegral(5.0, 10.0))
    short, long = (
        fp.ClosedLoop(
            *blocks, actuator=fp.Actuator(delay=12e-3, longest_delay=kept),
            sensor=ServoSensor(delay=18.5e-3, longest_delay=kept),
        )
        for kept in (2, 40)
    )  # fmt: skip
    settings = {"dt": DT, "samples": 200, "stepping": "sampled", "record": ("applied", "measured_velocity")}
    for initial in (None, short.init()):
        found, truth = (fp.simulate(loop, fp.Constant(1.0), initial=initial, **settings) for loop in (short, long))
        assert np.flatnonzero(found.signals["applied"])[0] == 12
        for name, values in truth.signals.items():
            np.testing.assert_allclose(found.signals[name], values, rtol=1e-12, atol=1e-15)
    margins = [loop.linearise(1.0, dt=DT).margins().delay_margin for loop in (short, long)]
    assert margins[0] == pytest.approx(margins[1], rel=1e-9)
    with pytest.raises(fp.InputError, match=r"actuator.delay = 2 s is 2000 periods of dt = 0.001 s"):
        fp.simulate(fp.set_parameters(short, {"actuator.delay": 2.0}), fp.Constant(1.0), **settings)
