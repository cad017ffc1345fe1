"""Several stretches of one recording, and several logs, are runs of one machine."""

import dataclasses

import numpy as np
import pytest
from numpy_machine import swing

from fpjax import Log, read_log
from fpjax.gap.data.inputs import read_logs
from fpjax.gap.data.record import make_records

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")

DT = 1e-3
INERTIA = 0.05


def table(rows=2000, begin=0.0, amplitude=3.0, rate=8.0):
    found = swing(rows, DT, inertia=INERTIA, amplitude=amplitude, rate=rate)
    return found | {"time": begin + found["time"]}


def joined(*parts):
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def names(source):
    ((first, *further),) = read_logs(source)
    return [len(first), *map(len, further)]


def test_every_stretch_of_a_log_is_diagnosed():
    assert names(joined(table(2000), table(2200, 5.0), table(1500, 9.0))) == [2200, 2000, 1500]
    two = joined(table(2000), table(2200, 5.0))
    assert [len(group) for group in read_logs([two, table()])] == [2, 1]


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
