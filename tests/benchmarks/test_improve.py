"""The withheld check of improve: its scores, and the truth in closed loop with given gains."""

import math

import numpy as np
import pytest

from benchmarks.improve.score import goals, held, share_won, table, worse


def row(nominal=1.0, ours=0.5, best=0.4, now=1.2, promised=(0.4, 0.6), **more):
    usual = {"effects": ["stribeck"], "sensors": "both", "set": "single", "decision": "change", "verdict": "explained"}
    errors = {"error_now": now, "error_nominal": nominal, "error_improve": ours, "error_truth": best}
    return usual | errors | {"promised": list(promised)} | more


def test_the_share_is_of_what_the_truth_itself_could_win():
    assert share_won(row()) == pytest.approx(0.5 / 0.6)
    assert share_won(row(ours=1.1)) == pytest.approx(-0.1 / 0.6)
    assert share_won(row(best=0.99)) is None
    assert share_won(row(nominal=math.inf)) == 1.0


def test_worse_and_held_are_counted_as_the_goals_say():
    assert not worse(row(ours=1.015))
    assert worse(row(ours=1.03))
    assert held(row())
    assert not held(row(ours=0.7))
    assert held(row(promised=(None, None))) is None


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
    from benchmarks.withheld.identity import identities

    identity = next(one for one in identities(0, 1) if one.set == "none" and one.sensors in ("rate", "both"))
    true = build(identity, 2001)
    soft = true.now | {"controller.kp": 0.5 * true.now["controller.kp"]}
    forward = true.now | {
        "feedforward.coulomb": true.case.machine.physics["coulomb_positive"],
        "feedforward.viscous": true.case.machine.physics["viscous_positive"],
        "feedforward.inertia": true.case.machine.physics["inertia"],
    }
    now, slow, ahead = run([(true, gains) for gains in (true.now, soft, forward)], substeps=8, seconds=0.6)
    assert error(slow) > error(now)
    assert error(ahead) <= error(now)
    assert np.isfinite(rough(now))
    assert len(now.time) == 600
