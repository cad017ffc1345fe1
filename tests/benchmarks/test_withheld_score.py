"""Scoring of `benchmarks withheld` on answers written by hand."""

import json
import math
from pathlib import Path

import pytest

import fpjax.gap
from benchmarks.withheld.cases import identities
from benchmarks.withheld.judge import diagnose_all, read_scores, score_all
from benchmarks.withheld.real import intervals, read_record, run_real
from benchmarks.withheld.score import number, score_case
from benchmarks.withheld.summary import calibration, confusion, misses, summarise, summary_of


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
        "set": kind,
        "system": "servo",
        "effects": list(effects),
        "outside": None,
        "accepted": accepted or [sorted(effects)],
        "parameters": {e: v for e, v in parameters.items() if e in effects},
        "perfect_gap": {"velocity": 0.01, "position": 1e-4},
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
    assert (score.top1, score.name, score.strict, score.top3, score.exact) == (True,) * 5
    assert score.statement is True
    assert score.probability == pytest.approx(0.9)
    # the perfect model's gap is the label's 0.01, whatever floor the tool states
    assert score.closed == pytest.approx(0.09 / 0.10)
    found = {p.name: p for p in score.parameters}
    assert found["stribeck_torque"].relative_error == pytest.approx(0.1)
    assert found["stribeck_torque"].covered is True
    assert found["stribeck_velocity"].covered is False
    assert score.column == "stribeck"


def test_the_right_name_that_calls_itself_unexplained_is_not_top1():
    score = score_case(answer("unexplained", [], entry("stribeck", 0.8)), label())
    assert score.name is True
    assert score.top1 is False
    assert score.column == "unexplained"


def test_a_wrong_name_counts_only_in_the_top_three():
    given = answer("explained", ["presliding"], entry("presliding", 0.7), entry("stribeck", 0.3))
    score = score_case(given, label())
    assert (score.top1, score.name, score.top3, score.statement) == (False, False, True, False)
    assert score.column == "presliding"
    assert not score.parameters


def test_a_declared_confusable_counts_but_a_class_of_everything_does_not():
    few = answer(
        "explained", ["presliding"], entry("presliding", 0.5, ["stribeck"]), entry("stribeck", 0.4, ["presliding"])
    )
    score = score_case(few, label())
    assert score.top1 is True
    assert score.strict is False
    # the class shares its probability: the statement is the class
    assert score.probability == pytest.approx(0.9)
    assert score.statement is True
    many = ["stribeck", "backlash", "compliance", "cogging"]
    score = score_case(answer("explained", ["presliding"], entry("presliding", 0.5, many)), label())
    assert score.top1 is False
    assert score.statement is False


def test_exact_twins_count_and_a_twin_of_three_causes_wants_all_three():
    sets = [["torque_gain_error"], ["coulomb_error", "inertia_error", "viscous_error"]]
    gain = label(effects=("torque_gain_error",), accepted=sets)
    three = ["inertia_error", "coulomb_error", "viscous_error"]
    whole = answer("explained", three, entry("inertia_error", 0.6))
    part = answer("explained", ["inertia_error"], entry("inertia_error", 0.6))
    assert score_case(whole, gain).top1 is True
    assert score_case(whole, gain).column == "torque_gain_error"
    assert score_case(part, gain).top1 is False
    delay = label(effects=("actuator_delay",), accepted=[["actuator_delay"], ["velocity_delay"]])
    twin = answer("explained", ["velocity_delay"], entry("velocity_delay", 0.5))
    assert score_case(twin, delay).strict is True


def test_nominal_errors_are_true_causes_where_the_nominal_is_off():
    given = answer("explained", ["stribeck", "coulomb_error"], entry("stribeck", 0.9))
    assert score_case(given, label("single_off")).exact is True
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
    assert score_case(answer("unexplained", []), outside).wrongly_confident is False
    assert score_case(answer("unexplained", ["backlash"]), outside).wrongly_confident is True
    assert score_case(answer("no_gap", []), outside).wrongly_confident is False


def test_a_failed_diagnosis_is_wrong_everywhere():
    assert score_case(None, label()).top1 is False
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
    assert written["sets"]["single"]["top1"] == 1.0
    assert written["sets"]["pairs"]["both"] == 0.0
    assert written["sets"]["pairs"]["failed"] == 1
    assert written["sets"]["none"]["false_alarms"] == 0.0
    assert written["provenance"]["seeds"] == [1]
    printed = capsys.readouterr().out
    assert "false_alarms" in printed
    assert "1 cases count against a goal" in printed
    for name in ("confusion", "calibration", "parameters"):
        assert (tmp_path / f"{name}.png").stat().st_size > 5000


def test_nothing_to_score_is_not_an_error():
    summary = summarise([])
    assert summary["brier"] is None
    assert summary["sets"] == {}


EMPS = Path(__file__).parents[3] / "shared" / "data" / "emps"


class Answer:
    """A diagnosis by hand for the real logs."""

    def __init__(self, content):
        self.content = content

    def to_dict(self):
        return self.content


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS records are not here")
def test_the_real_logs_are_read_and_their_checks_can_fail(tmp_path, capsys):
    calls = []
    record = read_record(EMPS / "DATA_EMPS_PULSES.mat")
    pulses = intervals(record["pulses"] != 0, record["time"])
    assert len(pulses) > 3
    good = answer(
        "unexplained",
        ["asymmetric_friction"],
        entry("asymmetric_friction", 0.9, viscous_positive=(166, 160, 170), viscous_negative=(241, 235, 245)),
        gap={"unit": "N", "before": 2.54, "after": 1.5, "noise_floor": 0.29},
    ) | {"where": {"time": [{"from": a, "to": b, "share": 0.1} for a, b in pulses]}}
    bad = answer("explained", ["stribeck"], entry("velocity_delay", 0.9), entry("stribeck", 0.1))

    def give(content):
        def diagnose(log, model, holdout=None):
            calls.append((log.name, holdout))
            assert model.exists()
            return Answer(content)

        return diagnose

    assert run_real(EMPS, tmp_path, give(good)) == 0
    assert calls[0][0] == "emps.csv"
    assert [path.name for path in calls[0][1]] == ["pulses.csv"]
    assert run_real(EMPS, tmp_path, give(bad)) == 1
    failed = [
        c["passed"] for part in ("ladder", "pulses") for c in json.loads((tmp_path / "real.json").read_text())[part]
    ]
    assert failed.count(False) >= 5
    capsys.readouterr()


def test_a_report_of_a_set_that_found_nothing(tmp_path, capsys):
    score_all(tmp_path, [label("none", (), [[]])], {})
    assert "false_alarms" in capsys.readouterr().out
    assert (tmp_path / "parameters.png").exists()


def test_an_interrupted_run_goes_on_and_a_failing_log_is_counted(tmp_path, monkeypatch, capsys):
    wanted = identities(0, ("none",), ("servo", "drive"))
    for one in wanted:
        place = tmp_path / "logs" / one.name
        place.mkdir(parents=True)
        (place / "log.csv").write_text("time,torque,velocity\n")
        (place / "servo.toml").write_text("")
    asked, broken = [], {wanted[1].name}

    def diagnose(log, model):
        asked.append(log.parent.name)
        assert model.name == "servo.toml"
        if log.parent.name in broken:
            raise ValueError("does not converge")
        return Answer(answer("no_gap", []))

    monkeypatch.setattr(fpjax.gap, "diagnose", diagnose, raising=False)
    diagnose_all(tmp_path, wanted)
    assert asked == [one.name for one in wanted]
    labels = [label("none", (), [[]], case=one.name) for one in wanted]
    scores = read_scores(tmp_path, labels)
    assert [s.verdict for s in scores] == ["no_gap", "failed", "no_gap", "no_gap"]
    assert [s.warm for s in scores if s.seconds is not None] == [False, True, True]
    assert "does not converge" in (tmp_path / "results" / wanted[1].name / "error.txt").read_text()
    broken.clear()
    diagnose_all(tmp_path, wanted)
    assert asked[len(wanted) :] == [wanted[1].name]
    assert summary_of(read_scores(tmp_path, labels))["false_alarms"] == 0.0
    assert "reused" in capsys.readouterr().err
