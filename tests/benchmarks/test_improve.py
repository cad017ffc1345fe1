"""The withheld check of improve: its scores, and the truth in closed loop with given gains."""

import argparse
import json
import math
import types

import numpy as np
import pytest

import fpjax as fp
from benchmarks.improve.command import VERSION, cases_wanted
from benchmarks.improve.command import run as run_check
from benchmarks.improve.score import goals, held, share_won, table, worse
from benchmarks.withheld.identity import identities


def row(nominal=1.0, ours=0.5, best=0.4, now=1.2, promised=(0.4, 0.6), **more):
    usual = {"effects": ["stribeck"], "sensors": "both", "set": "single", "decision": "change", "verdict": "explained"}
    errors = {"error_now": now, "error_nominal": nominal, "error_improve": ours, "error_truth": best}
    return usual | errors | {"promised": list(promised)} | more


def test_the_share_is_of_what_the_truth_itself_could_win():
    assert share_won(row()) == pytest.approx(0.5 / 0.6)
    assert share_won(row(ours=1.1)) == pytest.approx(-0.1 / 0.6)
    assert share_won(row(best=0.99)) is None
    assert share_won(row(best=None)) is None
    assert share_won(row(nominal=math.inf)) == 1.0


def test_worse_and_held_are_counted_as_the_goals_say():
    assert not worse(row(ours=1.015))
    assert worse(row(ours=1.03))
    assert held(row())
    assert not held(row(ours=0.7))
    assert held(row(promised=(None, None))) is None


def test_gains_that_ask_for_more_torque_than_improve_allows_are_counted_apart():
    over, within = ({"nominal": {"roughness": 0.5, "peak": peak}} for peak in (1.3, 0.8))
    rows = [row(ours=1.5, of_allowed=over), row(ours=0.9, of_allowed=within), row()]
    found = {goal: (have, met) for goal, _, have, met in goals(rows)}
    assert found["worse than the nominal gains by over 2 %"] == ("1 of 3", "not met")
    assert found["of these, against gains that keep improve's limits of torque"] == ("0 of 1", "met")


def test_a_worse_machine_counts_apart_where_improve_said_what_speaks_against_the_other_gains():
    better, worse_there = ({"objection": "need more torque", "ratio": {"value": value}} for value in (0.9, 1.1))
    plain = {"objection": "", "ratio": {"value": 0.9}}
    rows = [row(ours=1.5, told=told) for told in (better, worse_there, plain, None)]
    found = {goal: (have, met) for goal, _, have, met in goals(rows)}
    assert found["of these, and improve did not say what speaks against them"] == ("3 of 4", "not met")


def test_the_goals_are_met_only_where_they_are():
    good = [row(ours=0.41, promised=(0.4, 0.6)) for _ in range(9)] + [row(ours=0.41, promised=(0.5, 0.6))]
    words = {goal: met for goal, _, _, met in goals(good)}
    assert words["share of what is possible, median"] == "met"
    assert words["truth within the promised 90 % interval"] == "met"
    assert words["unexplained logs worse than with the gains that ran"] == "not measured"
    bad = [*good, row(ours=1.5, verdict="unexplained")]
    words = {goal: met for goal, _, _, met in goals(bad)}
    assert words["worse than the nominal gains by over 2 %"] == "not met"
    assert words["unexplained logs worse than with the gains that ran"] == "not met"
    (one,) = table(bad, lambda each: each["sensors"])
    assert one["machines"] == 11


def test_the_truth_runs_with_the_gains_that_it_is_given():
    from benchmarks.improve.machines import build, error, rough, run

    true = build(some_identity(1), 2001)
    physics = true.case.case.machine.physics
    soft = true.now | {"controller.kp": 0.5 * true.now["controller.kp"]}
    forward = true.now | {
        "feedforward.coulomb": physics["coulomb_positive"],
        "feedforward.viscous": physics["viscous_positive"],
        "feedforward.inertia": physics["inertia"],
    }
    now, slow, ahead = run([(true, gains) for gains in (true.now, soft, forward)], substeps=8, seconds=0.6)
    assert error(slow) > error(now)
    assert error(ahead) <= error(now)
    assert np.isfinite(rough(now))
    assert len(now.time) == 600


def some_identity(generator):
    return next(one for one in identities(0, generator) if one.set == "none" and one.sensors in ("rate", "both"))


@pytest.mark.parametrize("generator", [1, 2])
def test_the_true_drive_runs_the_law_of_the_file(generator):
    """Its torque is that of our `Feedforward`, sample by sample: the difference to the sample that follows."""
    from benchmarks.improve.machines import build, run

    true = build(some_identity(generator), 601)
    gains = dict.fromkeys(true.now, 0.0) | {"feedforward.inertia": 1.0}
    (record,) = run([(true, gains)], substeps=4)
    expected = np.diff(record.reference) / float(record.time[1] - record.time[0])
    commanded = getattr(record, "command", record.torque)[:-1]
    rounding = true.case.case.world.values["torque_step"] if generator == 2 else 1e-9
    limit = true.case.case.world.values["rating"] if generator == 2 else np.inf
    assert commanded == pytest.approx(np.clip(expected, -limit, limit), abs=rounding)


def test_machines_of_the_second_generator_run_with_other_gains_too(tmp_path):
    from benchmarks.improve.machines import build, error, run, settled, write

    identity = some_identity(2)
    (drawn,) = settled([identity], 601)
    true = build(identity, 601, drawn)
    assert true.now["controller.kp"] > 0.0
    soft = true.now | {"controller.kp": 0.5 * true.now["controller.kp"]}
    now, slow = run([(true, gains) for gains in (true.now, soft)], substeps=6)
    assert error(slow) > error(now)
    write(tmp_path, true, now)
    model = fp.load_model(tmp_path / "servo.toml")
    assert model.limits["torque"] == pytest.approx(true.rating)
    assert model.bounds["controller.kp"] == pytest.approx(true.bounds["controller.kp"], rel=1e-6)
    assert fp.read_log(tmp_path / "log.csv", linear=model.linear or None).reference is not None


@pytest.mark.parametrize("generator", ["1", "2", "both"])
def test_what_is_asked_has_a_controller_that_is_known(generator):
    asked = argparse.Namespace(half="development", seeds=1, skip=0, generator=generator, machines=12)
    wanted = cases_wanted(asked)
    assert len(set(wanted)) == 12
    assert {one.truth for one in wanted} == ({1, 2} if generator == "both" else {int(generator)})
    assert all(one.sensors in ("rate", "both") for one in wanted if one.truth == 2)


def test_an_interrupted_check_goes_on_where_it_stopped(tmp_path, monkeypatch, capsys):
    """What is on disk is not done again; without the best gains the share of what is possible is not measured."""
    asked = argparse.Namespace(
        half="development", seeds=1, skip=0, generator="1", machines=2, periods=2001, out=tmp_path, no_best=True,
        score_only=False,
    )  # fmt: skip
    side = {"gains": {"controller.kp": 1.0}, "error": {"low": 0.4, "high": 0.6}}
    said = {"decision": "change", "verdict": "explained", "reason": "", "after": side}
    for one in cases_wanted(asked):
        own = tmp_path / one.name
        (own / "improve").mkdir(parents=True)
        for name, content in (
            ("made.json", {"version": VERSION, "now": {"controller.kp": 2.0}}),
            ("nominal.json", {"gains": {"controller.kp": 1.5}}),
            ("improve/improve.json", said), ("cost.json", {"processor_s": 1.0}),
            ("driven.json", {"now": 1.2, "nominal": None, "improve": 0.5}),  # the nominal gains are unstable
        ):  # fmt: skip
            (own / name).write_text(json.dumps(content))
    assert run_check(asked) == 0
    told = capsys.readouterr().out
    assert "2 of 2 machines" in told
    assert "not measured" in told
    assert json.loads((tmp_path / "improve.json").read_text())["machines"] == 2
    old = tmp_path / cases_wanted(asked)[0].name / "made.json"
    old.write_text(json.dumps({"version": VERSION - 1}))
    with pytest.raises(fp.InputError, match="earlier version"):
        run_check(asked)


def test_torque_is_allowed_up_to_the_drives_rating_where_the_file_tells_it():
    from benchmarks.improve.machines import shares_of_allowed

    clock = np.arange(3000) * 1e-3
    now, more = (types.SimpleNamespace(time=clock, torque=size * np.sin(20.0 * clock)) for size in (1.0, 2.0))
    assert shares_of_allowed(more, now, None)["peak"] == pytest.approx(2.0 / 1.25, rel=1e-3)
    assert shares_of_allowed(more, now, 8.0)["peak"] == pytest.approx(0.25, rel=1e-3)
    more.torque[5] = np.nan
    assert shares_of_allowed(more, now, 8.0)["roughness"] == math.inf


def test_what_is_expected_of_unexplained_logs_is_no_promise():
    rows = [row(promised=(0.4, 0.6)) for _ in range(9)] + [row(promised=(0.6, 0.7))]
    rows += [row(promised=(0.6, 0.7), verdict="unexplained") for _ in range(5)]
    found = {goal: (have, met) for goal, _, have, met in goals(rows)}
    assert found["truth within the promised 90 % interval"] == ("90%", "met")
    assert found["... within what is expected of unexplained logs, not promised"] == ("0%", "no goal")
