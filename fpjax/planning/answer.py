"""The run to record next and what it is expected to show, as data; `plan.json` is its `to_dict`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..gap.thresholds import THRESHOLDS
from ..output.json_object import JsonObject
from .limits import Limits

NEEDED = THRESHOLDS.sure  # [nats] lead that a cause needs before the diagnosis asserts it
MATERIAL = THRESHOLDS.nothing  # [1] share of the commanded torque below which a missing torque counts as no gap


@dataclass(frozen=True)
class Visible:
    """An effect, and the evidence for it that the run would bring if the machine had it.

    Attributes:
        effect: its name in the vocabulary.
        size: its parameters by name: (value, unit).
        nats: expected log evidence over the nominal model with its parameters and an offset free; NaN for a twin.
        share: the torque that the nominal model lacks over the rms of the commanded torque [1]; NaN for a twin and for
            an error of a reading, which makes no torque.
        twin: why no run can show it; "" where a run can.
        unseen: why this run does not show it; "" where it does, and for a twin.
        nearest: the effect that is hardest to tell from it; "" where none can be told from it or it was not looked at.
        apart: expected log evidence over a model with that effect at any size instead [nats]; NaN without one.
    """

    effect: str
    size: dict[str, tuple[float, str]]
    nats: float
    share: float = math.nan
    twin: str = ""
    unseen: str = ""
    nearest: str = ""
    apart: float = math.nan

    @property
    def shown(self) -> bool:
        """Whether the run is expected to show it."""
        return not self.twin and not self.unseen

    def to_dict(self) -> JsonObject:
        """By name; both numbers are None for a twin, the share for an error of a reading."""
        size = {name: {"value": value, "unit": unit} for name, (value, unit) in self.size.items()}
        nats, share, apart = (value if math.isfinite(value) else None for value in (self.nats, self.share, self.apart))
        return {
            "effect": self.effect, "size": size, "nats": nats, "share": share, "shown": self.shown, "twin": self.twin,
            "unseen": self.unseen, "nearest": self.nearest, "apart": apart,
        }  # fmt: skip


@dataclass(frozen=True)
class Separation:
    """Two rivals and the evidence between them that the run would bring.

    Attributes:
        between: their names.
        nats: expected log evidence between them, the smaller of the two directions; NaN for exact twins.
        twins: whether no run with these sensors can separate them.
        where: the part of the run from which most of the evidence comes.
        experiment: an experiment that a person could do besides this run.
        sentence: a summary for the user.
    """

    between: tuple[str, str]
    nats: float
    twins: bool
    where: str
    experiment: str
    sentence: str

    @property
    def separated(self) -> bool:
        """Whether the run is expected to decide between them."""
        return not self.twins and self.nats >= NEEDED

    def to_dict(self) -> JsonObject:
        """By name; `nats` is None for twins."""
        nats = None if self.twins else self.nats
        return {
            "between": list(self.between), "nats": nats, "needed": NEEDED, "twins": self.twins,
            "separated": self.separated, "where": self.where, "experiment": self.experiment, "sentence": self.sentence,
        }  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """A run within the limits of the machine, as data; `fpjax.planning.Plan` also prints and plots it.

    Attributes:
        aim: "effects", to make every effect of the vocabulary visible, or "rivals", to separate causes between which a
            diagnosis could not decide.
        time: [s], shape (samples,).
        reference: for the drive [rad/s], or [rad] from its present position, shape (samples,).
        motion: the planned "speed" [rad/s], "acceleration" [rad/s^2] and "position" [rad], each of shape (samples,).
        torque: torque of the nominal machine on this run [N m], shape (samples,).
        limits: the limits of the run.
        visible: the effects of the vocabulary, the least visible first, what the run does not show and twins last; ()
            where the aim is "rivals".
        separations: pairs of rivals, the hardest to separate first; () where the aim is "effects".
        rivals: names of the rivals.
        missing: level of the missing torque that was assumed [N m].
        noise: noise standard deviations by sensor: "velocity" [rad/s], "position" [rad].
        position: whether the reference is a position.
        linear: whether the machine is linear, with units m and N.
        torque_unit: unit of the torque.
        model: name of the nominal model's file.
        evaluations: how many motions were tried, each with its gradient.
        gained: the smallest evidence over all comparisons, of the best start and of the plan, without those that no
            motion shows [nats].
        usual: of plain references, a "sine" and a "sweep" within the same limits: how many effects they show (or pairs
            of rivals they separate), and their smallest evidence [nats]; empty after an interrupt.
        ended: "converged", "time" or "interrupted".
        notes: choices made for the user, a sentence each.
        seconds: processor time by stage [s].
    """

    aim: Literal["effects", "rivals"]
    time: np.ndarray
    reference: np.ndarray
    motion: dict[str, np.ndarray]
    torque: np.ndarray
    limits: Limits
    visible: tuple[Visible, ...]
    separations: tuple[Separation, ...]
    rivals: tuple[str, ...]
    missing: float
    noise: dict[str, float]
    position: bool
    linear: bool
    torque_unit: str
    model: str
    evaluations: int
    gained: tuple[float, float]
    ended: str
    usual: dict[str, tuple[int, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def used(self) -> dict[str, float]:
        """Share of every limit that the motion uses [1]; a torque without a limit is left out."""
        limits = self.limits
        found = {
            "speed": float(np.max(np.abs(self.motion["speed"]))) / limits.speed,
            "acceleration": float(np.max(np.abs(self.motion["acceleration"]))) / limits.acceleration,
            "travel": float(np.ptp(self.motion["position"])) / limits.travel,
        }
        if np.isfinite(limits.torque):
            found["torque"] = float(np.max(np.abs(self.torque))) / limits.torque
        return found

    @property
    def decided(self) -> int:
        """Effects that the run is expected to show, or pairs of rivals that it separates."""
        return sum(one.shown for one in self.visible) + sum(one.separated for one in self.separations)

    def to_dict(self) -> JsonObject:
        """`plan.json`: numbers, strings, lists and dictionaries; the motion itself is in reference.csv."""
        return {
            "aim": self.aim,
            "model": self.model,
            "rivals": list(self.rivals),
            "limits": self.limits.to_dict(),
            "used": self.used,
            "reference": "position" if self.position else "velocity",
            "samples": len(self.time),
            "dt": float(self.time[1] - self.time[0]),
            "needed": NEEDED,
            "missing_torque": self.missing,
            "noise": self.noise,
            "visible": [one.to_dict() for one in self.visible],
            "separations": [one.to_dict() for one in self.separations],
            "evaluations": self.evaluations,
            "worst_nats": {
                "start": self.gained[0],
                "plan": self.gained[1],
                **{name: least for name, (_, least) in self.usual.items()},
            },
            "decided": {"plan": self.decided, **{name: count for name, (count, _) in self.usual.items()}},
            "ended": self.ended,
            "notes": list(self.notes),
            "seconds": {stage: round(spent, 3) for stage, spent in self.seconds.items()},
        }
