"""What an encoder misreads periodically, told from cogging by a rate sensor beside it and taken out of its column."""

import dataclasses

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import diagnose
from fpjax.gap.data.encoder_error import EncoderError, about_errors, encoder_errors, without_errors

J = 0.05  # of the machine [kg m^2]
ERROR = EncoderError(40.0, 3e-4, -4e-4)


def recorded(**changes):
    """A log with a rate sensor and an encoder."""
    return numpy_machine.record(**changes)


def misread(log, *errors):
    """The log as an encoder with some errors reads it."""
    return dataclasses.replace(log, position=log.position + sum(one.at(log.position) for one in errors))


def through_a_lag(values, time, dt):
    """A first-order lag of the values held over each period."""
    read, decay = np.array(values), np.exp(-dt / time)
    for k in range(1, len(read)):
        read[k] = decay * read[k - 1] + (1.0 - decay) * values[k]
    return read


def test_a_sine_of_the_position_is_found_and_taken_out():
    log = recorded()
    read = misread(log, ERROR)
    (found,) = encoder_errors(read, J)
    assert found.periods == pytest.approx(ERROR.periods, rel=2e-3)
    assert found.amplitude == pytest.approx(ERROR.amplitude, rel=0.05)
    left = without_errors(read, [found]).position - log.position
    assert np.std(left) < 0.1 * np.std(read.position - log.position)


def test_two_sines_are_found_the_one_that_looks_like_more_torque_first():
    read = misread(recorded(), ERROR, EncoderError(97.0, 0.0, 2e-4))
    assert [round(one.periods) for one in encoder_errors(read, J)] == [97, 40]


@pytest.mark.parametrize("lag", [0.0, 3e-3])
def test_cogging_is_no_error_of_the_encoder_however_late_the_rate_is(lag):
    def cogs(time, velocity, position, command):
        return 0.15 * np.sin(40.0 * position)

    log = recorded(extra=cogs)
    read = through_a_lag(log.velocity, lag, log.dt) if lag else log.velocity
    assert encoder_errors(dataclasses.replace(log, velocity=read), J) == ()


def test_an_error_is_found_beside_a_rate_that_is_late():
    read = misread(recorded(), ERROR)
    read = dataclasses.replace(read, velocity=through_a_lag(read.velocity, 3e-3, read.dt))
    (found,) = encoder_errors(read, J)
    assert found.periods == pytest.approx(ERROR.periods, rel=2e-3)
    assert found.amplitude == pytest.approx(ERROR.amplitude, rel=0.1)


def test_without_a_rate_of_its_own_nothing_is_said():
    read = misread(recorded(), ERROR)
    assert encoder_errors(dataclasses.replace(read, velocity=None), J) == ()
    assert encoder_errors(dataclasses.replace(read, position=None), J) == ()
    derived = np.gradient(read.position, read.dt)
    assert encoder_errors(dataclasses.replace(read, velocity=derived), J) == ()
    for column in ("position", "velocity"):
        assert encoder_errors(dataclasses.replace(read, **{column: np.zeros(len(read.time))}), J) == ()
    assert encoder_errors(recorded(), J) == ()


def test_a_sine_that_is_not_there_in_all_of_a_long_log_is_left_alone(monkeypatch):
    """Found where the machine travels most; the rest would be made worse by it."""
    monkeypatch.setattr("fpjax.gap.data.encoder_error.MOST", 4000)
    log = recorded()
    read = misread(log, ERROR)
    assert encoder_errors(read, J)
    other = misread(log, EncoderError(ERROR.periods, -ERROR.sine, -ERROR.cosine))
    half = np.arange(len(log.time)) < 4000
    assert encoder_errors(dataclasses.replace(read, position=np.where(half, read.position, other.position)), J) == ()


def test_rest_behind_the_motion_of_a_long_log_takes_no_sine_away(monkeypatch):
    monkeypatch.setattr("fpjax.gap.data.encoder_error.MOST", 4000)
    log = recorded(seconds=4.0)
    read = misread(log, ERROR)
    count = len(log.time)
    rests = {"time": log.dt * np.arange(3 * count), "torque": np.pad(log.torque, (0, 2 * count))}
    rests |= {"position": np.pad(read.position, (0, 2 * count), mode="edge"), "reference": None}
    (found,) = encoder_errors(dataclasses.replace(log, velocity=np.pad(log.velocity, (0, 2 * count)), **rests), J)
    assert found.amplitude == pytest.approx(ERROR.amplitude, rel=0.1)


def test_what_was_done_is_said_in_the_units_of_the_axis():
    log = recorded()
    assert "0.0005 rad (40 periods a turn)" in about_errors(log, [ERROR])
    assert "0.0005 m (a period of 0.157 m)" in about_errors(dataclasses.replace(log, linear=True), [ERROR])
    assert without_errors(log, []) is log


@pytest.mark.long
def test_a_misread_position_is_no_cogging_and_hides_no_cause():
    log = misread(recorded(machine=numpy_machine.Machine(coulomb=0.6)), ERROR)
    found = diagnose(log, gap_search.MODEL)
    assert found.causes == ("coulomb_error",)
    assert found.verdict == "explained"
    assert found.ranking[0].parameters["coulomb"].value == pytest.approx(0.6, rel=0.02)
    assert any("40" in warning and "sine of itself" in warning for warning in found.warnings)


@pytest.mark.long
def test_a_rate_sensor_that_ripples_with_the_position_leaves_the_encoder_as_it_is():
    """It parts from the encoder as an encoder's error would; the machine's motion says which of both is wrong."""
    log = recorded(machine=numpy_machine.Machine(coulomb=0.6))
    rippling = dataclasses.replace(log, velocity=log.velocity * (1.0 + 0.03 * np.sin(40.0 * log.position)))
    assert encoder_errors(rippling, J)
    found = diagnose(rippling, gap_search.MODEL)
    assert found.causes == ("coulomb_error",)
    assert not any("sine of itself" in warning for warning in found.warnings)
