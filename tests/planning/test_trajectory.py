"""Motions within the limits: each start, whatever its numbers, and the sweep."""

import jax.numpy as jnp
import numpy as np
import pytest
from plan_case import LIMITS

from fpjax.planning.limits import Limits
from fpjax.planning.trajectory import SWEEP, Shape, make_course
from fpjax.simulation.precision import double_precision

# Each is held by another one of its limits.
VARIED = [LIMITS, Limits(5.0, 2.0, 9.0, 6.0, 4.0), Limits(5.0, 400.0, 9.0, 0.05, 4.0)]


@pytest.mark.parametrize("limits", VARIED)
def test_no_motion_leaves_its_limits_whatever_its_numbers(limits):
    course = make_course(limits, 4e-3, 0.02)
    rng = np.random.default_rng(1)
    with double_precision():
        for _ in range(10):
            shape = Shape(*(jnp.asarray(part + rng.normal(0, 3, part.shape)) for part in course.starts(0, 1)[0]))
            motion = course.motion(shape)
            assert float(jnp.max(jnp.abs(motion.speed))) <= limits.speed
            assert float(jnp.max(jnp.abs(motion.acceleration))) <= limits.acceleration
            assert float(jnp.ptp(motion.position)) <= limits.travel
            ends = np.abs(np.asarray(motion.speed)[[0, -1]])
            assert np.max(ends) < 1e-9 * limits.speed
            assert abs(float(motion.position[-1])) < 1e-6 * limits.travel + 1e-9


@pytest.mark.parametrize("limits", VARIED)
def test_one_start_is_the_sweep_which_uses_its_limits(limits):
    course = make_course(limits, 4e-3, 0.02)
    with double_precision():
        start = course.starts(0, 7)[SWEEP]
        begun, sweep = course.motion(start), course.within(course.usual[:, 1])
    speed = np.asarray(sweep.speed)
    assert np.max(np.abs(np.asarray(begun.speed) - speed)) < 0.1 * np.max(np.abs(speed))  # the tones are hardly there
    used = [
        np.max(np.abs(speed)) / limits.speed,
        np.max(np.abs(np.asarray(sweep.acceleration))) / limits.acceleration,
        np.ptp(np.asarray(sweep.position)) / limits.travel,
    ]
    assert 0.99 < max(used) <= 1.0
    apart = np.diff(np.flatnonzero(np.diff(np.sign(course.usual[1:, 1]))))  # samples from one reversal to the next
    assert np.mean(apart[:3]) > 3.0 * np.mean(apart[-3:])


def test_position_speed_and_acceleration_are_one_motion():
    course = make_course(LIMITS, 4e-3, 0.02)
    with double_precision():
        motion = course.motion(course.starts(0, 1)[0])
    speed = np.gradient(np.asarray(motion.position), 4e-3)
    assert np.max(np.abs(speed - np.asarray(motion.speed))[2:-2]) < 0.01 * LIMITS.speed
