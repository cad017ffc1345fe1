"""Units as drives write them."""

import re

import numpy as np
import pytest
from log_files import TURN

from fpjax import read_log
from fpjax.logs.columns.units import find_unit


@pytest.mark.parametrize(
    ("text", "factor", "label"),
    [
        ("0.1 rpm", 0.1 * TURN / 60, ""),
        ("0,1 %", 0.1, "%"),
        ("‰", 1.0, "‰"),
        ("V (Voltage)", 1.0, "V"),
        ("deg/sec", TURN / 360, ""),
        ("N-m", 1.0, ""),
        ("oz-in", 0.00706155181422604, ""),
        ("1/min", TURN / 60, ""),
        ("min-1", TURN / 60, ""),
    ],
)
def test_units_as_drives_write_them(text, factor, label):
    unit = find_unit(text)
    assert unit is not None
    assert unit.factor == pytest.approx(factor)
    assert unit.label == label


@pytest.mark.parametrize("text", ["0 rpm", "10^-3 Nm", "m/s^2", "(None)", "2.5", "MN"])
def test_what_is_no_unit(text):
    assert find_unit(text) is None


@pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")
@pytest.mark.parametrize("unit", ["1/s", "s-1", "s^-1", "1 / s"])
def test_a_speed_in_1_per_s_is_told_as_what_it_was_read(unit):
    time = 1e-3 * np.arange(300)
    data = {"time [s]": time, "torque [Nm]": np.sin(9 * time), f"Drehzahl [{unit}]": np.cos(7 * time)}
    log = read_log(data)
    np.testing.assert_array_equal(log.velocity, np.cos(7 * time))
    said = [each for each in log.warnings if "was read in rad/s" in each]
    mapped = re.findall("--columns (velocity=.*:rev/s)", said[0])
    turned = read_log(data, columns=mapped[0])
    np.testing.assert_allclose(turned.velocity, TURN * log.velocity)
    assert not any("was read in rad/s" in each for each in turned.warnings)


def test_an_effective_current_in_brackets_is_one():
    assert find_unit("A (rms)") == find_unit("Arms") == find_unit("A(Eff)")
    assert find_unit("A (phase)") == find_unit("A")
