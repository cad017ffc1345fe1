"""Smooth loops against scipy's DOP853 and Radau, written out by hand, and each solver's order of convergence."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fpjax as fp

INERTIA, KP, KI = 10.0, 150.0, 200.0
END = 0.4


def reference(time):
    return np.sin(2.0 * np.pi * 5.0 * time + 0.4)


def truth(rates, states, method="DOP853"):
    """Final state to about 1e-12."""
    return solve_ivp(rates, (0.0, END), np.zeros(states), method, rtol=1e-12, atol=1e-13).y[:, -1]


def run(loop, dt, solver="rk4", record=("velocity",)):
    """Signals at t = END."""
    samples = round(END / dt) + 1
    result = fp.simulate(loop, fp.Sine(1.0, 5.0, 0.4), dt=dt, samples=samples, solver=solver, record=record)
    return [float(result.signals[name][-1]) for name in record]


def efp_loop():
    plant = fp.OneMass(INERTIA, fp.CoulombViscous(20.0, 2.0, 5.0))
    return fp.ClosedLoop(plant, fp.ProportionalIntegral(KP, KI), fp.ExtendedFriedlandPark(INERTIA, 30.0, 20.0, 5.0))


def efp_rates(time, state):
    velocity, integral, first, second = state
    error = reference(time) - velocity
    control = KP * error + integral
    coulomb = first - 20.0 / 5.0 * np.log(np.cosh(5.0 * velocity))
    viscous = second - 15.0 * velocity**2
    side = np.tanh(5.0 * velocity)
    torque = control + coulomb * side + viscous * velocity
    friction = 20.0 * side + 2.0 * velocity
    return [
        (torque - friction) / INERTIA,
        KI * error,
        20.0 * side * control / INERTIA,
        30.0 * velocity * control / INERTIA,
    ]


# The largest step of each is one at which its error already falls as it should, and not yet to rounding.
@pytest.mark.parametrize(
    ("solver", "order", "largest"),
    [
        ("euler", 1, 1e-3),
        pytest.param("heun", 2, 5e-4, marks=pytest.mark.long),
        pytest.param("ode3", 3, 2e-3, marks=pytest.mark.long),
        ("rk4", 4, 4e-3),
    ],
)
def test_order_of_convergence_of_a_compensated_loop(solver, order, largest):
    exact = truth(efp_rates, 4)
    coulomb = exact[2] - 4.0 * np.log(np.cosh(5.0 * exact[0]))
    target = np.asarray([exact[0], coulomb, exact[3] - 15.0 * exact[0] ** 2])
    record = ("velocity", "estimates.coulomb", "estimates.viscous")
    errors = [
        np.linalg.norm(np.asarray(run(efp_loop(), dt, solver, record)) - target)
        for dt in (largest, largest / 2, largest / 4)
    ]
    orders = np.log2(np.asarray(errors[:-1]) / np.asarray(errors[1:]))
    # A quarter of an order: the next order still has a share at these steps.
    assert np.all(np.abs(orders - order) < 0.25), (errors, orders)


def stribeck(velocity):
    return (20.0 + 5.0 * np.exp(-((velocity / 0.3) ** 2))) * np.tanh(8.0 * velocity) + 2.0 * velocity


FRICTIONS = {
    "smooth_coulomb": (fp.SmoothCoulomb(20.0, 8.0), lambda w: 20.0 * np.tanh(8.0 * w)),
    "stribeck": (fp.Stribeck(20.0, 25.0, 0.3, 2.0, 2.0, 8.0), stribeck),
    "viscous": (fp.Viscous(2.0), lambda w: 2.0 * w),
    "asymmetric": (
        # The two drags meet at w = 0 with a kink in the slope, so only the Coulomb part differs here.
        fp.AsymmetricCoulombViscous(20.0, 12.0, 2.0, 2.0, 8.0),
        lambda w: (16.0 + 4.0 * np.tanh(8.0 * w)) * np.tanh(8.0 * w) + 2.0 * w,
    ),
}


@pytest.mark.parametrize("name", FRICTIONS)
def test_friction_laws_in_a_loop(name):
    law, friction = FRICTIONS[name]

    def rates(time, state):
        error = reference(time) - state[0]
        return [(KP * error + state[1] - friction(state[0])) / INERTIA, KI * error]

    loop = fp.ClosedLoop(fp.OneMass(INERTIA, law), fp.ProportionalIntegral(KP, KI))
    # RK4 at 5e-4: the loop's fastest rate is (KP + 8 x 25) / J = 35 1/s, so (35 x 5e-4)^4 / 120 = 1e-9.
    assert run(loop, 5e-4)[0] == pytest.approx(truth(rates, 2)[0], abs=1e-8)


def test_dahl_against_radau():
    def rates(time, state):
        velocity, integral, friction = state
        error = reference(time) - velocity
        slack = 1.0 - friction / 20.0 * np.sign(velocity)
        bend = 2000.0 * np.sign(slack) * np.abs(slack) ** 1.0 * velocity
        return [(KP * error + integral - friction) / INERTIA, KI * error, bend]

    loop = fp.ClosedLoop(fp.OneMass(INERTIA, fp.Dahl(20.0, 2000.0)), fp.ProportionalIntegral(KP, KI))
    # Kinks where w changes its sign cost RK4 its order there: about dt^2 x the jump of the slope.
    assert run(loop, 1e-4)[0] == pytest.approx(truth(rates, 3, "Radau")[0], abs=1e-6)


def test_two_masses_against_dop853():
    motor, load, stiffness, damping = 4.0, 6.0, 4e4, 40.0

    def rates(time, state):
        first, second, twist, integral = state
        error = reference(time) - first
        shaft = stiffness * twist + damping * (first - second)
        friction = 20.0 * np.tanh(8.0 * second) + 2.0 * second
        return [
            (KP * error + integral - shaft) / motor,
            (shaft - friction) / load,
            first - second,
            KI * error,
        ]

    plant = fp.TwoMass(motor, load, stiffness, damping, fp.CoulombViscous(20.0, 2.0, 8.0))
    loop = fp.ClosedLoop(plant, fp.ProportionalIntegral(KP, KI), sensor=fp.IdealSensor("motor"))
    # 20 Hz resonance: (130 x 1e-4)^4 / 120 x 13,000 steps x the state's size.
    found = run(loop, 1e-4, "rk4", ("motor_velocity", "velocity"))
    np.testing.assert_allclose(found, truth(rates, 4)[:2], rtol=0, atol=2e-8)


def test_sampled_loop_with_many_substeps_is_the_continuous_plant_under_a_held_torque():
    """Between samples the plant is integrated as scipy does it, the torque held."""
    dt, law = 2e-3, fp.CoulombViscous(20.0, 2.0, 8.0)
    loop = fp.ClosedLoop(fp.OneMass(INERTIA, law), fp.ProportionalIntegral(KP, KI))
    result = fp.simulate(
        loop, fp.Sine(1.0, 5.0, 0.4), dt=dt, samples=41, stepping="sampled", substeps=8, record=("velocity", "torque")
    )
    velocity = integral = 0.0
    for index in range(41):
        error = reference(index * dt) - velocity
        torque = KP * error + integral
        # RK4 with 8 substeps of 0.25 ms at 16 1/s (8 x 20 / 10): (16 x 2.5e-4)^4 / 120 = 2e-12 a step.
        assert float(result.signals["velocity"][index]) == pytest.approx(velocity, abs=1e-9)
        assert float(result.signals["torque"][index]) == pytest.approx(torque, abs=1e-7)
        integral += KI * error * dt
        held = lambda t, w, u=torque: (u - 20.0 * np.tanh(8.0 * w) - 2.0 * w) / INERTIA  # noqa: E731
        velocity = solve_ivp(held, (0.0, dt), [velocity], "DOP853", rtol=1e-12, atol=1e-13).y[0, -1]


def test_single_precision_gives_the_same_to_single_precision():
    loop = efp_loop()
    double = run(loop, 1e-3)[0]
    single = fp.simulate(
        fp.astype(loop, jnp.float32),
        fp.astype(fp.Sine(1.0, 5.0, 0.4), jnp.float32),
        dt=jnp.float32(1e-3),
        samples=round(END / 1e-3) + 1,
        record=("velocity",),
    ).signals["velocity"][-1]
    assert single.dtype == jnp.float32
    # 400 steps of rounding at 6e-8, which the compensated loop multiplies.
    assert float(single) == pytest.approx(double, abs=1e-4)
