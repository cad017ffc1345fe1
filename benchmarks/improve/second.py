"""A machine of the second generator, whose drive can be given other gains."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

from fpjax.output.json_object import JsonObject

from ..withheld.identity import Identity
from ..withheld.second import cases, label
from ..withheld.second.simulate import SUBSTEPS, simulate
from ..withheld.second.world import Trace, World
from .first import DRIVE

TURNING = 0.03  # speed scale of the feed-forward's tanh over the machine's speed, as in the generator itself


class Second:
    """One machine; its drive follows a velocity with a rate sensor, as the nominal model's controller does.

    Args:
        identity: of the case.
        periods: of its log.
        drawn: `words` and `grow` of the accepted draw (`finish_second`); None for the first draw.
    """

    def __init__(self, identity: Identity, periods: int, drawn: JsonObject | None):
        drawn = drawn or {"words": f"{words_of(identity)}/0", "grow": 1.0}
        self.identity = identity
        self.case = cases.build(
            identity.seed, drawn["words"], identity.set, identity.sensors, identity.system, identity.effects, periods,
            drawn["grow"],
        )  # fmt: skip
        values = self.case.world.values
        values.setdefault("forward_speed", TURNING * self.case.plan.drawn.kind.speed)
        values["forward_ahead"] = 1.0  # the feed-forward law of servo.toml and of the exported code

    @property
    def nominal(self) -> dict[str, float]:
        """Inertia, coulomb and viscous of the nominal model."""
        return self.case.plan.nominal

    @property
    def turning(self) -> float:
        """Speed scale of the tanh of the drive's friction feed-forward, in the unit of the speed."""
        return self.case.world.values["forward_speed"]

    @property
    def rating(self) -> float | None:
        """The drive's largest torque, from its data sheet [N m]: the true drive limits its command there."""
        return float(self.case.world.values["rating"])

    def now(self) -> dict[str, float]:
        """The gains with which the log is recorded, by the keys of servo.toml."""
        return {word: float(self.case.world.values.get(name, 0.0)) for word, name in DRIVE.items()}

    def write(self, folder: Path, trace: Trace) -> None:
        """log.csv and servo.toml."""
        label.write(folder, self.case, trace, self.identity.sensors)


def words_of(one: Identity) -> str:
    """The words that a case is drawn from, beside its seed."""
    return f"{one.set}/{one.sensors}/{one.number}"


def finish_second(wanted: Sequence[Identity], periods: int) -> list[JsonObject]:
    """Words and size factor of the accepted draw of each case.

    The generator draws again until the effect is visible and the log is one that somebody would keep.
    """
    asked = [
        cases.Asked(one.seed, words_of(one), one.set, one.sensors, one.system, one.effects, one.recording)
        for one in wanted
    ]
    done = [case for case, _, _ in cases.run(asked, periods)]
    return [{"words": case.words, "grow": case.plan.grow} for case in done]


def run_second(
    machines: Sequence[tuple[Second, dict[str, float]]], substeps: int | None, seconds: float | None
) -> list[Trace]:
    """Closed loops with given gains."""
    wanted: list[World] = []
    for true, gains in machines:
        world = true.case.world
        count = len(world.reference) if seconds is None else min(len(world.reference), math.ceil(seconds / world.dt))
        wanted.append(
            dataclasses.replace(
                world, values=world.values | {DRIVE[word]: value for word, value in gains.items()},
                reference=world.reference[:count],
                push=None if world.push is None else world.push[:count],
                lost_commands=None if world.lost_commands is None else world.lost_commands[:count],
            )
        )  # fmt: skip
    return simulate(wanted, substeps=SUBSTEPS if substeps is None else substeps)
