"""A machine with a shaft whose motion is followed better in windows half as long."""

from types import SimpleNamespace

import gap_search
import numpy_machine
import pytest

from fpjax import diagnose
from fpjax.gap import EFFECTS, verb
from fpjax.gap.data.record import SHORTEST, half_as_long, make_records
from fpjax.gap.select.shorter_windows import follows_better, shorter
from fpjax.gap.thresholds import THRESHOLDS

INERTIA = 0.05
FEW = tuple(effect for effect in EFFECTS if effect.name in ("constant_torque", "viscous_error"))


def decided(left, structure="transmission"):
    """A decision whose causes leave a share of what the nominal model misses."""
    family = SimpleNamespace(key=(structure, ()))
    return SimpleNamespace(
        chosen=SimpleNamespace(left=left, fit=SimpleNamespace(candidate=SimpleNamespace(family=family)))
    )


@pytest.fixture(scope="module")
def records():
    return make_records([numpy_machine.record(seconds=8.0)], [], INERTIA)


def searched(records):
    return SimpleNamespace(records=records, setting=SimpleNamespace(inertia=INERTIA))


def test_a_shaft_that_leaves_a_part_is_looked_at_again_and_nothing_else_is(records):
    half = records[0].samples // 2
    assert shorter(searched(records), decided(2.0 * THRESHOLDS.closes)) == half
    assert shorter(searched(records), decided(0.9 * THRESHOLDS.closes)) == 0
    assert shorter(searched(records), decided(2.0 * THRESHOLDS.closes, "rigid")) == 0
    assert shorter(searched(records), decided(2.0 * THRESHOLDS.closes, "bristles")) == 0


def test_windows_are_halved_as_long_as_the_sensors_resolve_the_torque_in_them(records):
    log, samples = numpy_machine.record(seconds=8.0), records[0].samples
    assert (half := half_as_long(records, INERTIA)) == samples // 2
    assert len(make_records([log], [], INERTIA, half)[0].rows()[0]) == half
    # What moves a mass a million times as heavy is a torque that no short window tells from the sensor's noise.
    assert half_as_long(records, 1e6 * INERTIA) == 0
    assert half_as_long(make_records([log], [], INERTIA, 2 * SHORTEST - 1), INERTIA) == 0


def test_what_shorter_windows_tell_is_taken_where_less_is_left_as_a_further_cause_must_leave_less():
    enough = (1.0 - THRESHOLDS.removes) ** 0.5
    assert follows_better(decided(0.99 * enough * 0.6), decided(0.6))
    assert not follows_better(decided(1.01 * enough * 0.6), decided(0.6))


@pytest.mark.long  # a diagnosis each
@pytest.mark.parametrize("better", [True, False])
def test_the_answer_is_that_of_the_windows_in_which_less_is_left(monkeypatch, better):
    log = numpy_machine.record(seconds=8.0)
    usual = diagnose(log, gap_search.MODEL, effects=FEW)
    asked = []

    def once(search, decision):
        asked.append(search.records[0].samples)
        return half_as_long(search.records, search.setting.inertia) if len(asked) == 1 else 0

    monkeypatch.setattr(verb, "shorter", once)
    monkeypatch.setattr(verb, "follows_better", lambda closer, decision: better)
    found = diagnose(log, gap_search.MODEL, effects=FEW)
    # What is better may be better still in windows shorter yet.
    assert len(asked) == (2 if better else 1)
    assert found.free_replay.window == pytest.approx(usual.free_replay.window * (0.5 if better else 1.0), rel=0.02)
    assert (found.gap.before == usual.gap.before) is not better
    assert found.verdict == usual.verdict
