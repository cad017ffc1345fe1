"""What `benchmarks withheld` makes of its scores: calibration, tables, files, and a run that goes on."""

import json
from typing import Any

import pytest
from withheld_labels import answer, entry, label

from benchmarks.withheld.calibration import by_verdict, calibration, laplace
from benchmarks.withheld.goals import goals_table
from benchmarks.withheld.identity import identities
from benchmarks.withheld.judge import diagnose_all, read_scores, score_all
from benchmarks.withheld.score import score_case
from benchmarks.withheld.summary import confusion, misses, summarise, summary_of


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
