"""A measured torque holds noise that no machine feels: it is found, taken out, and is no gap nor a cause of one."""

from dataclasses import replace

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import load_model
from fpjax.gap import EFFECTS, diagnose
from fpjax.gap.data import torque_noise as module
from fpjax.gap.data.octaves import details, gains
from fpjax.gap.data.torque_noise import TorqueNoise, without_noise
from fpjax.gap.fit.candidate import Start
from fpjax.gap.verb import make_search

NOISE = 0.1  # [N m]
SMALL = (
    gap_search.MODEL.replace("0.05", "0.002").replace("0.03", "0.1").replace("1e-3", "1e-2")
)  # the machine of `steps`
LEVELS = np.array([1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, -1.0, -2.0, -3.0, -4.0, -3.0, -2.0, -1.0])


@pytest.fixture(scope="module", params=[("velocity",), ("position",), ("velocity", "position")], ids="+".join)
def steps(request):
    """Speeds one after the other, as a friction measurement has them: next to no inertia is in it."""
    return friction_measurement(request.param)


def friction_measurement(sensors=("velocity",)):
    return numpy_machine.record(
        numpy_machine.Machine(inertia=0.002, viscous=0.1, kp=0.05, ki=2.0), seconds=28.0, dt=1e-2,
        velocity_noise=0.02, sensors=sensors, reference=np.repeat(LEVELS, 200),
    )  # fmt: skip


def torque_noise(log, inertia=0.002, viscous=0.1):
    return module.torque_noise(log, inertia, viscous)


def measured(log, noise=NOISE, seed=7):
    return replace(
        log,
        torque_measured=True,
        torque=log.torque + noise * np.random.default_rng(seed).standard_normal(log.time.size),
    )


@pytest.mark.parametrize("noise", [0.03, 0.1, 0.2])
def test_the_noise_is_found_and_most_of_it_taken_out_but_no_edge(steps, noise):
    log = measured(steps, noise)
    found = torque_noise(log)
    assert found == pytest.approx(noise, rel=0.1)
    quiet, _ = without_noise(log, found)
    left = quiet.torque - steps.torque
    assert np.sqrt(np.mean(left**2)) < 0.4 * noise
    reversal = 7 * 200  # the torque changes there by twice the Coulomb friction
    sides = [np.mean(quiet.torque[a : a + 20]) - np.mean(steps.torque[a : a + 20]) for a in (reversal - 20, reversal)]
    assert np.max(np.abs(sides)) < noise


def test_nothing_is_found_in_a_torque_without_noise(steps):
    assert torque_noise(steps) == 0.0
    # Whether a column was measured its name does not always say.
    assert torque_noise(replace(measured(steps), torque_measured=False)) == torque_noise(measured(steps))
    assert torque_noise(measured(steps, 0.002)) == 0.0  # too little to matter


def test_what_a_loop_makes_of_its_sensor_s_noise_is_no_noise_of_the_reading():
    """The machine feels it, and the reading tells of it."""
    log = numpy_machine.record(
        numpy_machine.Machine(kp=2.0, ki=10.0), seconds=8.0, dt=2e-3, velocity_noise=0.15,
        sensors=("velocity", "position"),
    )  # fmt: skip
    assert torque_noise(measured(log, 0.0), 0.05, 0.03) == 0.0
    both = measured(log, 0.2)  # 0.3 N m that act, 0.2 that do not
    found = torque_noise(both, 0.05, 0.03)
    assert found == pytest.approx(0.2, rel=0.1)
    # Where both are, nothing tells them apart row by row, and nothing is taken out.
    quiet, noise = without_noise(both, found)
    assert quiet.torque == pytest.approx(both.torque, abs=1e-12)
    assert (noise.size, any(noise.taken)) == (found, False)
    # The rate sensor alone would not show 0.2 N m beside its own noise.
    assert torque_noise(replace(both, position=None), 0.05, 0.03) == 0.0


def test_what_the_machine_may_have_felt_is_no_noise_where_the_sensor_could_not_show_it():
    """A loop on a rate sensor that was not recorded, with an encoder of 500 counts, which shows none of it."""
    machine = numpy_machine.Machine(kp=2.0, ki=10.0)
    more = {"seconds": 8.0, "dt": 2e-3, "velocity_noise": 0.15, "sensors": ("position",)}
    coarse = numpy_machine.record(machine, position_step=2.0 * np.pi / 500.0, **more)
    assert torque_noise(coarse, 0.05, 0.03) == 0.0
    assert torque_noise(coarse, 0.05e-3, 0.03e-3) > 0.2  # it would have shown on so light a machine
    assert without_noise(coarse, 0.0)[0] is coarse
    # An excitation by noise, of which friction lets the encoder see little.
    white = np.random.default_rng(0).standard_normal(4000)
    loose = dict(more, feedforward=white, position_step=2.0 * np.pi / 500.0)
    excited = numpy_machine.record(numpy_machine.Machine(kp=0.0, ki=0.0), **loose)
    assert torque_noise(excited, 0.05, 0.03) == 0.0


def test_a_gap_is_as_large_where_a_loop_answers_its_sensor_s_noise():
    log = numpy_machine.record(
        numpy_machine.Machine(kp=2.0, ki=10.0), seconds=8.0, dt=2e-3, velocity_noise=0.15,
        extra=lambda time, speed, angle, command: 0.12 * np.sin(3.0 * angle),
    )  # fmt: skip
    model = gap_search.MODEL.replace("1e-3", "2e-3")
    own, commanded = (diagnose(replace(log, torque_measured=flag), load_model(model)) for flag in (True, False))
    assert own.gap.before == commanded.gap.before > 0.05
    assert not any("white noise" in warning for warning in own.warnings)


def test_a_ripple_as_weak_as_the_noise_of_its_octave_stays():
    time = 1e-2 * np.arange(4000)
    ripple = 0.05 * np.sin(2.0 * np.pi * 3.0 * time) + 0.5 * np.sin(2.0 * np.pi * 0.1 * time)
    velocity = 0.02 * np.random.default_rng(3).standard_normal(4000)
    log = replace(friction_measurement(), time=time, torque=ripple, velocity=velocity, reference=None)
    noisy = measured(log)
    quiet, noise = without_noise(noisy, torque_noise(noisy))
    kept = 2.0 * np.mean(quiet.torque * np.sin(2.0 * np.pi * 3.0 * time))
    assert kept == pytest.approx(0.05, abs=0.01)
    assert noise.taken[:2] == (True, True)


def test_resampling_takes_noise_from_the_fastest_octave_which_then_says_nothing(steps):
    log = measured(steps)
    half = np.convolve(np.append(log.torque, log.torque[-1]) - np.append(steps.torque, steps.torque[-1]), [0.5, 0.5])
    log = replace(log, torque=steps.torque + half[1:-1])
    assert torque_noise(replace(log, resampled=True)) > 1.2 * torque_noise(log)


def test_what_is_left_of_the_noise_has_the_density_that_is_said():
    white = np.random.default_rng(5).standard_normal(1 << 17)
    parts, rest = details(white, 5)
    taken = (True, False, True, False, False)
    left = rest + sum(part for part, gone in zip(parts, taken, strict=True) if not gone)
    power = np.mean(np.abs(np.fft.rfft(left.reshape(-1, 256), axis=1)) ** 2, axis=0)[1:-1] / 256.0
    said = TorqueNoise(1.0, taken, 1e-2).left(np.fft.rfftfreq(256, 1e-2)[1:-1])
    assert np.sqrt(power) == pytest.approx(said, abs=0.1)
    assert [np.std(part) for part in parts] == pytest.approx(gains(5), rel=0.05)


def test_a_soft_spring_is_charged_with_the_noise_that_it_keeps_from_the_load():
    log = friction_measurement()
    noise = TorqueNoise(0.1, (False,) * 4, log.dt)
    search = make_search([log], [], load_model(SMALL), noise=(noise,))
    spring = next(effect for effect in EFFECTS if effect.name == "compliance")

    def volumes(side):
        candidates = [search.candidate(Start((spring,), (), values(hertz, side))) for hertz in (2.0, 8.0)]
        fitter = search.fitters[candidates[0].family.key]
        kept = np.where(search.modes.sensor, 0.0, 3.0)
        counted = np.stack([0.0 * kept, 0.0 * kept, kept])
        soft = candidates[0]
        slope = fitter.log_volume_slope(soft, counted)
        place = [search.family((spring,)).parameters[i].name for i in soft.free].index("frequency")
        ends = np.repeat(soft.vector[None], 2, 0)
        ends[:, soft.free[place]] += 1e-3 * soft.scale[place] * np.array([-1.0, 1.0])
        low, high = fitter.log_volumes(ends, counted)
        assert slope[place] == pytest.approx(0.5 * (high - low) / 2e-3, rel=1e-2)
        return [fitter.log_volume(c, counted) for c in candidates]

    def values(hertz, side):
        return {"frequency": hertz, "damping_ratio": 0.1, "load_share": 0.5, "load_side": side}

    soft, stiff = volumes(1.0)
    assert soft > stiff > 0.0
    assert volumes(0.0)[0] < soft  # the motor feels it


def test_noise_of_the_torque_alone_is_no_gap():
    found = diagnose(measured(friction_measurement(), 0.2), load_model(SMALL))
    assert found.verdict == "no_gap"
    assert any("white noise of 0.19" in warning for warning in found.warnings)


def test_a_wrong_coulomb_friction_is_told_beside_the_noise():
    found = diagnose(measured(friction_measurement()), load_model(SMALL.replace("0.4", "0.2")))
    assert (found.verdict, found.causes) == ("explained", ("coulomb_error",))
    assert found.ranking[0].parameters["coulomb"].value == pytest.approx(0.4, rel=0.1)
