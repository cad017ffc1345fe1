"""A fit far behind the one that it is compared with converges sooner; one near it, or alone, goes to its end."""

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax.gap.fit.candidate import Start
from fpjax.gap.fit.least_squares import GAINED, SLIGHT


@pytest.fixture(scope="module")
def search():
    return gap_search.search_of(numpy_machine.record(numpy_machine.Machine(inertia=0.06), seconds=3.0))


def fitted(search, beside, steps):
    c = search.candidate(Start((), ("inertia",), {"inertia": 0.05}))
    c.beside = beside
    search.go_on([c], search.train, steps, white=True)
    return c


def test_a_fit_that_is_far_behind_converges_with_its_first_small_step(search):
    first = fitted(search, np.inf, 1)
    assert not first.converged
    assert fitted(search, first.cost - 1e9, 1).converged


def test_what_is_left_of_a_fit_is_a_small_share_of_what_it_is_behind(search):
    best = fitted(search, np.inf, 25)
    assert best.converged
    for behind in (1.0, 100.0, 1e4):
        c = fitted(search, best.cost - behind, 25)
        assert c.converged
        assert c.cost - best.cost < max(GAINED, 3.0 * SLIGHT * behind), behind


def test_sets_are_compared_with_the_likeliest_one(search):
    starts = [Start((), wide, {}) for wide in (("inertia",), ("coulomb",))]
    right, wrong = search.explore(starts)
    assert right.evidence > wrong.evidence + 100.0
    assert wrong.candidate.beside == right.candidate.beside
    assert wrong.candidate.cost > wrong.candidate.beside
    assert right.candidate.values()["inertia"] == pytest.approx(0.06, rel=0.01)
