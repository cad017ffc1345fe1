"""A load that hangs in a gap and rattles, found from a log of the motor; the machine is written in plain numpy."""

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import diagnose, load_model
from fpjax.gap import EFFECTS
from fpjax.gap.fit.candidate import NOMINAL, Start
from fpjax.gap.fit.hidden_starts import estimate_hidden_states
from fpjax.gap.fit.screen import from_bases
from fpjax.gap.select.starts import alone
from fpjax.gap.verb import make_search

GAP, LOAD = 0.02, 0.02  # rad, kg m^2 of the 0.05
# N m/rad, N m s/rad: a contact that rings at 50 Hz (J_r = 0.03 x 0.02 / 0.05), with a third of its critical damping.
STIFFNESS, DAMPING = 1200.0, 2.4
RUBBING = 0.15  # N m on the load, of 0.55
BY_NAME = {effect.name: effect for effect in EFFECTS}
NAMES = ("backlash", "compliance", "constant_torque", "stribeck", "actuator_lag")


class Load:
    """Driven through the gap's faces; its torque on the motor."""

    def __init__(self, step):
        self.step, self.angle, self.speed = step, 0.0, 0.0

    def __call__(self, time, speed, angle, command):
        beyond = angle - self.angle - np.clip(angle - self.angle, -0.5 * GAP, 0.5 * GAP)
        shaft = STIFFNESS * beyond + DAMPING * (speed - self.speed) if beyond else 0.0
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
    assert first["gap"] == pytest.approx(GAP, rel=0.25)
    assert first["load_share"] == pytest.approx(LOAD / 0.05, abs=0.2)
    starts = BY_NAME["backlash"].starts(search.setting)
    assert [start["gap"] for start in starts] == [start["gap"] for start in search.setting.contacts]


def test_without_the_effect_nobody_looks_for_contacts(log):
    others = tuple(effect for effect in EFFECTS if effect.name == "constant_torque")
    assert make_search([log], [], load_model(gap_search.MODEL), others).setting.contacts is None


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
