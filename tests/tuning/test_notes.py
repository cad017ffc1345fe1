"""The notes of a tuning: the solver's stability limit, and estimates that cannot converge."""

import numpy as np
import pytest
from tuning_loops import DEGREE, GAINS, INERTIA, SHORT, SINE, THESIS, efp

import fpjax
import tuning


@pytest.mark.long  # a search each
@pytest.mark.parametrize(("share", "close"), [(0.85, True), (0.5, False)])
def test_gains_at_the_solvers_stability_limit_are_marked(share, close):
    """|w| excites tanh^2 -> 1 as soon as the mass slides: the rate is (gain_2 + gain_1 w^2) / J."""
    limit = fpjax.get_solver("ode3").stability_limit
    gain = share * limit * INERTIA / SHORT["dt"]
    pinned = [tuning.Parameter("observer.gain_2", gain, 0.999 * gain, 1.001 * gain)]
    result = tuning.tune(
        efp(150.0, gain_1=1e-3), SINE, parameters=pinned, objective=THESIS, method=tuning.NelderMead(1), **SHORT
    )
    marked = [note for note in result.notes if note.startswith("at the solver's stability limit")]
    assert bool(marked) == close
    assert all("re-check with a smaller dt" in note for note in marked)
    assert ("note: at the solver's stability limit" in str(result)) == close
    if close:
        assert float(marked[0].split(" = ")[1].split(",")[0]) == pytest.approx(share * limit, rel=0.02)


def test_an_estimate_that_cannot_converge_is_said_as_the_excitation_says_it():
    result = tuning.tune(efp(150.0), SINE, parameters=GAINS, method=tuning.NelderMead(1), **SHORT)
    time = np.arange(501) * SHORT["dt"]
    expected = fpjax.analysis.excitation.assess_excitation(
        result.apply(efp(150.0)).observer,
        np.sin(2.0 * np.pi * time),
        SHORT["dt"],
        {"coulomb": 20.0, "viscous": 2.0 * DEGREE},
        duration=SHORT["duration"],
    )
    assert any("(b_hat) cannot converge" in sentence for sentence in expected.sentences)
    noted = [note for note in result.notes if note.startswith("on sine, ")]
    assert noted == [f"on sine, {sentence}" for sentence in expected.sentences_of(result.settled)]
    assert "(b_hat) cannot converge here" in str(result)


@pytest.mark.long  # a search over another loop
def test_without_an_observer_there_is_nothing_to_note():
    bare = fpjax.ClosedLoop(efp(150.0).plant, efp().controller)
    result = tuning.tune(
        bare, SINE, parameters=["controller.kp"], objective="tracking", method=tuning.NelderMead(1), **SHORT
    )
    assert result.notes == ()
