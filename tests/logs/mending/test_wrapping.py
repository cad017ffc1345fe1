"""A position that wraps is made continuous and that is said; what is no wrap is left as it is."""

import numpy as np
import pytest

from fpjax import FpjaxWarning, InputError, read_log

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")  # each test asks for its own

TIME = np.arange(4000) * 2e-3


def log_of(position, **more):
    columns = {"time": TIME, "torque": np.sin(3.0 * TIME), "position": position, **more}
    return read_log(columns)


def turning(speed=1.0, amplitude=40.0):
    """An angle [rad] that goes through several turns both ways."""
    return 0.3 + amplitude * np.sin(0.8 * speed * TIME)


def within(angle, period, low):
    return low + np.mod(angle - low, period)


@pytest.mark.parametrize(
    ("period", "low"), [(2 * np.pi, -np.pi), (2 * np.pi, 0.0), (8 * np.pi, -4 * np.pi), (25.0, -12.5), (21.3, 0.0)]
)
def test_an_angle_that_wraps_goes_on(period, low):
    angle = turning()
    with pytest.warns(FpjaxWarning, match="it wraps, and was made continuous"):
        log = log_of(within(angle, period, low))
    moved = log.position - angle
    # A range that no protocol is known for is measured: to a part of what the machine moves between two samples.
    np.testing.assert_allclose(moved, moved[0], atol=1e-9 if period != 21.3 else 0.05)


def test_one_jump_is_enough_and_its_turn_is_whole():
    angle = 0.5 * TIME - 1.0
    log = log_of(within(angle, 2 * np.pi, -2 * np.pi))
    np.testing.assert_allclose(log.position - angle, log.position[0] - angle[0], atol=1e-9)


def test_a_coarse_encoder_with_noise_at_its_end_goes_on():
    rng, step = np.random.default_rng(3), 2 * np.pi / 4096
    angle = turning(amplitude=9.0)
    read = np.round((angle + 0.4 * step * rng.standard_normal(TIME.size)) / step) * step
    log = log_of(within(read, 2 * np.pi, 0.0))
    assert np.max(np.abs(log.position - log.position[0] - (angle - angle[0]))) < 4 * step


def test_a_position_reference_goes_on_beside_it():
    angle = turning()
    reference = angle + 0.2 * np.cos(TIME)
    log = log_of(within(angle, 2 * np.pi, 0.0), reference=within(reference, 2 * np.pi, 0.0))
    np.testing.assert_allclose(log.reference - log.position, reference - angle, atol=1e-9)


@pytest.mark.parametrize("wraps", [True, False])
def test_a_reference_that_steps_stays_beside_the_position(wraps):
    angle = turning()
    reference = np.round(angle / 0.5) * 0.5
    log = log_of(within(angle, 2 * np.pi, 0.0), reference=within(reference, 2 * np.pi, 0.0) if wraps else reference)
    np.testing.assert_allclose(log.reference - log.position, reference - angle, atol=1e-9)
    assert "its reference with it" in log.warnings[0]


def test_a_reference_of_the_speed_is_left_alone():
    log = log_of(within(turning(), 2 * np.pi, 0.0), reference=np.cos(TIME))
    np.testing.assert_allclose(log.reference, np.cos(TIME))


STANDING = 0.01 * np.sin(TIME)
LEFT_ALONE = {
    "no jump": turning(),
    "a single wrong value": np.where(np.arange(TIME.size) == 700, 900.0, turning()),
    "an encoder that toggles between two levels": np.where(np.sin(2.0 * TIME) > 0.0, 1e-3, 0.0),
    "a reading that is lost for a while": np.where((TIME > 3.0) & (TIME < 3.4), 0.0, 12.0 + STANDING),
    "too fast for its samples": within(np.pi * 0.9 * np.arange(TIME.size), 2 * np.pi, 0.0),
    "steps of different sizes": np.select([TIME < 2.0, TIME < 5.0], [STANDING, 6.0 + STANDING], 9.0 + STANDING),
    "at rest": np.zeros(TIME.size),
    "two strokes of one run": np.where(TIME < 4.0, 0.75 * TIME, 0.75 * (TIME - 4.0)),
    "a counter that was set to zero": np.where(TIME < 6.0, 0.4 * TIME, 0.4 * (TIME - 6.0)),
}


@pytest.mark.parametrize("what", LEFT_ALONE)
def test_what_does_not_wrap_stays_as_it_is(what):
    log = log_of(LEFT_ALONE[what], velocity=np.gradient(LEFT_ALONE[what], TIME))
    assert not any("wraps" in each for each in log.warnings)
    np.testing.assert_allclose(log.position, LEFT_ALONE[what], atol=1e-12)


def test_a_linear_axis_that_returns_at_once_is_left_alone():
    stroke = np.mod(0.5 * TIME, 0.2)
    log = read_log({"time": TIME, "torque": np.sin(TIME), "position": stroke}, linear=True)
    np.testing.assert_allclose(log.position, stroke)


@pytest.mark.parametrize("period", [6.0, 7.0, 24.0])
def test_a_period_near_a_known_one_is_not_taken_for_it(period):
    angle = turning(amplitude=80.0)
    log = log_of(within(angle, period, 0.0))
    assert np.max(np.abs(log.position - log.position[0] - (angle - angle[0]))) < 0.1


def test_strict_refuses_a_position_that_wraps():
    columns = {"time": TIME, "torque": np.sin(3.0 * TIME), "position": within(turning(), 2 * np.pi, 0.0)}
    with pytest.raises(InputError, match=r"it wraps, and was made continuous\. \(strict"):
        read_log(columns, strict=True)


@pytest.mark.parametrize(
    ("period", "said"),
    [
        (360.0, "degrees wrap so: then say so with --columns position=NAME:deg"),
        # A counter may go on for many turns: its range is not what a turn has.
        (4096.0, "a counter of 4096 counts wraps so: then say so with --columns position=NAME:counts/N"),
    ],
)
def test_a_period_of_another_unit_is_said(period, said):
    log = log_of(within(turning() * period / (2 * np.pi), period, 0.0))
    assert any(said in each for each in log.warnings)
