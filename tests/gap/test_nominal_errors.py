"""Which nominal numbers are wrong, on stand-ins for fits whose likelihood is Gaussian."""

from types import SimpleNamespace

import numpy as np
import pytest

from fpjax.gap.fit.candidate import NOMINAL
from fpjax.gap.select.nominal_errors import wrong_numbers

SIZES = dict.fromkeys(NOMINAL, 2.0)
VAGUE = 4.0  # a fit's prior: twice the size


def fit(**found):
    """A fit of numbers known as (deviation, standard deviation) of their size; those not named are known to 0.1 %."""
    known = [found.get(name, (0.0, 1e-3)) for name in NOMINAL]
    off, error = (np.array([2.0 * pair[i] for pair in known]) for i in (0, 1))
    precision = np.diag(error**-2.0)
    # The mode under the fit's vague prior.
    vector = 2.0 + np.linalg.solve(precision + np.eye(3) / VAGUE**2, precision @ off)
    names = [SimpleNamespace(name=name) for name in NOMINAL]
    candidate = SimpleNamespace(
        wide=frozenset(NOMINAL), free=np.arange(3), vector=vector, center=np.full(3, 2.0), spread=np.full(3, VAGUE),
        scale=np.ones(3), normal=precision, family=SimpleNamespace(parameters=names),
    )  # fmt: skip
    return SimpleNamespace(candidate=candidate, evidence=100.0)


@pytest.mark.parametrize(
    ("found", "wrong"),
    [
        ({}, ()),
        ({"inertia": (0.03, 1e-3)}, ()),  # within what counts as right
        ({"inertia": (0.25, 1e-3)}, ("inertia",)),
        ({"inertia": (0.049, 1e-3)}, ()),
        (
            {"inertia": (0.052, 1e-3)},
            ("inertia",),
        ),  # likelier as right, but it would be held at a bound
        ({"viscous": (0.08, 0.08)}, ()),  # hardly known: right is as likely
        ({"viscous": (0.18, 0.06)}, ("viscous",)),  # a guess, where a vague prior alone had it right
        ({"inertia": (0.2, 1e-3), "coulomb": (-0.15, 5e-3), "viscous": (0.2, 0.06)}, NOMINAL),
        ({"inertia": (0.2, 1e-3), "viscous": (0.2, 1.0)}, ("inertia",)),  # the log does not tell: as given
        ({"coulomb": (3.0, 1e-2)}, ("coulomb",)),  # wild
    ],
)
def test_a_number_is_wrong_where_the_log_says_so(found, wrong):
    assert wrong_numbers(fit(**found), SIZES)[1] == wrong


def test_right_numbers_are_likelier_than_free_ones_and_wrong_ones_cost_their_odds():
    right, _ = wrong_numbers(fit(), SIZES)
    assert right > 100.0  # numbers that are right without being free: likelier by what freedom costs
    one, _ = wrong_numbers(fit(inertia=(0.2, 1e-3)), SIZES)
    two, _ = wrong_numbers(fit(inertia=(0.2, 1e-3), coulomb=(0.2, 1e-3)), SIZES)
    assert right > one > two


def test_only_numbers_that_the_fit_frees_are_asked():
    held = fit(inertia=(0.25, 1e-3))
    held.candidate.wide = frozenset({"coulomb"})
    assert wrong_numbers(held, SIZES)[1] == ()
