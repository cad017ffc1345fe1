"""What is said of a cause that is not sure beside a part that is told, of rivals and of a slight gap."""

import dataclasses
import math

import pytest
from report_cases import CASES
from weighed_models import judged, weighed

from fpjax.gap import Step
from fpjax.gap.answer.summary import verdict_line
from fpjax.gap.answer.warning_texts import undecided_effects
from fpjax.gap.report import heading, sentences
from fpjax.gap.thresholds import THRESHOLDS


def test_a_share_is_told_of_the_causes_alone_where_more_is_closed_with_what_is_not_sure():
    told = CASES["partly_explained"]()
    before, nan2 = told.gap.before, (math.nan, math.nan)
    steps = (Step("stribeck", 0.75 * before, nan2), Step("presliding", told.gap.after, nan2))
    told = dataclasses.replace(
        told, steps=steps, undecided=("presliding",), gap=dataclasses.replace(told.gap, noise_floor=0.0)
    )
    sentence = sentences.verdict_sentence(told).replace("\u202f", " ")
    assert sentence.startswith("Stribeck friction explains 25 % of the missing torque; with presliding friction, which")
    assert "does not make sure of, 60 % is closed" in sentence
    assert "25.0% of the gap is closed on withheld data, 60.0% with presliding, which this log" in verdict_line(told)
    assert told.to_dict()["closed_by_causes"] == pytest.approx(0.25)
    assert told.to_dict()["undecided"] == ["presliding"]
    assert CASES["explained"]().to_dict()["closed_by_causes"] == CASES["explained"]().gap.closed
    assert [sentences.step_remark(told, name) for name in ("stribeck", "presliding", "cogging")] == [
        "", " (not sure)", " (a detail)",
    ]  # fmt: skip
    head = heading.header(told).replace("\u202f", " ")
    assert "--closed:25%" in head
    assert "Gap closed with what is not sure" in head
    (warned,) = undecided_effects(("presliding",), ("stribeck",), ("backlash", "actuator_lag"))
    assert "holds presliding, which takes a part" in warned
    assert "backlash or actuator_lag would do nearly as well" in warned
    assert undecided_effects((), ("stribeck",), ("backlash",)) == []


def test_a_slight_gap_that_no_cause_closes_is_none_and_said_with_less_certainty():
    chosen, torque = weighed("compliance", 500.0), 5.0
    slight, more = 0.029 * torque, 0.031 * torque
    assert judged(chosen, [], before=slight, left=0.15).word == "explained"
    found = judged(chosen, [], before=slight, left=0.25)
    assert (found.word, found.causes) == ("no_gap", ())
    assert found.probability == pytest.approx(1.0 - THRESHOLDS.right_unexplained[0])
    assert judged(chosen, [], before=more, left=0.25).word != "no_gap"
    assert judged(chosen, [], before=slight, left=0.25, contradicted=True).word == "unexplained"
    # Without evidence for any effect it is as sure as ever.
    none = judged(weighed("compliance", 3.0), [], before=slight, left=0.25)
    assert none.probability == pytest.approx(1.0 - THRESHOLDS.right_no_gap)


@pytest.mark.parametrize(("scale", "another"), [(0.99, False), (0.92, False), (0.9, True)])  # the inertia is 1.2 times
def test_a_number_that_is_far_further_off_than_a_factor_makes_it_is_wrong_beside_it_too(monkeypatch, scale, another):
    monkeypatch.setattr("fpjax.gap.select.verdict.wrong_numbers", lambda fit, sizes: (0.0, tuple(fit.candidate.wide)))
    chosen = weighed("", 500.0, wide=("inertia",))
    rival = weighed("backlash+velocity_scale_error", 505.0, wide=("inertia",), wrong={"scale": scale})
    found = judged(chosen, [rival], shares={"inertia_error": 0.9})
    assert ("backlash" in found.main) == another
