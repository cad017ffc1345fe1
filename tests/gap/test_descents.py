"""Descents of the search for a shaft: from which points of a grid they begin, and which of them are starts."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from fpjax.gap.fit.shaft_starts import APART, DESCENTS, FACES, HARD, _descents


class Bowl:
    """Lowest at a point, and a little less low at others: scores of a search, with what a descent asks for."""

    def __init__(self, target, given):
        numbers = {"inertia": 1.0, "coulomb": 1.0, "viscous": 1.0}
        self.log = SimpleNamespace(
            nominal=numbers, given=numbers | given, setting=SimpleNamespace(friction=1.0, speed=1.0)
        )
        self.target, self.tried, self.filters = np.log(target)[:, None], [], [None, None]

    def scores(self, rows, used=2):
        self.tried.append(rows.shape[1])
        return np.sum((np.log(rows) - self.target) ** 2, axis=0)

    def linearised(self, rows, used):
        away = np.log(rows) - self.target
        return np.sum(away**2, axis=0), away.T, np.repeat(np.eye(len(away))[None], rows.shape[1], 0)


TARGET = [0.02, 0.4, 3.0, 0.2, 0.3, 0.3, 1.0, 1.0, 1.0]
GRID = [[gap, 0.5, frequency, 0.1, 0.5, 0.5] for gap in (0.01, 0.1) for frequency in (1.0, 2.0, 4.0)]
LOW, HIGH = [1e-3, 0.1, 0.9, 0.01, 0.02, 0.02], [1.0, 0.9, 8.0, 0.4, 0.98, 0.98]


def test_each_slice_of_a_backlash_holds_a_resonance_of_the_grid():
    edges = np.geomspace(0.1, 2.0, FACES + 1)
    assert [np.sum((a < h) & (h < b)) for a, b in itertools.pairwise(edges) for h in [np.array(HARD)]] == [1] * FACES


def test_points_of_the_grid_are_tried_once_where_the_numbers_agree():
    for given, grid in (({}, len(GRID)), ({"inertia": 2.0}, 2 * len(GRID))):
        bowl = Bowl(TARGET, given)
        _descents(bowl, GRID, LOW, HIGH, 3)
        assert bowl.tried[0] == grid
        # Three dampings of the best points of each slice, of which the better half goes on.
        assert bowl.tried[1] == 3 * 3 * min(DESCENTS, bowl.tried[0] // 3)
        assert bowl.tried[-2] == 3 * 3 * min(DESCENTS, bowl.tried[0] // 3) // 2


def test_descents_that_meet_are_one_start_and_none_leaves_the_bounds():
    (only,) = _descents(Bowl(TARGET, {}), GRID, LOW, HIGH, 3)
    assert np.exp(only) == pytest.approx(TARGET, rel=APART)
    beyond = [9.0, *TARGET[1:]]
    found = np.exp(_descents(Bowl(beyond, {}), GRID, LOW, HIGH, 3, of_each=True))
    assert found[:, 0] == pytest.approx([HIGH[0]] * 3)
    edges = np.geomspace(LOW[2], HIGH[2], 4)
    assert sorted(found[:, 2]) == pytest.approx([edges[1], TARGET[2], edges[2]], rel=0.01)
