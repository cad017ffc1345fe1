"""Screening: which starts go on after one step, and which windows they are tried on."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from gap_search import search_of
from numpy_machine import record

from fpjax.gap.fit.candidate import NOMINAL, Start
from fpjax.gap.fit.screen import COARSE_STEPS, LEAST, MODES, SETS, STEPS, screened

COGGING = SimpleNamespace(parameters=(SimpleNamespace(name="periods"),), fixed=(SimpleNamespace(name="side"),))


class Search:
    """Counts steps; every step leaves a candidate's cost at what it was given."""

    def __init__(self):
        self.asked, self.coarse, self.ticks = [], [], []

    def screening(self):
        return ["windows"]

    def go_on(self, candidates, windows, steps, *, white, modes=0):
        assert windows == ["windows"]
        if modes:
            assert all(len(c.level) == 0 for c in candidates)  # a level is one of these octaves
            for c in candidates:
                c.level = np.ones(modes)
            self.coarse.append(([c.place for c in candidates], steps, modes))
        else:
            self.asked.append(([c.place for c in candidates], steps))

    def tick(self, share):
        self.ticks.append(share)


def candidate(place, cost, name="cogging", periods=1.0, inertia=1.0, key=("rigid", ())):
    values = {"periods": periods, "side": 1.0, "inertia": inertia}
    return SimpleNamespace(
        place=place,
        cost=cost,
        names=(name,),
        effects=(COGGING,),
        values=lambda: values,
        family=SimpleNamespace(key=key),
        level=np.ones(3),
        damping=10.0,
        converged=True,
    )


def left(candidates, most=0):
    search = Search()
    found = screened(search, candidates, most, white=True)
    first = [place for places, steps in search.asked if steps == 1 for place in places]
    assert sorted(first) == list(range(len(candidates)))
    again = [place for places, steps in search.asked if steps == STEPS - 1 for place in places]
    assert sorted(again) == sorted(c.place for c in found)
    assert search.ticks == sorted(search.ticks)
    return {c.place for c in found}


def test_of_one_start_beside_given_and_fitted_numbers_the_better_goes_on():
    twins = [candidate(0, 5.0, inertia=1.0), candidate(1, 3.0, inertia=1.2)]
    others = [candidate(2, 9.0, periods=7.0), candidate(3, 8.0, name="unbalance")]
    assert left([*twins, *others]) == {1, 2, 3}


def test_a_start_that_diverges_takes_no_others_place():
    assert left([candidate(0, math.inf), candidate(1, 3.0, inertia=1.2)]) == {1}
    assert left([candidate(0, 3.0), candidate(1, math.inf, inertia=1.2)]) == {0}


def test_a_start_that_diverges_has_an_infinite_cost():
    search = search_of(record(seconds=6.0))
    c = search.candidate(Start((), NOMINAL, {"inertia": math.nan}))
    search.go_on([c], search.screening(), 1, white=True)
    assert c.cost == math.inf


def test_alone_every_other_start_goes_on_however_far_behind():
    assert left([candidate(place, 10.0**place, periods=place) for place in range(8)]) == set(range(8))


@pytest.mark.parametrize(("starts", "kept"), [(1, {0}), (2, {0}), (3, {0, 1}), (6, {0, 1, 2})])
def test_beside_fitted_causes_the_better_half_of_a_sets_starts_goes_on(starts, kept):
    assert left([candidate(place, float(place), periods=place) for place in range(starts)], most=4) == kept


def test_beside_fitted_causes_sets_far_behind_are_left_out():
    sets = [candidate(place, float(place), name=f"cause {place}") for place in range(9)]
    assert left(sets, most=4) == set(range(int(4 * SETS)))


def test_families_take_their_steps_one_after_the_other():
    search, keys = Search(), [("rigid", ()), ("transmission", ()), ("rigid", ())]
    screened(search, [candidate(n, 1.0, periods=n, key=key) for n, key in enumerate(keys)], 0, white=True)
    assert [places for places, _ in search.asked] == [[0, 2], [1], [0, 2], [1]]
    assert 0.0 < search.ticks[0] < search.ticks[1] < search.ticks[2] < search.ticks[3] < 1.0


def test_a_new_shaft_is_fitted_to_the_lowest_modes_first_and_the_better_half_of_its_starts_to_more():
    search, count = Search(), 4 * LEAST
    shafts = [candidate(n, float(n), periods=n, key=("transmission", ())) for n in range(count)]
    twin = candidate(count, -1.0, periods=1.0, inertia=2.0, key=("transmission", ()))  # of the second start
    others = [candidate(100, 1.0, name="unbalance"), candidate(101, 2.0, name="drag", key=("transmission", ()))]
    found = screened(search, [*shafts, twin, *others], 0, [*shafts, twin], white=True)
    first, second = search.coarse
    assert [modes for *_, modes in search.coarse] == list(MODES)
    assert first[1] == second[1] == COARSE_STEPS
    assert sorted(first[0]) == list(range(count + 1))
    assert sorted(second[0]) == [0, *range(2, count // 2), count]
    assert sorted(c.place for c in found) == [0, *range(2, LEAST), count, 100, 101]
    assert all(c.damping == 1.0 and not len(c.level) for c in found if c.place <= count)
    assert all(c.damping == 10.0 and len(c.level) for c in found if c.place > count)
    assert search.ticks == sorted(search.ticks)


@pytest.mark.parametrize("sensors", [("velocity",), ("velocity", "position")])
def test_the_lowest_modes_are_the_first_of_all_with_the_same_torques(sensors):
    search = search_of(record(seconds=6.0, sensors=sensors))
    all_of_them, few = search.modes, search._coarse_fitter(search.base.family.key, MODES[0]).modes
    torques = ~few.sensor
    assert np.sum(torques) == MODES[0]
    np.testing.assert_allclose(few.gain[torques], all_of_them.gain[: MODES[0]])
    np.testing.assert_allclose(few.frequency[torques], all_of_them.frequency[: MODES[0]])
    assert np.array_equal(few.band[torques], all_of_them.band[: MODES[0]])
    assert few.unanswered.shape == (few.bands,)
    assert np.sum(few.sensor) == np.sum(all_of_them.sensor)


@pytest.mark.parametrize("sensors", [("velocity",), ("position",), ("velocity", "position")])
def test_short_windows_have_no_fewer_modes_than_all(sensors):
    search = search_of(record(seconds=3.2, dt=0.01, sensors=sensors))
    assert np.sum(~search.modes.sensor) < MODES[1]
    assert search._coarse_fitter(search.base.family.key, MODES[1]) is search.fitters[search.base.family.key]
    c = search.candidate(Start((), NOMINAL, {}))
    for modes in (*MODES, 0):
        c.level, c.converged = np.zeros(0), False
        search.go_on([c], search.screening(), 1, white=True, modes=modes)
        assert np.isfinite(c.cost)
