"""The real axis: EMPS, where the data lie beside the repository (they are not ours to bundle)."""

import pathlib
import sys

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from public_records import EMPS, needs_emps

import fpjax as fp
from fpjax.logs.dynamics.derivative import measured_velocity
from fpjax.logs.dynamics.regression import fit_pairs

ROOT = pathlib.Path(__file__).parents[2]
MODEL = ROOT / "examples" / "emps.toml"
LAP = 6.24  # [s] one period of the reference, over which final estimates are averaged
pytestmark = needs_emps


@pytest.fixture(scope="module")
def log():
    return fp.read_log(EMPS, columns="emps")


class Drive(fp.AbstractSensor):
    """What the EMPS drive reads: the position, and the mean of its last two differences as the velocity."""

    start: jnp.ndarray

    def init(self):
        return self.start, self.start

    def step(self, state, output, noise, dt):
        last, before = state
        velocity = 0.5 * (output.position - before) / dt
        return (output.position, last), fp.Measurement(velocity, output.position)


def replay(log, law, offset):
    """(force error relative to the record's force, position error [m] rms) of the closed loop on the reference."""
    # As published with the record: position gain [1/s], velocity gain [V s/m], drive gain [N/V], moved mass [kg].
    start = jnp.asarray(log.position[0])
    controller = fp.PositionLoop(160.18, fp.Proportional(243.45 * 35.15))
    plant = fp.OneMass(95.1089, law, fp.Unbalance(0.0, 0.0, offset))
    loop = fp.ClosedLoop(plant, controller, sensor=Drive(start))
    initial = eqx.tree_at(lambda at: at.plant.position, loop.init(), start)
    run = fp.simulate(
        loop,
        fp.Recorded(log.reference, log.dt),
        dt=log.dt,
        samples=log.samples,
        stepping="sampled",
        substeps=4,
        record=("torque", "position"),
        initial=initial,
    )
    force, position = (np.asarray(run.signals[name]) for name in ("torque", "position"))
    error = np.linalg.norm(force - log.torque) / np.linalg.norm(log.torque)
    return error, np.sqrt(np.mean((position - log.position) ** 2))


def test_the_drive_is_understood(log):
    """The published control law on the record's own positions gives the record's force to 0.24 %."""
    difference = np.diff(log.position, prepend=log.position[0]) / log.dt
    velocity = 0.5 * (difference + np.concatenate([[0.0], difference[:-1]]))
    force = 243.45 * 35.15 * (160.18 * (log.reference - log.position) - velocity)
    # The first two samples would need positions from before the record.
    assert np.linalg.norm((force - log.torque)[2:]) / np.linalg.norm(log.torque) < 0.003


def test_replay_of_the_published_model(log):
    """Measured here: 4.9 % and 1.75 um symmetric, 4.2 % and 1.42 um with viscous friction by direction."""
    symmetric, position = replay(log, fp.CoulombViscous(20.3935, 203.5034, 5000.0), -3.1648)
    assert symmetric == pytest.approx(0.051, abs=0.003)
    assert position == pytest.approx(1.7e-6, abs=0.1e-6)
    # The offset belongs to the fit: by direction it is next to nothing, the asymmetry having taken its place.
    law = fp.AsymmetricCoulombViscous(20.39, 20.39, 166.7, 240.4, 5000.0)
    directed, _ = replay(log, law, -0.24)
    assert directed == pytest.approx(0.044, abs=0.003)
    assert directed < 0.9 * symmetric


def test_least_squares_pairs_the_torque_with_its_period(log):
    """The published least squares: 95.11 kg, 20.39 N, 203.5 N s/m, -3.16 N, from the positions alone."""
    velocity, _ = measured_velocity(log)
    found = fit_pairs(log.torque[:-1], velocity, log.dt, 95.1089)
    # Within a per cent: the published fit filters the positions in another way.
    assert found["coulomb"] == pytest.approx(20.39, rel=0.01)
    assert found["viscous"] == pytest.approx(203.5, rel=0.01)
    assert found["offset"] == pytest.approx(-3.165, abs=0.1)
    assert found["free inertia"] == pytest.approx(95.11, rel=0.005)


@pytest.fixture(scope="module")
def example():
    sys.path.insert(0, str(ROOT / "examples"))
    try:
        import emps_estimate
    finally:
        sys.path.pop(0)
    return emps_estimate


@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.long), pytest.param(1, marks=pytest.mark.slow)])
def test_an_observer_tuned_in_simulation_comes_within_five_per_cent(example, seed, tmp_path):
    """Goal: 5 % of 20.39 N and 203.5 N s/m, by gains that never saw the record's torque."""
    found = example.main(str(EMPS), tmp_path, seed)
    assert found.final["coulomb"] == pytest.approx(20.3935, rel=0.05)
    assert found.final["viscous"] == pytest.approx(203.5034, rel=0.05)
    assert (tmp_path / "emps_estimate.png").exists()


def test_the_gains_tried_by_hand(log):
    """The issue's rough try: (95, 1e4) gives about 20.8 N and 200 N s/m, ten times higher 16-18 N and 238-270 N s/m."""
    load = fp.load_model(MODEL).loop.plant.load

    def final(gain_2, gain_1):
        return fp.estimate(log, fp.ExtendedFriedlandPark(95.1089, gain_1, gain_2), load=load, average=LAP).final

    slow, fast = final(95.0, 1e4), final(950.0, 1e5)
    assert slow["coulomb"] == pytest.approx(20.8, rel=0.05)
    assert slow["viscous"] == pytest.approx(200.0, rel=0.05)
    assert 16.0 < fast["coulomb"] < 18.0
    assert 238.0 < fast["viscous"] < 270.0


@pytest.mark.long
@pytest.mark.xfail(strict=True, reason="one pass: the tuning asks for gains that follow the friction's direction")
def test_one_pass_over_the_record_is_not_enough(example, tmp_path, monkeypatch):
    """KNOWN_GAPS.md: tuned for a single pass the observer misses the goal of 5 %."""
    monkeypatch.setattr(example, "PASSES", 1)
    found = example.main(str(EMPS), tmp_path, 1)
    assert found.final["coulomb"] == pytest.approx(20.3935, rel=0.05)
    assert found.final["viscous"] == pytest.approx(203.5034, rel=0.05)
