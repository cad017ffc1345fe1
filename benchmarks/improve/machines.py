"""Machines of the withheld generator in closed loop with given gains: their log, and what the gains come to."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fpjax.improvement.judge import LONGEST_SETTLING, SETTLING

from ..withheld import first
from ..withheld.identity import Identity
from ..withheld.truth.integrate import SUBSTEPS, simulate
from ..withheld.truth.machine import Machine, Record

# The gains that the truth's own drive has, by the words of servo.toml.
DRIVE = {
    "controller.kp": "kp",
    "controller.ki": "ki",
    "feedforward.inertia": "forward_inertia",
    "feedforward.coulomb": "forward_coulomb",
    "feedforward.viscous": "forward_viscous",
}
CONTROLLER = {"controller.kp": (0.5, 2.5), "controller.ki": (0.25, 5.0)}  # of the gains that run
FORWARD = {"inertia": 1.5, "coulomb": 2.0, "viscous": 3.0}  # of the nominal values
TURNING = 0.02  # of the machine's speed: where a feed-forward turns round, for machines that had none

Gains = dict[str, float]


@dataclass
class Truth:
    """One true machine.

    Attributes:
        identity: of the case.
        case: the generator's.
        now: the gains that run when the log is recorded, by the file's words.
        bounds: (low, high) of each.
    """

    identity: Identity
    case: first.Case
    now: Gains
    bounds: dict[str, tuple[float, float]]


def build(identity: Identity, periods: int) -> Truth:
    """A machine, and between which values its gains may be tuned: the same for every way of tuning."""
    case = first.build(identity, periods)
    physics, nominal = case.machine.physics, case.plan.nominal
    physics.setdefault("forward_velocity", TURNING * case.plan.draw.kind.speed)
    now = {word: float(physics.get(name, 0.0)) for word, name in DRIVE.items()}
    bounds = {word: (low * now[word], high * now[word]) for word, (low, high) in CONTROLLER.items()}
    for key, factor in FORWARD.items():
        word = f"feedforward.{key}"
        bounds[word] = (0.0, max(factor * nominal[key], 1.2 * now[word]))
    return Truth(identity, case, now, bounds)


def run(
    machines: Sequence[tuple[Truth, Gains]], substeps: int = SUBSTEPS, seconds: float | None = None
) -> list[Record]:
    """Closed loops of true machines with given gains, side by side.

    Args:
        machines: each with its gains.
        substeps: of the integrator in a period.
        seconds: of the log that is run; None for all of it.
    """
    wanted: list[Machine] = []
    for true, gains in machines:
        machine = true.case.machine
        physics = machine.physics | {DRIVE[word]: value for word, value in gains.items()}
        count = len(machine.reference)
        if seconds is not None:
            count = min(count, machine.preroll + math.ceil(seconds / machine.dt))

        def cut(values: np.ndarray | None, count: int = count) -> np.ndarray | None:
            return None if values is None else values[: count + 1]

        wanted.append(
            dataclasses.replace(
                machine, physics=physics, reference=machine.reference[:count],
                velocity_normal=machine.velocity_normal[:count], position_normal=machine.position_normal[:count],
                disturbance=cut(machine.disturbance),
                held_reading=None if machine.held_reading is None else machine.held_reading[:count],
                held_command=None if machine.held_command is None else machine.held_command[:count],
            )
        )  # fmt: skip
    with np.errstate(all="ignore"):  # gains that no machine stands are part of a search
        return simulate(wanted, substeps=substeps)


def error(record: Record) -> float:
    """Rms of reference less true velocity where `improve` counts it [rad/s]; infinite where the loop is none."""
    start = min(SETTLING * len(record.time) * (record.time[1] - record.time[0]), LONGEST_SETTLING)
    left = (record.reference - record.true_velocity)[record.time >= start]
    value = float(np.sqrt(np.mean(np.square(left))))
    return value if math.isfinite(value) and value < 100.0 * float(np.std(record.reference)) else math.inf


def rough(record: Record) -> float:
    """Size of the torque's second difference [N m], as `improve` counts it."""
    return float(np.mean(np.abs(np.diff(record.torque, n=2)) ** 0.25) ** 4)


def write(folder: Path, true: Truth, record: Record) -> None:
    """log.csv and servo.toml: the nominal model with the drive's own law, and the bounds of its gains."""
    first.write(folder, true.case, record)
    path = folder / "servo.toml"
    forward = "".join(f"{word.partition('.')[2]} = {v:.9g}\n" for word, v in true.now.items() if "forward" in word)
    speed = true.case.machine.physics["forward_velocity"]
    bounds = "".join(f"{word} = [{low:.9g}, {high:.9g}]\n" for word, (low, high) in true.bounds.items())
    path.write_text(f"{path.read_text()}[feedforward]\n{forward}speed = {speed:.9g}\n[bounds]\n{bounds}")


Tell = Callable[[float], None]
