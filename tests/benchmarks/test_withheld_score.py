"""Scoring of `benchmarks withheld` on answers written by hand."""

import json
import math
from typing import Any

import pytest

from benchmarks.withheld.calibration import by_verdict, calibration, laplace
from benchmarks.withheld.goals import goals_table
from benchmarks.withheld.identity import identities
from benchmarks.withheld.judge import diagnose_all, read_scores, score_all
from benchmarks.withheld.score import number, score_case
from benchmarks.withheld.summary import confusion, misses, summarise, summary_of


def label(kind="single", effects=("stribeck",), accepted=None, **changes):
    """A label as the truth generator writes it."""
    parameters = {
        "stribeck": {
            "stribeck_torque": {"value": 2.0, "unit": "N m"},
            "stribeck_velocity": {"value": 0.1, "unit": "rad/s"},
        }
    }
    return {
        "case": "case-1",
        "version": 1,
        "seed": 1,
        "half": "reported",
        "truth": 1,
        "set": kind,
        "sensors": "rate",
        "group": f"truth 1, {kind}, rate",
        "system": "servo",
        "effects": list(effects),
        "outside": None,
        "accepted": accepted or [sorted(effects)],
        "parameters": {e: v for e, v in parameters.items() if e in effects},
        "nominal_true": {"inertia": 1.0, "coulomb": 2.0, "viscous": 0.5},
        "nominal_error_percent": {"inertia": 0.0, "coulomb": 0.0, "viscous": 0.0},
    } | changes


def entry(effect, probability, twins=(), **parameters):
    return {
        "effect": effect,
        "probability": probability,
        "gap_after": 0.1,
        "parameters": {
            name: {"value": v, "low": low, "high": high, "unit": ""} for name, (v, low, high) in parameters.items()
        },
        "indistinguishable_from": list(twins),
    }


def answer(verdict, causes, *ranking, gap=None):
    return {"verdict": verdict, "causes": causes, "ranking": list(ranking), "gap": gap or {}}


def test_the_right_name_with_the_right_verdict():
    given = answer(
        "explained",
        ["stribeck"],
        entry("stribeck", 0.9, stribeck_torque=(2.2, 1.9, 2.5), stribeck_velocity=(0.1, 0.11, 0.2)),
        entry("presliding", 0.1),
        gap={"signal": "velocity", "unit": "rad/s", "before": 0.11, "after": 0.02, "noise_floor": 0.015},
    )
    score = score_case(given, label(), 3.0)
    assert (score.right, score.name, score.strict, score.top3, score.exact) == (True,) * 5
    assert score.statement is True
    assert score.probability == pytest.approx(0.9)
    assert score.closed == pytest.approx(0.09 / 0.095)
    found = {p.name: p for p in score.parameters}
    assert found["stribeck_torque"].relative_error == pytest.approx(0.1)
    assert found["stribeck_torque"].covered is True
    assert found["stribeck_velocity"].covered is False
    assert score.column == "stribeck"


@pytest.mark.parametrize("verdict", ["explained", "partly_explained"])
def test_both_verdicts_that_assert_a_cause_are_statements(verdict):
    right = score_case(answer(verdict, ["stribeck"], entry("stribeck", 0.97)), label())
    assert (right.right, right.name, right.wrongly_sure, right.sure_statements) == (True, True, False, 1)
    wrong = score_case(answer(verdict, ["backlash"], entry("backlash", 0.97)), label())
    assert (wrong.right, wrong.wrongly_asserted, wrong.wrongly_sure) == (False, True, True)
    unsure = score_case(answer(verdict, ["backlash"], entry("backlash", 0.7)), label())
    assert (unsure.wrongly_asserted, unsure.wrongly_sure) == (True, False)
    outside = score_case(answer(verdict, ["backlash"], entry("backlash", 0.97)), label("outside", (), [[]]))
    assert (outside.wrongly_asserted, outside.wrongly_sure) == (True, True)
    # both causes of a pair are statements: the second one is wrong and sure
    pair = label("pairs", ("stribeck", "cogging"))
    second = entry("backlash", 0.4) | {"cause_probability": 0.99}
    score = score_case(answer(verdict, ["stribeck", "backlash"], entry("stribeck", 0.6), second), pair)
    assert (score.both, score.one, score.wrongly_sure) == (False, True, True)


def test_a_probability_above_the_limit_is_a_statement_whatever_the_verdict():
    score = score_case(answer("unexplained", [], entry("backlash", 0.96)), label())
    assert (score.wrongly_asserted, score.wrongly_sure, score.sure_statements) == (False, True, 1)
    score = score_case(answer("unexplained", [], entry("backlash", 0.94)), label())
    assert (score.wrongly_sure, score.sure_statements) == (False, 0)


def test_clutter_that_is_truly_there_may_be_asserted_and_is_not_the_cause():
    cluttered = label(also_true=["cogging"])
    both = answer("explained", ["stribeck", "cogging"], entry("stribeck", 0.97), entry("cogging", 0.02))
    score = score_case(both, cluttered)
    assert (score.right, score.wrongly_asserted, score.wrongly_sure) == (True, False, False)
    score = score_case(answer("explained", ["cogging"], entry("cogging", 0.97)), cluttered)
    assert (score.right, score.name, score.wrongly_sure) == (False, False, False)
    score = score_case(answer("explained", ["cogging"], entry("cogging", 0.97)), label())
    assert score.wrongly_sure is True


def test_a_learned_law_is_no_statement_and_no_name():
    learned = entry("learned_velocity", 0.98)
    given = answer("partly_explained", ["learned_velocity"], learned, entry("stribeck", 0.01))
    score = score_case(given, label())
    assert (score.name, score.right, score.wrongly_asserted, score.wrongly_sure) == (False, False, False, False)
    outside = score_case(given, label("outside", (), [[]]))
    assert (outside.wrongly_asserted, outside.wrongly_sure, outside.sure_statements) == (False, False, 0)


MODEL = """[plant]
type = "one_mass"
inertia = 1.01
[friction]
coulomb = 2.0
viscous = 0.62
"""


def test_errors_of_a_wide_nominal_may_lead_and_are_to_be_named_or_corrected():
    wide = label("wide", nominal_error_percent={"inertia": 25.0, "coulomb": -15.0, "viscous": 20.0})
    ranked = (entry("inertia_error", 0.5), entry("stribeck", 0.45, stribeck_torque=(2.1, 1.9, 2.3)))
    given = answer("explained", ["inertia_error", "stribeck"], *ranked) | {"model": MODEL}
    score = score_case(given, wide)
    assert (score.name, score.right, score.strict, score.exact) == (True, True, False, True)
    assert (score.wrongly_asserted, score.wrongly_sure) == (False, False)
    assert {n.name: (n.named, n.corrected) for n in score.nominal} == {
        "inertia": (True, True),
        "coulomb": (False, True),
        "viscous": (False, False),
    }
    assert [p.covered for p in score.parameters] == [True]
    figures = summary_of([score])
    assert figures["nominal_corrected"] == pytest.approx(2 / 3)
    # where the nominal is exact, an error of it is a wrong name
    assert score_case(given, label()).name is False
    # of two masses the inertia is their sum; a diagnosis without a model corrects nothing
    two = "plant = {motor_inertia = 0.4, load_inertia = 0.6}\nfriction = {coulomb = 2.0, viscous = 0.5}"
    assert all(n.corrected for n in score_case(given | {"model": two}, wide).nominal)
    assert not any(n.corrected for n in score_case(given | {"model": "no ="}, wide).nominal)


def test_coverage_is_told_apart_for_laws_of_another_form():
    inside = answer("explained", ["stribeck"], entry("stribeck", 0.9, stribeck_torque=(2.1, 1.9, 2.3)))
    beside = answer("explained", ["stribeck"], entry("stribeck", 0.9, stribeck_torque=(2.5, 2.4, 2.6)))
    scores = [score_case(inside, label()), score_case(beside, label(other_form=["stribeck"]))]
    found = summary_of(scores)["parameters"]
    assert (found["coverage_same_law"], found["coverage_other_form"]) == (1.0, 0.0)
    assert found["coverage"] == 0.5


def test_the_right_name_that_calls_itself_unexplained_is_not_asserted():
    score = score_case(answer("unexplained", [], entry("stribeck", 0.8)), label())
    assert score.name is True
    assert score.right is False
    assert score.column == "unexplained"


def test_a_wrong_name_counts_only_in_the_top_three():
    given = answer("explained", ["presliding"], entry("presliding", 0.7), entry("stribeck", 0.3))
    score = score_case(given, label())
    assert (score.right, score.name, score.top3, score.statement) == (False, False, True, False)
    assert score.column == "presliding"
    assert not score.parameters


def test_a_declared_confusable_counts_but_a_class_of_everything_does_not():
    few = answer(
        "explained", ["presliding"], entry("presliding", 0.5, ["stribeck"]), entry("stribeck", 0.4, ["presliding"])
    )
    score = score_case(few, label())
    assert score.right is True
    assert score.strict is False
    # the class shares its probability: the statement is the class
    assert score.probability == pytest.approx(0.9)
    assert score.statement is True
    many = ["stribeck", "backlash", "compliance", "cogging"]
    score = score_case(answer("explained", ["presliding"], entry("presliding", 0.5, many)), label())
    assert score.right is False
    assert score.statement is False


def test_exact_twins_count_and_a_twin_of_three_causes_wants_all_three():
    sets = [["torque_gain_error"], ["coulomb_error", "inertia_error", "viscous_error"]]
    gain = label(effects=("torque_gain_error",), accepted=sets)
    three = ["inertia_error", "coulomb_error", "viscous_error"]
    whole = answer("explained", three, entry("inertia_error", 0.6))
    part = answer("explained", ["inertia_error"], entry("inertia_error", 0.6))
    assert score_case(whole, gain).right is True
    assert score_case(whole, gain).column == "torque_gain_error"
    assert score_case(part, gain).right is False
    delay = label(effects=("actuator_delay",), accepted=[["actuator_delay"], ["velocity_delay"]])
    twin = answer("explained", ["velocity_delay"], entry("velocity_delay", 0.5))
    assert score_case(twin, delay).strict is True


def test_nominal_errors_are_true_causes_where_the_nominal_is_off():
    given = answer("explained", ["stribeck", "coulomb_error"], entry("stribeck", 0.9))
    off = label("single_off", nominal_error_percent={"inertia": 1.0, "coulomb": -2.0, "viscous": 0.5})
    assert score_case(given, off).exact is True
    assert score_case(given, label("single")).exact is False


def test_pairs():
    both = label("pairs", ("stribeck", "cogging"))
    found = answer("explained", ["cogging", "stribeck"], entry("cogging", 0.5), entry("stribeck", 0.5))
    score = score_case(found, both)
    assert (score.both, score.one, score.both_ranked, score.exact) == (True,) * 4
    half = answer("explained", ["cogging", "backlash"], entry("cogging", 0.9))
    score = score_case(half, both)
    assert (score.both, score.one, score.exact) == (False, True, False)
    # one class cannot stand for both causes
    lumped = answer("explained", ["cogging"], entry("cogging", 0.9, ["stribeck"]))
    assert score_case(lumped, both).both is False
    declared = answer(
        "explained", ["cogging", "presliding"], entry("cogging", 0.5), entry("presliding", 0.2, ["stribeck"])
    )
    assert score_case(declared, both).both is True
    assert score_case(answer("unexplained", ["cogging"]), both).one is True
    # of a pair the parameters of the cause that was found are scored
    assert {p.effect for p in score_case(found, both).parameters} == set()
    given = answer(
        "explained", ["stribeck"], entry("cogging", 0.5), entry("stribeck", 0.5, stribeck_torque=(2.0, 1.0, 3.0))
    )
    assert [p.covered for p in score_case(given, both).parameters] == [True]


def test_no_gap_and_outside():
    none = label("none", (), [[]])
    assert score_case(answer("no_gap", []), none).false_alarm is False
    assert score_case(answer("unexplained", []), none).false_alarm is True
    false = score_case(answer("explained", ["cogging"], entry("cogging", 0.8)), none)
    assert false.false_alarm is True
    assert false.statement is False
    outside = label("outside", (), [[]], outside="hysteresis")
    assert score_case(answer("unexplained", []), outside).wrongly_asserted is False
    assert score_case(answer("explained", ["backlash"]), outside).wrongly_asserted is True
    assert score_case(answer("no_gap", []), outside).wrongly_sure is False


def test_a_failed_diagnosis_is_wrong_everywhere():
    assert score_case(None, label()).right is False
    assert score_case(None, label("pairs", ("stribeck", "cogging"))).both is False
    assert score_case(None, label("none", (), [[]])).false_alarm is True
    # it asserts nothing, but it is counted and shown
    score = score_case(None, label("outside", (), [[]], outside="hysteresis"))
    assert score.column == "failed"
    assert summary_of([score])["failed"] == 1


def test_numbers_with_and_without_intervals():
    assert number({"value": 3, "low": 2, "high": 4}) == 3.0
    assert math.isnan(number(None))
    assert math.isnan(number("much"))


def test_brier_and_calibration_by_hand():
    right = answer("explained", ["stribeck"], entry("stribeck", 0.9))
    wrong = answer("explained", ["backlash"], entry("backlash", 0.7))
    scores = [score_case(right, label()) for _ in range(9)] + [score_case(wrong, label())]
    assert summary_of(scores)["brier"] == pytest.approx((9 * 0.01 + 0.49) / 10)
    rows = calibration(scores)
    assert [(r["count"], r["right"]) for r in rows] == [(1, 0.0), (9, 1.0)]
    assert [r["supported"] for r in rows] == [pytest.approx(1 / 3), pytest.approx(10 / 11)]
    assert [(r["named"], r["named_of"]) for r in rows] == [(0, 1), (9, 9)]
    assert confusion(scores) == {"stribeck": {"stribeck": 9, "backlash": 1}}
    assert [m["answered"] for m in misses(scores)] == ["backlash"]


def test_warm_and_first_calls_are_timed_apart():
    given = answer("no_gap", [])
    none = label("none", (), [[]])
    scores = [score_case(given, none, 40.0, warm=False)]
    scores += [score_case(given, none, t) for t in (2.0, 3.0, 9.0)]
    spent = summary_of(scores)["time"]
    assert (spent["median"], spent["worst"], spent["first_calls"]) == (3.0, 9.0, [40.0])


def test_what_is_written(tmp_path, capsys):
    labels = [
        label(case="a"),
        label("none", (), [[]], case="b"),
        label("pairs", ("stribeck", "cogging"), case="c"),
        label("outside", (), [[]], case="d", outside="hysteresis"),
    ]
    labels.append(label(case="e"))  # not tried yet: it counts nowhere
    failed = tmp_path / "results" / "c"
    failed.mkdir(parents=True)
    (failed / "error.txt").write_text("ValueError: does not converge\n")
    answers = {
        "a": answer("explained", ["stribeck"], entry("stribeck", 0.95, stribeck_torque=(2.1, 1.9, 2.3))),
        "b": answer("no_gap", []),
        "d": answer("unexplained", [], entry("backlash", 0.2)),
    }
    for case, given in answers.items():
        place = tmp_path / "results" / case
        place.mkdir(parents=True)
        (place / "diagnosis.json").write_text(json.dumps(given))
        (place / "run.json").write_text(json.dumps({"seconds": 4.0, "warm": True}))
    assert [s.verdict for s in read_scores(tmp_path, labels)] == [
        "explained",
        "no_gap",
        "failed",
        "unexplained",
    ]
    score_all(tmp_path, labels, {"seeds": 1})
    written = json.loads((tmp_path / "withheld.json").read_text())
    assert written["groups"]["truth 1, single, rate"]["name"] == 1.0
    assert written["groups"]["truth 1, pairs, rate"]["both"] == 0.0
    assert written["groups"]["truth 1, pairs, rate"]["failed"] == 1
    assert written["groups"]["truth 1, none, rate"]["false_alarms"] == 0.0
    assert sum(row["count"] for row in written["calibration"]["rate sensor"]) == 2
    assert written["provenance"]["seeds"] == [1]
    printed = capsys.readouterr().out
    row = next(line for line in printed.splitlines() if line.startswith("no gap: false alarms"))
    assert row.split()[4:] == ["0", "of", "1", "0.0", "%", "none", "met"]
    assert "1 of 5 logs are not diagnosed yet" in printed
    assert (written["provenance"]["cases"], written["provenance"]["not_diagnosed"]) == (4, 1)
    assert "calibration, rate sensor" in printed
    assert "1 cases count against a goal" in printed
    for name in ("confusion", "calibration", "parameters"):
        assert (tmp_path / f"{name}.png").stat().st_size > 5000


def test_nothing_to_score_is_not_an_error():
    summary = summarise([])
    assert summary["brier"] is None
    assert summary["groups"] == {}


def test_a_report_of_a_set_that_found_nothing(tmp_path, capsys):
    place = tmp_path / "results" / "case-1"
    place.mkdir(parents=True)
    (place / "error.txt").write_text("failed")
    score_all(tmp_path, [label("none", (), [[]])], {})
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("no gap: false alarms"))
    assert row.split()[4:] == ["1", "of", "1", "100.0", "%", "none", "MISSED"]
    assert (tmp_path / "parameters.png").exists()


def test_an_interrupted_run_goes_on_and_a_failing_log_is_counted(tmp_path, capsys):
    wanted = [one for one in identities(0, 1) if one.set == "none" and one.sensors == "rate"]
    wanted += [one for one in identities(0, 1) if one.set == "none" and one.sensors == "encoder"][:2]
    assert len(wanted) == 5
    asked, broken = [], {wanted[1].name}

    def tool(log, model, out):
        asked.append(log.parent.name)
        assert (log.name, model.name, model.parent) == ("log.csv", "servo.toml", log.parent)
        out.mkdir()
        (out / "diagnosis.json").write_text(json.dumps(answer("no_gap", [])))
        if log.parent.name in broken:
            # what is half written when a run breaks is not an answer
            raise ValueError("does not converge")

    diagnose_all(tmp_path, wanted, tool)
    assert asked == [one.name for one in wanted]
    labels = [label("none", (), [[]], case=one.name) for one in wanted]
    scores = read_scores(tmp_path, labels)
    assert [s.verdict for s in scores] == ["no_gap", "failed", "no_gap", "no_gap", "no_gap"]
    assert [s.warm for s in scores if s.seconds is not None] == [False, True, False, True]
    assert "does not converge" in (tmp_path / "results" / wanted[1].name / "error.txt").read_text()
    broken.clear()
    diagnose_all(tmp_path, wanted, tool)
    assert asked[len(wanted) :] == [wanted[1].name]
    assert summary_of(read_scores(tmp_path, labels))["false_alarms"] == 0.0
    assert "reused" in capsys.readouterr().err


def test_statements_are_counted_by_verdict_lead_and_sensors_for_the_name_and_for_what_is_there():
    cluttered = {"also_true": ["cogging"], "sensors": "encoder"}
    clear = answer("explained", ["stribeck"], entry("stribeck", 0.9)) | {"ahead": 0.5}
    near = answer("explained", ["cogging"], entry("cogging", 0.7)) | {"ahead": 0.05}
    quiet = answer("no_gap", [], entry("stribeck", 0.01)) | {"ahead": None}
    scores = [score_case(clear, label()), score_case(clear, label("outside", (), [[]]))]
    scores += [score_case(near, label(**cluttered)), score_case(near, label())]
    scores += [score_case(quiet, label("none", (), [[]])), score_case(quiet, label())]
    scores += [score_case(answer("unexplained", [], entry("backlash", 0.3)), label())]
    rows = {(row["verdict"], row["lead"], row["sensors"]): row for row in by_verdict(scores)}

    def counts(*key):
        row = rows[key]
        return [row["named"], row["named_of"], row["there"], row["there_of"]]

    assert counts("explained", "clear", "all") == [1, 1, 1, 2]
    # the clutter is there, and is not the withheld effect
    assert counts("explained", "contested", "encoder only") == [0, 1, 1, 1]
    assert counts("explained", "contested", "all") == [0, 2, 1, 2]
    assert counts("unexplained", "not said", "rate sensor") == [0, 1, 0, 1]
    assert counts("no_gap", "", "all") == [0, 0, 1, 2]
    assert rows["explained", "clear", "all"]["there_supported"] == laplace(1, 2) == 0.5
    assert rows["explained", "contested", "encoder only"]["stated"] == pytest.approx(0.7)
    assert ("explained", "between", "all") not in rows


def test_the_goals_table_has_its_rows_in_order_with_counts_and_says_what_nobody_asked():
    right = answer("explained", ["stribeck"], entry("stribeck", 0.97, stribeck_torque=(2.1, 1.9, 2.3)))
    wrong = answer("explained", ["backlash"], entry("backlash", 0.97))
    second: dict[str, Any] = {"truth": 2}
    scores = [score_case(right, label(**second), 5.0), score_case(wrong, label(sensors="encoder", **second), 7.0)]
    scores += [score_case(right, label(**second, other_form=["stribeck"]), 40.0, warm=False)]
    scores += [score_case(wrong, label("outside", (), [[]]), 6.0), score_case(right, label("recorded", **second))]
    rows = goals_table(scores)
    names = [row["name"] for row in rows]
    assert names[0] == "second generator, one effect, rate sensor: right first"
    assert names[-1].startswith("processor seconds, first log")
    found = {row["name"]: (row["count"], row["of"], row["met"]) for row in rows}
    assert found[names[0]] == (2, 2, True)
    assert found["second generator, one effect, encoder only: right first"] == (0, 1, False)
    assert found["second generator, one effect, encoder only: wrongly sure"] == (1, 1, False)
    assert found["second generator, one effect, as drives record: right first"] == (1, 1, True)
    assert found["outside the vocabulary: wrongly sure"] == (1, 1, False)
    assert found["90 % intervals that hold the truth, another form"] == (1, 1, True)
    assert found["second generator, pairs: both"] == (0, 0, None)
    # a statement above the limit is counted once, however often it is told
    assert found["statements above 0.95 that are wrong"] == (2, 5, False)
    times = {row["name"]: (row["found"], row["met"]) for row in rows if row["count"] is None}
    assert list(times.values()) == [(6.0, True), (7.0, True), (40.0, False)]


def test_a_run_of_so_many_minutes_leaves_the_rest_for_another(tmp_path, capsys, monkeypatch):
    wanted = [one for one in identities(0, 1) if one.set == "none"][:3]
    now = iter(range(0, 10**6, 100))
    monkeypatch.setattr("benchmarks.withheld.judge.time.monotonic", lambda: float(next(now)))

    def tool(log, model, out):
        out.mkdir()
        (out / "diagnosis.json").write_text(json.dumps(answer("no_gap", [])))

    diagnose_all(tmp_path, wanted, tool, minutes=3)
    labels = [label("none", (), [[]], case=one.name) for one in wanted]
    assert len(read_scores(tmp_path, labels)) == 1
    assert "2 left for another run" in capsys.readouterr().err
