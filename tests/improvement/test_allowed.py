"""What gains may ask for, and what speaks against those of the nominal model."""

import dataclasses
import math

import improve_case as case
import numpy as np
import pytest

import fpjax as fp
from fpjax.improvement.judge import Score
from fpjax.improvement.machines import records_of
from fpjax.improvement.nominal_gains import compare_nominal
from fpjax.improvement.search import AllowedScore, limits_of, robust_costs
from fpjax.improvement.torque_limit import allowed_torque, controller_limit


@pytest.mark.parametrize(
    ("more", "peak"),
    [
        ("", 5.0),  # nobody knows what the drive can give: a quarter more than it gave so far
        ("[limits]\ntorque = 9.0\n", 9.0),
        ("[actuator]\nlimit = 7.0\n", math.inf),  # the simulated machine holds it: a command beyond it costs nothing
        ("[actuator]\nlimit = 7.0\n[limits]\ntorque = 9.0\n", 9.0),
    ],
)
def test_the_torque_that_is_allowed_is_the_files_and_only_else_a_guess(more, peak):
    score = Score(*(np.full((2, 3), value) for value in (0.5, 0.5, 1.0, 4.0, 0.1)))
    quiet = dataclasses.replace(records_of(case.log(), case.model())[0], torque=np.full(1500, 3.0))
    limits = limits_of(score.of(0), quiet, case.model(more))
    assert limits.peak == pytest.approx(peak)
    assert robust_costs(score, limits) == pytest.approx([1.0, 1.0])


def test_the_limit_of_the_files_controller_stands_for_itself():
    limited = fp.load_model(case.text().replace("ki = 8.0", "ki = 8.0\nlimit = 6.0"))
    assert allowed_torque(limited, 4.0) == math.inf
    assert controller_limit(limited) == pytest.approx(6.0)
    assert controller_limit(case.model()) is None


def scores_of(errors, peaks, rough=1.0):
    """Scores of the current gains, proposed ones, and the nominal model's, in twenty machines."""
    rows = [np.full((3, 20), 1.0) for _ in range(5)]
    rows[0] *= np.array(errors)[:, None]
    rows[3] *= np.array(peaks)[:, None]
    rows[4] *= np.array([1.0, 1.0, rough])[:, None]
    return Score(*rows)


@pytest.mark.parametrize(
    ("errors", "peaks", "rough", "objection", "said"),
    [
        ((1.0, 0.5, 0.6), (1.0, 1.0, 1.0), 1.0, "", "20.0% worse"),
        ((1.0, 0.5, 2.5), (1.0, 1.0, 1.0), 1.0, "", "with 5 times the error on these machines (error 5 to 5 times"),
        ((1.0, 0.5, 0.501), (1.0, 1.0, 1.0), 1.0, "", "follow as well on these machines (error 1 to 1 times"),
        ((1.0, 0.5, 0.499), (1.0, 2.0, 2.3), 1.0, "", "follow as well on these machines (error 0.998 to 0.998 times as "
         "large), but need a largest torque of 2.3 N m"),
        ((1.0, 0.5, 0.4), (1.0, 2.0, 2.3), 1.0, "", "20.0% better (error 0.8 to 0.8 times as large), but need a "
         "largest torque of 2.3 N m, 15.0% above the allowed 2 N m"),
        ((1.0, 0.5, 0.4), (1.0, 2.0, 2.0), 2.1, "", "but make the torque 2.10 times as rough"),
        ((1.0, 0.5, 0.4), (1.0, 2.0, 2.3), 3.0, "leave a margin of 0.30", "but leave a margin of 0.30."),
        ((1.0, 0.5, np.inf), (1.0, 1.0, 1.0), 1.0, "are unstable", "make most of the machines unstable"),
    ],
)  # fmt: skip
def test_what_speaks_against_the_nominal_models_gains_is_said_with_its_number(errors, peaks, rough, objection, said):
    limits = AllowedScore(error=1.0, rough=1.0, peak=2.0)
    gains = {"controller.kp": 2.0}
    told = compare_nominal(gains, scores_of(errors, peaks, rough), 1, limits, objection, "N m")
    assert said in told.sentence()
    assert not told.proposed


def test_the_nominal_models_gains_are_proposed_where_they_are_the_best():
    limits = AllowedScore(error=1.0, rough=1.0, peak=2.0)
    told = compare_nominal({}, scores_of((1.0, 0.5, 0.4), (1.0, 1.0, 1.0)), 2, limits, "", "N m")
    assert told.proposed
    assert "are proposed" in told.sentence()
