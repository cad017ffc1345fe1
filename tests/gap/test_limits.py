"""A drive that is asked for far more torque than it gives."""

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import diagnose, load_model
from fpjax.gap import EFFECTS
from fpjax.gap.fit.candidate import NOMINAL, Start
from fpjax.gap.select.weighed import Exact, moving_windows, whole_gap
from fpjax.gap.verb import make_search
from fpjax.simulation.precision import double_precision

LIMIT = 1.3  # [N m]; the friction is 0.4
PUSH = 0.3  # [N m]
# A loop without anti-windup that asks for some twenty times the limit.
GREEDY = numpy_machine.Machine(kp=6.0, ki=15.0)
BY_NAME = {effect.name: effect for effect in EFFECTS}
SATURATION = BY_NAME["torque_saturation"]
FEW = (SATURATION, BY_NAME["constant_torque"], BY_NAME["quadratic_drag"])


def limited(push):
    def beyond(time, velocity, position, command):
        return push + np.clip(command, -LIMIT, LIMIT) - command

    return numpy_machine.record(GREEDY, seconds=6.0, extra=beyond)


@pytest.mark.long
def test_a_limit_far_below_the_command_hides_no_second_cause():
    log = limited(PUSH)
    assert np.max(np.abs(log.torque)) > 12.0 * LIMIT
    found = diagnose(log, load_model(gap_search.MODEL), effects=FEW)
    assert found.verdict == "explained"
    assert found.causes == ("torque_saturation", "constant_torque")
    by_name = {ranked.effect: ranked.parameters for ranked in found.ranking}
    assert by_name["torque_saturation"]["limit"].value == pytest.approx(LIMIT, rel=0.03)
    assert by_name["constant_torque"]["torque"].value == pytest.approx(PUSH, rel=0.1)


@pytest.mark.long
def test_a_limit_that_leaves_more_than_the_drive_gives_explains_nothing():
    def beyond(time, velocity, position, command):
        return 0.8 * np.sin(2.0 * np.pi * 1.1 * time) + np.clip(command, -LIMIT, LIMIT) - command

    log = numpy_machine.record(GREEDY, seconds=6.0, extra=beyond)
    found = diagnose(log, load_model(gap_search.MODEL), effects=(SATURATION,))
    assert found.verdict != "explained"


def test_no_more_than_what_the_drive_gives_counts_as_missing_beside_its_limit():
    with double_precision():
        search = make_search([limited(0.0)], [], load_model(gap_search.MODEL), FEW)
        starts = [Start((), NOMINAL, {}), Start((SATURATION,), NOMINAL, {"limit": LIMIT})]
        fits = search.explore(starts)
        given = search.finish([search.exact])[0]
        exact = Exact(given, moving_windows(search.records))
        alone, with_limit = sorted(fits, key=lambda fit: len(fit.candidate.structural))
        assert whole_gap(search, exact, alone) == exact.left(given)
        most = whole_gap(search, exact, with_limit)
    assert 0.5 * LIMIT < most <= LIMIT * 1.05
    assert most < 0.5 * exact.left(given)
