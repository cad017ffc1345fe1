"""Whether a torque comes late or a reading does, where the rate sensor alone shows the motion."""

import dataclasses

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax.gap.effects.vocabulary import EFFECTS
from fpjax.gap.fit.candidate import NOMINAL, Start, nominal_sizes
from fpjax.gap.select.late_place import late_elsewhere
from fpjax.gap.select.nominal_errors import wrong_numbers
from fpjax.gap.select.weighed import Exact, weighed_fit

LAG = 4e-3  # of the reading [s]
BY_NAME = {effect.name: effect for effect in EFFECTS}


def read_late(**machine):
    """A log of the velocity alone, read through a lag."""
    log = numpy_machine.record(numpy_machine.Machine(**machine), sensors=("velocity",), velocity_noise=0.0)
    read, decay = np.array(log.velocity), np.exp(-log.dt / LAG)
    for k in range(1, len(read)):
        read[k] = decay * read[k - 1] + (1.0 - decay) * 0.5 * (log.velocity[k] + log.velocity[k - 1])
    noise = 2e-3 * np.random.default_rng(5).standard_normal(len(read))
    return dataclasses.replace(log, velocity=read + noise)


@pytest.mark.parametrize("bandwidth", [0.0, 3.0])
def test_a_guide_holds_no_machine_to_a_reading_that_is_late(bandwidth, monkeypatch):
    monkeypatch.setattr("fpjax.gap.fit.search.guide_bandwidth", lambda *_, **__: bandwidth)
    search = gap_search.search_of(read_late())
    assert search.guide == bandwidth
    names = ("velocity_lag", "actuator_lag", "actuator_delay")
    starts = [Start((BY_NAME[n],), NOMINAL, {BY_NAME[n].parameters[0].name: LAG}) for n in names]
    right, *wrong = search.fitted(starts)
    assert right.candidate.values()["velocity_lag"] == pytest.approx(LAG, rel=0.05)
    assert right.evidence > max(fit.evidence for fit in wrong) + 100.0


@pytest.mark.parametrize("first", ["actuator_lag", "velocity_delay", "velocity_lag"])
def test_a_late_reading_taken_for_a_late_torque_is_put_right_beside_the_details(first):
    search = gap_search.search_of(read_late(stribeck=0.12))
    given = search.finish([search.exact])[0]
    exact = Exact(given, tuple(np.arange(len(record.starts)) for record in search.records))
    stribeck = {"stribeck_torque": 0.12, "stribeck_velocity": 0.15}
    late = {BY_NAME[first].parameters[0].name: LAG}
    (fit,) = search.fitted([Start((BY_NAME[first], BY_NAME["stribeck"]), NOMINAL, stribeck | late)])
    chosen = weighed_fit(search, exact, fit, wrong_numbers(fit, nominal_sizes(search.setting))[0])
    found, tried = late_elsewhere(search, exact, chosen)
    assert set(found.structural) == {"stribeck", "velocity_lag"}
    assert (found is chosen) == (first == "velocity_lag")
    assert tried


def test_without_a_lost_time_nothing_is_asked():
    search = gap_search.search_of(read_late())
    given = search.finish([search.exact])[0]
    exact = Exact(given, tuple(np.arange(len(record.starts)) for record in search.records))
    numbers = weighed_fit(search, exact, given, given.evidence)
    assert late_elsewhere(search, exact, numbers) == (numbers, [])
