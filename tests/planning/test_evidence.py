"""The evidence's algebra: what may move is projected out, what one window alone shows does not count."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from plan_case import LIMITS, servo

from fpjax.planning.expected_evidence import apart, evidence_against
from fpjax.planning.measurement_model import make_measurement_model
from fpjax.simulation.precision import double_precision


def test_what_may_move_is_projected_out():
    notes = []
    model = servo()
    measurement = make_measurement_model(model, LIMITS, None, 0.05, {"velocity": 0.01}, notes)
    count, windows = len(measurement.modes.gain), len(measurement.starts)
    rng = np.random.default_rng(0)
    with double_precision():
        tangents = jnp.asarray(1e4 * rng.normal(size=(2, count, windows)))
        shifts = jnp.asarray(1e4 * rng.normal(size=(2, count, windows)))
        shift = rng.normal(size=(2, windows))
        inside = jnp.einsum("p,pmw->mw", jnp.asarray([0.3, -0.2]), tangents)
        inside = inside + jnp.einsum("sw,smw->mw", jnp.asarray(shift), shifts)
        outside = jnp.asarray(rng.normal(size=(count, windows)))
        nothing = evidence_against(measurement, inside, tangents, shifts)
        some = evidence_against(measurement, outside, tangents, shifts)
        more = evidence_against(measurement, 3.0 * outside + inside, tangents, shifts)
    assert float(nothing.nats) < 1e-3 * float(some.nats)
    assert float(more.nats) > 2.0 * float(some.nats)
    # Small misfits, alike in all windows, cost half their square in deviations, whatever the bands.
    alike = 1e-3 * jnp.tile(outside[:, :1], windows)
    whitened = np.asarray(alike) / np.sqrt(measurement.variance)[:, None]
    with double_precision():
        small = float(evidence_against(measurement, alike, *nothing_free(count, windows)).nats)
    assert small == pytest.approx(0.5 * np.sum(whitened**2), rel=1e-4)


def nothing_free(count, windows):
    return jnp.zeros((0, count, windows)), jnp.zeros((1, count, windows))


def test_what_one_window_alone_shows_is_no_evidence():
    measurement = make_measurement_model(servo(), LIMITS, None, 0.05, {"velocity": 0.01}, [])
    count, windows = len(measurement.modes.gain), len(measurement.starts)
    random = np.random.default_rng(0)
    spread = random.normal(size=(count, windows))
    alone = np.zeros((count, windows))
    alone[:, 2] = np.sqrt(windows) * random.normal(size=count)
    with double_precision():
        free = nothing_free(count, windows)
        everywhere, once = (
            float(evidence_against(measurement, jnp.asarray(one), *free).nats) for one in (spread, alone)
        )
    assert everywhere > 10.0
    assert once < 1e-9


@pytest.mark.parametrize("sensors", ["velocity", "position", "both"])
def test_the_missing_torque_is_that_which_makes_the_misfit(sensors):
    noise = {"velocity": 1e-4, "position": 1e-6}
    measurement = make_measurement_model(servo(sensors), LIMITS, None, 0.05, noise, [])
    modes, windows = measurement.modes, len(measurement.starts)
    time = np.linspace(0.0, 1.0, measurement.samples)[:, None]
    torque = 0.3 * np.sin(2.0 * np.pi * 5.0 * time + np.arange(windows))  # N m
    plain = np.where(modes.sensor, 0.0, np.sqrt(modes.gain))[:, None] * (modes.torque.T @ torque)
    with double_precision():
        told = evidence_against(measurement, jnp.asarray(modes.turn.T @ plain), *nothing_free(len(plain), windows))
    assert float(told.missing) == pytest.approx(np.sqrt(np.mean(torque**2)), rel=0.1)


@pytest.mark.parametrize("sensors", ["velocity", "position"])
def test_free_initial_states_do_not_make_a_torque_larger(sensors):
    noise = {"velocity": 1e-3, "position": 1e-5}
    measurement = make_measurement_model(servo(sensors), LIMITS, None, 0.01, noise, [])
    modes, windows = measurement.modes, len(measurement.starts)
    torque = np.full((measurement.samples, windows), 0.2)  # N m
    plain = np.sqrt(modes.gain)[:, None] * (modes.torque.T @ torque)
    time = np.arange(measurement.samples) * measurement.dt
    # One prior deviation of the velocity and of the position at a window's start, in standard deviations of the sensor.
    readings = [np.ones_like(time), 0.0 * time] if sensors == "velocity" else [time, np.ones_like(time)]
    states = [each * size / noise[sensors] for each, size in zip(readings, (0.25, 0.25), strict=True)]
    shifts = np.stack([np.repeat((modes.basis.T @ each)[:, None], windows, axis=1) for each in states])
    with double_precision():
        free = jnp.zeros((0, len(plain), windows))
        told = evidence_against(measurement, jnp.asarray(modes.turn.T @ plain), free, jnp.asarray(shifts))
    # They take a part of a constant torque, and never add to it.
    assert 0.1 < float(told.missing) < 0.2 * 1.05


def test_effects_that_bend_the_torque_alike_are_not_apart():
    measurement = make_measurement_model(servo(), LIMITS, None, 0.05, {"velocity": 0.01}, [])
    count, windows = len(measurement.modes.gain), len(measurement.starts)
    rng = np.random.default_rng(0)
    with double_precision():
        one, other, own, free = (jnp.asarray(rng.normal(size=(count, windows))) for _ in range(4))
        alone = float(apart(measurement, one, free[None], jnp.zeros((1, count, windows))))
        alike = float(apart(measurement, 2.0 * one, free[None], one[None]))
        by_parameter = float(apart(measurement, other + own + 0.5 * free, free[None], jnp.stack([other, own])))
        unlike = float(apart(measurement, one, free[None], other[None]))
    assert alone > 10.0
    assert unlike > 0.8 * alone
    assert alike < 0.05 * alone
    assert by_parameter < 0.2 * alone


def test_the_evidence_has_a_gradient():
    measurement = make_measurement_model(servo(), LIMITS, None, 0.05, {"velocity": 0.01}, [])
    count, windows = len(measurement.modes.gain), len(measurement.starts)
    rng = np.random.default_rng(0)
    with double_precision():
        c, t, x = (jnp.asarray(rng.normal(size=(*k, count, windows))) for k in ((), (1,), (2,)))

        def nats(scale):
            return evidence_against(measurement, scale * c, t, x).nats

        slope, step = jax.grad(nats)(1.0), 1e-5
        assert float(slope) == pytest.approx(float(nats(1 + step) - nats(1 - step)) / (2 * step), rel=1e-5)
