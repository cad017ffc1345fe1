"""The integrator: leapfrog with many substeps per control period and sticking as an event.

Positions (and bristles) move half a substep, then the velocities are changed over a whole one, then
positions again: second order where friction is smooth. Within a kick a velocity that would change
sign stops at the crossing; the rest of the substep starts from rest, where friction takes up to
its static level. No steepness, no regularisation. All machines of a group are stepped as vectors.
"""

from collections.abc import Callable

import numpy as np

from .actuator import Actuator
from .friction import MAXWELL_ELEMENTS, Friction, dahl_travel, maxwell_shares, soft
from .machine import Machine, Record, stack
from .sensor import VelocitySensor, rounded

SUBSTEPS = 50  # in each control period; the integration error is then below the noise of the sensors


class Body:
    """Inertias, friction and transmission of a group of machines of one kind."""

    def __init__(self, p: dict[str, np.ndarray]):
        self.p = p
        self.friction = Friction(p)
        count = len(p["inertia"])
        self.kind = int(p["bristle_kind"][0])
        self.two = bool(p["transmission"][0] > 0)
        self.play = self.two and bool(np.any(p["transmission"] == 2))
        self.inertia = p["inertia"] * (1 - p["load_share"])
        self.load_inertia = p["inertia"] * p["load_share"]
        self.share = 1 - p["friction_load_share"]
        self.position = p["start_position"].copy()
        self.load_position = self.position.copy()
        self.velocity, self.load_velocity = np.zeros(count), np.zeros(count)
        self.bristle = np.zeros((MAXWELL_ELEMENTS, count) if self.kind == 3 else count)
        self.lagging = self.position.copy()  # a position that follows through a backlash (play operator)
        self.cogs = bool(np.any(p["cogging"] != 0))
        self.unbalanced = bool(np.any(p["unbalance"] != 0) or np.any(p["known_unbalance"] != 0))
        self.hysteretic = bool(np.any(p["hysteresis"] != 0))
        self.offset = p["constant_torque"] - p["known_offset"]
        self.stiff_shares, strengths = maxwell_shares()
        self.yields = strengths / self.stiff_shares  # in units of C / k

    def drift(self, h: float) -> None:
        """Positions and bristles over a time h [s] at constant velocity."""
        self.position = self.position + h * self.velocity
        if self.two:
            self.load_position = self.load_position + h * self.load_velocity
        if self.kind == 1 or self.kind == 2:
            reach = self.reach()
            self.bristle = reach * dahl_travel(
                self.bristle / reach, h * self.velocity / reach, self.p["bristle_exponent"]
            )
        elif self.kind == 3:
            ends = self.yields * self.reach()
            self.bristle = np.clip(self.bristle + h * self.velocity, -ends, ends)
        if self.hysteretic:
            play = self.p["hysteresis_play"]
            self.lagging = np.clip(self.lagging, self.position - play, self.position + play)

    def reach(self) -> np.ndarray:
        """Deflection at which the bristles slide: level / stiffness [rad]."""
        level = self.friction.coulomb(self.velocity >= 0, self.change)
        if self.friction.stribeck:
            level = level + self.friction.near_rest(np.abs(self.velocity))
        return level / self.p["bristle_stiffness"]

    def held(self) -> np.ndarray | float:
        """Torques of the surroundings that depend on position, on the motor [N m]."""
        p, torque = self.p, 0.0
        if self.cogs:
            angle = p["cogging_periods"] * self.position + p["cogging_phase"]
            torque = p["cogging"] * np.sin(angle)
            torque = torque + p["cogging"] * p["cogging_second"] * np.sin(2 * angle + p["cogging_phase_second"])
        if self.hysteretic:
            stretch = self.lagging / p["hysteresis_width"]
            torque = torque + p["hysteresis"] * np.tanh(stretch)
        return torque

    def weight(self) -> np.ndarray | float:
        """Torque of unbalance, on the load where there is one [N m]."""
        if not self.unbalanced:
            return 0.0
        p, angle = self.p, self.load_position if self.two else self.position
        known = p["known_unbalance"] * np.sin(angle + p["known_unbalance_phase"])
        return p["unbalance"] * np.sin(angle + p["unbalance_phase"]) + known

    def bristle_friction(self, velocity: np.ndarray) -> np.ndarray:
        """Bristle torque, its damping and the smooth part [N m]."""
        p = self.p
        reach = self.reach()
        if self.kind == 3:
            force = p["bristle_stiffness"] * np.sum(self.stiff_shares * self.bristle, axis=0)
            free = np.mean(np.abs(self.bristle) < self.yields * reach, axis=0)
        else:
            force = p["bristle_stiffness"] * self.bristle
            relative = self.bristle / reach * np.where(velocity >= 0, 1.0, -1.0)
            free = np.maximum(1 - relative, 0.0) ** p["bristle_exponent"]
        # The damping acts on the rate of the bristle itself, which is zero once it slides.
        return force + p["bristle_damping"] * free * velocity + self.friction.smooth(velocity)

    def kick(self, torque: np.ndarray, h: float, time: float) -> None:
        """Velocities over a time h [s] under a motor torque [N m] at fixed positions."""
        self.change = self.friction.base(self.position, time)
        outer = torque + self.offset - self.held()
        if self.two:
            self.kick_two(outer, h)
        elif self.kind:
            outer = outer - self.weight()
            v = self.velocity
            # Midpoint rule: bristle damping depends on the velocity.
            half = v + h / 2 * (outer - self.bristle_friction(v)) / self.inertia
            self.velocity = v + h * (outer - self.bristle_friction(half)) / self.inertia
        else:
            outer = outer - self.weight()
            # The same for set-valued friction: the half step gives the velocity at which smooth friction is taken.
            half = self.stick_slip(self.velocity, outer, outer, h / 2, self.inertia, 1.0)
            self.velocity = self.stick_slip(self.velocity, outer, outer, h, self.inertia, 1.0, half)

    def coupling(self, speed: np.ndarray, h: float) -> np.ndarray:
        """Torque through the transmission at a relative speed [N m]; a contact never pulls."""
        p = self.p
        twist = self.position - self.load_position
        if not self.play:
            return p["stiffness"] * twist + p["damping"] * speed
        # Mean depth and share of the time in contact over the substep, around the twist at its middle: a
        # contact may then begin or end within a substep without a jump in torque.
        side = np.where(twist >= 0, 1.0, -1.0)
        depth = twist * side - p["gap"] / 2
        swing = np.maximum(np.abs(speed) * h / 2, 1e-30)
        share = np.clip(0.5 + depth / (2 * swing), 0.0, 1.0)
        pressed = np.where(share < 1, share * share * swing, depth)
        torque = p["stiffness"] * pressed + p["damping"] * share * speed * side
        return side * np.maximum(torque, 0.0)

    def kick_two(self, outer: np.ndarray, h: float) -> None:
        """`kick` for motor and load, with the coupling torque at the half step."""
        v, w = self.velocity, self.load_velocity
        weight = self.weight()
        through = self.coupling(v - w, h)
        motor, load, other = self.inertia, self.load_inertia, 1 - self.share
        v_half = self.stick_slip(v, outer - through, outer - through, h / 2, motor, self.share)
        w_half = self.stick_slip(w, through - weight, through - weight, h / 2, load, other)
        through = self.coupling(v_half - w_half, h)
        m, n = outer - through, through - weight
        self.velocity = self.stick_slip(v, m, m, h, motor, self.share, v_half)
        self.load_velocity = self.stick_slip(w, n, n, h, load, other, w_half)

    def stick_slip(
        self,
        v: np.ndarray,
        outer: np.ndarray,
        breaking: np.ndarray,
        h: float,
        inertia: np.ndarray,
        share: np.ndarray | float,
        half: np.ndarray | None = None,
    ) -> np.ndarray:
        """Velocity after h with set-valued friction; `half` is the velocity to take friction at.

        `outer` drives, `breaking` is the torque that friction has to hold at rest [N m].
        """
        friction = self.friction
        resting = v == 0
        forward = np.where(resting, breaking > 0, v > 0)
        sign = np.where(forward, 1.0, -1.0)
        at = v if half is None else half
        static = level = friction.coulomb(forward, self.change)
        if friction.stribeck:
            # A half-way velocity beyond zero counts as rest.
            level = static + friction.near_rest(np.maximum(at * sign, 0.0))
            static = static + friction.p["stribeck_torque"]
        drive = outer - share * (sign * level + friction.smooth(at))
        new = v + h * drive / inertia
        # At rest it stays unless the torque exceeds the static level; then it starts with the excess.
        holds = resting & (np.abs(breaking) <= share * static)
        new = np.where(holds, 0.0, new)
        crossing = ~resting & (new * sign < 0)
        if np.any(crossing):
            static = friction.coulomb(breaking > 0, self.change)
            if friction.stribeck:
                static = static + friction.p["stribeck_torque"]
            # Time left after the crossing of zero, by linear interpolation of the velocity.
            rest = h * new / np.where(crossing, new - v, 1.0)
            new = np.where(crossing, rest * soft(breaking, share * static) / inertia, new)
        return np.where(resting & (new * sign < 0), 0.0, new)


def group(p: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Indices of machines that are stepped together: rigid, LuGre and Dahl, Maxwell, two masses."""
    kind = np.where(p["bristle_kind"] == 3, 3, np.minimum(p["bristle_kind"], 1))
    key = np.where(p["transmission"] > 0, 10 + p["transmission"], kind)
    return [np.flatnonzero(key == value) for value in np.unique(key)]


def simulate(
    machines: list[Machine],
    substeps: int = SUBSTEPS,
    progress: Callable[[float], None] | None = None,
) -> list[Record]:
    """Run every machine's closed loop; references of one call have one length and one preroll."""
    p = stack(machines)
    groups = group(p)
    records: list[Record | None] = [None] * len(machines)
    for number, index in enumerate(groups):

        def report(share: float, number: int = number) -> None:
            if progress is not None:
                progress((number + share) / len(groups))

        members = [machines[i] for i in index]
        for i, record in zip(index, run_group(members, substeps, report), strict=True):
            records[i] = record
    return [record for record in records if record is not None]


def run_group(machines: list[Machine], substeps: int, progress: Callable[[float], None]) -> list[Record]:
    """Closed loop of one group: controller once per period, machine `substeps` times."""
    p = stack(machines)
    dt, preroll = machines[0].dt, machines[0].preroll
    h = dt / substeps
    reference = np.stack([m.reference for m in machines], axis=1)
    periods, count = reference.shape
    noise = np.stack([m.velocity_normal for m in machines], axis=1) * p["velocity_noise"]
    position_noise = np.stack([m.position_normal for m in machines], axis=1) * p["position_noise"]
    disturbance = None
    if any(m.disturbance is not None for m in machines):
        none = np.zeros(periods + 1)
        columns = [none if m.disturbance is None else m.disturbance for m in machines]
        disturbance = np.stack(columns, axis=1)
    held = [_mask([m.held_reading for m in machines], periods), _mask([m.held_command for m in machines], periods)]
    body, actuator = Body(p), Actuator(p, dt, substeps)
    body.change = body.friction.base(body.position, -1.0)
    sensor = VelocitySensor(p, dt, substeps)
    # Acceleration feed-forward by central differences: the drive knows its trajectory.
    slope = np.gradient(reference, dt, axis=0)
    aimed = reference
    if np.any(p["forward_ahead"]):
        change = np.diff(reference, axis=0, append=reference[-1:])
        slope = slope + p["forward_ahead"] * (change / dt - slope)
        aimed = reference + 0.5 * p["forward_ahead"] * change
    forward = p["forward_coulomb"] * np.tanh(aimed / p["forward_velocity"])
    forward = forward + p["forward_viscous"] * aimed + p["forward_inertia"] * slope
    integral, last_reading, last_sent = np.zeros(count), np.zeros(count), np.zeros(count)
    on_load = p["sensor_on_load"] > 0
    out = {
        name: np.zeros((periods, count))
        for name in ("torque", "velocity", "position", "true_velocity", "true_position")
    }
    for k in range(periods):
        velocity, position = body.velocity, body.position
        if body.two:
            velocity = np.where(on_load, body.load_velocity, velocity)
            position = np.where(on_load, body.load_position, position)
        reading = sensor.read(noise[k])
        if held[0] is not None:
            reading = np.where(held[0][k], last_reading, reading)
        last_reading = reading
        error = reference[k] - reading
        command = p["kp"] * error + integral + forward[k]
        integral = integral + p["ki"] * dt * error
        out["torque"][k], out["velocity"][k] = command, reading
        out["true_velocity"][k], out["true_position"][k] = velocity, position
        out["position"][k] = rounded(position + position_noise[k], p["position_step"])
        sent = command
        if held[1] is not None:
            sent = np.where(held[1][k], last_sent, command)
        last_sent = sent
        actuator.hold(sent)
        # Time zero is the first row of the log; the preroll lets transients of the start die out.
        start = (k - preroll) * dt
        body.drift(h / 2)
        for j in range(substeps):
            torque = actuator.torque(j)
            if disturbance is not None:
                share = (j + 0.5) / substeps
                torque = torque + (1 - share) * disturbance[k] + share * disturbance[k + 1]
            body.kick(torque, h, start + (j + 0.5) * h)
            body.drift(h if j < substeps - 1 else h / 2)
            if sensor.follows:
                seen = body.velocity
                if body.two:
                    seen = np.where(on_load, body.load_velocity, seen)
                sensor.follow(seen)
        if not sensor.follows:
            seen = body.velocity
            if body.two:
                seen = np.where(on_load, body.load_velocity, seen)
            sensor.follow(seen)
        if k % 100 == 99:
            progress((k + 1) / periods)
    time = np.arange(periods - preroll) * dt
    return [
        Record(
            time=time,
            reference=reference[preroll:, i],
            **{name: values[preroll:, i] for name, values in out.items()},
        )
        for i in range(count)
    ]


def _mask(masks: list[np.ndarray | None], periods: int) -> np.ndarray | None:
    if all(mask is None for mask in masks):
        return None
    return np.stack([np.zeros(periods, bool) if m is None else m for m in masks], axis=1)
