"""A model whose friction holds the machine at rest while it moves."""

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import load_model
from fpjax.gap.data.record import TURNING
from fpjax.gap.data.replay_tables import surely_moving
from fpjax.gap.verb import make_search

COULOMB = numpy_machine.Machine().coulomb


def slow(time):
    """A speed that changes its direction every two seconds [rad/s]."""
    return 0.5 * np.sign(np.sin(0.5 * np.pi * time + 0.1))


def search_of(coulomb, sensors=("velocity", "position"), dt=1e-3, seconds=8.0):
    time = dt * np.arange(round(seconds / dt))
    log = numpy_machine.record(seconds=seconds, dt=dt, reference=slow(time), sensors=sensors)
    model = gap_search.MODEL.replace("coulomb = 0.4", f"coulomb = {coulomb}").replace("dt = 1e-3", f"dt = {dt}")
    return make_search([log], [], load_model(model))


@pytest.mark.long  # a fit each
@pytest.mark.parametrize("sensors", [("velocity", "position"), ("velocity",)])
def test_what_a_friction_above_every_torque_misses_is_told_at_its_size(sensors):
    search = search_of(12 * COULOMB, sensors)
    record = search.records[0]
    steady = [
        int(i) for i, start in enumerate(record.starts) if np.all(surely_moving(record)[start : start + record.samples])
    ]
    missing = search.finish([search.exact])[0].missing_rms([np.array(steady)])
    assert len(steady) >= 3
    assert missing == pytest.approx(11 * COULOMB, rel=0.05)


def test_a_machine_surely_moves_only_away_from_its_reversals():
    record = search_of(COULOMB).records[0]
    moving = surely_moving(record)
    assert 0.5 < np.mean(moving) < 1.0
    assert np.min(np.abs(record.speed[moving])) > TURNING * np.max(np.abs(record.speed))
    reversals = np.flatnonzero(np.diff(np.sign(record.speed)) != 0)
    assert len(reversals) > 2
    assert not np.any(moving[reversals])
