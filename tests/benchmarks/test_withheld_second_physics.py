"""The physics of the second truth of `benchmarks withheld`, held against scipy and against balances of energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.withheld.second import physics
from benchmarks.withheld.second.cases import DT, build
from benchmarks.withheld.second.simulate import Plant, simulate
from benchmarks.withheld.second.world import World

STIFF = {"element_stiffness": 2e4, "element_damping": 0.5}


def pushed(values: dict[str, float], torque: np.ndarray, substeps: int = 16, **world):
    """A machine without controller or noise under a torque that is held over each period."""
    return simulate([World(values, np.zeros(len(torque)), 0, push=torque, **world)], substeps)[0]


# Smooth cases: scipy's own solver is the oracle, of the equations written down again.


def held(torque: np.ndarray):
    return lambda t: torque[min(int(t / DT + 1e-9), len(torque) - 1)]


def oracle(right, start, count: int, torque: np.ndarray) -> np.ndarray:
    """States at the periods' starts, period by period, so that no step crosses a switch."""
    states = [np.asarray(start, float)]
    for k in range(count - 1):
        found = solve_ivp(lambda t, y, k=k: right(y, torque[k]), (0, DT), states[-1], rtol=1e-9, atol=1e-12)
        states.append(found.y[:, -1])
    return np.stack(states)


def test_a_mass_with_drag_and_position_torques_meets_scipy():
    torque = 0.8 * np.sin(2 * np.pi * 3 * np.arange(400) * DT)
    values = {
        "inertia": 0.02, "viscous_positive": 0.05, "viscous_negative": 0.03, "drag": 0.01, "unbalance": 0.3,
        "unbalance_phase": 0.4, "unbalance_second": 0.03, "ripple": 0.05, "ripple_periods": 9.0, "offset": 0.07,
        "swing": 0.3, "swing_phase": 1.0,
    }  # fmt: skip

    def right(state, u):
        x, v = state
        drag = (0.05 if v > 0 else 0.03) * v + 0.01 * v * abs(v)
        hangs = 0.3 * (np.sin(x + 0.4) + 0.03 * np.sin(2 * (x + 0.4))) + 0.05 * np.sin(9 * x) + 0.07
        # d/dt of J(x) v^2 / 2 is the power: J a + J' v^2 / 2 = T
        bend = -0.5 * 0.02 * 0.3 * np.sin(x + 1.0) * v * v
        return [v, (u - drag - hangs - bend) / (0.02 * (1 + 0.3 * np.cos(x + 1.0)))]

    expected = oracle(right, [0, 0], 400, torque)
    found = pushed(values, torque)
    # Kutta's third order at 1/16 ms; friction switches its slope at v = 0, which costs it an order there.
    np.testing.assert_allclose(found.true_position, expected[:, 0], atol=2e-8 * np.ptp(expected[:, 0]) + 1e-9)
    np.testing.assert_allclose(found.true_velocity, expected[:, 1], atol=1e-6 * np.ptp(expected[:, 1]))


def test_two_masses_on_a_hardening_spring_meet_scipy():
    torque = np.where(np.arange(500) < 60, 1.0, -0.3)
    values = {
        "inertia": 0.05, "split": 1.0, "load_share": 0.4, "stiffness": 60.0, "hardening": 2e3, "damping": 0.02,
        "viscous_positive": 0.01, "viscous_negative": 0.01, "friction_on_load": 0.25,
    }  # fmt: skip

    def right(state, u):
        a, b, va, vb = state
        pull = 60 * (a - b) * (1 + 2e3 * (a - b) ** 2) + 0.02 * (va - vb)
        return [va, vb, (u - pull - 0.0075 * va) / 0.03, (pull - 0.0025 * vb) / 0.02]

    expected = oracle(right, [0, 0, 0, 0], 500, torque)
    for on_load, column in ((0.0, 2), (1.0, 3)):
        found = pushed(values | {"sensor_on_load": on_load}, torque)
        np.testing.assert_allclose(found.true_velocity, expected[:, column], atol=2e-5 * np.ptp(expected[:, column]))


def test_poles_of_actuator_and_sensor_meet_scipy_and_delays_are_exact():
    torque = np.zeros(200)
    reference = np.where(np.arange(200) >= 20, 1.0, 0.0)  # a P controller's step, far from closing a loop
    gain = 1e-3
    values = {"inertia": 1.0, "kp": gain, "pole_1": 4e-3, "pole_2": 1e-3, "rate_pole_1": 3e-3}
    found = simulate([World(values, reference, 0)])[0]

    def right(state, u):
        first, second, v, seen = state
        return [(u - first) / 4e-3, (first - second) / 1e-3, second, (v - seen) / 3e-3]

    expected = oracle(right, [0, 0, 0, 0], 200, gain * reference)
    # means over substeps of 1/16 ms stand for the poles' curves
    scale = np.max(np.abs(expected[:, 2]))
    np.testing.assert_allclose(found.true_velocity, expected[:, 2], atol=4e-4 * scale)
    np.testing.assert_allclose(found.rate, expected[:, 3], atol=4e-3 * scale)
    assert not torque.any()
    for name in ("delay", "rate_delay"):
        delayed = simulate([World({"inertia": 1.0, "kp": gain, name: 3.37e-3}, reference, 0)])[0]
        since = np.maximum(np.arange(200) * DT - 0.020 - 3.37e-3, 0)
        np.testing.assert_allclose(delayed.rate, gain * since, atol=2e-4 * gain * since.max())


def test_maxwell_elements_spend_what_is_put_in():
    """Work of the torque = kinetic energy + stored in the springs + heat of the sliders + heat of the dampers."""
    level, stiffness, inertia = 1.3, 900.0, 0.01
    torque = 2.6 * np.sin(2 * np.pi * 4 * np.arange(1200) * DT) + 0.5 * np.sin(2 * np.pi * 11 * np.arange(1200) * DT)
    values = {
        "inertia": inertia, "coulomb_positive": level, "coulomb_negative": level, "element_stiffness": stiffness,
        "element_damping": 0.3,
    }  # fmt: skip
    plant = Plant([World(values, np.zeros(1), 0)])
    step, work, heat = DT / 24, 0.0, 0.0
    share, springs = physics.LIMITS[:, None], (physics.LIMITS / physics.YIELDS)[:, None] * stiffness
    for k in range(1200 * 24):
        before, anchors, speed = plant.position[0].copy(), plant.anchor[0].copy(), plant.velocity[0].copy()
        plant.step(torque[k // 24 : k // 24 + 1], k * step, step)
        moved = plant.position[0] - before
        work += float(torque[k // 24] * moved[0])
        middle, mean = 0.5 * (plant.position[0] + before), 0.5 * (plant.velocity[0] + speed)
        levels = (np.array([level]), np.array([level]))
        force = physics.element_force(
            middle - anchors, mean, *levels, plant.p["element_stiffness"], plant.p["element_damping"]
        )
        # all that the elements take, less what their springs still hold, is heat
        heat += float(np.sum(force * moved))
        assert np.all(np.abs(force) <= share * level * (1 + 1e-12))
    stored = float(np.sum(0.5 * springs * (plant.position[0] - plant.anchor[0]) ** 2))
    kinetic = float(0.5 * inertia * plant.velocity[0][0] ** 2)
    assert work == pytest.approx(kinetic + heat, rel=2e-3)
    assert 0 < heat - stored < work


def test_a_closed_maxwell_loop_has_the_area_of_its_sliders():
    """Slow cycles of amplitude A: each slider of yield y and level f that slips turns 4 f (A - y) into heat."""
    level, stiffness, amplitude = 2.0, 100.0, 0.05
    yields, limits = physics.YIELDS / stiffness * level, physics.LIMITS * level
    path = amplitude * np.sin(2 * np.pi * np.linspace(0, 3, 30001))
    up = down = np.array([level])
    anchor = np.zeros((physics.ELEMENTS, 1))
    force = []
    for x in path:
        force.append(physics.element_force(x - anchor, np.zeros(1), up, down, np.array([stiffness]), np.zeros(1)).sum())
        anchor = x - physics.slide(x - anchor, up, down, np.array([stiffness]))
    last = slice(20000, 30001)
    area = np.trapezoid(np.array(force)[last], path[last])
    assert area == pytest.approx(np.sum(4 * limits * np.maximum(amplitude - yields, 0)), rel=1e-3)
    # Masing: the first rise has the initial stiffness that the label tells
    slope = (force[1] - force[0]) / (path[1] - path[0])
    assert slope == pytest.approx(physics.INITIAL * stiffness, rel=1e-6)


def test_it_rests_below_the_level_and_slides_above_it():
    values = {"inertia": 0.1, "coulomb_positive": 1.0, "coulomb_negative": 0.6} | STIFF
    rest = pushed(values, np.full(400, 0.9))
    # it hangs on its elements: a little swing about one place, that dies away
    # Against the travel of a free mass under 0.9 N m in 0.4 s, a t^2 / 2.
    assert np.ptp(rest.true_position[200:]) < 1e-5 * 0.9 / 0.1 * 0.4**2 / 2
    assert np.abs(rest.true_velocity[300:]).max() < 0.7 * np.abs(rest.true_velocity[:100]).max()
    fast = pushed(values, np.full(400, 1.8))
    assert fast.true_velocity[-1] - fast.true_velocity[-101] == pytest.approx(0.8 / 0.1 * 0.1, rel=1e-6)
    back = pushed(values, np.full(400, -1.8))
    assert back.true_velocity[-1] - back.true_velocity[-101] == pytest.approx(-1.2 / 0.1 * 0.1, rel=1e-6)


def test_friction_grows_with_what_passes_the_gear():
    values = {"inertia": 0.1, "coulomb_positive": 0.5, "coulomb_negative": 0.5, "load_friction": 0.2} | STIFF
    found = pushed(values, np.full(300, 3.0))
    # T = J a + C + mu 0.8 J a
    acceleration = (3.0 - 0.5) / (0.1 * (1 + 0.2 * 0.8))
    assert (found.true_velocity[-1] - found.true_velocity[-101]) / 0.1 == pytest.approx(acceleration, rel=1e-4)


def test_a_tabulated_law_is_met_at_its_points_and_a_wave_has_its_fundamental():
    values = np.linspace(2, 1, physics.POINTS)[:, None]
    speed = 0.3 * np.array([1 / 3])  # v / (v + vs) = 1/4
    assert physics.table(values, speed, np.array([0.3]))[0] == pytest.approx(1.75)
    angle = np.linspace(0, 2 * np.pi, 20001)[:-1]
    for steepness in (1.0, 1.4, 2.5):
        wave = physics.trapezoid(angle, np.array([steepness]))
        assert 2 * np.mean(wave * np.sin(angle)) == pytest.approx(1.0, abs=1e-6)


def test_a_contact_never_pulls_and_backlash_leaves_the_load_alone_until_it_closes():
    twist = np.linspace(-0.02, 0.02, 401)
    for rate in (-50.0, 0.0, 50.0):
        force = physics.contact(twist, np.full(401, rate), np.full(401, 0.01), np.full(401, 1e4), np.full(401, 0.5))
        assert np.all(force * twist >= 0)
        assert np.all(force[np.abs(twist) <= 0.005] == 0)
    values = {
        "inertia": 0.2, "split": 1.0, "load_share": 0.5, "clearance": 0.02, "contact_stiffness": 1e5,
        "contact_loss": 5.0, "sensor_on_load": 1.0,
    }  # fmt: skip
    found = pushed(values, np.full(300, 1.0))
    crossing = np.sqrt(2 * 0.01 * 0.1)
    assert np.all(found.true_velocity[found.time < crossing - DT] == 0)
    # Both masses share 1 N m for 0.3 s on 0.2 kg m^2; impacts leave a swing around that.
    assert found.true_velocity[-1] == pytest.approx(0.3 / 0.2, rel=0.1)


def test_limits_and_dead_zones_are_those_of_their_labels_far_from_the_knee():
    high = physics.soft_limit(np.array([40.0]), np.array([2.0]), np.array([10.0]))
    assert high[0] == pytest.approx(2.0, rel=1e-6)
    case = build(0, "test/torque_dead_zone", "single", "both", "joint", ("torque_dead_zone",), 250, 1.0)
    width, knee = (np.array([case.world.values[name]]) for name in ("lost", "lost_rounding"))
    told = case.plan.parameters["torque_dead_zone"]["width"]
    passed = physics.dead_zone(1000 * width, width, knee)
    assert 1000 * width[0] - passed[0] == pytest.approx(told, rel=5e-3)
