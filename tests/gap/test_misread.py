"""Errors of the velocity reading among the causes of a verdict."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy_machine import swing
from weighed_models import judged, weighed

from fpjax import Log
from fpjax.gap.answer.assemble import unknown_step
from fpjax.gap.data.record import make_records
from fpjax.gap.select.readings import Reading, beside_gap
from fpjax.gap.thresholds import THRESHOLDS

SLIGHT = {"velocity_quantisation": 0.5 * THRESHOLDS.matters}


def test_a_wrong_reading_does_not_lead_where_a_torque_is_missing_that_nobody_explains():
    lost = judged(weighed("stribeck", 500.0), [weighed("presliding", 100.0)], left=0.97, readings=("velocity_lag",))
    assert (lost.word, lost.causes) == ("unexplained", ("velocity_lag",))
    assert lost.main["velocity_lag"] < lost.main["stribeck"]
    assert lost.among["velocity_lag"] > 0.9


def test_a_reading_leads_where_it_is_larger_than_what_the_leading_cause_makes():
    # The leading cause makes half of the missing energy.
    chosen = weighed("stribeck", 1000.0)
    less, more = (
        judged(chosen, (), readings=("velocity_lag",), misread={"velocity_lag": energy}) for energy in (0.4, 0.6)
    )
    assert (less.causes, more.causes) == (("stribeck", "velocity_lag"), ("velocity_lag", "stribeck"))
    assert 0.9 < more.main["velocity_lag"] <= sum(more.main.values()) <= 1.0


def test_a_reading_stands_among_the_causes_in_its_place_by_size():
    chosen, shares = weighed("unbalance", 1000.0, wide=("coulomb",)), {"coulomb_error": 0.6, "unbalance": 0.2}
    for energy, place in ((0.7, 0), (0.4, 1), (0.1, 2)):
        misread = {"velocity_scale_error": energy}
        found = judged(chosen, [], shares=shares, readings=("velocity_scale_error",), misread=misread)
        assert [name for name in found.causes if name in shares] == ["coulomb_error", "unbalance"]
        assert found.causes.index("velocity_scale_error") == place
    # Of two, each by itself.
    both = {"velocity_bias": 0.65, "velocity_scale_error": 0.3}
    found = judged(chosen, [], shares=shares, readings=tuple(both), misread=both)
    assert found.causes == ("velocity_bias", "coulomb_error", "velocity_scale_error", "unbalance")


def test_where_nothing_is_missing_whatever_is_misread_is_all_there_is():
    def beside(size, torque, share, moving):
        return beside_gap(Reading("velocity_delay", {}, size, torque, 100.0), share, moving)

    assert beside(0.1, 0.2, 0.0, 0.0) == np.inf
    assert beside(0.0, 0.0, 0.0, 0.0) == 0.0
    assert beside(0.1, 0.0, 0.2, 0.0) == pytest.approx(0.25)
    assert beside(0.1, 0.3, 0.2, 0.3) == pytest.approx(1.0)


def test_one_wrong_number_comes_before_a_reading_that_makes_less_and_a_guessed_model_after_it():
    slight, chosen = {"velocity_delay": 0.1}, weighed("", 500.0, wide=("inertia",))
    for numbers in (1.0, 0.3):  # what all numbers free leave
        shares = {"inertia_error": 0.9}
        one = judged(chosen, [], shares=shares, readings=("velocity_delay",), misread=slight, numbers=numbers)
        assert one.causes == ("inertia_error", "velocity_delay")
    shares = {"inertia_error": 0.9, "coulomb_error": 0.3}
    guessed = judged(chosen, [], shares=shares, readings=("velocity_delay",), misread=slight)
    assert guessed.causes == ("velocity_delay", "inertia_error", "coulomb_error")
    # Beside an effect too a reading counts as effects do: by what the wrong numbers leave, 0.09 of the energy here.
    shares, both = shares | {"stribeck": 0.06}, weighed("stribeck", 500.0, wide=("inertia", "coulomb"))
    for energy, first in ((0.1, "velocity_delay"), (0.05, "inertia_error")):
        found = judged(
            both, [], shares=shares, readings=("velocity_delay",), misread={"velocity_delay": energy}, numbers=0.3
        )
        assert found.causes[0] == first


def test_a_wrong_reading_is_a_cause_beside_the_others_or_alone():
    chosen = weighed("stribeck", 500.0)
    beside = judged(chosen, [], readings=("velocity_quantisation",))
    assert beside.causes == ("stribeck", "velocity_quantisation")
    slight = judged(chosen, [], readings=("velocity_lag", "velocity_quantisation"), misread=SLIGHT)
    assert slight.causes == ("stribeck", "velocity_lag")
    assert "velocity_quantisation" not in slight.among
    # An error as large as another reading's must be to be told is told.
    readings = ("velocity_quantisation",)
    large = judged(chosen, [], readings=readings, misread=SLIGHT, rounded=1.3 * THRESHOLDS.reading)
    assert large.causes == ("stribeck", "velocity_quantisation")
    small = judged(chosen, [], readings=readings, misread=SLIGHT, rounded=0.9 * THRESHOLDS.reading)
    assert small.causes == ("stribeck",)
    unknown = judged(chosen, [], left=0.97, readings=readings, misread=SLIGHT)
    assert (unknown.word, unknown.causes) == ("unexplained", ())
    number = judged(chosen, [], shares={"inertia_error": 0.9}, readings=readings, misread=SLIGHT)
    assert number.causes == ("inertia_error",)
    # A machine that lacks nothing reads as it is rounded.
    machine = judged(chosen, [], before=0.01, readings=readings, misread=SLIGHT)
    assert machine.causes == readings
    alone = judged(chosen, [], before=0.01, readings=("velocity_lag", "velocity_quantisation"))
    assert (alone.word, alone.causes) == ("explained", ("velocity_lag", "velocity_quantisation"))
    lost = judged(chosen, [], left=0.97, readings=("velocity_lag",))
    assert (lost.word, lost.causes) == ("unexplained", ("velocity_lag",))
    for found in (beside, alone, lost):
        assert sum(found.main.values()) <= 1.0 + 1e-12
        assert found.among[found.causes[-1]] > 0.9


def test_what_is_sure_of_the_reading_is_told_however_little_where_nothing_else_is_amiss():
    chosen, readings = weighed("stribeck", 500.0), ("velocity_delay", "velocity_quantisation")
    slight = {"readings": readings, "slight": frozenset(readings[:1]), "misread": SLIGHT}
    alone = judged(chosen, [], before=0.01, **slight)
    assert (alone.word, set(alone.causes)) == ("explained", set(readings))
    # A cause of the machine, a torque that nobody explains, or a reading that is wrong by more.
    assert judged(chosen, [], **slight).causes == ("stribeck",)
    assert judged(chosen, [], left=0.97, **slight).causes == ()
    more = judged(chosen, [], before=0.01, **slight | {"readings": (*readings, "velocity_bias")})
    assert more.causes == ("velocity_bias",)


def test_a_reading_that_is_late_is_as_sure_of_its_lag_as_the_log_shows_lag_and_no_delay():
    sure = judged(weighed("", 1.0), [], before=0.01, readings=("velocity_lag",), doubts={})
    torn = judged(
        weighed("", 1.0), [], before=0.01, readings=("velocity_lag",), doubts={"velocity_lag": ("velocity_delay", 0.7)}
    )
    assert sure.probability == pytest.approx(THRESHOLDS.right_read)
    assert torn.probability == pytest.approx(0.7 * THRESHOLDS.right_read)
    assert torn.main["velocity_delay"] == pytest.approx(0.3 * THRESHOLDS.right_read)


@pytest.mark.parametrize(("noise", "told"), [(0.2, 0.02), (0.5, 0.0)])
def test_a_rounding_is_told_only_where_it_is_most_of_the_readings_noise(noise, told):
    """Noise of half a step dithers it away: a machine without a gap was "explained" by a rounding that nobody sees."""
    log, step = swing(4000, inertia=0.05, amplitude=3.0, rate=8.0, noise=noise * 0.02), 0.02
    rounded = step * np.round(log["velocity"] / step)
    (record,) = make_records([Log(log["time"], log["torque"], rounded, None, None, 1e-3)], [], 0.05)
    search = SimpleNamespace(records=[record], nominal=SimpleNamespace(sensor=None))
    assert unknown_step(search) == pytest.approx(told)
