"""Units as drives write them."""

import pytest
from log_files import TURN

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


def test_an_effective_current_in_brackets_is_one():
    assert find_unit("A (rms)") == find_unit("Arms") == find_unit("A(Eff)")
    assert find_unit("A (phase)") == find_unit("A")
