"""A torque that is recorded later than it acted: noticed, taken back, and no cause of a gap."""

import dataclasses

import gap_search
import numpy as np
import numpy_machine
import pytest
from scipy.signal import lfilter

from fpjax import diagnose, load_model
from fpjax.gap import EFFECTS
from fpjax.gap.data.inputs import about_late_torque, with_earlier_torque
from fpjax.gap.fit.saved_fits import SavedFits
from fpjax.gap.select.decision import decide, fit_alone
from fpjax.gap.select.late_torque import lags, late_beside_numbers, late_torque
from fpjax.gap.verb import make_search
from fpjax.simulation.precision import double_precision

DT = 1e-3
NAMES = ("constant_torque", "actuator_delay")
FEW = tuple(effect for effect in EFFECTS if effect.name in NAMES)
LAG = 3e-3  # [s]


def filtered(log, lag=LAG):
    """The log with the torque as a drive reports it after a first-order digital filter with a lag [s]."""
    share = log.dt / (log.dt + lag)
    torque, _ = lfilter([share], [1.0, share - 1.0], log.torque, zi=[(1.0 - share) * log.torque[0]])
    return dataclasses.replace(log, torque=torque)


def filtered_and_read_before(log):
    """The filter's state as each row begins, before the row's command acts."""
    return rows_late(filtered(log), 1)


def rows_late(log, rows=4):
    """The log in which each row holds the torque of some rows before."""
    return dataclasses.replace(log, torque=np.concatenate([np.full(rows, log.torque[0]), log.torque[:-rows]]))


def late_of(*logs, model=gap_search.MODEL, effects=FEW):
    with double_precision():
        search = make_search(logs, [], load_model(model), effects)
        return late_torque(search, decide(search, lambda *arguments: None))


def every(log, rows):
    """The log as a slower logger sees it: each reading that of its moment."""
    some = {
        name: column[::rows]
        for name in ("time", "torque", "velocity", "position", "reference")
        if (column := getattr(log, name)) is not None
    }
    return dataclasses.replace(log, dt=rows * log.dt, **some)


def late_at_first(log, model=gap_search.MODEL, effects=FEW):
    with double_precision():
        search = make_search([log], [], load_model(model), effects)
        return late_beside_numbers(search, fit_alone(search, lambda *arguments: None))


def pressing(time, speed, angle, command):
    return -0.4 * np.cos(7.0 * angle)


def test_a_torque_of_the_moment_is_half_a_row_late_before_any_cause_is_looked_for():
    """And a small cause that is there besides does not hide it."""
    slow = every(numpy_machine.record(seconds=12.0, sensors=("position",)), 10)
    assert late_at_first(slow) == pytest.approx(0.5 * slow.dt, rel=0.15)
    assert late_at_first(rows_late(slow, 1)) == pytest.approx(1.5 * slow.dt, rel=0.1)
    assert late_at_first(with_earlier_torque(slow, 0.5 * slow.dt, 0.0)) == 0.0
    cogging = every(numpy_machine.record(seconds=12.0, extra=lambda *at: 0.15 * pressing(*at)), 10)
    assert late_at_first(cogging) == pytest.approx(0.5 * slow.dt, rel=0.3)


@pytest.mark.parametrize("machine", [numpy_machine.Machine(delay=3), numpy_machine.Machine(coulomb=0.6)])
@pytest.mark.parametrize("sensors", [("velocity",), ("position",)])
@pytest.mark.parametrize("extra", [numpy_machine.nothing, pressing])
def test_a_torque_in_time_is_not_moved_for_what_a_cause_makes(machine, sensors, extra):
    assert late_at_first(numpy_machine.record(machine, seconds=6.0, sensors=sensors, extra=extra)) == 0.0


def test_a_nominal_model_with_a_dead_time_has_no_second_one_either():
    log = rows_late(numpy_machine.record(seconds=6.0))
    assert late_at_first(log) == pytest.approx(4.0 * DT, rel=0.1)
    assert late_at_first(log, model=gap_search.MODEL + "[actuator]\ndelay = 0.002\n") == 0.0


def test_a_torque_is_moved_as_far_as_it_is_late_and_a_filter_is_taken_back():
    log = numpy_machine.record(seconds=4.0)
    np.testing.assert_allclose(with_earlier_torque(filtered(log), LAG, LAG).torque, log.torque, atol=1e-12)
    whole = with_earlier_torque(filtered_and_read_before(log), LAG + DT, LAG).torque
    np.testing.assert_allclose(whole[1:-1], log.torque[1:-1], atol=1e-12)
    # A dead time of a row and a half leaves the mean of two rows.
    moved = with_earlier_torque(log, 1.5 * DT, 0.0)
    np.testing.assert_allclose(moved.torque[:-2], 0.5 * (log.torque[1:-1] + log.torque[2:]), atol=1e-12)
    assert moved.velocity is log.velocity


def test_what_a_filter_may_have_made_is_never_less_than_nothing():
    assert lags(0.4e-3, DT) == [0.0, 0.4e-3]
    assert lags(3e-3, DT) == [0.0, 3e-3, pytest.approx(2e-3)]


def test_the_warning_says_what_was_done_and_by_how_much():
    log = numpy_machine.record(seconds=4.0)
    assert "1.5 ms later than it acted: the column was corrected" in about_late_torque([log], 1.5e-3, 0.0)
    assert "acted, as by a first-order filter: the column" in about_late_torque([log], 1.5e-3, 1.5e-3)
    assert "acted, 0.5 ms of it as by a first-order filter: the column" in about_late_torque([log], 1.5e-3, 5e-4)


def test_a_torque_that_is_recorded_in_time_is_left_as_it_is():
    log = numpy_machine.record(seconds=6.0)
    assert late_of(log) == 0.0
    # A row of a millisecond makes less than a hundredth of this torque.
    assert late_of(rows_late(log, 1)) == 0.0
    # A torque that acts later than it is recorded is the actuator's matter.
    assert late_of(numpy_machine.record(numpy_machine.Machine(delay=3), seconds=6.0)) == 0.0


def test_a_nominal_model_with_a_dead_time_has_no_second_one():
    log = rows_late(numpy_machine.record(seconds=6.0))
    assert late_of(log) == pytest.approx(4.0 * DT, rel=0.1)
    assert late_of(log, model=gap_search.MODEL + "[actuator]\ndelay = 0.002\n") == 0.0


def test_a_late_torque_is_noticed_whichever_causes_are_asked_for_and_in_every_log_or_none():
    log = numpy_machine.record(seconds=6.0)
    assert late_of(rows_late(log), effects=FEW[:1]) == pytest.approx(4.0 * DT, rel=0.1)
    assert "actuator_delay" not in [effect.name for effect in FEW[:1]]
    assert late_of(rows_late(log), log) == 0.0


@pytest.mark.long
def test_a_filtered_torque_is_no_gap():
    log = filtered_and_read_before(numpy_machine.record(seconds=6.0))
    found = diagnose(log, load_model(gap_search.MODEL), effects=FEW)
    assert (found.verdict, found.causes) == ("no_gap", ())
    (said,) = [warning for warning in found.warnings if "later than it acted" in warning]
    assert float(said.split("recorded ")[1].split(" ms")[0]) == pytest.approx(1e3 * (LAG + DT), rel=0.1)
    assert "filter" in said
    assert float(said.split("acted, ")[1].split(" ms")[0]) == pytest.approx(1e3 * LAG, rel=0.1)


@pytest.mark.long
def test_a_late_torque_hides_no_cause_and_an_interrupt_keeps_the_fits_of_both_searches(tmp_path):
    log = rows_late(numpy_machine.record(numpy_machine.Machine(constant=0.15), seconds=6.0))
    model, begun, path = load_model(gap_search.MODEL), [], tmp_path / "kept"

    def until(last):
        def stop(stage, share):
            begun.append(stage)
            if begun.count("looking") > 1 and stage == last:
                raise KeyboardInterrupt

        begun.clear()
        kept = SavedFits(path)
        with pytest.raises(KeyboardInterrupt):
            diagnose(log, model, effects=FEW, progress=stop, keep=kept)
        return kept.taken

    assert until("looking") == 0
    first = until("intervals and curves")  # what the first search had stored, and none of the second
    again = SavedFits(path)
    found = diagnose(log, model, effects=FEW, keep=again)
    assert again.taken >= first + 8  # of three ways each its bases; nominal model and effects
    assert not again.lost
    assert (found.verdict, found.causes) == ("explained", ("constant_torque",))
    assert found.ranking[0].parameters["torque"].value == pytest.approx(0.15, rel=0.03)
    (said,) = [warning for warning in found.warnings if "later than it acted" in warning]
    assert "filter" not in said
    whole = diagnose(log, model, effects=FEW)
    assert str(found) == str(whole)
    assert repr(found.ranking) == repr(whole.ranking)


@pytest.mark.parametrize("last", ["effects together (2)", "intervals and curves"])
def test_a_diagnosis_of_a_torque_in_time_resumes_with_the_same_numbers(tmp_path, last):
    """Every question before a cause is chosen has the same answer again; the second one was another's, once."""
    log = numpy_machine.record(numpy_machine.Machine(constant=0.15), seconds=4.0, extra=pressing)
    model, path = load_model(gap_search.MODEL), tmp_path / "kept"
    some = tuple(effect for effect in EFFECTS if effect.name in (*NAMES, "unbalance"))

    def stop(stage, share):
        if stage == last:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(log, model, effects=some, progress=stop, keep=SavedFits(path))
    again = SavedFits(path)
    found = diagnose(log, model, effects=some, keep=again)
    assert again.taken >= 3
    assert not again.lost
    assert repr(found.ranking) == repr(diagnose(log, model, effects=some).ranking)
