"""A fit far behind the one that it is compared with converges sooner; one near it, or alone, goes to its end."""

from dataclasses import replace

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


@pytest.mark.parametrize(("inertia", "given"), [(0.05, True), (0.06, False)])
def test_a_further_cause_starts_from_the_likelier_of_the_fitted_and_the_given_numbers(inertia, given):
    """Beside one effect alone the numbers make up for another: what was given may be nearer."""
    search = gap_search.search_of(numpy_machine.record(numpy_machine.Machine(inertia=inertia), seconds=3.0))
    start = Start((), ("inertia",), {"inertia": 0.06})
    assert search._started([start], white=True)[0].values()["inertia"] == 0.06
    (c,) = search._started([replace(start, or_given=True)], white=True)
    assert c.values()["inertia"] == pytest.approx(0.05 if given else 0.06)


def test_a_start_that_diverges_is_the_likelier_one_never(search, monkeypatch):
    start = Start((), ("inertia",), {"inertia": 0.06}, or_given=True)
    fitter = search.fitters[search.base.family.key]
    right = fitter.coefficients

    def diverged(candidates, which, windows):
        return [
            np.full_like(out, np.nan) if c.values()["inertia"] == 0.05 else out
            for c, out in zip(candidates, right(candidates, which, windows), strict=True)
        ]

    monkeypatch.setattr(fitter, "coefficients", diverged)
    (c,) = search._started([start], white=True)
    assert c.values()["inertia"] == 0.06
    assert np.isfinite(c.cost)
