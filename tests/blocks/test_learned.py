"""Tables of a learned torque: what they are between, beyond and at their points; in the file and in the loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from model_files import body
from scipy.interpolate import PchipInterpolator

import fpjax as fp

AT, TORQUE = [-2.0, -0.7, 0.1, 0.6, 1.9, 4.0], [-1.0, 0.4, 0.5, 2.0, 1.2, 1.3]
X = np.linspace(-3.0, 5.0, 401)

SERVO = (
    body(0.5, 1.0, 0.2)
    + """
[controller]
type = "pi"
kp = 5.0
ki = 20.0
[reference]
type = "sine"
amplitude = 2.0
frequency = 1.0
[simulation]
dt = 1e-3
duration = 2.0
stepping = "sampled"
solver = "exact"
"""
)


def inside(x):
    return np.clip(x, AT[0], AT[-1])


def test_straight_lines_are_numpys():
    table = fp.LearnedTorque("position", AT, TORQUE)
    np.testing.assert_allclose(table.value(jnp.asarray(X)), np.interp(X, AT, TORQUE), atol=1e-14)


def test_the_cubic_is_scipys_monotone_one():
    table = fp.LearnedTorque("position", AT, TORQUE, interpolation="cubic")
    np.testing.assert_allclose(table.value(jnp.asarray(X)), PchipInterpolator(AT, TORQUE)(inside(X)), atol=1e-13)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_period_repeats_and_joins(interpolation):
    table = fp.LearnedTorque("position", AT, TORQUE, 7.0, interpolation)
    x = jnp.asarray(X)
    np.testing.assert_allclose(table.value(x + 21.0), table.value(x), atol=1e-12)
    # Over three periods scipy's cubic no longer knows its ends in the middle one; numpy has a period of its own.
    many_at = np.concatenate([np.asarray(AT) + 7.0 * turn for turn in (-2, -1, 0, 1, 2)])
    truth = np.interp(X, AT, TORQUE, period=7.0) if interpolation == "linear" else None
    if truth is None:
        truth = PchipInterpolator(many_at, np.tile(TORQUE, 5))(X)
    np.testing.assert_allclose(table.value(x), truth, atol=1e-12)


def test_every_point_is_a_parameter_with_a_gradient():
    table = fp.LearnedTorque("velocity", AT, TORQUE, interpolation="cubic")

    def total(torque):
        return jnp.sum(fp.LearnedTorque("velocity", AT, torque, interpolation="cubic").value(jnp.asarray(X)))

    start = tuple(jnp.asarray(each) for each in TORQUE)
    slopes = jax.grad(total)(start)
    for i, slope in enumerate(slopes):
        up, down = ([each + step * (i == j) for j, each in enumerate(TORQUE)] for step in (1e-6, -1e-6))
        assert float(slope) == pytest.approx((float(total(up)) - float(total(down))) / 2e-6, rel=1e-6)
    assert {"torque.3", "at.0"} <= {name.replace("[", ".").replace("]", "") for name in fp.parameter_names(table)}


def test_a_jump_at_zero_is_coulomb_friction():
    at, torque, coulomb = fp.split_jump([-2.0, 0.0, 0.0, 3.0], [-2.0, -0.5, 1.5, 2.5])
    assert coulomb == pytest.approx(1.0)
    assert at == [-2.0, 0.0, 3.0]
    np.testing.assert_allclose(torque, [-1.0, 0.5, 1.5])


def learned(of, at, torque, more=""):
    return SERVO + f'[[learned]]\nof = "{of}"\nat = {at}\ntorque = {torque}\n{more}\n'


def run(text):
    model = fp.load_model(text)
    return fp.simulate(
        model.loop,
        model.reference,
        dt=model.dt,
        duration=model.duration,
        stepping=model.stepping,
        solver=model.solver,
        record=("velocity", "position", "applied", "time"),
    ).signals


def test_a_learned_friction_is_the_same_as_the_law_that_it_tabulates():
    """C sign(w) + b w as a table with a jump: the exact step sticks as it does under the law."""
    law = run(SERVO)
    table = run(
        SERVO.replace("coulomb = 1.0", "coulomb = 0.4").replace("viscous = 0.2", "viscous = 0.0")
        + '[[learned]]\nof = "velocity"\nat = [-5, 0, 0, 5]\ntorque = [-1.6, -0.6, 0.6, 1.6]\n'
    )
    # The law's drag is taken at the middle of the step and the table at its start: first order in b dt / J.
    difference = np.max(np.abs(np.asarray(law["velocity"]) - np.asarray(table["velocity"])))
    assert difference < 2.0 * 0.2 * 1e-3 / 0.5 * np.max(np.abs(np.asarray(law["velocity"])))
    model = fp.load_model(learned("velocity", [-5, 0, 0, 5], [-1.6, -0.6, 0.6, 1.6]))
    assert float(model.loop.plant.friction.coulomb) == pytest.approx(1.6)
    assert "jumps by 1.2 N m at zero velocity" in model.notes[0]


@pytest.mark.parametrize(
    ("of", "law"),
    [
        ("position", lambda s: 0.3 * np.asarray(s["position"])),
        ("torque", lambda s: 0.1 * np.asarray(s["applied"])),
        ("time", lambda s: 0.2 * np.asarray(s["time"])),
    ],
)
def test_what_a_table_takes_from_the_motion(of, law):
    """The acceleration lacks exactly what the table holds."""
    slope = {"position": 0.3, "torque": 0.1, "time": 0.2}[of]
    text = learned(of, [-50.0, 50.0], [-50.0 * slope, 50.0 * slope])
    free = text.replace("coulomb = 1.0", "coulomb = 0.0").replace("viscous = 0.2", "viscous = 0.0")
    signals = run(free)
    acceleration = np.diff(np.asarray(signals["velocity"])) / 1e-3
    held = np.asarray(signals["applied"]) - law(signals)
    np.testing.assert_allclose(0.5 * acceleration, held[:-1], atol=2e-3)


def test_a_table_survives_the_file_and_is_found_by_name():
    text = learned("position", AT, TORQUE, 'period = 7.0\ninterpolation = "cubic"')
    model = fp.load_model(text)
    assert fp.load_model(fp.dump_model(model)).loop.plant.load.interpolation == "cubic"
    names = [name for name in fp.parameter_names(model.loop) if "load" in name]
    assert any("torque" in name for name in names)
    pushed = fp.set_parameters(model.loop, {next(name for name in names if "torque" in name): 9.0})
    assert float(pushed.plant.load.torque[0]) == 9.0


def test_a_table_of_the_torque_needs_one():
    table = fp.LearnedTorque("torque", AT, TORQUE)
    zero = jnp.zeros(())
    with pytest.raises(fp.InputError, match="depends on the torque through the gear"):
        table.readout(fp.Motion(zero, zero, zero))
