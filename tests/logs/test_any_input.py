"""Whatever is read gives a log or an InputError: bytes, text, numbers, words."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from log_files import DT

from fpjax import InputError, read_log

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")  # each test asks for its own


def outcome(source, **options):
    """The log, or None after one sentence; any other exception fails the test."""
    try:
        return read_log(source, **options)
    except InputError as error:
        sentence = str(error)
    assert "\n" not in sentence
    return None


QUIET = settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])


@QUIET
@given(
    st.binary(max_size=400), st.sampled_from(["csv", "npz", "mat", "txt", "parquet", "mcap", "json", "wpilog", "db3"])
)
def test_any_bytes_give_a_log_or_an_input_error(tmp_path, content, suffix):
    path = tmp_path / f"fuzz.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_log(path)


@QUIET
@given(st.text(alphabet="time,torquevlcy0123456789.-+e;\t\n\"'#nai[] ", max_size=600))
def test_any_text_gives_a_log_or_an_input_error(tmp_path, content):
    path = tmp_path / "fuzz.csv"
    path.write_text("time,torque,velocity\n" + content)
    outcome(path, repair=True)


@QUIET
@given(
    hnp.arrays(np.float64, st.tuples(st.integers(20, 40), st.just(3)), elements=st.floats(allow_nan=True, width=32)),
    st.booleans(),
)
def test_any_numbers_give_a_finite_uniform_log_or_an_input_error(values, repair):
    data = dict(zip(("time", "torque", "velocity"), values.T, strict=True))
    log = outcome(data, repair=repair)
    if log is None:
        return
    assert np.all(np.isfinite(log.torque))
    np.testing.assert_allclose(np.diff(log.time), log.dt, rtol=1e-3)


@QUIET
@given(st.text(max_size=40))
def test_any_columns_text_gives_a_log_or_an_input_error(spec):
    time = DT * np.arange(30)
    outcome({"time": time, "torque": time, "velocity": time}, columns=spec)


@QUIET
@given(
    st.floats(1e-5, 1.0), st.integers(22, 200), st.floats(-1e3, 1e6), st.floats(0, 0.2),
    st.randoms(use_true_random=False),
)  # fmt: skip
def test_a_period_is_recovered_from_jittering_stamps(dt, rows, start, jitter, random):
    stamps = start + dt * np.arange(rows) + np.array([random.uniform(-1, 1) * jitter * dt for _ in range(rows)])
    if np.spacing(start) > 0.01 * dt:
        return
    log = read_log({"time": stamps, "torque": stamps * 0.0, "velocity": stamps * 0.0})
    # Stamps that are followed say nothing before the first and after the last of them.
    assert rows - 2 * log.resampled <= len(log) <= rows
    assert log.dt == pytest.approx(dt, rel=0.4 / rows)
