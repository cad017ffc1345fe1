"""The identifiability block on Jacobians made by hand, and on the thesis' own objective."""

import numpy as np
import pytest
from tuning_loops import GAINS, SETUP, SINE, THESIS, efp

import tuning
from tuning.identifiability import judge

NAMES = ("a", "b", "c")
INSIDE = np.zeros(3)
RNG = np.random.default_rng(0)


def columns(*parts):
    return np.stack(parts, axis=1)


ONE, TWO, THREE = RNG.normal(size=(3, 20))


@pytest.mark.parametrize(
    ("jacobian", "verdicts"),
    [
        (columns(ONE, TWO, THREE), ("pinned", "pinned", "pinned")),
        (columns(ONE, 0.0 * TWO, THREE), ("pinned", "dead", "pinned")),
        (columns(ONE, 1e-3 * TWO, THREE), ("pinned", "flat", "pinned")),
        (columns(ONE, TWO, -2.0 * ONE), ("traded off with c", "pinned", "traded off with a")),
        (columns(ONE, TWO, ONE + TWO), ("not pinned", "not pinned", "not pinned")),
    ],
)
def test_verdicts(jacobian, verdicts):
    block = judge(NAMES, jacobian, INSIDE)
    assert tuple(block.verdicts.values()) == verdicts


def test_bounds_and_the_free_direction():
    block = judge(NAMES, columns(ONE, TWO, -2.0 * ONE), np.array([0.0, 0.99, -1.0]))
    assert block.verdicts["b"] == "at its high bound"
    assert block.verdicts["c"] == "traded off with a, at its low bound"
    # 2 a + c leaves the residuals as they are: a may double while c grows by half as many e-folds.
    np.testing.assert_allclose([block.free_direction[name] for name in NAMES], [1.0, 0.0, 0.5], atol=1e-12)
    assert block.condition > 1e12
    assert "dead" not in str(block)
    assert block.to_dict()["names"] == NAMES


def test_fewer_residuals_than_parameters_cannot_pin_all():
    block = judge(NAMES, columns(ONE[:1], TWO[:1], THREE[:1]), INSIDE)
    assert all(verdict != "pinned" for verdict in block.verdicts.values())


@pytest.mark.parametrize("steepness", [None, 150.0])
def test_the_thesis_objective_pins_a_curve_not_a_point(steepness):
    """docs/tuning.md: the set of zero cost is a curve alpha_1(alpha_2)."""
    result = tuning.tune(
        efp(steepness, 72.5, 298.4),
        SINE,
        parameters=GAINS,
        objective=THESIS,
        method=tuning.GridSearch(iterations=1),
        **SETUP,
    )
    block = result.identifiability
    assert block is not None
    assert block.derivative == ("finite differences" if steepness is None else "forward mode")
    assert all("traded off" in verdict for verdict in block.verdicts.values())
