"""A model whose friction holds the machine at rest while it moves."""

import gap_search
import jax.numpy as jnp
import numpy as np
import numpy_machine
import pytest

from fpjax import OneMass, Stribeck, load_model
from fpjax.blocks.plants import OneMassState, TwoMassState
from fpjax.gap.data.record import TURNING
from fpjax.gap.data.replay_tables import AROUND, surely_moving
from fpjax.gap.machine import nominal_machine, with_structure
from fpjax.gap.simulate.replay import _moved
from fpjax.gap.verb import make_search
from fpjax.simulation.precision import double_precision

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
    # As far from a reversal as a column may lag, and no further.
    doubtful = np.flatnonzero(~moving)
    runs = [len(run) for run in np.split(doubtful, np.flatnonzero(np.diff(doubtful) > 1) + 1)]
    assert min(runs[1:-1]) > 2 * AROUND


@pytest.mark.parametrize(("structure", "dt"), [("rigid", 0.01), ("transmission", 1e-3), ("bristles", 1e-3)])
def test_a_carried_machine_feels_the_friction_of_the_measured_speed(structure, dt):
    """In 10 ms a start fast enough not to stop would have another viscous and Stribeck torque: 0.5 rad/s has not."""
    inertia, applied, speed = 0.05, 0.2, 0.5
    law = Stribeck(5.0, 6.0, 0.3, viscous=0.8)
    friction = 5.0 + (6.0 - 5.0) * np.exp(-((speed / 0.3) ** float(law.exponent))) + 0.8 * speed
    with double_precision():
        machine = with_structure(nominal_machine(OneMass(inertia, law), None, None, ("shape",)), structure, 50.0, 1e-3)
        zero = jnp.zeros(())
        state = {
            "rigid": OneMassState(zero, zero, ()),
            "bristles": OneMassState(zero, zero, jnp.ones(())),  # all bent
            "transmission": TwoMassState(zero, zero, zero, zero, ()),
        }[structure]
        shift = jnp.asarray(speed), zero
        moved = _moved(machine, state, jnp.asarray(applied), shift, jnp.asarray(True), zero, jnp.asarray(dt), 4)
        speeds = [moved.motor_velocity, moved.load_velocity] if structure == "transmission" else [moved.velocity]
    assert np.mean(speeds) * inertia / dt == pytest.approx(applied - friction, rel=0.01)
