"""The integrator of the second generator: third-order Runge-Kutta on all machines at once, elastic friction elements.

Nothing sticks exactly: at rest a body is held by its Maxwell elements and creeps as they stretch. Their sliders move
after each step only, so that the right-hand side is continuous within a step.
"""

from collections.abc import Callable

import numpy as np

from . import physics
from .world import NEUTRAL, Trace, World, stack

SUBSTEPS = 12
HISTORY = 24  # periods of velocity and commands kept for dead times, the longest of which is 11 ms


class Plant:
    """Masses, friction and transmission of many machines."""

    def __init__(self, worlds: list[World]):
        self.p = p = stack(worlds)
        self.curve = np.stack([world.curve for world in worlds], axis=1)
        self.curved = np.any(self.curve != 1.0)
        self.split = p["split"] > 0
        self.two = bool(self.split.any())
        # Terms that no machine of the batch has are not computed.
        self.has = {name for name, value in p.items() if np.any(value != NEUTRAL[name])}
        share = np.where(self.split, p["load_share"], 0.0)
        self.motor, self.load = p["inertia"] * (1 - share), p["inertia"] * np.where(self.split, p["load_share"], 1.0)
        count = len(worlds)
        # motor and load, or the one body
        self.position = np.stack([p["start"]] * (2 if self.two else 1))
        self.velocity = np.zeros(self.position.shape)
        self.anchor = self.position[:, None, :] * np.ones((1, physics.ELEMENTS, 1))
        self.through = np.zeros(count)  # torque through the gear
        self.delivered = np.zeros(count)  # torque beyond friction
        self.on = np.stack([np.where(self.split, 1 - p["friction_on_load"], 1.0), p["friction_on_load"] * self.split])

    def levels(self, side: int, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Friction levels of the positive and the negative direction on one side."""
        p = self.p
        speed = self.velocity[side]
        factor, more = np.ones(len(speed)), np.zeros(len(speed))
        if "wave" in self.has:
            angle = p["wave_periods"] * self.position[side] + p["wave_phase"]
            factor = 1 + p["wave"] * physics.trapezoid(angle, p["wave_steepness"])
        if self.curved:
            factor = factor * physics.table(self.curve, speed, p["curve_speed"])
        if "drift" in self.has:
            warm = np.exp(-time / p["drift_time"])
            slow = np.exp(-time / (3 * p["drift_time"]))
            more = p["drift"] * ((1 - p["drift_slow"]) * warm + p["drift_slow"] * slow)
        if "load_friction" in self.has:
            more = more + p["load_friction"] * np.abs(self.through)
        up = np.maximum(p["coulomb_positive"] * factor + more, 0) * self.on[side]
        down = np.maximum(p["coulomb_negative"] * factor + more, 0) * self.on[side]
        return up, down

    def friction(self, side: int, position: np.ndarray, velocity: np.ndarray, levels: tuple[np.ndarray, np.ndarray]):
        """Friction torque on one side."""
        p = self.p
        forces = physics.element_force(
            position - self.anchor[side], velocity, *levels, p["element_stiffness"], p["element_damping"]
        )
        viscous = np.where(velocity > 0, p["viscous_positive"], p["viscous_negative"])
        drag = p["drag"] * np.abs(velocity)
        return forces.sum(axis=0) + self.on[side] * (viscous + drag) * velocity

    def held(self, position: np.ndarray) -> np.ndarray:
        """Torques locked to the position, and constant ones."""
        p = self.p
        total = p["offset"] + p["known_offset"]
        if "unbalance" in self.has:
            angle = position + p["unbalance_phase"]
            total = total + p["unbalance"] * (np.sin(angle) + p["unbalance_second"] * np.sin(2 * angle))
        if "cogging" in self.has:
            angle = p["cogging_periods"] * position + p["cogging_phase"]
            total = total + p["cogging"] * physics.trapezoid(angle, p["cogging_steepness"])
        if "ripple" in self.has:
            total = total + p["ripple"] * np.sin(p["ripple_periods"] * position + p["ripple_phase"])
        return total

    def acceleration(
        self, position: np.ndarray, velocity: np.ndarray, torque: np.ndarray, levels: list, time: float
    ) -> np.ndarray:
        """Accelerations: (1, machines) where all are one body, else motor and load, (2, machines)."""
        p = self.p
        first = self.friction(0, position[0], velocity[0], levels[0])
        hangs = self.held(position[-1])
        change = 1.0
        if "payload" in self.has:
            change = change + p["payload"] / (1 + np.exp(np.clip(-(time - p["payload_time"]) / 0.02, -50, 50)))
        if "swing" in self.has:
            angle = position[-1] + p["swing_phase"]
            change = change + p["swing"] * np.cos(angle)
            hangs = hangs - 0.5 * p["swing"] * np.sin(angle) * velocity[-1] ** 2 * p["inertia"]
        whole = (torque - first - hangs) / (p["inertia"] * change)
        if not self.two:
            return whole[None]
        second = self.friction(1, position[1], velocity[1], levels[1])
        twist, rate = position[0] - position[1], velocity[0] - velocity[1]
        transmitted = self.transmitted(twist, rate)
        motor = (torque - first - transmitted) / self.motor
        load = (transmitted - second - hangs) / (self.load * change)
        return np.stack([np.where(self.split, motor, whole), np.where(self.split, load, whole)])

    def transmitted(self, twist: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Torque that the motor's body gives to the load's."""
        p = self.p
        pressed = physics.contact(twist, rate, p["clearance"], p["contact_stiffness"], p["contact_loss"])
        return pressed + physics.spring(twist, rate, p["stiffness"], p["hardening"], p["damping"])

    def inside(self) -> dict[str, np.ndarray]:
        """What no sensor shows and the label needs, by the names of `Trace`."""
        found = {}
        if self.two:
            twist, rate = self.position[0] - self.position[1], self.velocity[0] - self.velocity[1]
            found |= {"twist": twist, "twist_rate": rate, "transmitted": self.transmitted(twist, rate)}
        if "load_friction" in self.has:
            level = self.p["load_friction"] * np.abs(self.through)
            found |= {"delivered": self.delivered, "load_level": level}
        return found

    def step(self, torque: np.ndarray, time: float, step: float) -> None:
        """One step of Kutta's third-order rule, then the anchors follow."""
        sides = range(len(self.position))
        levels = [self.levels(side, time) for side in sides]
        x, v = self.position, self.velocity
        a1 = self.acceleration(x, v, torque, levels, time)
        x2, v2 = x + 0.5 * step * v, v + 0.5 * step * a1
        a2 = self.acceleration(x2, v2, torque, levels, time)
        x3, v3 = x + step * (2 * v2 - v), v + step * (2 * a2 - a1)
        a3 = self.acceleration(x3, v3, torque, levels, time)
        self.position = x + step / 6 * (v + 4 * v2 + v3)
        self.velocity = v + step / 6 * (a1 + 4 * a2 + a3)
        if "load_friction" in self.has:
            # The torque through the gear: most of the inertia is behind it, and all loads.
            held = self.held(self.position[-1])
            self.through = self.p["geared"] * self.p["inertia"] * a3[-1] + held
            self.delivered = self.motor * a3[0] + np.where(self.split, self.load * a3[-1], 0.0) + held
        for side in sides:
            stretch = physics.slide(self.position[side] - self.anchor[side], *levels[side], self.p["element_stiffness"])
            self.anchor[side] = self.position[side] - stretch


class Actuator:
    """From the command to the torque on the motor."""

    def __init__(self, plant: Plant, step: float):
        self.p, self.step = plant.p, step
        count = len(plant.split)
        self.first = self.second = self.slewed = self.magnet = np.zeros(count)
        self.keep = [np.where(self.p[n] > 0, np.exp(-step / np.maximum(self.p[n], 1e-9)), 0.0) for n in POLES]

    def torque(self, command: np.ndarray, time: float) -> np.ndarray:
        """Torque over one step, of the command that has arrived."""
        p = self.p
        # The mean over the step, not its end value, which would lead by half a step.
        room = p["slew"] * self.step
        self.slewed = self.slewed + np.minimum(np.maximum(command - self.slewed, -room), room)
        before = self.first
        self.first = self.slewed + (self.first - self.slewed) * self.keep[0]
        middle = 0.5 * (before + self.first) * (self.keep[0] > 0) + self.first * (self.keep[0] == 0)
        before = self.second
        self.second = middle + (self.second - middle) * self.keep[1]
        lagged = 0.5 * (before + self.second) * (self.keep[1] > 0) + self.second * (self.keep[1] == 0)
        # Magnetic hysteresis: part of the torque follows through a play operator (backlash of the given width).
        width = p["magnet_width"]
        self.magnet = np.minimum(np.maximum(self.magnet, lagged - width), lagged + width)
        shaped = lagged + p["magnet"] * (self.magnet - lagged)
        shaped = np.where(p["lost"] > 0, physics.dead_zone(shaped, p["lost"], p["lost_rounding"]), shaped)
        shaped = np.where(p["limit"] < 1e8, physics.soft_limit(shaped, p["limit"], p["limit_power"]), shaped)
        return shaped * p["gain"] * (1 + p["gain_fade"] * (1 - 2 * np.exp(-time / p["gain_fade_time"])))


POLES = ("pole_1", "pole_2")


def rounded(value: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Rounded to a step; a step of zero rounds nothing."""
    return np.where(step > 0, np.round(value / np.where(step > 0, step, 1.0)) * step, value)


def simulate(
    worlds: list[World], substeps: int = SUBSTEPS, progress: Callable[[float], None] | None = None
) -> list[Trace]:
    """Simulate machines, those with one body or two, one rate and one length side by side.

    Args:
        worlds: the machines.
        substeps: of the integrator in 1 ms.
        progress: called with the share done.

    Returns:
        One trace for each machine, in the given order.
    """
    groups: dict[tuple[bool, float, int], list[int]] = {}
    for i, world in enumerate(worlds):
        key = (bool(world.values.get("split", 0.0)), world.dt, len(world.reference))
        groups.setdefault(key, []).append(i)
    found: dict[int, Trace] = {}
    work = {key: key[1] * key[2] * (2 if key[0] else 1) for key in groups}  # whatever the number of machines
    done = 0.0
    for key in sorted(groups):

        def report(share: float, before: float = done, part: float = work[key]) -> None:
            if progress is not None:
                progress((before + share * part) / sum(work.values()))

        steps = max(round(substeps * key[1] / 1e-3), 1)
        traces = _simulate([worlds[i] for i in groups[key]], steps, report)
        found |= dict(zip(groups[key], traces, strict=True))
        done += work[key]
    return [found[i] for i in range(len(worlds))]


def _simulate(worlds: list[World], substeps: int, progress: Callable[[float], None]) -> list[Trace]:
    plant = Plant(worlds)
    p, dt = plant.p, worlds[0].dt
    step, count, periods = dt / substeps, len(worlds), len(worlds[0].reference)
    actuator = Actuator(plant, step)
    reference = np.stack([world.reference for world in worlds])
    slope = np.gradient(reference, dt, axis=1)
    aimed = reference
    if "forward_ahead" in plant.has:
        change = np.diff(reference, axis=1, append=reference[:, -1:])
        slope = slope + p["forward_ahead"][:, None] * (change / dt - slope)
        aimed = reference + 0.5 * p["forward_ahead"][:, None] * change
    # Position reference of a cascade: the integral of the velocity reference up to this sample.
    wanted = p["start"][:, None] + np.cumsum(reference, axis=1) * dt - reference * dt
    normals = np.stack([np.random.default_rng(world.seed).normal(size=(3, periods)) for world in worlds], axis=1)
    push = np.stack([np.zeros(periods) if w.push is None else w.push for w in worlds])
    lost = np.stack([np.zeros(periods, bool) if w.lost_commands is None else w.lost_commands for w in worlds])
    out = {name: np.zeros((periods, count)) for name in RECORDED}
    inner = {name: np.zeros((periods, count)) for name in plant.inside()}
    owners = {name: plant.split if name in OF_TWO else p["load_friction"] > 0 for name in inner}
    lanes = np.arange(count)
    history = np.zeros((HISTORY * substeps, count))
    seen = np.zeros(count)
    slow = [np.zeros(count), np.zeros(count)]
    keep = [np.where(p[n] > 0, np.exp(-step / np.maximum(p[n], 1e-9)), 0.0) for n in ("rate_pole_1", "rate_pole_2")]
    counts = np.tile(np.floor(p["start"] / p["encoder_step"]) * p["encoder_step"], (64, 1))
    integral = derived = np.zeros(count)
    commands = np.zeros((HISTORY, count))  # newest at [number % HISTORY]
    smooth = np.where(p["filter"] > 0, np.exp(-dt / np.maximum(p["filter"], 1e-9)), 0.0)
    measures = np.array([world.measured for world in worlds])
    on_load = (p["sensor_on_load"] > 0) & plant.split
    arrives = p["delay"] / step  # in steps; a step in which the command switches takes the weighted mean
    whole = np.floor(arrives)
    number = 0
    for k in range(periods):
        time = k * dt
        source = np.where(on_load, plant.position[-1], plant.position[0])
        speed = np.where(on_load, plant.velocity[-1], plant.velocity[0])
        read = seen if k else speed
        rate = rounded(p["rate_scale"] * read + p["rate_bias"] + p["rate_noise"] * normals[0, :, k], p["rate_step"])
        encoder = p["encoder_step"] * np.floor((source + p["encoder_noise"] * normals[1, :, k]) / p["encoder_step"])
        counts[k % 64] = encoder
        # Difference over `average` periods, then a first-order filter: how a drive derives its velocity.
        span = p["average"].astype(np.intp)
        change = encoder - counts[(k - span) % 64, lanes]
        derived = change / (span * dt) + (derived - change / (span * dt)) * smooth
        used = np.where(p["reads_rate"] > 0, rate, derived)
        target = reference[:, k] + p["position_gain"] * (wanted[:, k] - encoder) * (p["position_gain"] > 0)
        error = target - used
        forward = p["forward_coulomb"] * np.tanh(aimed[:, k] / p["forward_speed"]) + p["forward_viscous"] * aimed[:, k]
        command = p["kp"] * error + integral + forward + p["forward_inertia"] * slope[:, k]
        # Anti-windup: the integral stands still while the drive is at its rating.
        held = np.clip(command, -p["rating"], p["rating"])
        integral = integral + p["ki"] * dt * error * (held == command)
        command = rounded(held, p["torque_step"])
        # A lost command is in the log as sent; the drive keeps the last one that arrived.
        commands[k % HISTORY] = np.where(lost[:, k], commands[(k - 1) % HISTORY], command)
        for name, value in plant.inside().items():
            inner[name][k] = value
        applied = np.zeros(count)
        for i in range(substeps):
            # The command that has arrived: period k minus the dead time, interpolated where it switches in the step.
            place = k * substeps + i - whole
            now = commands[np.floor(place / substeps).astype(np.intp) % HISTORY, lanes]
            before = commands[np.floor((place - 1) / substeps).astype(np.intp) % HISTORY, lanes]
            torque = actuator.torque(now + (arrives - whole) * (before - now), time + i * step)
            applied += torque / substeps
            plant.step(torque + push[:, k], time + (i + 0.5) * step, step)
            history[number % len(history)] = np.where(on_load, plant.velocity[-1], plant.velocity[0])
            # Dead time of the sensor in steps, interpolated between two of them.
            back = p["rate_delay"] / step
            lower = np.floor(back).astype(np.intp)
            one = history[(number - lower) % len(history), lanes]
            two = history[(number - lower - 1) % len(history), lanes]
            seen = one + (back - lower) * (two - one)
            for j, decay in enumerate(keep):
                slow[j] = seen + (slow[j] - seen) * decay
                seen = slow[j]
            number += 1
        logged = np.where(measures, rounded(applied + p["torque_noise"] * normals[2, :, k], p["torque_step"]), command)
        row = (logged, command, rate, encoder, derived, speed, source)
        for name, value in zip(RECORDED, row, strict=True):
            out[name][k] = value
        if k % 100 == 0:
            progress(k / periods)
    stamps = np.arange(periods) * dt
    return [
        Trace(
            time=stamps,
            reference=reference[i],
            position_reference=wanted[i],
            **{name: np.ascontiguousarray(values[:, i]) for name, values in out.items()},
            **{name: np.ascontiguousarray(values[:, i]) for name, values in inner.items() if owners[name][i]},
        )
        for i in range(count)
    ]


RECORDED = ("torque", "command", "rate", "position", "derived", "true_velocity", "true_position")
OF_TWO = ("twist", "twist_rate", "transmitted")
