"""Results of the diagnosis, of improve and of plan: data frames, pictures and what a notebook prints of them."""

import math
import sys

import numpy as np
import pytest
import report_cases

import fpjax as fp
from fpjax.improvement import Change, Range, Side
from fpjax.planning.answer import Visible
from fpjax.planning.limits import Limits

TIME = np.arange(101) * 1e-2


def improvement():
    def side(error, peak):
        rough, torque = Range(1e-3, 9e-4, 2e-3, "N m"), Range(0.4, 0.3, 0.5, "N m")
        reversal = None if error > 0.1 else Range(error, 0.0, 1.0, "rad/s")  # one side alone has it
        return Side({"kp": 1.0}, Range(error, 0.9 * error, 1.1 * error, "rad/s"), reversal, torque, peak, None, rough,
                    {"phase": Range(50.0, 45.0, 60.0, "deg")}, 0.0)  # fmt: skip

    before, after = side(0.2, Range(1.0, 0.9, 1.1, "N m")), side(0.1, Range(2.0, 1.9, 2.1, "N m"))
    error = np.stack([TIME, 2.0 * TIME, 3.0 * TIME])
    runs = {"time": TIME, "reference": np.sin(TIME), "before": error, "after": error, "found": error}
    return fp.Improvement(
        "change", "The error halves.", before, after, None, (Change("kp", 1.0, 2.0, 0.1, 10.0),), 1.0,
        Range(0.5, 0.4, 0.6, "1"), None, "", "", "velocity", "explained", ("coulomb_error",), 8, 8, 100, (),
        runs=runs, ratios=np.linspace(0.4, 0.6, 8),
    )  # fmt: skip


def plan():
    motion = {"speed": np.cos(TIME), "acceleration": -np.sin(TIME), "position": np.sin(TIME)}
    visible = (Visible("stribeck", {"stribeck_torque": (0.1, "N m")}, 4.0),)
    limits = Limits(1.0, 2.0, math.inf, 3.0, 1.0)
    return fp.Plan(
        "effects", TIME, np.cos(TIME), motion, 0.1 * np.sign(np.cos(TIME)), limits, visible, (), (), 0.01,
        {"velocity": 1e-3}, False, False, "N m", "servo.toml", 1, (0.0, 0.0), "converged",
    )  # fmt: skip


def test_the_ranking_is_a_row_for_each_parameter():
    pytest.importorskip("pandas")
    found = report_cases.explained()
    frame = found.to_dataframe()
    assert frame.index.name == "effect"
    assert list(dict.fromkeys(frame.index)) == [entry.effect for entry in found.ranking]
    entry = found.ranking[0]
    rows = frame.loc[[entry.effect]].set_index("parameter")
    assert rows["cause"].all()
    for name, estimate in entry.parameters.items():
        told = (estimate.value, estimate.low, estimate.high, estimate.unit)
        assert tuple(rows.loc[name, ["value", "low", "high", "unit"]]) == told
    assert not frame.loc[[each for each in frame.index if each not in found.causes], "cause"].any()


def test_an_effect_without_numbers_keeps_its_row():
    pytest.importorskip("pandas")
    found = report_cases.bare()
    assert len(found.to_dataframe()) >= len(found.ranking)


def test_a_prediction_has_its_interval_and_a_missing_side_is_nan():
    pytest.importorskip("pandas")
    frame = improvement().to_dataframe()
    row = frame.loc["tracking error, rms"]
    assert (row["before"], row["after_low"], row["after_high"]) == pytest.approx((0.2, 0.09, 0.11))
    assert row["unit"] == "rad/s"
    reversal = frame.loc["tracking error at reversals, rms"]
    assert math.isnan(reversal["before"])
    assert reversal["after"] == 0.1
    assert "found" not in frame.columns


def test_a_plan_is_its_run():
    pytest.importorskip("pandas")
    frame = plan().to_dataframe()
    assert frame.index.name == "time"
    np.testing.assert_array_equal(frame["reference"], np.cos(TIME))
    np.testing.assert_array_equal(frame["planned_torque"], 0.1 * np.sign(np.cos(TIME)))


@pytest.mark.parametrize("result", [report_cases.explained, improvement, plan])
def test_without_pandas_one_sentence_says_what_to_install(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(fp.InputError, match="pip install pandas"):
        result().to_dataframe()


@pytest.mark.parametrize("result", [report_cases.explained, improvement, plan])
def test_a_result_draws_itself_into_a_file_and_a_notebook_prints_its_sentences(result, tmp_path):
    found = result()
    assert found.plot(tmp_path / "sub" / "picture.png") is not None
    assert (tmp_path / "sub" / "picture.png").stat().st_size > 5_000
    assert repr(found) == str(found)
    assert "array(" not in repr(found)


def test_the_verbs_of_the_diagnosis_stand_at_the_top():
    assert fp.diagnose is fp.gap.diagnose
    assert {"diagnose", "improve", "plan", "Diagnosis", "Improvement", "Plan"} <= set(dir(fp))
