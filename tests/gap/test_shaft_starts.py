"""A load that hangs in a gap or on a spring, found with the measured motion imposed; machines in plain numpy."""

from types import SimpleNamespace

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import diagnose, load_model
from fpjax.gap import EFFECTS
from fpjax.gap.effects.parameters import largest_gap
from fpjax.gap.fit import hidden_starts, imposed_motion
from fpjax.gap.fit.candidate import NOMINAL, Candidate, Start, held
from fpjax.gap.fit.hidden_starts import estimate_hidden_states, fit_hidden_states
from fpjax.gap.fit.imposed_motion import ImposedMotion, Objective
from fpjax.gap.fit.screen import from_bases
from fpjax.gap.fit.shaft_starts import BANDS
from fpjax.gap.select.starts import alone
from fpjax.gap.verb import make_search

GAP, LOAD = 0.02, 0.02  # rad, kg m^2 of the 0.05
# N m/rad, N m s/rad: a contact that rings at 50 Hz (J_r = 0.03 x 0.02 / 0.05), with a third of its critical damping.
STIFFNESS, DAMPING = 1200.0, 2.4
RUBBING = 0.15  # N m on the load, of 0.55
BY_NAME = {effect.name: effect for effect in EFFECTS}
TRUE = {
    "gap": GAP, "frequency": 50.3, "damping_ratio": 0.316, "load_share": LOAD / 0.05, "friction_share": RUBBING / 0.55,
    "viscous_share": 0.0, "load_side": 0.0, "inertia": 0.05, "coulomb": 0.55, "viscous": 0.03,
}  # fmt: skip
NAMES = ("backlash", "compliance", "constant_torque", "stribeck", "actuator_lag")


class Load:
    """Driven through the gap's faces; its torque on the motor."""

    def __init__(self, step, stiffness=STIFFNESS, damping=DAMPING):
        self.step, self.angle, self.speed = step, 0.0, 0.0
        self.stiffness, self.damping = stiffness, damping

    def __call__(self, time, speed, angle, command):
        beyond = angle - self.angle - np.clip(angle - self.angle, -0.5 * GAP, 0.5 * GAP)
        shaft = self.stiffness * beyond + self.damping * (speed - self.speed) if beyond else 0.0
        shaft = np.sign(beyond) * max(np.sign(beyond) * shaft, 0.0)
        self.speed += self.step * (shaft - RUBBING * np.tanh(self.speed / 0.02)) / LOAD
        self.angle += self.step * self.speed
        return -shaft


@pytest.fixture(scope="module")
def log():
    return numpy_machine.record(
        numpy_machine.Machine(inertia=0.03), seconds=5.0, extra=Load(1e-3 / 20),
        sensors=("velocity",),
    )  # fmt: skip


@pytest.fixture(scope="module")
def search(log):
    return gap_search.search_of(log)


@pytest.mark.long  # makes a search: 7 s
def test_the_motion_shows_the_gap_before_anything_is_fitted(search):
    first = search.setting.contacts[0]
    assert first["gap"] == pytest.approx(GAP, rel=0.05)
    assert first["load_share"] == pytest.approx(LOAD / 0.05, abs=0.05)
    assert first["friction_share"] == pytest.approx(RUBBING / 0.55, abs=0.05)
    assert first["load_side"] == 0.0
    starts = BY_NAME["backlash"].starts(search.setting)
    assert [start["gap"] for start in starts] == [start["gap"] for start in search.setting.contacts]


def test_of_a_long_log_the_part_is_looked_at_in_which_most_torque_is_missing():
    size, count = 500, 40
    starts = np.arange(count) * size
    record = SimpleNamespace(time=np.zeros(count * size), starts=starts, samples=size)
    course = 0.1 * np.random.default_rng(0).standard_normal(count * size)
    course[20 * size : 29 * size] *= 10.0
    course[23 * size : 25 * size] = np.nan  # withheld
    whole = ImposedMotion(None, 0, record, course, {}, {}, None).part
    assert (whole.start, whole.stop) in [(k * size, k * size + imposed_motion.BLOCK) for k in (20, 21)]
    short = SimpleNamespace(time=np.zeros(3000), starts=starts[:6], samples=size)
    assert ImposedMotion(None, 0, short, course[:3000], {}, {}, None).part == slice(0, 3000)


SPRING, ON_LOAD = 20.0, 0.35  # N m/rad: 5.17 Hz of the two halves; N m of dry friction, all of it on the load
OTHER = 0.02  # kg m^2 of each mass


class Carried:
    """A load on an undamped spring that rubs by itself: the motor has viscous friction alone, as under a voltage.

    `sensor` is "motor" for a log of the motor; else the log is of the load, and the motor is simulated here.
    """

    def __init__(self, step, sensor):
        self.step, self.sensor = step, sensor
        self.angle, self.speed = 0.0, 0.0

    def __call__(self, time, speed, angle, command):
        shaft = SPRING * (angle - self.angle)
        if self.sensor == "motor":
            moved = self.speed + self.step * shaft / OTHER
            lost = self.step * ON_LOAD / OTHER
            self.speed = np.copysign(max(abs(moved) - lost, 0.0), moved)
            self.angle += self.step * self.speed
            return -shaft
        self.speed += self.step * (command + shaft - 0.05 * self.speed) / OTHER
        self.angle += self.step * self.speed
        return -shaft - command


@pytest.fixture(scope="module", params=["motor", "load"])
def sprung(request):
    on_motor = request.param == "motor"
    machine = numpy_machine.Machine(
        inertia=OTHER, coulomb=0.0 if on_motor else ON_LOAD, viscous=0.05 if on_motor else 0.0, kp=0.0, ki=0.0
    )
    time = 1e-3 * np.arange(8000)
    push = 1.2 * np.sign(np.sin(2 * np.pi * 0.53 * time)) + 0.3 * np.sin(2 * np.pi * 1.7 * time)
    log = numpy_machine.record(
        machine, feedforward=push, reference=np.zeros(8000), extra=Carried(1e-3 / 20, request.param)
    )
    return request.param, log


SPRUNG = gap_search.MODEL.replace("0.05", str(2 * OTHER)).replace("0.4", str(ON_LOAD)).replace("0.03", "0.05")


@pytest.mark.long
def test_a_spring_whose_friction_is_divided_unevenly_is_found_from_either_side(sprung):
    _, log = sprung
    found = diagnose(log, SPRUNG, effects=tuple(e for e in EFFECTS if e.name in NAMES))
    assert found.verdict == "explained"
    assert found.causes[0] == "compliance"
    told = found.ranking[0].parameters
    assert told["frequency"].value == pytest.approx(np.sqrt(SPRING * 2 / OTHER) / (2 * np.pi), rel=0.02)
    assert told["stiffness"].value == pytest.approx(SPRING, rel=0.05)


@pytest.mark.long
def test_springs_are_looked_for_in_slices_of_resonances_on_either_side(sprung):
    side, log = sprung
    springs = gap_search.search_of(log, SPRUNG).setting.springs
    # One of each slice of resonances and side, none twice.
    assert len({(s["load_side"], s["frequency"], s["load_share"]) for s in springs}) == len(springs) >= 8
    for one in (0.0, 1.0):
        own = sorted(s["frequency"] for s in springs if s["load_side"] == one)
        assert own[-1] > 5.0 * own[0]
    assert [s["load_side"] for s in springs] == sorted(s["load_side"] for s in springs)
    if side == "motor":
        return  # an undamped load is met by chance: its rings must be met to some per cent
    frequency = np.sqrt(SPRING * 2 / OTHER) / (2 * np.pi)
    near = [s for s in springs if s["load_side"] == (side == "load") and abs(s["frequency"] / frequency - 1.0) < 0.2]
    assert any(abs(s["load_share"] - 0.5) < 0.25 for s in near)


@pytest.mark.long
@pytest.mark.parametrize("side", [0.0, 1.0])
def test_a_stiff_closed_shaft_leaves_nothing_beside_a_known_load(side):
    """The search compares with all that the nominal model has: a known load, and friction beside its numbers."""

    def weight(time, speed, angle, command):
        return -0.5 * np.sin(angle)

    log = numpy_machine.record(numpy_machine.Machine(viscous=0.13), extra=weight)
    model = gap_search.MODEL.replace("0.03", "0.13") + '[load]\ntype = "unbalance"\namplitude = 0.5\n'
    search = gap_search.search_of(log, model)
    backlash = BY_NAME["backlash"]
    states = search.hidden_states[search.family((backlash,)).key]
    numbers = {name: search.exact.values()[name] for name in NOMINAL}
    course = search.missing_course(search.exact, noisy=True)[0]
    objective = Objective(
        ImposedMotion(states, 0, search.records[0], course, numbers, numbers, search.setting), side, (0.03,)
    )
    weights = np.mean(objective._energies(objective.held[None])[0])
    closed = [1e-9 * search.setting.speed, 0.3, 150.0, 0.3, 0.3, 0.3, *numbers.values()]
    # One sum of squares in the logarithm: what is left of the friction's share and the load, of which little may be.
    (score,) = objective.scores(np.array([closed]).T)
    assert np.exp(score) - objective.floors[0] < 0.02 * weights


@pytest.mark.long
@pytest.mark.parametrize(("stiffness", "damping"), [(300.0, 0.8), (150.0, 0.8), (600.0, 1.0)])
def test_a_load_that_bounces_between_soft_faces_is_found(stiffness, damping):
    """From starts that are off by a tenth the fit ends where no gap is: an impact is some milliseconds early."""
    machine, load = numpy_machine.Machine(inertia=0.03), Load(1e-3 / 20, stiffness, damping)
    search = gap_search.search_of(numpy_machine.record(machine, seconds=5.0, extra=load, sensors=("velocity",)))
    backlash = BY_NAME["backlash"]
    found = search.explore([start for start in alone(search) if start.effects == (backlash,)])[0].candidate.values()
    reduced = 0.03 * LOAD / 0.05
    assert found["gap"] == pytest.approx(GAP, rel=0.03)
    assert found["load_share"] == pytest.approx(LOAD / 0.05, abs=0.01)
    assert found["frequency"] == pytest.approx(np.sqrt(stiffness / reduced) / (2 * np.pi), rel=0.05)
    assert found["damping_ratio"] == pytest.approx(damping / (2.0 * np.sqrt(stiffness * reduced)), rel=0.1)
    assert found["load_side"] == 0.0


@pytest.mark.long
def test_the_objective_is_least_for_the_true_load_and_knows_its_slope(search, monkeypatch):
    states = search.hidden_states[search.family((BY_NAME["backlash"],)).key]
    given = {name: search.exact.values()[name] for name in NOMINAL}
    course = search.missing_course(search.base, noisy=True)[0]
    imposed = ImposedMotion(states, 0, search.records[0], course, search.base.values(), given, search.setting)
    objective = Objective(imposed, 0.0, BANDS)
    reduced = 0.03 * LOAD / 0.05
    true = [GAP, LOAD / 0.05, np.sqrt(STIFFNESS / reduced) / (2 * np.pi), DAMPING / (2 * np.sqrt(STIFFNESS * reduced))]
    true = np.array([*true, RUBBING / 0.55, 0.02, 0.05, 0.55, 0.03])
    others = [np.where(np.arange(9) == k, f * true, true) for k in (0, 1, 4) for f in (0.5, 1.5)]  # not its damping
    light = [1e-3 * GAP, 0.95, 100.0, 0.3, 0.5, 0.5, 0.05, 0.55, 0.03]  # a light motor, whose torque has little noise
    none = [1e-3 * GAP, 0.05, 100.0, 0.3, 0.1, 0.1, 0.05, 0.55, 0.03]
    scores = objective.scores(np.array([true, light, none, *others]).T)
    assert np.argmin(scores) == 0
    assert scores[0] < min(scores[1:]) - 3.0
    at, small = true * [1.2, 1.1, 1.1, 1.2, 1.1, 1.0, 1.0, 1.0, 1.0], 1e-4
    monkeypatch.setattr(imposed_motion, "CHANGE", small)
    for used in (1, 3):
        score, gradient, matrix = objective.linearised(at[:, None], used)
        np.testing.assert_allclose(score, objective.scores(at[:, None], used))
        after = objective.scores(np.array([at * np.exp(small * (np.arange(9) == k)) for k in range(9)]).T, used)
        slope = (after - score) / small - small * np.diag(matrix[0])  # without its change over the step
        np.testing.assert_allclose(2.0 * gradient[0], slope, rtol=0.05, atol=0.03 * np.max(np.abs(slope)))
    assert np.all(np.linalg.eigvalsh(matrix[0]) > -1e-9 * np.trace(matrix[0]))


@pytest.mark.parametrize(("travel", "most"), [(0.01, 0.05), (1.0, 0.25), (1000.0, 0.5)])
def test_the_largest_gap_follows_the_travel_within_half_a_second_of_motion(travel, most):
    assert largest_gap(SimpleNamespace(travel=travel, speed=1.0)) == most


def test_without_the_effect_nobody_looks_for_contacts(log):
    others = tuple(effect for effect in EFFECTS if effect.name == "constant_torque")
    assert make_search([log], [], load_model(gap_search.MODEL), others).setting.contacts is None
    assert make_search([log], [], load_model(gap_search.MODEL), others).setting.springs is None


@pytest.mark.long
def test_a_load_that_rattles_is_told_as_backlash_with_its_gap(log):
    found = diagnose(log, gap_search.MODEL, effects=tuple(e for e in EFFECTS if e.name in NAMES))
    assert found.causes[0] == "backlash"
    assert found.verdict in ("explained", "partly_explained")
    gap = found.ranking[0].parameters["gap"]
    assert gap.value == pytest.approx(GAP, rel=0.05)


@pytest.mark.long
def test_a_further_cause_that_begins_badly_ends_no_worse_than_the_backlash_alone(search):
    backlash, stribeck = (BY_NAME[name] for name in ("backlash", "stribeck"))
    base = search.explore([start for start in alone(search) if start.effects == (backlash,)])[0].candidate
    begins = base.values() | {"gap": 3.0 * GAP, "load_share": 0.1, "stribeck_torque": 1.0}
    both = search.explore([Start((backlash, stribeck), NOMINAL, begins, base)], white=False)[0]
    assert both.candidate.cost < base.cost + 1.0
    assert both.candidate.values()["gap"] == pytest.approx(GAP, rel=0.05)


@pytest.mark.long
def test_a_cause_that_is_left_out_leaves_nothing_in_the_fit_without_it(search):
    backlash, offset = (BY_NAME[name] for name in ("backlash", "constant_torque"))
    both = search.candidate(Start((backlash, offset), NOMINAL, {"gap": GAP, "torque": 0.2, "load_side": 1.0}))
    one = search.candidate(Start((backlash,), NOMINAL, {}))
    known = both.known_to(one)
    assert {name: known[name] for name in ("gap", "load_side")} == {"gap": GAP, "load_side": 1.0}
    assert known["inertia"] == both.values()["inertia"]
    assert "torque" not in known
    assert one.known_to(both).keys() == known.keys()
    given = search.candidate(Start((backlash,), (), {}))
    assert both.known_to(given).keys() == known.keys() - set(NOMINAL)


@pytest.mark.long
def test_a_cause_is_tried_at_the_fit_beside_it_with_little_of_that_cause(search):
    backlash, stribeck, delay = (BY_NAME[name] for name in ("backlash", "stribeck", "actuator_delay"))
    base = search.candidate(Start((backlash,), NOMINAL, search.setting.contacts[0]))
    for effect in (stribeck, delay):
        own_starts = effect.starts(search.setting)
        starts = [Start((backlash, effect), NOMINAL, base.values() | own, base) for own in own_starts]
        candidates = [search.candidate(start) for start in starts]
        begun = {id(c): start for c, start in zip(candidates, starts, strict=True)}
        found = from_bases(search, candidates, begun)
        if effect is stribeck:  # a start for each of its shapes
            assert [c.values()["stribeck_velocity"] for c in found] == [s.values["stribeck_velocity"] for s in starts]
            for c, start in zip(found, starts, strict=True):
                assert 0.0 < c.values()["stribeck_torque"] < 0.2 * start.values["stribeck_torque"]
        else:  # starts that differ in nothing but the delay begin alike without it
            (only,) = found
            assert only.values() == base.values() | {"actuator_delay": 0.0}
        assert all(c.known_to(base) == base.known_to(c) for c in found)
        assert from_bases(search, candidates[:1], begun)[0].values() == found[0].values()
    rigid = [Start((stribeck,), NOMINAL, {}, search.candidate(Start((), NOMINAL, {})))]
    candidates = [search.candidate(start) for start in rigid]
    assert from_bases(search, candidates, {id(candidates[0]): rigid[0]}) == []


@pytest.mark.long
def test_a_window_at_a_wrong_speed_is_begun_afresh_where_that_is_asked_for(search):
    c = search.candidate(Start((BY_NAME["backlash"],), NOMINAL, search.setting.contacts[0]))
    key, window = c.family.key, search.train[0][3]
    c.states[0][0, window] = 40.0 * search.fitters[key].deviations(c, 0)[0]
    for afresh in (False, True):
        estimate_hidden_states(
            search.fitters[key], search.hidden_states[key], search.records, [c], search.train, afresh=afresh
        )
        assert bool(c.states[0][0, window] == 0.0) is afresh


@pytest.mark.long
def test_a_load_that_rests_within_its_gap_as_the_log_begins_is_found_there(search):
    """Away from both faces: from either of them the whole first window is simulated wrong."""
    c = search.candidate(Start((BY_NAME["backlash"],), NOMINAL, TRUE))
    (first,) = np.flatnonzero(search.records[0].starts[search.train[0]] == 0)
    c.hidden[0][0] = 0.5 * GAP
    estimate_hidden_states(
        search.fitters[c.family.key], search.hidden_states[c.family.key], search.records, [c], search.train
    )
    twist, rate = c.hidden[0][:, search.train[0][first]]
    assert abs(twist) < 0.3 * 0.5 * GAP
    assert rate == 0.0
    others = np.delete(search.train[0], first)
    assert np.all(np.abs(c.hidden[0][0, others]) > 0.5 * 0.5 * GAP)  # driven to and fro: the load lies at a face


def test_of_several_start_states_the_one_is_kept_that_fits_best_after_some_steps(monkeypatch):
    """Not the one that fits best before them; in each window its own, and what was there where none is better."""
    record, begun = SimpleNamespace(starts=np.array([0, 5, 10]), samples=5), {}
    # (cost before, cost after the steps) of the present states and of two others, by window.
    ends = {0.0: [(9, 9), (9, 9), (1, 1)], 1.0: [(2, 8), (8, 2), (5, 5)], 2.0: [(7, 3), (3, 7), (np.inf, 0)]}

    def costs(fitter, candidates, which, chosen):
        found = []
        for c in candidates:
            hidden = c.hidden[which][0, chosen]
            found.append(
                np.array([ends[at][w][w in begun.get(id(c), ())] for at, w in zip(hidden, chosen, strict=True)], float)
            )
        return found

    def go_on(candidates, windows, steps, **words):
        assert steps == 4
        begun.update({id(c): set(windows[0]) for c in candidates})
        kept.extend(candidates)  # else another may get the address of one

    kept = []
    monkeypatch.setattr(hidden_starts, "_costs", costs)
    monkeypatch.setattr(hidden_starts, "_options", lambda *arguments: [
        (arguments[-1], [[np.array([[at] * 3, [0.0] * 3])] for at in (1.0, 2.0)])
    ])  # fmt: skip
    c = candidate_of_windows(3)
    hidden_starts.fit_hidden_states(SimpleNamespace(go_on=go_on), None, [record], [c], [np.arange(3)], 4)
    assert c.hidden[0][0].tolist() == [2.0, 1.0, 0.0]


def candidate_of_windows(count):
    """A candidate of nothing, with the start states of some windows."""
    none = np.zeros(0)
    family = SimpleNamespace(parameters=())
    return Candidate(
        (), frozenset(), family, none, np.zeros(0, int), none, none, none, none, none, none, [np.zeros((4, count))],
        [np.zeros((2, count))],
    )  # fmt: skip


@pytest.mark.long
def test_start_states_are_fitted_from_all_that_they_may_be_and_the_best_is_kept(search):
    effects = (BY_NAME["backlash"],)
    key = search.family(effects).key
    fitter, hidden = search.fitters[key], search.hidden_states[key]
    chosen = search.train[0]

    def costs(c):
        (out,) = fitter.coefficients([c], 0, chosen)
        return fitter.window_costs(c, 0, chosen, out) + fitter.state_prior(c, 0, chosen)

    right = search.candidate(Start(effects, NOMINAL, TRUE))
    search.go_on([right], search.train, 6, white=False)
    best, wrong = held(right), held(right)
    # Each window at the face where the load is not; its rate and angle stay.
    wrong.hidden[0][0] = -np.copysign(0.5 * GAP, right.hidden[0][0])
    wrong.states[0][2:] = 0.0
    before = costs(wrong)
    assert np.sum(before) > np.sum(costs(right)) + 1000.0
    vector = wrong.vector.copy()
    for c in (wrong, best):
        fit_hidden_states(fitter, hidden, search.records, [c], search.train, 4)
    assert np.all(costs(wrong) <= before)
    # From the wrong faces as well as from the right ones, and never worse than what was there.
    assert np.all(costs(best) <= costs(right) + 1e-6)
    assert np.sum(costs(wrong)) < np.sum(costs(right)) + 20.0
    np.testing.assert_array_equal(wrong.vector, vector)
