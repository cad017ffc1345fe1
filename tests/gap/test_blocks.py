"""The blocks that carry the diagnosis' effects: neutral values, exact steps, references that are not ourselves."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from fpjax import CoulombViscous, InputError, LuGre, Motion, OneMass, PlantOutput
from fpjax.blocks.friction.bristles import Bristles
from fpjax.blocks.friction.general import GeneralFriction
from fpjax.blocks.plants import OneMassState, TwoMassState
from fpjax.blocks.plants.sticking import advance_exact
from fpjax.blocks.plants.transmission import Transmission
from fpjax.blocks.position_torque import PositionTorque
from fpjax.blocks.servo_sensor import ServoSensor
from fpjax.gap import EFFECTS, Setting
from fpjax.gap.effects.effect import free
from fpjax.gap.machine import FEATURES, nominal_machine
from fpjax.gap.simulate.family import Nominal, key_for, make_family
from fpjax.gap.simulate.replay import assembled


def motion(velocity, position=0.3, time=0.7):
    return Motion(jnp.asarray(velocity), jnp.asarray(position), jnp.asarray(time), jnp.asarray(0.5))


def setting():
    nominal = {"inertia": 0.5, "coulomb": 2.0, "viscous": 0.3}
    return Setting(0.5, 2.0, 0.3, 2.0, 3.0, 9.0, 4.0, 10.0, 1e-3, effort=12.0, nominal=nominal)


@pytest.mark.parametrize("velocity", [-2.0, -1e-3, 0.0, 1e-3, 2.0])
def test_general_friction_at_its_neutral_values_is_coulomb_and_viscous(velocity):
    zeros = tuple(jnp.zeros(()) for _ in range(3))
    law = GeneralFriction(
        2.0, 0.3, stribeck_torque=0.0, drift_amplitude=0.0, position_cosine=zeros, position_sine=zeros
    )
    plain = CoulombViscous(2.0, 0.3)
    at = motion(velocity)
    assert float(law.level(at)) == float(plain.level(at))
    assert float(law.drag(at)) == float(plain.drag(at))


@pytest.mark.parametrize(("deflection", "exponent"), [(0.02, 1.0), (0.02, 2.0), (0.02, 0.5), (0.005, 1.3)])
def test_the_bristles_exact_step_is_the_solution_of_their_equation(deflection, exponent):
    bristles = Bristles(GeneralFriction(2.0, 0.0), deflection, 0.0, exponent)

    def slope(x, s):
        return np.sign(1 - s) * abs(1 - s) ** exponent / deflection

    for travel in (0.001, 0.01, 0.02):
        found = solve_ivp(slope, (0.0, travel), [-0.4], rtol=1e-10, atol=1e-12, method="LSODA").y[0, -1]
        np.testing.assert_allclose(bristles.advance(jnp.asarray(-0.4), jnp.asarray(travel)), found, atol=1e-6)


def test_bristles_slide_as_lugre_does_at_constant_level():
    lugre = LuGre(2.0, 2.0, 1.0, 100.0, 0.0, 0.3)
    bristles = Bristles(GeneralFriction(2.0, 0.3), 2.0 / 100.0)
    at = motion(0.4)
    share = jnp.asarray(0.37)
    z = share * 2.0 / 100.0
    np.testing.assert_allclose(bristles.derivative(share, at) * 0.02, lugre.derivative(z, at), rtol=1e-12)
    np.testing.assert_allclose(bristles.readout(share, at, 0.0), lugre.readout(z, at, jnp.asarray(0.0)), rtol=1e-12)


def test_a_mass_that_stops_within_the_step_sticks_and_one_that_is_pushed_harder_turns():
    plant = OneMass(2.0, CoulombViscous(3.0, 0.0))
    state = OneMassState(jnp.asarray(0.01), jnp.asarray(0.0), ())
    dt, zero = jnp.asarray(0.1), jnp.asarray(0.0)
    held = advance_exact(plant, state, jnp.asarray(2.0), zero, dt)
    assert float(held.velocity) == 0.0
    # Stops after v / a with a = (3 - 2) / 2 = 0.5 rad/s^2, on half of v t.
    np.testing.assert_allclose(held.position, 0.5 * 0.01 * (0.01 / 0.5), rtol=1e-12)
    turned = advance_exact(plant, state, jnp.asarray(-5.0), zero, dt)
    # Slowed down by 5 + 3 N m until rest, then driven back by 5 - 3.
    until = 0.01 / (8.0 / 2.0)
    np.testing.assert_allclose(turned.velocity, -(0.1 - until) * 1.0, rtol=1e-12)
    np.testing.assert_allclose(turned.position, 0.5 * 0.01 * until - 0.5 * (0.1 - until) ** 2, rtol=1e-9)


def test_a_resting_mass_stays_exactly_and_its_sensitivity_is_zero():
    plant = OneMass(2.0, CoulombViscous(3.0, 0.1))

    def after(torque):
        state = OneMassState(jnp.zeros_like(torque), jnp.zeros_like(torque), ())
        return advance_exact(plant, state, torque, jnp.asarray(0.0), jnp.asarray(1e-3)).velocity

    value, slope = jax.jvp(after, (jnp.asarray(2.5),), (jnp.asarray(1.0),))
    assert float(value) == 0.0
    assert float(slope) == 0.0
    value, slope = jax.jvp(after, (jnp.asarray(3.5),), (jnp.asarray(1.0),))
    # (3.5 - 3) N m on 2 kg m^2 for 1 ms; viscous friction takes a share of 5e-5.
    np.testing.assert_allclose(value, 0.5e-3 * 0.5, rtol=1e-3)
    np.testing.assert_allclose(slope, 0.5e-3, rtol=1e-3)


def test_one_step_a_period_is_second_order_away_from_rest():
    plant = OneMass(
        0.5,
        GeneralFriction(2.0, 0.3, stribeck_torque=1.0, stribeck_velocity=0.5),
        PositionTorque((jnp.asarray(0.4),), (jnp.asarray(-0.2),), 5.0),
    )

    def slope(t, y):
        level = 2.0 + np.exp(-(abs(y[0] / 0.5) ** 2))
        load = 0.4 * np.cos(5 * y[1]) - 0.2 * np.sin(5 * y[1])
        return [(6.0 - np.sign(y[0]) * level - 0.3 * y[0] - load) / 0.5, y[0]]

    exact = solve_ivp(slope, (0, 0.1), [0.5, 0.2], rtol=1e-11, atol=1e-13).y[:, -1]
    errors = []
    for steps in (20, 40):
        state = OneMassState(jnp.asarray(0.5), jnp.asarray(0.2), ())
        for k in range(steps):
            state = advance_exact(
                plant, state, jnp.asarray(6.0), jnp.asarray(k * 0.1 / steps), jnp.asarray(0.1 / steps)
            )
        errors.append(abs(float(state.velocity) - exact[0]))
    # Half the step: a quarter of the error, nearly.
    assert errors[1] < errors[0] / 3.5


def test_a_transmission_without_play_and_friction_is_a_linear_spring():
    plant = Transmission(1.0, 0.4, 900.0, 0.5, GeneralFriction(0.0, 0.0))

    def slope(t, y):
        shaft = 900.0 * (y[1] - y[3]) + 0.5 * (y[0] - y[2])
        return [(0.7 - shaft) / 0.6, y[0], shaft / 0.4, y[2]]

    exact = solve_ivp(slope, (0, 0.1), [0.3, 0.01, -0.1, 0.0], rtol=1e-11, atol=1e-13).y[:, -1]
    errors, step = [], eqx.filter_jit(advance_exact)
    for times in (2, 8):  # as 4 and 16 substeps of a millisecond, in one program
        state = TwoMassState(jnp.asarray(0.3), jnp.asarray(0.01), jnp.asarray(-0.1), jnp.asarray(0.0), ())
        for k in range(100 * times):
            dt = 1e-3 / times
            state = step(plant, state, jnp.asarray(0.7), jnp.asarray(k * dt), jnp.asarray(dt), 2)
        found = [state.motor_velocity, state.motor_position, state.load_velocity, state.load_position]
        errors.append(np.max(np.abs(np.array(found) - exact)))
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 12  # second order


def test_a_shaft_that_hardens_swings_in_the_period_of_duffings_oscillator():
    """x'' + a x + b x^3 = 0 from rest at A: 4 K(m) / sqrt(a + b A^2), m = b A^2 / (2 (a + b A^2))."""
    plant = Transmission(1.0, 0.4, 900.0, 0.0, GeneralFriction(0.0, 0.0), hardening=4e6)
    mobility, amplitude = 1.0 / 0.4 + 1.0 / 0.6, 0.03
    a, b = 900.0 * mobility, 4e6 * mobility * amplitude**2
    period = 4.0 * ellipk(b / (2.0 * (a + b))) / np.sqrt(a + b)
    step = eqx.filter_jit(advance_exact)
    state = TwoMassState(jnp.asarray(0.0), jnp.asarray(amplitude), jnp.asarray(0.0), jnp.asarray(0.0), ())
    dt, twists = period / 200, []
    for k in range(201):
        twists.append(float(state.motor_position - state.load_position))
        state = step(plant, state, jnp.asarray(0.0), jnp.asarray(k * dt), jnp.asarray(dt), 4)
    assert twists[200] == pytest.approx(amplitude, rel=1e-3)
    assert twists[100] == pytest.approx(-amplitude, rel=1e-3)
    assert abs(twists[50]) < 0.01 * amplitude
    # Twice as fast as the small swings: without the cubic the twist would be far from its start.
    assert period < 0.6 * 2.0 * np.pi / np.sqrt(a)


def test_a_shaft_that_hardens_is_a_plain_spring_at_small_twists_and_steeper_beyond():
    plant = Transmission(1.0, 0.4, 900.0, 0.0, GeneralFriction(0.0, 0.0), gap=0.02, hardening=5e4)
    torque = [
        float(plant.shaft(TwoMassState(*map(jnp.asarray, (0.0, x, 0.0, 0.0)), ()))) for x in (0.005, 0.0101, -0.11)
    ]
    np.testing.assert_allclose(torque, [0.0, 900.0 * 1e-4, -(900.0 * 0.1 + 5e4 * 0.1**3)], rtol=1e-6)
    with pytest.raises(InputError, match="hardening"):
        Transmission(1.0, 0.4, 900.0, 0.0, GeneralFriction(0.0, 0.0), hardening=-1.0)


def test_inside_the_play_nothing_is_transmitted():
    plant = Transmission(1.0, 0.5, 1e4, 10.0, GeneralFriction(0.0, 0.0), gap=0.1)
    state = TwoMassState(jnp.asarray(0.2), jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(0.0), ())
    after = advance_exact(plant, state, jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(1e-3), 4)
    assert float(after.load_velocity) == 0.0
    assert float(after.motor_velocity) == pytest.approx(0.2, rel=1e-12)


def test_a_plant_without_an_exact_step_says_so():
    plant = OneMass(1.0, LuGre(1.0, 1.5, 0.1, 100.0))
    with pytest.raises(InputError, match="exact sticking"):
        advance_exact(plant, plant.init(), jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(1e-3))


def test_the_neutral_servo_sensor_reads_the_truth():
    sensor = ServoSensor()
    state = sensor.init()
    for rate in (0.1, 0.5, -0.2):
        value = jnp.asarray(rate)
        output = PlantOutput(value, 2 * value, value, 2 * value, value)
        state, read = sensor.step(state, output, (jnp.asarray(0.0), jnp.asarray(0.0)), jnp.asarray(1e-3))
        assert float(read.velocity) == pytest.approx(rate, abs=1e-12)
        assert float(read.position) == pytest.approx(2 * rate, abs=1e-12)


def test_the_sensors_lag_is_exact_for_a_ramp():
    sensor = ServoSensor(lag=0.02)
    lagged, before = jnp.asarray(0.0), jnp.asarray(0.0)
    for k in range(1, 101):
        rate = jnp.asarray(2.0 * k * 1e-3)
        lagged = sensor.follow(lagged, before, rate, jnp.asarray(1e-3))
        before = rate
    t = 0.1
    np.testing.assert_allclose(lagged, 2.0 * (t - 0.02 * (1 - np.exp(-t / 0.02))), rtol=1e-10)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_at_its_neutral_value_is_exactly_not_there(effect):
    s = setting()
    nominal = Nominal(OneMass(0.5, CoulombViscous(2.0, 0.3)))
    family = make_family(key_for((effect,), s), nominal, (effect,), s)
    names = [p.name for p in effect.parameters]
    changed = assembled(family.machine, family.effects, family.parameters, jnp.asarray(family.neutral(s))[:, None])
    plain = family.machine
    if effect.structure != "rigid":
        assert all(p.low(s) <= p.neutral(s) <= p.high(s) for p in effect.parameters)
        return
    for at in (0.0, 0.4, -2.0):
        m = Motion(jnp.asarray([at]), jnp.asarray([0.3]), jnp.asarray([0.2]), jnp.asarray([0.5]))
        for law, other in ((changed.plant.friction, plain.plant.friction), (changed.plant.load, plain.plant.load)):
            if hasattr(law, "level"):
                assert float(law.level(m)[0]) == float(jnp.ravel(other.level(m))[0])
                assert float(law.drag(m)[0]) == float(jnp.ravel(other.drag(m))[0])
            else:
                assert float(law.readout(m)[0]) == float(jnp.ravel(other.readout(m))[0])
    for name in ("gain", "lag", "delay", "limit", "dead_zone", "offset"):
        assert float(getattr(changed.actuator, name)[0]) == float(getattr(plain.actuator, name)), names


def test_every_effect_of_the_contract_is_there_with_its_parameters():
    names = {effect.name for effect in EFFECTS}
    assert len(names) == 24  # the 25th, velocity_quantisation, is read from the data
    parameters = free(EFFECTS)
    s = setting()
    for parameter in parameters:
        value = parameter.neutral(s)
        assert parameter.low(s) < parameter.high(s), parameter.name
        assert parameter.low(s) <= value or parameter.name == "limit", parameter.name
        assert parameter.scale(s) > 0, parameter.name


def test_a_machine_without_features_is_the_same_machine():
    plant = OneMass(0.5, CoulombViscous(2.0, 0.3))
    with_all, without = nominal_machine(plant, features=FEATURES), nominal_machine(plant, features=())
    at = motion(0.2)
    assert float(with_all.law.level(at)) == float(without.law.level(at))
    assert not eqx.tree_equal(with_all, without)
