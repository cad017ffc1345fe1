"""A model whose friction holds the machine at rest while it moves."""

import dataclasses
from types import SimpleNamespace

import equinox as eqx
import gap_search
import jax.numpy as jnp
import numpy as np
import numpy_machine
import pytest

import fpjax as fp
from fpjax import OneMass, Stribeck, load_model
from fpjax.blocks.plants import OneMassState, TwoMassState
from fpjax.gap.data.channel import make_channel
from fpjax.gap.data.motion import encoder_rate, motion
from fpjax.gap.data.record import make_records
from fpjax.gap.data.replay_tables import LATE, surely_moving
from fpjax.gap.data.setting import reading_at_rest
from fpjax.gap.data.tables import TAPS, Guide, Tables
from fpjax.gap.machine import lanes, nominal_machine, with_structure
from fpjax.gap.simulate.held_motion import moved as moved_on
from fpjax.gap.simulate.held_motion import output_of, sure_speed
from fpjax.gap.simulate.replay import STATES, advance, begin
from fpjax.gap.simulate.windows import Windows
from fpjax.gap.verb import make_search
from fpjax.simulation.precision import double_precision

COULOMB = numpy_machine.Machine().coulomb


def slow(time):
    """A speed that changes its direction every two seconds [rad/s]."""
    return 0.5 * np.sign(np.sin(0.5 * np.pi * time + 0.1))


def search_of(coulomb, sensors=("velocity", "position"), dt=1e-3, seconds=8.0):
    time = dt * np.arange(round(seconds / dt))
    log = numpy_machine.record(seconds=seconds, dt=dt, reference=slow(time), sensors=sensors)
    model = gap_search.MODEL.replace("coulomb = 0.4", f"coulomb = {coulomb}").replace("dt = 1e-3", f"dt = {dt}")
    return make_search([log], [], load_model(model))


@pytest.mark.long  # a fit each
@pytest.mark.parametrize("sensors", [("velocity", "position"), ("velocity",)])
def test_what_a_friction_above_every_torque_misses_is_told_at_its_size(sensors):
    search = search_of(12 * COULOMB, sensors)
    record = search.records[0]
    steady = [
        int(i) for i, start in enumerate(record.starts) if np.all(surely_moving(record)[start : start + record.samples])
    ]
    missing = search.finish([search.exact])[0].missing_rms([np.array(steady)])
    assert len(steady) >= 3
    assert missing == pytest.approx(11 * COULOMB, rel=0.05)


def motion_of(speed, noise=1e-5, sensors="position"):
    """What tells where a machine of some speed [rad/s] moves: readings of an encoder or a rate sensor at 1 kHz."""
    scatter = noise * np.random.default_rng(1).standard_normal((2, len(speed)))
    position = make_channel(np.cumsum(1e-3 * speed) + 1e-3 * scatter[0]) if sensors == "position" else None
    velocity = make_channel(speed + 100.0 * scatter[1]) if sensors == "velocity" else None
    measured, _, _, deviation = motion(velocity, position, 1e-3)
    smoothing = 0
    if position is not None:
        measured, deviation, smoothing = encoder_rate(velocity, position, 1e-3)
    return SimpleNamespace(followed=measured, followed_noise=deviation, smoothing=smoothing)


def ramps(*corners):
    """Straight lines through speeds that are 500 samples apart, and the speed at each sample [rad/s]."""
    return np.interp(np.arange(500 * (len(corners) - 1)), 500 * np.arange(len(corners)), corners)


def doubtful(record):
    """(first, last) sample of each stretch in which a machine does not surely move."""
    still = np.flatnonzero(~surely_moving(record))
    return [(run[0], run[-1]) for run in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1) if len(run)]


@pytest.mark.parametrize(("sensors", "away"), [("position", 2), ("velocity", LATE)])
def test_a_machine_surely_moves_but_at_its_reversals(sensors, away):
    ((start, end),) = [
        (a, b) for a, b in doubtful(motion_of(ramps(1.0, 1.0, -1.0, -1.0), sensors=sensors)) if 0 < a < 1400
    ]
    assert 750 - away - 10 <= start <= 750 - away
    assert 750 + away - 1 <= end <= 750 + away + 10


def test_a_machine_that_nearly_stops_and_goes_on_surely_moves():
    """A simulated one stops there or turns back, and its friction would push for some milliseconds."""
    record = motion_of(ramps(1.0, 1.0, 2e-3, 1.0, 1.0))
    assert all(end < 50 or start > 1950 for start, end in doubtful(record))


def test_bristles_that_bend_at_rest_are_no_motion():
    speed = ramps(1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    speed[1100:] += 0.02 * np.sin(0.02 * np.arange(len(speed) - 1100))
    assert not np.any(surely_moving(motion_of(speed))[1010:])


@pytest.mark.parametrize(("structure", "dt"), [("rigid", 0.01), ("transmission", 1e-3), ("bristles", 1e-3)])
def test_a_machine_at_rest_feels_the_friction_of_the_motion_it_should_have(structure, dt):
    """In 10 ms a start fast enough not to stop would have another Stribeck torque: 0.5 rad/s has not.

    The drag of a rigid one is that of its own speed, none: what it lacks is what the damping of the modes expects.
    """
    inertia, applied, speed = 0.05, 0.2, 0.5
    law = Stribeck(5.0, 6.0, 0.3, viscous=0.8)
    friction = 5.0 + (6.0 - 5.0) * np.exp(-((speed / 0.3) ** float(law.exponent)))
    with double_precision():
        machine = with_structure(nominal_machine(OneMass(inertia, law), None, None, ("shape",)), structure, 50.0, 1e-3)
        zero = jnp.zeros(())
        state = {
            "rigid": OneMassState(zero, zero, ()),
            "bristles": OneMassState(zero, zero, jnp.ones(())),  # all bent
            "transmission": TwoMassState(zero, zero, zero, zero, ()),
        }[structure]
        shift = jnp.asarray(speed), zero
        moved = moved_on(machine, state, jnp.asarray(applied), shift, jnp.ones(()), zero, jnp.asarray(dt), 4)
        speeds = [moved.motor_velocity, moved.load_velocity] if structure == "transmission" else [moved.velocity]
    fading = 0.8 * dt / inertia  # of what a rigid one gains, by its own drag
    rigid = (applied - friction) * (1.0 - np.exp(-fading)) / fading
    expected = rigid if structure == "rigid" else applied - friction - 0.8 * speed
    assert np.mean(speeds) * inertia / dt == pytest.approx(expected, rel=0.01)


def test_a_friction_by_load_of_a_held_machine_grows_with_the_torque_alone():
    law = fp.CoulombViscous(0.4, 0.8).general()
    law = eqx.tree_at(lambda at: at.load_coefficient, law, 0.3, is_leaf=lambda leaf: leaf is None)
    inertia, torque, dt = 0.05, 0.2, 1e-3
    with double_precision():
        machine = nominal_machine(OneMass(inertia, law), None, None)
        zero, state = jnp.zeros(()), OneMassState(jnp.zeros(()), jnp.zeros(()), ())
        shift = jnp.ones(()), zero
        moved = moved_on(machine, state, jnp.asarray(torque), shift, jnp.ones(()), zero, jnp.asarray(dt), 4)
    assert float(moved.velocity) * inertia / dt == pytest.approx(torque - 0.4 - 0.3 * torque, rel=0.02)


@pytest.mark.parametrize("structure", ["transmission", "bristles"])
def test_a_light_machine_that_is_as_fast_as_it_was_feels_the_friction_of_that_speed(structure):
    """Within 2 ms its friction could stop it from 0.2 rad/s: it is not taken for faster than it surely was."""
    inertia, dt, speed, law = 0.012, 2e-3, 0.1, Stribeck(0.4, 0.7, 0.1, viscous=0.1)
    friction = 0.4 + 0.3 * np.exp(-((speed / 0.1) ** float(law.exponent))) + 0.1 * speed
    with double_precision():
        machine = with_structure(nominal_machine(OneMass(inertia, law), None, None, ("shape",)), structure, 50.0, 1e-4)
        zero, moving = jnp.zeros(()), jnp.asarray(speed)
        state = (
            OneMassState(moving, zero, jnp.ones(()))
            if structure == "bristles"
            else TwoMassState(moving, zero, moving, zero, ())
        )
        at = jnp.asarray(friction), (zero, zero), moving, zero, jnp.asarray(dt)
        moved = moved_on(machine, state, *at, 4)
        speeds = [moved.motor_velocity, moved.load_velocity] if structure == "transmission" else [moved.velocity]
    # Held by its own friction the speed stays, but for the swing of a shaft that has no twist yet. At the speed from
    # which it could not stop within the period two fifths of the friction were missing.
    assert (np.mean(speeds) - speed) * inertia / dt == pytest.approx(0.0, abs=0.05 * friction)


@pytest.mark.parametrize("structure", ["rigid", "transmission", "bristles"])
def test_what_a_machine_does_that_should_move_has_no_jumps(structure):
    """Else a fit sees slopes of any size where a lane stops and its neighbour, a small change away, does not."""
    inertia, dt = 0.05, 1e-3
    law = Stribeck(0.4, 0.5, 0.3, viscous=0.1)
    with double_precision():
        machine = with_structure(nominal_machine(OneMass(inertia, law), None, None, ("shape",)), structure, 50.0, 1e-3)
        tables = Tables(
            *[jnp.full(64 + TAPS, 0.2)] + [jnp.zeros(64 + TAPS)] * 4,
            jnp.asarray(dt),
            Guide(jnp.zeros(64 + TAPS), jnp.zeros(64 + TAPS), jnp.zeros(()), jnp.zeros(())),
            jnp.full(64 + TAPS, 0.3),
            jnp.zeros(()),
        )
        speeds = jnp.linspace(0.0, 0.1, 4001)  # it would come to rest after 0 to 20 periods
        machines = lanes(machine, len(speeds))
        windows = Windows(
            jnp.full(speeds.shape, TAPS),
            0 * speeds,
            speeds,
            0 * speeds,
            0 * speeds,
            (jnp.ones(speeds.shape) if structure == "bristles" else 0 * speeds, 0 * speeds),
            0 * speeds,
        )
        states = jnp.zeros((STATES[structure], len(speeds)))
        carry = begin(machines, windows, states, tables)
        for index in range(40):
            carry, _ = advance(machines, carry, windows, tables, jnp.asarray(index))
        reached = np.asarray(output_of(carry.plant).motor_velocity)
    steps = np.abs(np.diff(reached))
    assert np.ptp(reached) > 0.01
    assert np.max(steps) < 5.0 * np.median(steps) + 0.1 * np.max(np.diff(speeds))


def stopping(time):
    """A speed that rests for half of the time [rad/s]."""
    return np.where(np.sin(np.pi * time) > 0.0, 2.0 * np.sign(np.sin(0.5 * np.pi * time + 0.1)), 0.0)


BIAS = 0.15


def rests(bias):
    log = numpy_machine.record(reference=stopping(1e-3 * np.arange(8000)), sensors=("velocity",))
    return dataclasses.replace(log, velocity=log.velocity + bias)


@pytest.mark.parametrize("bias", [BIAS, -BIAS])
def test_a_rate_sensor_says_at_rest_what_its_bias_is(bias):
    (record,) = make_records([rests(bias)], [], 0.05)
    assert reading_at_rest(record) == pytest.approx(bias, abs=2e-3)
    (beside,) = make_records([numpy_machine.record(reference=stopping(1e-3 * np.arange(8000)))], [], 0.05)
    assert reading_at_rest(beside) == 0.0


def test_a_steady_speed_and_one_slow_moment_are_no_rest():
    swinging = numpy_machine.record(
        reference=5.0 * np.sin(2.0 * np.pi * 0.3e-3 * np.arange(8000)), sensors=("velocity",)
    )
    slow = swinging.velocity.copy()
    slow[1000:1060] = 0.8
    (record,) = make_records([dataclasses.replace(swinging, velocity=slow)], [], 0.05)
    assert reading_at_rest(record) == 0.0
    steady = numpy_machine.record(reference=np.full(8000, 3.0), sensors=("velocity",))
    assert reading_at_rest(make_records([steady], [], 0.05)[0]) == 0.0


@pytest.mark.parametrize(
    ("reading", "alone", "speed"),
    [(0.7, 1.0, 0.4), (-0.5, 1.0, -0.8), (0.5, 1.0, 0.0), (0.2, 1.0, 0.0), (0.5, 0.0, 0.5), (0.0, 1.0, 0.0)],
)
def test_what_a_reading_says_of_the_motion_under_a_bias(reading, alone, speed):
    sensor = SimpleNamespace(bias=jnp.asarray(0.3), scale=jnp.asarray(1.0))
    assert float(sure_speed(sensor, jnp.asarray(reading), jnp.asarray(alone))) == pytest.approx(speed)


@pytest.mark.long  # a diagnosis
def test_a_machine_that_rests_under_a_biased_sensor_is_not_held_in_motion():
    """Taken for a motion, its rest lacks twice the friction, under a bias as without."""
    found = fp.diagnose(rests(BIAS), load_model(gap_search.MODEL))
    assert found.causes == ("velocity_bias",)
    assert found.ranking[0].parameters["bias"].value == pytest.approx(BIAS, abs=2e-3)
    assert found.gap.after < 0.1 * COULOMB < found.gap.before
