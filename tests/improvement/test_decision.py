"""When new gains are proposed, what a search minimises, and what acts on the machines."""

import dataclasses

import improve_case as case
import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp
from fpjax import Motion
from fpjax.gap import Learned
from fpjax.gap.machine import NO_LIMIT
from fpjax.improvement.decision import hopeless, objection, plausible, running, told_apart, too_large
from fpjax.improvement.judge import Score
from fpjax.improvement.machines import (
    Machines,
    Missing,
    draw_shares,
    nominal_machines,
    opposing,
    records_of,
    surrogate,
    with_laws,
)
from fpjax.improvement.margins import _unlimited
from fpjax.improvement.search import AllowedScore, robust_costs

# --- the decision


def score(errors, rough=1.0):
    errors = np.asarray(errors, float)
    same = np.ones_like(errors)
    return Score(errors, errors, same, same, rough * same)


MARGINS = {"modulus": np.full(4, 0.7)}


@pytest.mark.parametrize(
    ("new", "margins", "words"),
    [
        (score([0.5] * 17 + [1.1] * 3), MARGINS, "needs 95%"),
        (score([0.99] * 20), MARGINS, "needs 2%"),
        (score([0.5] * 19 + [np.inf]), MARGINS, "unstable"),
        (score([0.5] * 20), {"modulus": np.full(4, 0.3)}, "modulus margin"),
        (score([0.5] * 20, rough=3.0), MARGINS, "rough"),
        (score([0.5] * 20), MARGINS, ""),
    ],
)
def test_gains_are_proposed_only_where_nothing_speaks_against_them(new, margins, words):
    said = objection(score([1.0] * 20), new, MARGINS, margins)
    assert words in said
    assert bool(said) == bool(words)


def test_a_torque_above_the_allowed_one_is_said_with_both():
    asked = score([0.5] * 4)  # a largest torque of 1
    assert "1 N m, 25.0% above the allowed 0.8 N m" in too_large(asked, 0.8, "N m")
    assert not too_large(asked, 1.0, "N m")
    assert not too_large(asked, 0.99, "N m", 1.02)
    assert not too_large(asked, np.inf, "N m")


def test_a_loop_that_only_its_limit_holds_is_never_proposed():
    unstable = {"modulus": np.zeros(4)}
    assert "only its torque limit holds" in objection(score([1.0] * 20), score([0.5] * 20), unstable, unstable)
    assert objection(score([1.0] * 20), score([0.5] * 20), unstable, MARGINS) == ""


def test_margins_are_those_of_the_loop_within_its_limits():
    body = fp.OneMass(0.3, fp.CoulombViscous(1.0, 0.2))
    limits = fp.ClosedLoop(body, fp.ProportionalIntegral(4.0, 40.0, limit=2.0), actuator=fp.Actuator(limit=3.0))
    free = _unlimited(limits)
    assert float(free.controller.limit) == float(free.actuator.limit) == NO_LIMIT
    assert float(free.controller.kp) == 4.0


@pytest.mark.parametrize(
    ("errors", "decision"),
    [
        ([np.inf, *[1.0] * 19], "unstable"),
        ([1.0] * 15 + [np.inf] * 5, "cannot_promise"),
        (np.geomspace(0.1, 1.0, 20), "cannot_promise"),
        (np.linspace(0.9, 1.1, 20), None),
    ],
)
def test_nothing_is_promised_of_a_machine_that_may_be_anything(errors, decision):
    found, reason = hopeless(score(errors))
    assert found == decision
    assert bool(reason) == (decision is not None)


@pytest.mark.parametrize(
    ("errors", "measured", "kept"),
    [
        ([1.0, 1.1, np.inf, 0.9], None, [True, True, False, True]),  # the machine that made the log was stable
        ([1.0, 1.1, 0.3, 2.3], 1.0, [True, True, False, False]),  # and followed as the log shows
        ([1.0, 1.1, 0.3, 2.3], None, [True] * 4),
        ([1.0, np.inf, np.inf, np.inf], 1.0, [True] * 4),  # the posterior is what is wrong
        ([np.inf, 1.0, 1.0, 1.0], 1.0, [True] * 4),  # the fit itself: said by `hopeless`
        ([3.0, 3.1, 3.2, 3.0], 1.0, [True] * 4),  # the fit itself is off: the interval says it
    ],
)
def test_a_machine_that_cannot_have_made_the_log_is_left_out(errors, measured, kept):
    assert plausible(score(errors), measured).tolist() == kept


def test_machines_that_cannot_run_are_left_out_where_most_errors_are_off():
    """Most follow otherwise than the log shows: then the error is not asked, but an unstable one still did not run."""
    errors = [1.0, 3.0, 3.0, 3.0, np.inf]
    assert plausible(score(errors), 1.0).tolist() == [True, True, True, True, False]


@pytest.mark.parametrize(
    ("errors", "kept"),
    [
        ([1.0] * 19 + [np.inf], [True] * 19 + [False]),
        ([1.0] * 15 + [np.inf] * 5, [True] * 20),  # too little is known: said by `hopeless`
        ([np.inf, *[1.0] * 19], [True] * 20),
        ([1.0] * 10 + [9.0] * 10, [True] * 20),
    ],
)
def test_a_machine_that_runs_is_stable(errors, kept):
    assert running(score(errors)).tolist() == kept


def test_gains_stand_before_those_of_the_nominal_model_for_what_a_change_is_worth():
    nominal = np.ones(9)
    assert told_apart(np.full(9, 0.9), nominal)
    assert not told_apart(np.full(9, 0.99), nominal)
    assert not told_apart(np.full(9, 1.1), nominal)


def test_machines_are_left_out_of_every_explanation():
    rival = Machines(nominal_machines(case.model(), 3).machine, np.arange(9.0).reshape(3, 3))
    every = dataclasses.replace(nominal_machines(case.model(), 4), others=(rival, rival))
    some = every.only(np.array([1, 0, 1, 1, 0, 1, 0, 0, 0, 0], bool))
    assert [len(part.shares) for part in some.parts] == [3, 1]
    assert some.parts[1].shares.tolist() == [[3.0, 4.0, 5.0]]
    assert np.shape(some.machine.plant.inertia) == (3,)


def test_the_cost_is_the_mean_and_the_spread_and_fines_what_a_motor_would_feel():
    limits = AllowedScore(error=1.0, rough=1.0, peak=2.0)
    even, uneven = score([[1.0, 1.0, 1.0, 1.0]]), score([[0.5, 0.5, 1.5, 1.5]])
    assert robust_costs(even, limits)[0] == pytest.approx(1.0)
    assert robust_costs(uneven, limits)[0] == pytest.approx(1.0 + 1.28 * 0.5)
    assert robust_costs(score([[0.5] * 4], rough=4.0), limits)[0] > 10.0
    assert robust_costs(score([[0.5, 0.5, 0.5, np.inf]]), limits)[0] > 100.0


# --- what acts on the machines


def test_the_missing_torque_drives_at_its_time():
    tables = np.array([[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]])
    load = Missing(jnp.asarray(tables), jnp.asarray([1.0, 0.1]), jnp.asarray(0.5))
    motion = Motion(jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(0.6))
    assert float(load.readout(motion)) == pytest.approx(-(2.0 + 2.0))  # a load: it opposes what drives


def test_a_samples_missing_torque_keeps_its_size_and_colour():
    course = np.random.default_rng(1).standard_normal(4000).cumsum()
    course -= course.mean()
    other = surrogate(course, 3)
    assert np.std(other) == pytest.approx(np.std(course), rel=1e-6)
    assert abs(np.corrcoef(course, other)[0, 1]) < 0.9
    assert np.abs(np.fft.rfft(other))[1:-1] == pytest.approx(np.abs(np.fft.rfft(course))[1:-1], rel=1e-6, abs=1e-6)
    shares = draw_shares(50, 0)
    assert shares[0] == pytest.approx([1.0, 0.0, 0.0])
    assert np.linalg.norm(shares, axis=1) == pytest.approx(np.ones(50))


def test_a_learned_law_is_in_the_machines_its_jump_as_coulomb_friction():
    law = Learned("velocity", 0.5, (-5.0, 0.0, 0.0, 5.0), (-0.3, -0.1, 0.1, 0.3), (0.0,) * 4, (0.0,) * 4)
    record = dataclasses.make_dataclass("Record", ["speed", "elapsed", "angle", "torque"])(
        np.array([-2.5, 2.5]), *np.zeros((3, 2))
    )
    assert opposing(law, record) == pytest.approx([-0.2, 0.2])
    machine = case.known().posterior.machines(case.model(), records_of(case.log(), case.model()), 3)
    changed = with_laws(machine, (law,), 3)
    assert np.asarray(changed.law.coulomb) == pytest.approx(np.asarray(machine.law.coulomb) + 0.1)
