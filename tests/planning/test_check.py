"""The check of the plans: what its two runs may ask of a machine is the same, and its first log is poor."""

import numpy as np
import pytest

from benchmarks.plan import machines
from benchmarks.withheld import first


@pytest.fixture(scope="module")
def cases():
    return [first.build(one) for one in machines.chosen(len(machines.EFFECTS), 0)]


def test_one_machine_an_effect_with_an_encoder_only(cases):
    assert [case.identity.effects[0] for case in cases] == list(machines.EFFECTS)
    assert {case.identity.sensors for case in cases} == {"encoder"}
    assert {case.identity.system for case in cases} == {"gimbal", "servo", "drive"}


def test_the_first_log_is_one_stroke_at_one_speed(cases):
    for case in cases:
        speed = machines.first_reference(case)
        assert np.all(speed >= 0.0)
        assert np.mean(speed > 0.9 * speed.max()) > 0.7
        assert np.sum(speed) * first.DT == pytest.approx(machines.SHORT, rel=1e-2)
        assert speed[[0, -1]] == pytest.approx(0.0, abs=1e-3 * speed.max())


def test_the_run_by_habit_turns_round_and_is_faster_than_the_first_log(cases):
    for case in cases:
        known, rate = machines.first_reference(case), machines.generic_reference(case, machines.FIRST)
        assert len(rate) == len(known)
        assert np.max(np.abs(rate)) > 1.5 * np.max(known)
        assert np.sum(np.diff(np.sign(rate[np.abs(rate) > 1e-6])) != 0) >= 3
        assert np.ptp(np.cumsum(rate)) * first.DT <= machines.HABIT_TRAVEL


@pytest.mark.parametrize("length", [1.0, 2.0, 10.0])
def test_the_sweep_keeps_the_planned_runs_limits(cases, length):
    for case in cases:
        limits, rate = machines.limits_of(case, length), machines.sweep_reference(case, length)
        assert np.max(np.abs(rate)) <= 1.001 * limits["speed"]
        assert np.ptp(np.cumsum(rate)) * first.DT <= 1.001 * limits["travel"]
        nominal = case.plan.nominal
        needed = nominal["inertia"] * np.max(np.abs(np.gradient(rate, first.DT))) + nominal["coulomb"]
        assert needed <= limits["torque"]
        # as large as one of them lets it be
        used = [np.max(np.abs(rate)) / limits["speed"], np.ptp(np.cumsum(rate)) * first.DT / limits["travel"]]
        assert max(*used, needed / limits["torque"]) > 0.8
        assert len(rate) == round(limits["duration"] / first.DT) + 1
