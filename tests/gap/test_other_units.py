"""Runs whose clocks differ by some per cent, torques in units of a label, and where a ripple is looked for."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from gap_search import MODEL
from numpy_machine import Machine, record

import fpjax as fp
from fpjax import InputError
from fpjax.gap.answer.warning_texts import at_bounds
from fpjax.gap.data.inputs import on_one_clock
from fpjax.gap.fit.course_starts import longest_log, widest_log
from fpjax.logs.mending.resample import at_period
from fpjax.model_file import Units

OFFSET = tuple(effect for effect in fp.gap.EFFECTS if effect.name == "constant_torque")


@pytest.fixture(scope="module")
def log():
    return record(Machine(), seconds=6.0, extra=lambda time, *_: -0.1, sensors=("velocity", "position"))


def test_a_run_on_a_slower_clock_is_resampled_onto_the_first_ones(log):
    slow = dataclasses.replace(log, name="slow", time=1.02 * log.time, dt=1.02 * log.dt)
    one, other = on_one_clock([log, slow])
    assert one is log
    assert other.dt == log.dt
    assert np.diff(other.time) == pytest.approx(log.dt)
    np.testing.assert_allclose(other.position, np.interp(other.time, slow.time, slow.position), atol=2e-4)
    # The impulse stays: torque by its mean over each new period.
    assert np.sum(other.torque) * log.dt == pytest.approx(np.sum(slow.torque) * slow.dt, rel=1e-3, abs=1e-3)
    assert "its period of 0.00102 s was resampled onto 0.001 s, the period in common" in other.warnings[-1]
    assert on_one_clock([]) == []


def test_runs_at_other_rates_are_taken_at_the_slowest(log):
    """Two controllers of one machine logged at 500 and 333 Hz: neither is refused, none gets readings it never had."""
    slow = at_period(log, 3.0 * log.dt)
    for logs in ([log, slow], [slow, log]):
        found = on_one_clock(logs)
        assert [one.dt for one in found] == [slow.dt] * 2
        assert any(one is slow for one in found)
    with pytest.raises(InputError, match="logs of one machine need one period"):
        fp.diagnose([log, at_period(log, 5.0 * log.dt)], MODEL, effects=OFFSET)
    (entry,) = (
        one for one in fp.diagnose(log, MODEL, holdout=slow, effects=OFFSET).ranking if one.effect == "constant_torque"
    )
    assert entry.parameters["torque"].value == pytest.approx(-0.1, abs=0.01)


def test_a_log_counts_once_and_is_withheld_from_a_fit_that_it_is_not_in(log):
    for what, said in (({"log": log, "holdout": log}, "is fitted and held out"), ({"log": [log, log]}, "given twice")):
        with pytest.raises(InputError, match=said):
            fp.diagnose(model=MODEL, effects=OFFSET, **what)


def test_a_torque_in_ampere_is_answered_in_ampere(log):
    found = fp.diagnose(log, MODEL + '[units]\ntorque = "A"\nsensors = "both"\n', effects=OFFSET)
    assert found.gap.unit == "A"
    (entry,) = [one for one in found.ranking if one.effect == "constant_torque"]
    assert entry.parameters["torque"].unit == "A"
    assert {one.parameter: one.unit for one in found.identifiability}["inertia"] == "A s^2/rad"
    assert "N m" not in str(found)


def test_a_bound_is_told_in_the_model_files_units():
    candidate = SimpleNamespace(
        family=SimpleNamespace(parameters=(SimpleNamespace(name="viscous", unit="N m s/rad"),)),
        values=lambda: {"viscous": 0.0}, at_bound=lambda: ["viscous"], effects=(), wide=frozenset({"viscous"}),
    )  # fmt: skip
    (told,) = at_bounds(SimpleNamespace(candidate=candidate), Units(torque="PWM"))
    assert "(0 PWM s/rad)" in told


def test_a_ripple_is_looked_for_in_the_log_that_travels_furthest():
    short, wide, unseen = (SimpleNamespace(angle=np.linspace(0.0, end, 9)) for end in (0.2, 20.0, 90.0))
    train = [np.arange(8), np.arange(3), np.arange(0)]
    assert widest_log([short, wide, unseen], train) == 1
    assert longest_log(train) == 0
