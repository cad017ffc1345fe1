"""Several stretches of one recording, and several logs, are runs of one machine."""

import dataclasses

import numpy as np
import pytest
from numpy_machine import swing

from fpjax import Log, diagnose, read_log
from fpjax.gap.data.inputs import read_logs
from fpjax.gap.data.record import make_records

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")

DT = 1e-3
INERTIA = 0.05
MODEL = """
[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.3
viscous = 0.0
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""


def table(rows=2000, begin=0.0, amplitude=3.0, rate=8.0):
    found = swing(rows, DT, inertia=INERTIA, amplitude=amplitude, rate=rate)
    return found | {"time": begin + found["time"]}


def joined(*parts):
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def names(source):
    ((first, *further),) = read_logs(source)
    return [len(first), *map(len, further)]


def test_every_stretch_of_a_log_is_diagnosed():
    assert names(joined(table(2000), table(2200, 5.0), table(2100, 9.0))) == [2200, 2000, 2100]
    two = joined(table(2000), table(2200, 5.0))
    assert [len(group) for group in read_logs([two, table()])] == [2, 1]


def test_one_that_is_given_by_itself_too_is_not_taken_twice():
    log = read_log(joined(table(2000), table(2200, 5.0)))
    assert [len(group) for group in read_logs([log, *log.further])] == [1, 1]


def test_a_short_stretch_does_not_shorten_the_windows_of_all():
    assert names(joined(table(4000), table(2001, 5.0))) == [4000]
    assert names(joined(table(20_000), table(9000, 25.0))) == [20_000, 9000]  # eight of the longest windows


def test_stretches_are_taken_as_long_as_all_of_them_are_simulated_whole():
    assert names(joined(table(40_000), table(8200, 50.0))) == [40_000]


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda part: part | {"torque": 0.0 * part["torque"]}, id="no torque"),
        pytest.param(lambda part: part | {key: 0.0 * part[key] for key in ("velocity", "position")}, id="rest"),
        pytest.param(lambda part: part | {"velocity": -part["velocity"]}, id="a velocity of the other sign"),
    ],
)  # fmt: skip
def test_a_stretch_that_could_not_be_diagnosed_by_itself_is_left_out(change):
    assert names(joined(table(2200), change(table(2000, 5.0)))) == [2200]


def test_without_a_position_the_place_after_a_pause_is_not_known():
    log = {key: values for key, values in joined(table(2200), table(2000, 5.0)).items() if key != "position"}
    assert len(read_log(log).further) == 1
    assert names(log) == [2200]


def test_a_drift_counts_from_the_start_of_the_recording():
    first, second = make_records(read_logs(joined(table(2200), table(2000, 5.0)))[0], [], INERTIA)
    assert (first.elapsed[0], second.elapsed[0]) == (0.0, pytest.approx(5.0))
    assert second.elapsed[-1] == pytest.approx(5.0 + 1999 * DT)
    ((late,),) = read_logs(joined(table(1000), table(2200, 2.0)))
    assert late.since == 0.0  # of one that is diagnosed alone


@pytest.mark.long
def test_a_drift_over_a_pause_is_found_with_its_time():
    """Eight seconds cold, ten seconds after a pause: the time constant is longer than either of them."""
    rows = np.r_[0:8000, 10_000:20_000]
    found = swing(20_000, DT, inertia=INERTIA, coulomb=0.3, amplitude=3.0, rate=8.0)
    found["torque"] = found["torque"] + 0.3 * np.exp(-found["time"] / 20.0) * np.sign(np.sin(8.0 * found["time"]))
    found["position"] = found["position"] + 1e-5 * np.random.default_rng(1).normal(size=20_000)
    result = diagnose({key: values[rows] for key, values in found.items()}, MODEL)
    assert (result.verdict, result.causes) == ("explained", ("friction_drift",))
    amplitude, time = (result.ranking[0].parameters[name].value for name in ("amplitude", "time_constant"))
    assert amplitude == pytest.approx(0.3, rel=0.1)
    assert time == pytest.approx(20.0, rel=0.15)


def test_a_slow_run_beside_a_fast_one_keeps_the_velocity_of_both():
    """An encoder that resolves the torques of the fast run alone: both fit the rate sensor, none is refused."""

    def log(amplitude, rate):
        found = table(4000, amplitude=amplitude, rate=rate)
        position = np.round(found["position"] / 0.05) * 0.05
        return Log(found["time"], found["torque"], found["velocity"], position, None, DT, f"{amplitude:g} rad/s")

    def rate_fitted(*logs):
        return [record.velocity is not None for record in make_records(logs, [], INERTIA)]

    fast, slow = log(40.0, 8.0), log(0.4, 1.0)
    assert rate_fitted(fast) == [False]
    assert rate_fitted(slow) == [True]
    assert rate_fitted(fast, slow) == [True, True]
    assert rate_fitted(fast, dataclasses.replace(fast)) == [False, False]
