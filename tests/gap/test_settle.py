"""Hidden states and the size of a play: found again where they were lost."""

import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fpjax.blocks.friction import CoulombViscous
from fpjax.blocks.friction.general import GeneralFriction
from fpjax.blocks.plants import OneMass, TwoMassState
from fpjax.blocks.plants.sticking import advance_exact, mean_shaft
from fpjax.blocks.plants.transmission import Transmission
from fpjax.gap.attribute import Search
from fpjax.gap.effect import Setting
from fpjax.gap.family import Nominal
from fpjax.gap.record import make_record
from fpjax.gap.settle import bad_windows, scan_gap, settle
from fpjax.gap.vocabulary import EFFECTS

DT, NOISE = 1e-3, 1e-3
PLAY = {"gap": 0.02, "stiffness": 800.0, "damping_ratio": 0.3, "load_share": 0.45, "friction_share": 0.6}


def transmission(gap: float = PLAY["gap"]) -> Transmission:
    reduced = 0.05 * PLAY["load_share"] * (1.0 - PLAY["load_share"])
    damping = 2.0 * PLAY["damping_ratio"] * np.sqrt(PLAY["stiffness"] * reduced)
    law = GeneralFriction(0.4, 0.03)
    return Transmission(0.05, PLAY["load_share"], PLAY["stiffness"], damping, law, gap, PLAY["friction_share"])


@pytest.fixture(scope="module")
def search() -> Search:
    """A log of four seconds from a play that is known."""
    time = np.arange(4000) * DT
    torque = 1.5 * np.sin(2 * np.pi * 1.3 * time) + 0.8 * np.sin(2 * np.pi * 4.1 * time)
    plant = transmission()

    def step(state, row):
        command, now = row
        return advance_exact(plant, state, command, now, jnp.asarray(DT), 4), state.motor_velocity

    _, velocity = jax.lax.scan(step, plant.init(), (jnp.asarray(torque), jnp.asarray(time)))
    reading = np.asarray(velocity) + NOISE * np.random.default_rng(3).standard_normal(len(time))
    log = types.SimpleNamespace(
        time=time, torque=torque, velocity=reading, position=None, reference=None, dt=DT, name="play", linear=False
    )
    nominal = {"inertia": 0.05, "coulomb": 0.4, "viscous": 0.03}
    speed = float(np.quantile(np.abs(reading), 0.95))
    setting = Setting(0.05, 0.4, 0.03, 0.4, speed, 2.3, 10.0, 4.0, DT, nominal)
    return Search([make_record(log)], Nominal(OneMass(0.05, CoulombViscous(0.4, 0.03))), EFFECTS, setting, [log])


def started(search: Search, **changed: float):
    effect = next(effect for effect in EFFECTS if effect.name == "backlash")
    return search.candidate((effect,), PLAY | changed, "fixed")


def mean_cost(search: Search, candidate) -> np.ndarray:
    fitter = search.fitters[candidate.family.key]
    return fitter.window_costs([candidate], 0, search.train[0])[0] / search.per_window


def test_hidden_states_are_found_in_windows_that_were_off_track(search):
    candidate = started(search)
    fitter = search.fitters[candidate.family.key]
    candidate.hidden[0][:] = np.array([[0.004], [0.0]])
    fitter.fit([fixed := candidate], search.train, 1)
    before = mean_cost(search, fixed)
    for _ in range(3):
        settle(fitter, candidate, search.train, search.per_window)
    after = mean_cost(search, candidate)
    assert np.median(before) > 5.0
    assert np.median(after) < 1.5


def test_a_scan_finds_the_size_of_the_play_that_a_descent_misses(search):
    candidate = started(search, gap=1.3 * PLAY["gap"])
    fitter = search.fitters[candidate.family.key]
    fitter.fit([candidate], search.train, 2)
    settle(fitter, candidate, search.train, search.per_window)
    assert scan_gap(fitter, candidate, search.train, search.per_window)
    assert abs(candidate.values()["gap"] / PLAY["gap"] - 1.0) < 0.1


def test_windows_are_bad_against_the_noise_and_against_the_others():
    assert list(bad_windows(np.array([1.0, 1.1, 9.0]) * 250, 250)) == [2]
    assert list(bad_windows(np.array([0.5, 0.6, 0.9]) * 250, 250)) == []


def shaft(gap: float, twist: float, relative: float, dt: float = 1e-8) -> float:
    plant = transmission(gap)
    mobility = 1.0 / plant.motor_inertia + 1.0 / plant.load_inertia
    return float(mean_shaft(plant, jnp.asarray(twist), jnp.asarray(relative), jnp.zeros(()), mobility, jnp.asarray(dt)))


def test_a_face_pushes_and_never_pulls():
    assert shaft(0.02, 0.012, 0.0) == pytest.approx(0.002 * PLAY["stiffness"])
    assert shaft(0.02, -0.012, 0.0) == pytest.approx(-0.002 * PLAY["stiffness"])
    assert shaft(0.02, 0.005, 0.4) == 0.0
    assert shaft(0.02, 0.0101, -50.0) == 0.0  # leaves faster than the spring pushes
    assert shaft(0.0, 0.0001, -5.0) < 0.0  # a shaft without play pulls


def test_the_torque_is_continuous_in_the_gap_through_a_contact():
    gaps = np.linspace(0.0198, 0.0202, 401)
    values = np.array([shaft(gap, 0.01, 2.0, 1e-4) for gap in gaps])
    assert np.max(np.abs(np.diff(values))) < 0.02 * np.ptp(values)


def test_a_play_moves_as_an_independent_solution_does():
    from scipy.integrate import solve_ivp

    plant = transmission()
    motor, load = float(plant.motor_inertia), float(plant.load_inertia)
    half, stiffness, damping = 0.5 * PLAY["gap"], PLAY["stiffness"], float(plant.damping)

    def slope(_, y):  # always forwards, so that friction is its level
        w, wl, twist = y
        beyond = twist - np.clip(twist, -half, half)
        side = np.sign(beyond)
        torque = side * max(side * (stiffness * beyond + damping * (w - wl)), 0.0)
        own, other = 0.4 * (0.4 + 0.03 * w), 0.6 * (0.4 + 0.03 * wl)
        return [(1.2 - torque - own) / motor, (torque - other) / load, w - wl]

    zero = jnp.zeros(())
    state = TwoMassState(jnp.asarray(3.0), zero, jnp.asarray(2.0), zero, ())
    for k in range(60):
        state = advance_exact(plant, state, jnp.asarray(1.2), jnp.asarray(k * DT), jnp.asarray(DT), 4)
    exact = solve_ivp(slope, (0, 60 * DT), [3.0, 2.0, 0.0], max_step=1e-5, rtol=1e-8).y[:, -1]
    assert float(state.motor_velocity) == pytest.approx(exact[0], abs=5e-3)
    assert float(state.load_velocity) == pytest.approx(exact[1], abs=5e-3)
