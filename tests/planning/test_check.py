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


def test_the_first_log_has_one_speed_and_a_short_travel(cases):
    for case in cases:
        speed = np.abs(machines.first_reference(case))
        assert np.mean(speed > 0.9 * speed.max()) > 0.75  # tanh(4 sin): 76 % of the time
        assert np.ptp(np.cumsum(machines.first_reference(case))) * first.DT <= machines.SHORT


def test_the_generic_run_is_of_the_first_logs_kind(cases):
    for case in cases:
        known, rate = machines.first_reference(case), machines.generic_reference(case, machines.FIRST)
        assert len(rate) == len(known)
        assert np.max(np.abs(rate)) == pytest.approx(np.max(np.abs(known)), rel=1e-2)
        assert np.ptp(np.cumsum(rate)) <= np.ptp(np.cumsum(known))


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
