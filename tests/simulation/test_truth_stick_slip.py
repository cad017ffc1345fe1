"""Set-valued friction against exact solutions: piecewise analytic, events by root finding."""

import itertools

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.optimize import brentq

import fpjax as fp
from fpjax.blocks.plants.sticking import advance_exact

INERTIA, COULOMB, AMPLITUDE, OMEGA = 2.0, 3.0, 5.0, 2.0 * np.pi * 1.5


def exact(times):
    """Velocity under J w' = A sin(omega t) - k sign(w), from rest, with exact sticking."""
    events = [(0.0, 0.0, 0)]  # (start, velocity there, direction; 0 sticks)
    end = times[-1]
    while events[-1][0] < end:
        start, speed, side = events[-1]
        if side == 0:
            # Rest ends where |A sin| first exceeds k.
            grid = np.linspace(start, start + 2.0 * np.pi / OMEGA, 4001)
            over = np.abs(AMPLITUDE * np.sin(OMEGA * grid)) - COULOMB
            if over[0] > 0.0:
                leave = start
            else:
                first = int(np.argmax(over > 0.0))
                leave = brentq(
                    lambda t: abs(AMPLITUDE * np.sin(OMEGA * t)) - COULOMB, grid[first - 1], grid[first], xtol=1e-15
                )
            events.append((leave, 0.0, int(np.sign(np.sin(OMEGA * (leave + 1e-9))))))
            continue
        slide = sliding(start, speed, side)
        grid = np.linspace(start + 1e-7, start + 2.0 * np.pi / OMEGA, 4001)
        crossed = int(np.argmax(slide(grid) * side < 0.0))
        stop = brentq(slide, grid[crossed - 1], grid[crossed], xtol=1e-15)
        torque = AMPLITUDE * np.sin(OMEGA * stop)
        events.append((stop, 0.0, 0 if abs(torque) <= COULOMB else int(np.sign(torque))))
    velocity = np.zeros_like(times)
    for (start, speed, side), (stop, _, _) in itertools.pairwise(events):
        inside = (times >= start) & (times < stop)
        if side:
            velocity[inside] = sliding(start, speed, side)(times[inside])
    return velocity, [event for event in events if event[0] < end]


def sliding(start, speed, side):
    def velocity(time):
        swing = AMPLITUDE / OMEGA * (np.cos(OMEGA * start) - np.cos(OMEGA * time))
        return speed + (swing - side * COULOMB * (time - start)) / INERTIA

    return velocity


def simulated(dt, solver, steepness=None, end=2.0):
    loop = fp.ClosedLoop(fp.OneMass(INERTIA, fp.CoulombViscous(COULOMB, 0.0, steepness)), fp.TorqueInput())
    torque = fp.Sine(AMPLITUDE, OMEGA / (2.0 * np.pi))
    run = fp.simulate(loop, torque, dt=dt, duration=end, solver=solver, record=("velocity",))
    return np.asarray(run.time), np.asarray(run.signals["velocity"])


def test_the_exact_solution_sticks_and_slips():
    velocity, events = exact(np.linspace(0.0, 2.0, 2001))
    sides = {side for _, _, side in events}
    assert sides == {-1, 0, 1}
    assert np.mean(velocity == 0.0) > 0.1


@pytest.mark.parametrize("solver", ["euler", "ode3", "rk4"])
def test_sign_converges_to_it_with_the_first_order(solver):
    """The sign law chatters about rest within k dt / J, and its switching costs every solver its order."""
    errors = []
    for dt in (1e-3, 1e-4):
        time, velocity = simulated(dt, solver)
        errors.append(np.max(np.abs(velocity - exact(time)[0])))
        # The largest change of speed in one step is (k + A) dt / J; a switch may come up to a step late.
        assert errors[-1] < 3.0 * (COULOMB + AMPLITUDE) * dt / INERTIA
    assert errors[1] < 0.2 * errors[0]


def test_tanh_converges_to_it_as_its_steepness_grows():
    """Sticking is a creep of about T / (k lambda) [rad/s]."""
    errors = []
    for steepness in (1e3, 1e4):
        time, velocity = simulated(1e-5 if steepness > 5e3 else 1e-4, "rk4", steepness, end=1.0)
        errors.append(np.max(np.abs(velocity - exact(time)[0])))
    # Creep of at most atanh(T / k) / lambda; a T of nearly k makes it several times 1 / lambda.
    assert errors[0] < 10.0 / 1e3
    assert errors[1] < 0.2 * errors[0]


def test_the_sticking_step_is_second_order_at_periods_a_hundred_times_longer():
    """`advance_exact` with the torque's mean held over each period: rest is rest, and the error falls as dt^2."""
    plant, step = fp.OneMass(INERTIA, fp.Coulomb(COULOMB)), eqx.filter_jit(advance_exact)

    def largest(dt):
        times = np.arange(round(2.0 / dt) + 1) * dt
        torque = AMPLITUDE / OMEGA / dt * (np.cos(OMEGA * times[:-1]) - np.cos(OMEGA * times[1:]))
        state, velocity = plant.init(), [0.0]
        for index, held in enumerate(torque):
            state = step(plant, state, np.asarray(held), np.asarray(times[index]), np.asarray(dt))
            velocity.append(float(state.velocity))
        truth = exact(times)[0]
        return np.max(np.abs(np.asarray(velocity) - truth)), np.mean(np.asarray(velocity) == 0.0)

    (coarse, _), (fine, resting) = largest(2e-2), largest(5e-3)
    # A quarter of the step: a sixteenth of the error for second order, an eighth with the events between.
    assert fine < coarse / 8.0
    assert resting > 0.1


def test_a_mass_on_a_belt():
    """Stick-slip: pulled by a spring at constant speed, the mass sticks, slips, sticks, with a known period.

    J w' = F - k sign(w), F' = c (v - w): while sticking F grows by c v t to F_s; with F_s = k it never slips back, so
    it settles to sliding at v with the spring at k, oscillating at sqrt(c / J) with amplitude v / omega.
    """
    stiffness, speed = 50.0, 0.2
    natural = np.sqrt(stiffness / INERTIA)
    # A PI with ki alone is that spring: the integral of stiffness x (v - w).
    loop = fp.ClosedLoop(fp.OneMass(INERTIA, fp.Coulomb(COULOMB)), fp.ProportionalIntegral(0.0, stiffness))
    run = fp.simulate(loop, fp.Constant(speed), dt=1e-4, duration=3.0, solver="rk4", record=("velocity",))
    time, velocity = np.asarray(run.time), np.asarray(run.signals["velocity"])
    slips = COULOMB / (stiffness * speed)
    # From the slip on: w = v (1 - cos(omega t)), which touches zero only once a turn.
    truth = np.where(time < slips, 0.0, speed * (1.0 - np.cos(natural * (time - slips))))
    assert np.max(np.abs(velocity - truth)) < 2e-3 * speed + 2.0 * COULOMB * 1e-4 / INERTIA


@pytest.mark.parametrize(("share", "within"), [(1e-3, 1e-9), (0.1, 1e-4), (0.5, 3e-3), (1.0, 0.02), (3.0, 0.2)])
def test_a_viscous_friction_is_as_strong_in_any_step(share, within):
    """Of a share of the mechanical time constant [1]: a motor under a voltage, sampled as fast as it responds."""
    step = 0.01
    viscous = share * INERTIA / step
    plant = fp.OneMass(INERTIA, fp.CoulombViscous(0.0, viscous))
    state, speed, angle = fp.OneMass.init(plant), 0.0, 0.0
    scale = 1.0 / viscous
    for k, torque in enumerate((1.0, 1.0, 2.0, 0.5, 0.0, 3.0)):
        state = advance_exact(plant, state, np.float64(torque), np.float64(k * step), np.float64(step))
        steady = torque / viscous
        angle += steady * step + (speed - steady) * (1.0 - np.exp(-share)) * step / share
        speed = steady + (speed - steady) * np.exp(-share)
        assert float(state.velocity) == pytest.approx(speed, abs=within * scale)
        assert float(state.position) == pytest.approx(angle, abs=2.0 * within * scale * step)


@pytest.mark.parametrize("share", [2.5, 30.0, 1e4])
def test_a_step_of_many_time_constants_ends_at_the_steady_speed(share):
    step = 0.01
    viscous = share * INERTIA / step
    plant = fp.OneMass(INERTIA, fp.CoulombViscous(1.0, viscous))
    state = fp.OneMass.init(plant)
    for k in range(60):
        state = advance_exact(plant, state, np.float64(3.0), np.float64(k * step), np.float64(step))
    assert float(state.velocity) == pytest.approx(2.0 / viscous, rel=1e-6)


@pytest.mark.parametrize(("share", "most"), [(0.1, 1e-3), (0.5, 2e-3), (1.0, 1e-2)])
def test_a_body_that_just_stops_ends_as_one_that_just_does_not(share, most):
    """Largest change of the final speed from one start speed to the next, over what the step adds."""
    step = 0.01
    plant = fp.OneMass(INERTIA, fp.CoulombViscous(1.0, share * INERTIA / step))
    torque, starts = -3.0, np.linspace(0.0, 8.0 * step, 8001)

    def after(speed):
        state = eqx.tree_at(lambda at: at.velocity, fp.OneMass.init(plant), speed)
        moved = advance_exact(plant, state, np.float64(torque), np.float64(0.0), np.float64(step))
        return moved.velocity, moved.position

    speed, angle = (np.asarray(one) for one in jax.vmap(after)(starts))
    added = 4.0 / INERTIA * step
    assert np.any(speed < 0.0)
    assert np.any(speed > 0.0)
    assert np.max(np.abs(np.diff(speed))) < most * added
    assert np.max(np.abs(np.diff(angle))) < most * added * step


@pytest.mark.parametrize("share", [1.0, 5.0])
def test_bristles_under_a_strong_drag_come_to_their_steady_speed(share):
    step = 0.01
    viscous = share * INERTIA / step
    plant = fp.OneMass(INERTIA, fp.LuGre(1.0, 1.0, 1.0, 1e3, 1.0, viscous).general())
    after = jax.jit(lambda state, time: advance_exact(plant, state, np.float64(3.0), time, np.float64(step)))
    state = fp.OneMass.init(plant)
    for k in range(800):
        state = after(state, np.float64(k * step))
    assert float(state.velocity) == pytest.approx(2.0 / viscous, rel=1e-3)
