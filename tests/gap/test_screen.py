"""Screening: which starts go on after one step, and which windows they are tried on."""

import math
from types import SimpleNamespace

import pytest
from gap_search import search_of
from numpy_machine import record

from fpjax.gap.fit.candidate import NOMINAL, Start
from fpjax.gap.fit.screen import SETS, STEPS, screened

COGGING = SimpleNamespace(parameters=(SimpleNamespace(name="periods"),), fixed=(SimpleNamespace(name="side"),))


class Search:
    """Counts steps; every step leaves a candidate's cost at what it was given."""

    def __init__(self):
        self.asked, self.ticks = [], []

    def screening(self):
        return ["windows"]

    def go_on(self, candidates, windows, steps, *, white):
        assert windows == ["windows"]
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
