"""A known load that turns with the position, and a log that does not tell where the position starts."""

import math

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import load_model
from fpjax.gap.verb import make_search

WEIGHT, START = 0.5, 0.7  # N m, rad
MODEL = gap_search.MODEL + f'[load]\ntype = "unbalance"\namplitude = {WEIGHT}\n'


# A load taken START away from where it is lacks 2 WEIGHT sin(START / 2) cos(...): its rms.
ELSEWHERE = 2.0 * WEIGHT * np.sin(0.5 * START) / np.sqrt(2.0)


def left(sensors):
    """Missing torque of the nominal model as given [N m], rms."""
    log = numpy_machine.record(
        seconds=4.0, sensors=sensors, extra=lambda time, speed, angle, command: -WEIGHT * math.sin(angle + START)
    )
    search = make_search([log], [], load_model(MODEL))
    windows = [np.arange(len(record.starts)) for record in search.records]
    return search.finish([search.exact])[0].missing_rms(windows)


@pytest.mark.long  # its fit compiles for 13 s of processor time
def test_the_model_as_given_is_not_judged_at_another_angle_than_the_log_s():
    assert left(("velocity",)) < 0.1 * ELSEWHERE


@pytest.mark.long  # the same fit with one channel more compiles for 6 s of processor time
def test_an_encoder_that_is_zero_elsewhere_than_the_load_is_a_gap():
    assert left(("velocity", "position")) > 0.8 * ELSEWHERE
