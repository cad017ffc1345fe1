"""Friction that grows with the torque through the gear, against a solution with events found by scipy."""

import numpy as np
import pytest
from model_files import body
from scipy.integrate import solve_ivp

import fpjax as fp
from fpjax.blocks.friction.general import GeneralFriction
from fpjax.blocks.plants.transmission import Transmission
from fpjax.model_file import simplified

INERTIA, COULOMB, SHARE, VISCOUS, AMPLITUDE, OMEGA, HELD = 2.0, 2.0, 0.3, 0.5, 6.0, 2.0 * np.pi * 1.5, 1.0


def level(torque):
    return COULOMB + SHARE * np.abs(torque)


def truth(times):
    """J w' = T - L - side (k + mu |T|) - b w with exact sticking, T = A sin(omega t), L held."""
    velocity, now, speed, side = np.zeros_like(times), 0.0, 0.0, 0

    def torque(t):
        return AMPLITUDE * np.sin(OMEGA * t)

    while now < times[-1]:
        if side == 0:
            grid = np.linspace(now, now + 2.0 * np.pi / OMEGA, 40001)
            excess = np.abs(torque(grid) - HELD) - level(torque(grid))
            if not np.any(excess > 0.0):
                break
            now = grid[int(np.argmax(excess > 0.0))]
            side = int(np.sign(torque(now) - HELD))
            continue

        def slope(t, w, side=side):
            return (torque(t) - HELD - side * level(torque(t)) - VISCOUS * w) / INERTIA

        def stops(t, w, side=side, begun=now):
            return w[0] * side + (1e-9 if t < begun + 1e-6 else 0.0)

        stops.terminal, stops.direction = True, -1.0
        found = solve_ivp(slope, (now, times[-1]), [speed], rtol=1e-10, atol=1e-12, events=stops, dense_output=True)
        inside = (times >= now) & (times <= found.t[-1])
        velocity[inside] = found.sol(times[inside])[0]
        now, speed = found.t[-1], 0.0
        push = torque(now) - HELD
        side = int(np.sign(push)) if abs(push) > level(torque(now)) else 0
    return velocity


def simulated(dt, solver, steepness=None, end=2.0):
    law = GeneralFriction(COULOMB, VISCOUS, steepness=steepness, load_coefficient=SHARE)
    loop = fp.ClosedLoop(fp.OneMass(INERTIA, law, fp.Unbalance(0.0, 0.0, HELD)), fp.TorqueInput())
    stepping = "sampled" if solver == "exact" else "continuous"
    torque = fp.Sine(AMPLITUDE, OMEGA / (2.0 * np.pi))
    run = fp.simulate(loop, torque, dt=dt, duration=end, solver=solver, stepping=stepping, record=("velocity",))
    return np.asarray(run.time), np.asarray(run.signals["velocity"])


def test_exact_sticking_converges_to_the_truth():
    """A torque held over each period lags half of it: off by A (1 + mu) dt / 2 J, first order, as for every law."""
    errors = []
    for dt in (1e-3, 2.5e-4):
        time, velocity = simulated(dt, "exact")
        errors.append(np.max(np.abs(velocity - truth(time))))
        assert errors[-1] < 1.1 * AMPLITUDE * (1.0 + SHARE) * dt / (2.0 * INERTIA)
    assert errors[1] < 0.3 * errors[0]


def test_the_smooth_law_approaches_it():
    errors = []
    for steepness in (100.0, 400.0):
        time, velocity = simulated(2e-4, "rk4", steepness)
        errors.append(np.max(np.abs(velocity - truth(time))))
    assert errors[1] < 0.4 * errors[0]


def test_a_gear_holds_more_than_its_coulomb_friction_against_the_motor():
    """Breaking away takes k / (1 - mu), and the back-driving load is held up to k / 1 only at zero motor torque."""
    for torque, moves in ((0.99 * COULOMB / (1.0 - SHARE), False), (1.01 * COULOMB / (1.0 - SHARE), True)):
        law = GeneralFriction(COULOMB, 0.0, load_coefficient=SHARE)
        loop = fp.ClosedLoop(fp.OneMass(INERTIA, law), fp.TorqueInput())
        run = fp.simulate(
            loop, fp.Constant(torque), dt=1e-3, samples=50, solver="exact", stepping="sampled", record="velocity"
        )
        assert bool(run.signals["velocity"][-1] > 0.0) is moves


def test_zero_is_no_term():
    zero, none = (GeneralFriction(COULOMB, VISCOUS, load_coefficient=at) for at in (0.0, None))
    runs = []
    for law in (zero, none):
        loop = fp.ClosedLoop(fp.OneMass(INERTIA, law), fp.TorqueInput())
        run = fp.simulate(
            loop, fp.Sine(AMPLITUDE, 1.5), dt=1e-3, samples=500, solver="exact", stepping="sampled", record="velocity"
        )
        runs.append(np.asarray(run.signals["velocity"]))
    np.testing.assert_array_equal(*runs)


def test_two_bodies_feel_the_torque_of_the_shaft():
    """At constant speed a stiff gear passes the motor's torque: T = k + mu T + b w for one mass and for two."""
    law = GeneralFriction(COULOMB, VISCOUS, load_coefficient=SHARE)
    for plant in (fp.OneMass(INERTIA, law), Transmission(INERTIA, 0.5, 2e3, 20.0, law)):
        loop = fp.ClosedLoop(plant, fp.ProportionalIntegral(5.0, 20.0))
        run = fp.simulate(
            loop,
            fp.Constant(1.0),
            dt=1e-3,
            duration=8.0,
            solver="exact",
            stepping="sampled",
            substeps=4,
            record="applied",
        )
        assert float(run.signals["applied"][-1]) == pytest.approx((COULOMB + VISCOUS) / (1.0 - SHARE), rel=1e-3)


TEXT = (
    body(2.0, 2.0, 0.5)
    + """
load_coefficient = 0.3
[actuator]
limit = 30.0
[controller]
type = "pi"
kp = 20.0
ki = 20.0
[simulation]
dt = 1e-3
duration = 1.0
"""
)


def test_the_file_has_it_and_its_steepness_follows_the_largest_level():
    model = fp.load_model(TEXT)
    assert float(model.loop.plant.friction.load_coefficient) == 0.3
    assert fp.load_model(fp.dump_model(model)).loop.plant.friction.load_coefficient is not None
    # The level reaches 2 + 0.3 x 30 N m; the step follows half of the limit there.
    assert fp.stiffness_number(model.loop, 1e-3) == pytest.approx(0.5 * fp.RungeKutta4.stability_limit, rel=0.01)
    neutral = fp.load_model(TEXT.replace("0.3", "0.0"))
    assert isinstance(simplified(neutral).loop.plant.friction, fp.CoulombViscous)
