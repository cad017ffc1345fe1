"""Logs that once ended in a traceback, a hang or a silent wrong answer: each is looked at, or refused in a sentence.

What a fuzzer of damaged files found (mutated stamps, values, layouts and bytes in seven formats), each reduced to what
it needs.
"""

import contextlib
import io
import json
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy_machine import swing
from sentences import faults

from fpjax import InputError, read_log
from fpjax.cli.inspect import _show, starter
from fpjax.logs.checks.inspection import inspect_log
from fpjax.logs.dynamics.friction_curve import friction_curve

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")
ROWS = 300


def log(**changes):
    """A swinging mass under a torque, its columns replaced by the changes."""
    table = swing(ROWS, inertia=0.01, coulomb=0.1, amplitude=3.0, rate=25.0)
    return {name: values for name, values in (table | changes).items() if values is not None}


def looked_at(source, **options):
    """True after everything that `fpjax inspect` does, False after one sentence; anything else fails the test."""
    try:
        read = read_log(source, **options)
        found = inspect_log(read)
        with contextlib.redirect_stdout(io.StringIO()):
            _show(found)
        json.dumps(found.to_dict(), allow_nan=False)
        starter(found)
        friction_curve(read, found.nominal)
    except InputError as error:
        sentence = str(error)
    else:
        assert np.all(np.isfinite(read.torque))
        assert np.all(np.diff(read.time) > 0.0)
        return True
    assert not faults(sentence), sentence
    return False


TIME = 1e-3 * np.arange(ROWS)
ANSWERED = {
    "as it is": log(),
    "one reading of 1e308": log(torque=np.where(np.arange(ROWS) == 7, 1e308, log()["torque"])),
    "one reading of 1e150": log(position=np.where(np.arange(ROWS) == 7, 1e150, log()["position"])),
    "one reading of 1e200 in a column that nobody mapped": log(other=np.where(np.arange(ROWS) == 7, 1e200, TIME)),
    "a torque of zeros": log(torque=np.zeros(ROWS)),
    "no motion": log(velocity=np.zeros(ROWS), position=None),
    "all readings equal": log(torque=np.ones(ROWS), velocity=np.ones(ROWS), position=np.ones(ROWS)),
    "a single reversal": log(velocity=TIME - 0.15, position=(TIME - 0.15) ** 2 / 2),
    "every other reading is missing": log(velocity=np.where(np.arange(ROWS) % 2, np.nan, log()["velocity"])),
    "a torque of 1e-200": log(torque=1e-200 * log()["torque"]),
    "a position of 1e12": log(position=1e12 + log()["position"]),
    "stamps of 1.7e9 s": log(time=1.7e9 + TIME),
    "coarse stamps": log(time=np.floor(100 * TIME) / 100),
    "random stamps": log(time=np.cumsum(np.random.default_rng(1).exponential(1e-3, ROWS))),
    "runs joined together": log(time=np.concatenate([TIME[:100], TIME[:200]])),
    "noise only": log(
        **{name: np.random.default_rng(2).normal(size=ROWS) for name in ("torque", "velocity", "position")}
    ),
    "signs only": log(torque=np.sign(log()["torque"]), velocity=np.sign(log()["velocity"]), position=None),
    "64 samples": {name: values[:64] for name, values in log().items()},
    "20 samples": {name: values[:20] for name, values in log().items()},
}
REFUSED = {
    "a row every 1e-303 s": log(time=1e-300 * TIME),
    "a row every 1e297 s": log(time=1e300 * TIME),
    "stamps that a float does not tell apart": log(time=1e17 + TIME),
    "19 samples": {name: values[:19] for name, values in log().items()},
    "a velocity of 1e150": log(velocity=1e150 * log()["velocity"]),
    "a torque of nothing": log(torque=np.full(ROWS, np.nan)),
}


@pytest.mark.parametrize("case", ANSWERED)
def test_what_can_be_looked_at_is_looked_at(case):
    assert looked_at(ANSWERED[case])


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_one_sentence(case):
    assert not looked_at(REFUSED[case])


@pytest.mark.parametrize(
    "spec",
    ["time=time*1e-300", "torque=torque*1e300", "velocity=position,position=velocity", "=", "torque=:",
     "axis=99999999999", "velocity=velocity:counts/s/0", "torque=torque:A*0", "position=position*1e30",
     "torque=torque*1e-200"],
)  # fmt: skip
def test_any_mapping_is_answered(spec):
    looked_at(log(), columns=spec)


def test_a_period_that_is_not_the_logs_makes_nothing_up():
    sparse = {name: values[:60] for name, values in log(time=0.3 * np.arange(ROWS)).items()}
    assert not looked_at(sparse, dt=1e-4)


@pytest.mark.parametrize("kind", ["double", "float", "int64", "boolean", "double[]", "string"])
def test_wpilog_of_any_bits(tmp_path, kind):
    """A float may be any NaN, and its cast warned."""

    def record(entry, stamp, payload):
        return bytes([0b1111111]) + struct.pack("<IIQ", entry, len(payload), stamp) + payload

    def text(word):
        return struct.pack("<I", len(word)) + word.encode()

    generator = np.random.default_rng(3)
    found = b"WPILOG" + struct.pack("<HI", 0x0100, 0)
    for number, name in enumerate(("torque", "velocity"), start=1):
        found += record(0, 0, b"\x00" + struct.pack("<I", number) + text(name) + text(kind) + text(""))
    for row in range(60):
        for number in (1, 2):
            found += record(number, 1000 * row, generator.bytes(1 if kind == "boolean" else 8))
    (tmp_path / "log.wpilog").write_bytes(found)
    looked_at(tmp_path / "log.wpilog")


LINES = [",".join(log())] + [",".join(f"{cell:.9g}" for cell in row) for row in zip(*log().values(), strict=True)]


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(
            st.integers(0, ROWS),
            st.integers(0, 3),
            st.sampled_from(
                ["", "nan", "inf", "1e308", "-1e200", "abc", "1_0", "1,5", '"', "'", "9" * 400, "\t", ";", "#", "0"]
            ),
        ),
        max_size=6,
    ),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from(["utf-8", "utf-16", "utf-16-be", "latin-1"]),
    st.integers(0, 30),
)
def test_damaged_cells_are_answered(tmp_path, damage, end, encoding, dropped):
    lines = [line.split(",") for line in LINES[: len(LINES) - dropped]]
    for row, column, cell in damage:
        if row < len(lines):
            lines[row][column] = cell
    path = tmp_path / "log.csv"
    path.write_bytes(end.join(",".join(cells) for cells in lines).encode(encoding))
    looked_at(path)
