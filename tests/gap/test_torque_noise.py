"""A measured torque holds noise that no machine feels: it is estimated, and is neither a gap nor a cause of one."""

from dataclasses import replace
from types import SimpleNamespace

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import load_model
from fpjax.gap import EFFECTS
from fpjax.gap.data.torque_noise import kept_noise, torque_noise
from fpjax.gap.fit.candidate import Start
from fpjax.gap.select.weighed import Exact
from fpjax.gap.verb import make_search

NOISE = 0.2  # [N m]


@pytest.fixture(scope="module")
def steps():
    """Speeds one after the other, as a friction measurement has them: next to no inertia is in it."""
    levels = np.array([1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, -1.0, -2.0, -3.0, -4.0, -3.0, -2.0, -1.0])
    return numpy_machine.record(
        numpy_machine.Machine(inertia=0.002, viscous=0.1, kp=0.05, ki=2.0), seconds=28.0, dt=1e-2,
        velocity_noise=0.02, sensors=("velocity",), reference=np.repeat(levels, 200),
    )  # fmt: skip


def measured(log, noise=NOISE, seed=7):
    return replace(
        log,
        torque_measured=True,
        torque=log.torque + noise * np.random.default_rng(seed).standard_normal(log.time.size),
    )


def test_the_noise_of_a_measured_torque_is_found_beside_reversals_and_a_vibration(steps):
    assert torque_noise(steps) == 0.0
    assert torque_noise(measured(steps, noise=0.0)) < 0.01
    assert torque_noise(measured(steps)) == pytest.approx(NOISE, rel=0.1)
    samples = 30_000
    still = replace(steps, time=steps.dt * np.arange(samples), torque=np.zeros(samples), velocity=None,
                    position=np.zeros(samples), reference=None)  # fmt: skip
    assert torque_noise(measured(still)) == pytest.approx(NOISE, rel=0.03)
    hum = np.sin(2.0 * np.pi * 30.0 * steps.time)
    assert torque_noise(measured(replace(steps, torque=steps.torque + hum))) == pytest.approx(NOISE, rel=0.15)
    assert torque_noise(replace(measured(steps), torque=measured(steps).torque[:100], time=steps.time[:100],
                                velocity=steps.velocity[:100], reference=steps.reference[:100])) == 0.0  # fmt: skip


def test_resampling_takes_the_share_of_the_noise_that_is_said():
    white, late = np.random.default_rng(5).standard_normal(200_001), (1e-3 * np.arange(200_000)) % 1.0
    mixed = (1.0 - late) * white[:-1] + late * white[1:]  # the stamps drift through the periods
    power = np.mean(np.abs(np.fft.rfft(mixed.reshape(-1, 100), axis=1)) ** 2, axis=0)[1:-1] / 100.0
    frequency = np.fft.rfftfreq(100, 1e-2)[1:-1]
    assert power == pytest.approx(kept_noise(frequency, 1e-2, True), abs=0.1)
    assert np.mean(power) == pytest.approx(np.mean(kept_noise(frequency, 1e-2, True)), abs=0.01)
    assert np.all(kept_noise(frequency, 1e-2, False) == 1.0)


def lag_beside(log):
    """Evidence of an actuator's lag over the nominal model with its numbers free [nats]."""
    search = gap_search.search_of(log, gap_search.MODEL.replace("0.05", "0.002").replace("0.03", "0.1"))
    lag = next(effect for effect in EFFECTS if effect.name == "actuator_lag")
    fits = search.fitted([Start((lag,), (), {"actuator_lag": start}) for start in (0.02, 0.2)])
    return max(fit.evidence for fit in fits) - search.finish([search.base])[0].evidence, search


def test_the_noise_of_a_measured_torque_is_no_lag_of_the_actuator(steps):
    """A lag keeps the noise out of the simulated motion, and was likelier by that alone."""
    ahead, search = lag_beside(measured(steps))
    assert search.records[0].torque_noise == pytest.approx(NOISE, rel=0.15)
    assert ahead < 5.0
    commanded, _ = lag_beside(replace(measured(steps), torque_measured=False))
    assert commanded > 10.0


def test_a_shaft_that_lets_no_noise_through_leaves_no_less_than_the_noise():
    def fit(left, structure):
        candidate = SimpleNamespace(family=SimpleNamespace(key=(structure, ())))
        return SimpleNamespace(missing_rms=lambda windows, moving=False: left, candidate=candidate)

    exact = Exact(fit(0.3, "rigid"), (), unread=0.1)
    assert [exact.left(fit(*one)) for one in ((0.05, "rigid"), (0.05, "transmission"), (0.2, "transmission"))] == [
        0.05, 0.1, 0.2,
    ]  # fmt: skip
    assert Exact(fit(0.3, "rigid"), ()).left(fit(0.05, "transmission")) == 0.05


@pytest.mark.parametrize(
    "known", ["", "[actuator]\nlag = 0.02\n", "[sensor]\nlag = 0.02\n", "[actuator]\ngain = 2.0\n"]
)
def test_what_the_noise_makes_passes_what_the_nominal_model_has(known):
    log = numpy_machine.record(seconds=8.0, dt=2e-3, sensors=("velocity",))
    noisy = measured(log)
    search = make_search([noisy], [], load_model(gap_search.MODEL + known))
    fitter, modes = search.fitters[search.exact.family.key], search.modes
    more = replace(noisy, torque=noisy.torque + noisy.torque - log.torque)
    twice = make_search([more], [], load_model(gap_search.MODEL + known))
    windows = np.arange(len(search.records[0].starts))
    other = twice.fitters[twice.exact.family.key].coefficients([search.exact], 0, windows)[0]
    made = modes.plain(other - fitter.coefficients([search.exact], 0, windows)[0]) ** 2
    made = modes.by_octave(np.mean(made / np.where(modes.sensor, np.inf, modes.gain), axis=0))
    said = fitter.noise_through(search.exact.vector[None])[0] * (NOISE / search.records[0].torque_noise) ** 2
    fast = (modes.frequency > 4.0) & ~modes.sensor
    assert made[fast] == pytest.approx(modes.by_octave(said)[fast], rel=0.4)


def test_what_is_white_in_a_torque_that_acted_is_no_noise_of_its_reading():
    """A loop answers the noise of its speed sensor, and the machine feels it: the motion has it."""
    log = numpy_machine.record(
        numpy_machine.Machine(kp=2.0, ki=10.0), seconds=8.0, dt=2e-3, velocity_noise=0.15,
        extra=lambda time, speed, angle, command: 0.12 * np.sin(3.0 * angle),
    )  # fmt: skip
    own, commanded = (gap_search.search_of(replace(log, torque_measured=flag)) for flag in (True, False))
    assert torque_noise(replace(log, torque_measured=True)) > 0.25
    assert own.records[0].torque_noise < 0.1
    left = [one.finish([one.exact])[0].missing_rms(one.train) for one in (own, commanded)]
    assert left[0] == pytest.approx(left[1], rel=0.1)


def test_a_lag_that_is_there_is_found_beside_the_noise(steps):
    filtered = np.zeros(steps.time.size)
    for k in range(1, steps.time.size):  # the current leads the torque by a lag of 50 ms
        filtered[k] = steps.torque[k] + 5.0 * (steps.torque[k] - steps.torque[k - 1])
    ahead, _ = lag_beside(measured(replace(steps, torque=filtered), noise=0.02))
    assert ahead > 50.0
