"""A linearised loop against transfer functions by hand, python-control and the simulation itself."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp
from fpjax.blocks.servo_sensor import ServoSensor

control = pytest.importorskip("control")
J, B, KP, KI, DT = 10.0, 2.0, 150.0, 800.0, 1e-3


def loop(observer=None, controller=None, law=None, **parts):
    body = fp.OneMass(J, law or fp.CoulombViscous(20.0, B, 400.0))
    made = fp.ClosedLoop(body, controller or fp.ProportionalIntegral(KP, KI), **parts)
    return made if observer is None else fp.ClosedLoop(body, made.controller, observer, **parts)


def python_control(ratio):
    """(gain margin, phase margin [deg], modulus margin, phase crossing, gain crossing) of python-control.

    From its frequency response: its polynomials of a sampled system of this order are badly conditioned, and say so.
    """
    high = 1e4 if ratio.dt is None else math.pi / ratio.dt
    grid = np.geomspace(1.0, 0.999 * high, 30_000)
    system = control.ss(ratio.a, ratio.b, ratio.c, ratio.d, ratio.dt or 0)
    points = 1j * grid if ratio.dt is None else np.exp(1j * grid * ratio.dt)
    found = control.stability_margins(control.frd(system(points), grid, smooth=True))
    return found[0], found[1], found[2], found[3], found[4]


def test_the_return_ratio_of_a_pi_loop_is_the_textbooks():
    linear = loop().linearise(2.0, dt=DT, stepping="continuous")
    frequency = np.geomspace(0.1, 1e3, 50)
    s = 1j * frequency
    expected = (KP + KI / s) / (J * s + B)
    assert np.allclose(linear.ratio.response(frequency)[:, 0, 0], expected, rtol=1e-9)
    tracking = linear.tracking().response(frequency)[:, 0, 0]
    assert np.allclose(tracking, expected / (1.0 + expected), rtol=1e-9)
    assert linear.margins().stable


def test_the_sampled_return_ratio_is_the_held_plants():
    linear = loop().linearise(2.0, dt=DT, solver="rk4")
    z = np.exp(1j * np.geomspace(1.0, 3000.0, 40) * DT)
    decay = math.exp(-B / J * DT)
    held = (1.0 - decay) / B / (z - decay)
    expected = (KP + KI * DT / (z - 1.0)) * held
    assert np.allclose(linear.ratio.response(np.angle(z) / DT)[:, 0, 0], expected, rtol=1e-8)


def test_the_bandwidth_is_where_the_tracking_falls_below_half_the_power():
    linear = loop().linearise(2.0, dt=DT, solver="rk4")
    found = np.abs(linear.tracking().response(np.array([linear.bandwidth()]))[0, 0, 0])
    assert found == pytest.approx(math.sqrt(0.5), rel=1e-9)


@pytest.mark.parametrize("stepping", [pytest.param("continuous", marks=pytest.mark.long), "sampled"])
def test_margins_are_python_controls(stepping):
    two = fp.TwoMass(4.0, 6.0, 1e5, 50.0, fp.Viscous(2.0))
    made = fp.ClosedLoop(two, fp.ProportionalIntegral(300.0, 2000.0), sensor=fp.IdealSensor("motor"))
    if stepping == "sampled":
        made = fp.ClosedLoop(two, made.controller, actuator=fp.Actuator(delay=2.4e-3), sensor=made.sensor)
    linear = made.linearise(1.0, dt=DT, stepping=stepping, substeps=4)
    ours, theirs = linear.margins(), python_control(linear.ratio)
    # At high frequencies |1 + L| is 1, which python-control does not count.
    assert ours.modulus_margin == pytest.approx(min(theirs[2], 1.0), rel=1e-3)
    assert ours.phase_margin == pytest.approx(theirs[1], abs=0.01)
    assert ours.gain_crossing == pytest.approx(theirs[4], rel=1e-4)
    if math.isfinite(theirs[0]) and theirs[0] > 1.0:
        assert ours.gain_margin == pytest.approx(theirs[0], rel=1e-3)
        assert ours.phase_crossing == pytest.approx(theirs[3], rel=1e-3)


def test_the_gain_margin_is_where_the_simulation_turns_unstable():
    parts = {"law": fp.Viscous(B), "actuator": fp.Actuator(lag=5e-3)}
    made = loop(controller=fp.Proportional(KP), **parts)
    margin = made.linearise(1.0, dt=5e-3).margins().gain_margin
    assert 1.0 < margin < math.inf

    def spread(factor):
        more = loop(controller=fp.Proportional(factor * KP), **parts)
        run = fp.simulate(more, fp.Constant(1.0), dt=5e-3, samples=4000, stepping="sampled", record="velocity")
        tail = np.asarray(run.signals["velocity"])[-200:]
        return np.ptp(tail) / abs(tail).max() if np.isfinite(tail).all() else math.inf

    assert spread(0.97 * margin) < 1e-3
    assert spread(1.03 * margin) > 0.1


def test_the_delay_margin_is_the_delay_that_makes_it_unstable():
    dt = 5.0 * DT  # a delay of few periods: each is a state, and the response inverts them all at every frequency
    delay = loop(law=fp.Viscous(B)).linearise(1.0, dt=dt).margins().delay_margin
    assert 5.0 < delay / dt < 28.0
    for factor, stable in ((0.97, True), (1.03, False)):
        held = loop(law=fp.Viscous(B), actuator=fp.Actuator(delay=factor * delay, longest_delay=30))
        assert held.linearise(held.init(), dt=dt, reference=0.0).margins().stable is stable


def test_the_linear_step_is_the_simulations_small_step():
    observer = fp.ExtendedFriedlandPark(J, 100.0, 50.0, 400.0)
    made = loop(observer)
    settled = fp.simulate(made, fp.Constant(2.0), dt=DT, samples=20_000, stepping="sampled").final_state
    linear = made.linearise(settled, dt=DT, reference=2.0)
    small, samples = 1e-5, 300
    options = {"dt": DT, "samples": samples, "stepping": "sampled", "initial": settled, "record": "velocity"}
    run = fp.simulate(made, fp.Constant(2.0 + small), **options)
    still = fp.simulate(made, fp.Constant(2.0), **options)
    moved = (np.asarray(run.signals["velocity"]) - np.asarray(still.signals["velocity"])) / small
    _, step = linear.tracking().step((samples - 1) * DT, points=samples)
    assert np.allclose(moved, step[:samples], atol=2e-4)


def test_a_position_cascade_is_linearised_about_its_ramp():
    made = loop(controller=fp.PositionLoop(20.0, fp.ProportionalIntegral(KP, KI)))
    linear = made.linearise(0.5, dt=DT)
    assert linear.tracked == "position"
    assert linear.margins().stable
    time, values = linear.step_response()
    assert values[-1] == pytest.approx(1.0, abs=0.02)
    assert time[-1] > 0.1


def test_a_cascade_in_single_precision_is_linearised_in_double():
    made = loop(controller=fp.PositionLoop(20.0, fp.ProportionalIntegral(KP, KI)))
    rounded = fp.astype(made, jnp.float32)
    one, other = made.linearise(0.5, dt=DT).margins(), rounded.linearise(0.5, dt=DT).margins()
    assert other.modulus_margin == pytest.approx(one.modulus_margin, rel=1e-5)
    assert other.phase_margin == pytest.approx(one.phase_margin, rel=1e-5)
    with jax.enable_x64(False):  # as a process runs that never asked for double
        alone = loop(controller=fp.PositionLoop(20.0, fp.ProportionalIntegral(KP, KI))).linearise(0.5, dt=DT)
    assert alone.margins().modulus_margin == pytest.approx(one.modulus_margin, rel=1e-5)


@pytest.mark.parametrize("sensor", [ServoSensor(position_step=2.4e-5), fp.Encoder(2.4e-5)], ids=["servo", "encoder"])
def test_the_rounding_of_a_sensor_keeps_no_loop_from_its_steady_motion(sensor):
    cascade = fp.PositionLoop(20.0, fp.ProportionalIntegral(KP, KI))
    rounded = loop(controller=cascade, sensor=sensor).linearise(0.5, dt=DT).margins()
    # The same sensor without its steps: an encoder's velocity is a difference, with a delay of its own.
    name = "position_step" if isinstance(sensor, ServoSensor) else "step_size"
    smooth = eqx.tree_at(lambda each: getattr(each, name), sensor, jnp.zeros(()))
    plain = loop(controller=cascade, sensor=smooth).linearise(0.5, dt=DT).margins()
    assert rounded.modulus_margin == pytest.approx(plain.modulus_margin, rel=1e-9)
    assert rounded.delay_margin == pytest.approx(plain.delay_margin, rel=1e-9)


def test_what_stands_around_a_cascade_is_linearised_about_its_ramp_too():
    cascade = fp.PositionLoop(20.0, fp.ProportionalIntegral(KP, KI))
    plain = loop(controller=cascade).linearise(0.5, dt=DT)
    limited = loop(controller=fp.Limited(cascade, 1e3)).linearise(0.5, dt=DT)
    told = loop(controller=fp.PositionFeedforward(cascade, 1.0, J, 20.0, B, 0.1, DT)).linearise(0.5, dt=DT)
    assert limited.tracked == told.tracked == "position"
    # Nothing of it depends on a measurement: it moves no pole and costs no margin.
    for other in (limited, told):
        assert other.margins().modulus_margin == pytest.approx(plain.margins().modulus_margin, rel=1e-6)
        assert other.margins().delay_margin == pytest.approx(plain.margins().delay_margin, rel=1e-6)


def test_python_control_gets_the_same_system():
    linear = loop().linearise(1.0, dt=DT)
    theirs = linear.to_control()
    assert theirs.dt == DT
    assert theirs.input_labels == ["reference", "disturbance"]
    assert np.allclose(np.sort_complex(theirs.poles()), np.sort_complex(linear.closed.poles()))


def test_what_cannot_be_linearised_is_said():
    with pytest.raises(fp.InputError, match=r"does not settle at 1 rad/s"):
        loop(controller=fp.ProportionalIntegral(1e6, 1.0)).linearise(1.0, dt=DT)
    with pytest.raises(fp.InputError, match=r"state needs its reference"):
        loop().linearise(loop().init(), dt=DT)
    with pytest.raises(fp.InputError, match=r"no channel from 'torque'"):
        loop().linearise(1.0, dt=DT).closed.channel("velocity", "torque")
    with pytest.raises(fp.InputError, match=r"dt must be positive"):
        loop().linearise(1.0, dt=0.0)


@pytest.mark.parametrize("controller", [None, fp.PositionLoop(20.0, fp.ProportionalIntegral(KP, KI))])
def test_a_machine_that_friction_holds_has_no_margins(controller):
    stuck = loop(controller=controller, law=fp.CoulombViscous(20.0, B))
    with pytest.raises(fp.InputError, match=r"rests at 0 rad/s.*choose a speed at which it moves"):
        stuck.linearise(0.0, dt=DT, solver="exact")
    assert stuck.linearise(0.5, dt=DT, solver="exact").margins().stable
    # at rest without Coulomb friction, or with a smooth one, every torque moves it
    assert loop(controller=controller, law=fp.Viscous(B)).linearise(0.0, dt=DT, solver="exact").margins().stable
    smooth = loop(controller=controller, law=fp.CoulombViscous(20.0, B, 400.0))
    assert smooth.linearise(0.0, dt=DT).margins().stable


def test_a_load_that_turns_with_the_position_leaves_rest_alone():
    cascade = loop(controller=fp.PositionLoop(20.0, fp.ProportionalIntegral(KP, KI)), law=fp.Viscous(B))
    hanging = eqx.tree_at(lambda one: one.plant.load, cascade, fp.Unbalance(2.0))
    assert hanging.linearise(0.0, dt=DT, solver="exact").margins().stable
    with pytest.raises(fp.InputError, match="no steady motion at any speed but zero"):
        hanging.linearise(0.5, dt=DT, solver="exact")
    slight = eqx.tree_at(lambda one: one.plant.load, cascade, fp.Unbalance(1e-12))
    assert slight.linearise(0.5, dt=DT, solver="exact").margins().stable


def test_the_picture_shows_bode_and_step(tmp_path):
    figure = loop().linearise(1.0, dt=DT).plot(tmp_path / "margins.png")
    assert (tmp_path / "margins.png").stat().st_size > 10_000
    assert len(figure.axes) == 3
    assert jnp.asarray(figure.axes[2].lines[0].get_ydata())[-1] == pytest.approx(1.0, abs=0.05)
