"""Grey-box identification; the truth comes from scipy's DOP853, never from ourselves."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fpjax as fp

DT, DURATION = 5e-4, 1.5
MOTOR, LOAD, STIFFNESS, DAMPING, COULOMB, VISCOUS, STEEPNESS = 4.0, 6.0, 4e4, 40.0, 20.0, 2.0, 20.0
CHIRP = (2.0, 3.0, 40.0, DURATION)


def chirp(time):
    amplitude, first, last, span = CHIRP
    return amplitude * np.sin(2.0 * np.pi * (first * time + 0.5 * (last - first) / span * time * time))


@pytest.fixture(scope="module")
def record():
    """(motor velocity, torque) of a PI loop around two masses, by DOP853, with noise."""

    def parts(time, state):
        motor, load, twist, integral = state
        error = chirp(time) - motor
        torque = 150.0 * error + integral
        shaft = STIFFNESS * twist + DAMPING * (motor - load)
        friction = COULOMB * np.tanh(STEEPNESS * load) + VISCOUS * load
        return torque, [(torque - shaft) / MOTOR, (shaft - friction) / LOAD, motor - load, 200.0 * error]

    times = np.arange(round(DURATION / DT) + 1) * DT
    truth = solve_ivp(
        lambda t, y: parts(t, y)[1], (0.0, times[-1]), np.zeros(4), "DOP853", times, rtol=1e-10, atol=1e-12
    )
    torque = np.asarray([parts(t, y)[0] for t, y in zip(times, truth.y.T, strict=True)])
    # One per cent of each signal, so that intervals have a size.
    noise = np.random.default_rng(5)
    velocity = truth.y[0] + 0.01 * np.std(truth.y[0]) * noise.standard_normal(times.size)
    return velocity, torque + 0.01 * np.std(torque) * noise.standard_normal(times.size), torque


def model(stiffness, damping):
    plant = fp.TwoMass(MOTOR, LOAD, stiffness, damping, fp.CoulombViscous(COULOMB, VISCOUS, STEEPNESS))
    return fp.ClosedLoop(plant, fp.ProportionalIntegral(150.0, 200.0), sensor=fp.IdealSensor("motor"))


@pytest.mark.parametrize(("stiffness", "damping"), [(6e4, 10.0), pytest.param(2.5e4, 100.0, marks=pytest.mark.long)])
def test_two_mass_stiffness_and_damping_within_one_per_cent(record, stiffness, damping):
    names = ["plant.stiffness", "plant.damping"]
    measured = {"motor_velocity": record[0], "torque": record[1]}
    found = fp.identify(model(stiffness, damping), fp.Chirp(*CHIRP), measured, names, dt=DT)
    assert found.converged
    assert found.values["plant.stiffness"] == pytest.approx(STIFFNESS, rel=0.01)
    assert found.values["plant.damping"] == pytest.approx(DAMPING, rel=0.01)
    for name, truth in zip(names, (STIFFNESS, DAMPING), strict=True):
        low, high = found.intervals[name]
        # One draw: a 95 % interval misses the truth in one of twenty, three standard errors in one of 370.
        assert low < truth < high or abs(found.values[name] - truth) < 3.0 * found.standard_errors[name]
        assert found.verdicts[name] == "pinned"
    assert "plant.stiffness" in str(found)
    assert float(found.loop.plant.stiffness) == pytest.approx(found.values["plant.stiffness"])


def test_friction_from_a_recorded_torque(record):
    """The same record, driven by its torque instead of its reference: no controller need be known."""
    start = fp.ClosedLoop(
        fp.TwoMass(MOTOR, LOAD, STIFFNESS, DAMPING, fp.CoulombViscous(15.0, 3.0, STEEPNESS)), fp.TorqueInput()
    )
    names = ["plant.friction.coulomb", "plant.friction.viscous"]
    torque = fp.Recorded(record[2], DT, hold=False)
    found = fp.identify(start, torque, {"motor_velocity": record[0]}, names, dt=DT)
    assert found.values[names[0]] == pytest.approx(COULOMB, rel=0.02)
    # Interpolating the torque and 1 % of noise on the velocity: b's share of the torque is a tenth of k's.
    assert abs(found.values[names[1]] - VISCOUS) < 4.0 * found.standard_errors[names[1]]


def test_identifiability_block_names_dead_and_traded_off_parameters(record):
    """In a frictionless one mass J, kp and ki only enter as ratios, and a zero-amplitude load moves nothing."""
    time = np.arange(len(record[0])) * DT
    plant = fp.OneMass(10.0, fp.NoFriction(), fp.Unbalance(0.0, 0.3))
    loop = fp.ClosedLoop(plant, fp.ProportionalIntegral(150.0, 200.0))
    run = fp.simulate(loop, fp.Chirp(*CHIRP), dt=DT, samples=len(time), record=("velocity",))
    names = ["plant.inertia", "controller.kp", "controller.ki", "plant.load.phase"]
    start = fp.set_parameters(loop, {"plant.inertia": 11.0})
    found = fp.identify(start, fp.Chirp(*CHIRP), {"velocity": run.signals["velocity"]}, names, dt=DT)
    assert found.verdicts["plant.load.phase"].startswith("dead")
    assert "controller.kp" in found.verdicts["plant.inertia"]
    assert found.values["controller.kp"] / found.values["plant.inertia"] == pytest.approx(15.0, rel=1e-3)


def test_a_parameter_at_its_bound_is_named(record):
    measured = {"motor_velocity": record[0]}
    bounds = {"plant.stiffness": (4.4e4, 9e4)}
    found = fp.identify(model(6e4, 40.0), fp.Chirp(*CHIRP), measured, ["plant.stiffness"], dt=DT, bounds=bounds)
    assert "low bound" in found.verdicts["plant.stiffness"]


@pytest.mark.parametrize(
    ("measured", "names", "options", "said"),
    [
        ({"velocity": np.zeros(9)}, ["plant.stifness"], {}, "plant.stiffness"),
        ({"velocity": np.zeros(9)}, [], {}, "at least one"),
        ({}, ["plant.stiffness"], {}, "empty"),
        ({"velocity": np.full(9, np.nan)}, ["plant.stiffness"], {}, "not finite"),
        ({"velocity": np.zeros(9), "torque": np.zeros(8)}, ["plant.stiffness"], {}, "common length"),
        ({"speed": np.zeros(9)}, ["plant.stiffness"], {}, "not a signal"),
        ({"velocity": np.zeros(9)}, ["plant.stiffness"], {"bounds": {"plant.damping": (1.0, 2.0)}}, "not among"),
        ({"velocity": np.zeros(9)}, ["plant.stiffness"], {"bounds": {"plant.stiffness": (1.0, 2.0)}}, "inside"),
        ({"velocity": np.zeros(9)}, ["plant.stiffness"], {"noise": {"velocity": 0.0}}, "above zero"),
        # As the messages write a parameter's path, and one name alone.
        ({"velocity": np.zeros(9)}, ["loop.plant.stiffness"], {"bounds": {"loop.plant.stiffness": (1, 2)}}, "inside"),
        ({"velocity": np.zeros(9)}, "plant.stiffness", {"bounds": {"plant.stiffness": (1.0, 2.0)}}, "inside"),
    ],
)
def test_bad_input_is_one_sentence(measured, names, options, said):
    with pytest.raises(fp.InputError, match=said):
        fp.identify(model(6e4, 10.0), fp.Chirp(*CHIRP), measured, names, dt=DT, **options)


def test_readings_from_after_the_recorded_reference_are_refused():
    recorded = fp.Recorded(np.ones(50), DT)
    with pytest.raises(fp.InputError, match="both of one run"):
        fp.identify(model(6e4, 10.0), recorded, {"velocity": np.zeros(100)}, ["plant.stiffness"], dt=DT)


def test_a_delay_is_identified_beyond_the_history_of_the_loop():
    def loop(delay):
        actuator = fp.Actuator(delay=delay, longest_delay=3)
        return fp.ClosedLoop(fp.OneMass(1.0, fp.Viscous(0.5)), fp.Proportional(5.0), actuator=actuator)

    settings = {"dt": 1e-3, "stepping": "sampled"}
    run = fp.simulate(loop(6.3e-3), fp.Chirp(*CHIRP), samples=1001, record=("velocity",), **settings)
    found = fp.identify(
        loop(2e-3), fp.Chirp(*CHIRP), {"velocity": run.signals["velocity"]}, ["actuator.delay"], **settings
    )
    assert found.values["actuator.delay"] == pytest.approx(6.3e-3, rel=1e-3)
