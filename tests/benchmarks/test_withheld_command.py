"""The options of `benchmarks withheld`: which cases are meant, how a few are spread, what is written for whom."""

import json
from collections import Counter

import pytest

from benchmarks.__main__ import main
from benchmarks.withheld import judge
from benchmarks.withheld.export import answer_of, write_collection
from benchmarks.withheld.identity import SENSORS, SETS, SYSTEMS, identities, spread_over


def default(seed: int = 1):
    return [one for truth in (1, 2) for one in identities(seed, truth)]


def test_all_sets_and_sensors_of_both_truths_are_there_by_default():
    found = default()
    for truth in (1, 2):
        some = [one for one in found if one.truth == truth]
        assert {one.set for one in some} == set(SETS) - ({"recorded"} if truth == 1 else set())
        assert {one.sensors for one in some} == set(SENSORS)
    assert {one.system for one in found} == set(SYSTEMS)
    assert len({one.name for one in found}) == len(found)
    assert default() == found


@pytest.mark.parametrize("limit", [3, 8, 24, 60])
def test_a_limit_spreads_over_effects_machines_sets_sensors_and_truths(limit):
    chosen = spread_over(default(), limit)
    assert len(chosen) == limit
    for name in ("truth", "set", "sensors", "system"):
        counts = Counter(getattr(one, name) for one in chosen)
        possible = len({getattr(one, name) for one in default()})
        assert len(counts) >= min(possible, limit) - 2, (name, counts)
    effects = Counter(effect for one in chosen for effect in one.effects)
    assert max(effects.values()) <= 1 + limit // 24
    assert spread_over(default(), 10**6) == default()
    # the first of a sample are a sample too: an interrupted run says something of every row
    assert chosen == spread_over(default(), 90)[:limit]


@pytest.mark.parametrize(("truth", "seed", "limit"), [(2, 1, 60), (1, 7, 40)])
def test_sixty_logs_say_something_of_every_row_of_the_goals(truth, seed, limit):
    found = identities(seed, truth)
    chosen = spread_over(found, limit)
    counts = Counter(one.group for one in chosen)
    assert set(counts) == {one.group for one in found}
    assert max(counts.values()) <= 6
    effects = Counter(effect for one in chosen for effect in one.effects)
    assert set(effects) >= {effect for one in found for effect in one.effects if one.set == "single"}
    # nine ways of recording for seven or eight such logs
    assert len({one.recording for one in found} - {one.recording for one in chosen}) <= 2


def test_a_limit_of_three_is_not_three_errors_of_one_kind(tmp_path, capsys, monkeypatch):
    seen = []
    monkeypatch.setattr("benchmarks.withheld.command.generate", lambda folder, wanted, *_: seen.extend(wanted) or 0)
    monkeypatch.setattr("benchmarks.withheld.command.read_labels", lambda *_: [])
    monkeypatch.setattr(judge, "diagnose_all", lambda *_, **__: None)
    assert main(["withheld", "--out", str(tmp_path), "--limit", "3"]) == 0
    assert len({one.effects for one in seen}) == 3
    assert len({one.system for one in seen}) == 3
    assert len({one.set for one in seen}) == 3
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--sets", "singles"], "'singles' is not one of single"),
        (["--sensors", "gyro"], "'gyro' is not one of rate"),
        (["--truth", "3"], "'3' is not one of 1, 2"),
        (["--seeds", "0"], "--seeds must be at least 1, got 0"),
        (["--seeds", "3", "4"], "4 is not of the reported half"),
        (["--seed", "4"], "--seed: 4 is not of the reported half"),
        (["--seed", "3", "--seeds", "2"], "drop --seeds and --skip"),
        (["--limit", "0"], "--limit must be at least 1, got 0"),
        (["--minutes", "0"], "--minutes must be positive, got 0"),
        (["--sets", "single", "--sensors", "encoder", "--systems", "hobby", "--truth", "1"], "no case has"),
        (["--answers", "a.json"], "--answers goes with --write"),
    ],
)
def test_bad_options_are_one_sentence(tmp_path, capsys, words, said):
    assert main(["withheld", "--out", str(tmp_path), *words]) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1


def test_the_seeds_that_are_meant_are_printed(tmp_path, capsys, monkeypatch):
    """A number of seeds was read as a seed: 40 cases of "seed 13" were those of thirteen seeds, many met before."""
    monkeypatch.setattr("benchmarks.withheld.command.generate", lambda *_: 0)
    monkeypatch.setattr("benchmarks.withheld.command.read_labels", lambda *_: [])
    monkeypatch.setattr(judge, "score_all", lambda *_: None)
    for words, said in ((["--seed", "13"], "of seed 13\n"), (["--seeds", "2"], "of seeds 1, 3\n")):
        assert main(["withheld", "--out", str(tmp_path), "--score-only", *words]) == 0
        assert said in capsys.readouterr().out


def test_a_collection_keeps_the_reported_halfs_answers_apart(tmp_path, capsys):
    both = [one for one in identities(0, 2) if one.set == "none"][:1] + [
        one for one in identities(1, 2) if one.set == "outside"
    ][:1]
    assert main(["withheld", "--write", str(tmp_path / "x"), "--limit", "1"]) == 2
    assert "--answers FILE" in capsys.readouterr().err
    write_collection(tmp_path / "made", both, tmp_path / "answers.json", periods=200)
    development, reported = (tmp_path / "made" / one.name for one in both)
    assert sorted(p.name for p in development.iterdir()) == ["answer.json", "log.csv", "servo.toml"]
    assert sorted(p.name for p in reported.iterdir()) == ["log.csv", "servo.toml"]
    assert sorted(p.name for p in (tmp_path / "made").iterdir()) == sorted(one.name for one in both)
    assert json.loads((development / "answer.json").read_text())["effects"] == []
    apart = json.loads((tmp_path / "answers.json").read_text())
    assert list(apart) == [both[1].name]
    assert apart[both[1].name]["outside"] == both[1].effects[0]


def test_an_answer_tells_no_law():
    label = {"effects": ["stribeck"], "laws": {"stribeck": "secret"}, "other_form": ["stribeck"], "sizes": {}}
    assert answer_of(label) == {"effects": ["stribeck"]}


def test_a_quick_run_says_that_it_judges_nothing(tmp_path, capsys, monkeypatch):
    asked = []

    def tool(log, model, out):
        asked.append(log)
        out.mkdir()
        (out / "diagnosis.json").write_text('{"verdict": "no_gap", "causes": [], "ranking": []}')

    monkeypatch.setattr(judge.diagnose_all, "__defaults__", (tool, None))
    monkeypatch.setattr("benchmarks.withheld.command.QUICK", (2, 200))
    words = ["withheld", "--out", str(tmp_path), "--quick", "--truth", "2", "--sets", "none,outside"]
    assert main(words) == 0
    assert len(asked) == 2
    assert "judges nothing" in capsys.readouterr().out.splitlines()[-1]
    # what is there is not diagnosed again
    assert main(words) == 0
    assert len(asked) == 2
    capsys.readouterr()
