"""A machine of the first generator, whose drive can be given other gains."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

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
TURNING = 0.02  # speed scale of the feed-forward's tanh over the machine's speed, for machines without one


class First:
    """One machine."""

    def __init__(self, identity: Identity, periods: int):
        self.case = first.build(identity, periods)
        physics = self.case.machine.physics
        physics.setdefault("forward_velocity", TURNING * self.case.plan.draw.kind.speed)
        physics["forward_ahead"] = 1.0  # the feed-forward law of servo.toml and of the exported code

    @property
    def nominal(self) -> dict[str, float]:
        """Inertia, coulomb and viscous of the nominal model."""
        return self.case.plan.nominal

    @property
    def turning(self) -> float:
        """Speed scale of the tanh of the drive's friction feed-forward [rad/s]."""
        return self.case.machine.physics["forward_velocity"]

    @property
    def rating(self) -> float | None:
        """None: nothing is told of what this drive can give, as in a file that nobody filled in."""
        return None

    def now(self) -> dict[str, float]:
        """The gains with which the log is recorded, by the keys of servo.toml."""
        return {word: float(self.case.machine.physics.get(name, 0.0)) for word, name in DRIVE.items()}

    def write(self, folder: Path, record: Record) -> None:
        """log.csv and servo.toml."""
        first.write(folder, self.case, record)


def run_first(
    machines: Sequence[tuple[First, dict[str, float]]], substeps: int | None, seconds: float | None
) -> list[Record]:
    """Closed loops with given gains."""
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
    return simulate(wanted, substeps=SUBSTEPS if substeps is None else substeps)
