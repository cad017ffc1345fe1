"""`benchmarks real` on answers written by hand: what is asked, what counts, what is written."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.__main__ import main
from benchmarks.real.check import check_all, check_located, figures_of
from benchmarks.real.command import SHARED, run_real
from benchmarks.real.prepare import leave_out_pulses, stretches
from benchmarks.real.records import Goal, find_records

CASES = """
title = "a machine of mine"
[[case]]
name = "mine"
question = "what is missing?"
log = ["run.csv"]
holdout = ["other.csv"]
columns = "torque=current*0.07"
model = "servo.toml"
[case.goal]
verdict = ["partly_explained"]
causes = ["asymmetric_friction"]
first = ["asymmetric_friction"]
may = ["viscous_error"]
after = { at_most = 1.6, unit = "N" }
[case.goal.parameters]
"asymmetric_friction.viscous_positive" = { value = 166.7, within = 0.05 }
"""


def answer(**changes):
    entry = {
        "effect": "asymmetric_friction",
        "probability": 0.97,
        "parameters": {"viscous_positive": {"value": 165.0, "low": 160.0, "high": 170.0, "unit": "N s/m"}},
        "indistinguishable_from": [],
    }
    return {
        "verdict": "partly_explained",
        "causes": ["asymmetric_friction"],
        "ranking": [entry],
        "gap": {"unit": "N", "before": 2.1, "after": 1.5},
        "where": {"time": []},
    } | changes


@pytest.fixture
def mine(tmp_path):
    folder = tmp_path / "data" / "mine"
    folder.mkdir(parents=True)
    (folder / "cases.toml").write_text(CASES)
    for name in ("run.csv", "other.csv", "servo.toml"):
        (folder / name).write_text("dt = 1\n")
    return tmp_path / "data"


def writing(given, asked):
    """A command that leaves such a diagnosis where it was told to."""

    def tool(words):
        asked.append(words)
        if isinstance(given, Exception):
            raise given
        place = Path(words[words.index("--out") + 1])
        (place / "diagnosis.json").write_text(json.dumps(given))
        (place / "report.html").write_text("<p>")
        (place / "where.png").write_bytes(b"picture")

    return tool


def test_a_folder_of_ones_own_is_diagnosed_by_the_command_and_compared(mine, tmp_path, capsys):
    asked, out = [], tmp_path / "out"
    assert run_real(mine, out, tool=writing(answer(), asked)) == 0
    [words] = asked
    assert words[:2] == ["diagnose", str(mine / "mine" / "run.csv")]
    assert words[words.index("--holdout") + 1] == str(mine / "mine" / "other.csv")
    assert words[words.index("--columns") + 1] == "torque=current*0.07"
    whole = json.loads((out / "results.json").read_text())
    assert (whole["format"], whole["right"], whole["wrongly_sure"]) == (1, 1, 0)
    assert {"date", "commit", "versions"} <= set(whole["provenance"])
    [found] = whole["cases"]
    assert (found["right"], found["wrongly_sure"], found["verdict"]) == (True, False, "partly_explained")
    assert (found["causes"], found["report"]) == (["asymmetric_friction"], "mine/report.html")
    assert found["pictures"] == ["mine/where.png"]
    slope, left = found["figures"]
    assert slope == {
        "name": "asymmetric_friction.viscous_positive", "documented": 166.7, "within": 0.05, "value": 165.0,
        "low": 160.0, "high": 170.0, "unit": "N s/m", "passed": True,
    }  # fmt: skip
    assert (left["name"], left["documented"], left["value"], left["passed"]) == ("missing torque left", 1.6, 1.5, True)
    page = (out / "index.html").read_text()
    assert 'href="mine/report.html"' in page
    assert "2.1 to 1.5 N" in page
    printed = capsys.readouterr().out
    assert "1 of 1 right, 0 wrongly sure" in printed
    # what is there is not diagnosed again, unless it is asked for; its time is kept
    run_real(mine, out, tool=writing(answer(), asked))
    assert len(asked) == 1
    assert json.loads((out / "results.json").read_text())["cases"][0]["seconds"] == found["seconds"]
    run_real(mine, out, afresh=True, tool=writing(answer(), asked))
    assert len(asked) == 2
    capsys.readouterr()


def test_the_page_of_the_documentation_holds_every_figure_and_the_picture(mine, tmp_path, capsys):
    from PIL import Image

    def tool(words):
        writing(answer(provenance={"started": "2026-01-02T03:04", "versions": {"jax": "1.2.3"}}), [])(words)
        Image.new("RGB", (2000, 1000), "white").save(Path(words[words.index("--out") + 1]) / "overview.png")

    page = tmp_path / "pages" / "gallery.md"
    assert run_real(mine, tmp_path / "out", tool=tool, page=page) == 0
    text = page.read_text()
    assert "1 of 1 as documented, 0 wrongly sure (jax 1.2.3, of 2026-01-02)." in text
    assert "**partly explained**: asymmetric friction." in text
    assert "| asymmetric friction | 97.0 % | viscous positive 165 N s/m (160 to 170) |" in text
    assert "| withheld, at most 1.6 N left | yes | 2.1 -> 1.5 N |" in text
    assert "](gallery/mine.png)" in text
    with Image.open(tmp_path / "pages" / "gallery" / "mine.png") as picture:
        assert picture.size == (1000, 500)
    assert str(tmp_path) not in text  # no path of the machine that made it
    capsys.readouterr()


def test_a_record_that_the_tool_refuses_is_a_result(mine, tmp_path, capsys):
    assert run_real(mine, tmp_path / "out", tool=writing(RuntimeError("no motion"), [])) == 1
    [found] = json.loads((tmp_path / "out" / "results.json").read_text())["cases"]
    assert (found["verdict"], found["right"], found["wrongly_sure"]) == ("failed", False, False)
    assert "no motion" in (tmp_path / "out" / "index.html").read_text()
    capsys.readouterr()


@pytest.mark.parametrize(
    ("change", "fails"),
    [
        ({"verdict": "explained"}, "verdict"),
        ({"causes": []}, "causes"),
        ({"causes": ["asymmetric_friction", "stribeck"]}, "nothing else"),
        ({"gap": {"unit": "N", "before": 2.1, "after": 1.7}}, "withheld"),
        ({"ranking": []}, "first"),
    ],
)
def test_every_check_can_fail(mine, change, fails):
    goal = find_records(mine)[0].cases[0].goal
    assert all(check.passed for check in check_all(answer(), goal, ()))
    failed = [check.sentence for check in check_all(answer(**change), goal, ()) if check.passed is False]
    assert any(sentence.startswith(fails) for sentence in failed), failed


def test_a_parameter_a_share_away_and_a_sure_wrong_cause_are_told(mine):
    goal = find_records(mine)[0].cases[0].goal
    given = answer()
    given["ranking"][0]["parameters"]["viscous_positive"]["value"] = 180.0
    given["ranking"].append({"effect": "compliance", "probability": 0.01, "cause_probability": 0.99})
    given["causes"].append("compliance")
    failed = [check.sentence for check in check_all(given, goal, ()) if check.passed is False]
    assert any("viscous_positive" in sentence for sentence in failed)
    assert "nothing wrong above 0.95" in failed
    # a figure that is not given is no figure, and one of an effect that is not in the ranking fails
    [slope, _] = figures_of(answer(ranking=[]), goal)
    assert (slope.value, slope.passed) == (None, False)
    # a torque in another unit cannot be compared: neither right nor wrong
    other = check_all(answer(gap={"unit": "V", "before": 2, "after": 1}), goal, ())
    assert [check.passed for check in other if check.sentence.startswith("withheld")] == [None]


def test_pushes_are_located_where_most_places_are_pushes():
    hidden = ((1.0, 1.2), (3.0, 3.1))
    there = [{"from": 0.95, "to": 1.1, "share": 0.3}, {"from": 3.05, "to": 3.3, "share": 0.2}]
    away = [{"from": 7.0, "to": 7.2, "share": 0.1}]
    for places, right in ((there, True), (there[:1], False), (there + 2 * away, False), ([], False)):
        [check] = check_located({"where": {"time": places}}, {"pulses": True, "slack": 0.1}, hidden)
        assert check.passed is right
    assert stretches(np.array([0, 1, 1, 0, 1], bool), np.arange(5.0)) == ((1.0, 2.0), (4.0, 4.0))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[case]]\nname = 'a'\nlog = 'run.csv'", "model is missing"),
        ("[[case]]\nname = 'a'\nlog = 'none.csv'\nmodel = 'servo.toml'", "none.csv is not there"),
        ("[[case]]\nname = 'a'\nlog = 'run.csv'\nmodel = 'no.toml'", "no.toml is not there"),
        ("[[case]]\nname = 'a'\nlog = 'run.csv'\nmodel = 'servo.toml'\ncolums = 'x'", "colums is not known"),
        ("title = 'x'", "has no [[case]]"),
        ("title = ", "is not valid TOML"),
    ],
)
def test_a_description_that_is_not_right_is_one_sentence(mine, capsys, text, said):
    (mine / "mine" / "cases.toml").write_text(text)
    assert main(["real", "--out", str(mine.parent / "out"), "--data", str(mine)]) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1


def test_folders_without_records_and_unknown_cases(mine, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    for data, said in ((tmp_path / "empty", "holds no records"), (tmp_path / "nowhere", "is not a folder")):
        assert main(["real", "--out", str(tmp_path / "out"), "--data", str(data)]) == 2
        assert said in capsys.readouterr().err
    assert main(["real", "--out", str(tmp_path / "out"), "--data", str(mine), "--only", "yours"]) == 2
    assert "there are mine" in capsys.readouterr().err


shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the public records are not here")


@shared
def test_the_public_records_are_known_and_their_documented_figures_are_asked():
    cases = {case.name: case for records in find_records(SHARED) for case in records.cases}
    assert set(cases) == {
        "emps-asymmetry", "emps-light-nominal", "emps-pulses", "pendulum-gravity", "pendulum-gravity-policy",
        "pendulum-payload",
    }  # fmt: skip
    assert cases["pendulum-gravity"].holdout == cases["pendulum-gravity-policy"].log
    assert all(isinstance(case.goal, Goal) and case.goal.verdict for case in cases.values())


@shared
def test_the_pulse_record_without_its_pulses(tmp_path):
    made = leave_out_pulses(SHARED / "emps" / "DATA_EMPS_PULSES.mat", tmp_path)
    assert len(made.hidden) > 3
    rows = np.genfromtxt(made.log, delimiter=",", names=True)
    import scipy.io

    raw = scipy.io.loadmat(SHARED / "emps" / "DATA_EMPS_PULSES.mat")
    inside = (rows["time"] >= made.hidden[0][0]) & (rows["time"] <= made.hidden[0][1])
    taken = float(raw["gtau"].item()) * raw["vir"].ravel() - rows["torque"]
    # 5 V pulses at 35.15 N/V; outside nothing is taken
    assert np.allclose(np.abs(taken[inside]), 5 * float(raw["gtau"].item()))
    outside = raw["pulses_N"].ravel() == 0
    assert np.abs(taken[outside]).max() < 1e-9
