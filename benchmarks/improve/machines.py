"""Machines of both withheld generators in closed loop with given gains: their logs and tracking errors."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from fpjax.improvement.judge import LONGEST_SETTLING, SETTLING
from fpjax.improvement.search import ROUGHEST, SMOOTH
from fpjax.improvement.torque_limit import HARDEST
from fpjax.output.json_object import JsonObject

from ..withheld.identity import Identity
from .first import First, run_first
from .second import Second, finish_second, run_second

# Bounds of the tuned gains, the same for every way of tuning: multiples of the recorded gains for the controller, from
# zero to multiples of the nominal values for the feed-forward.
CONTROLLER = {"controller.kp": (0.5, 2.5), "controller.ki": (0.25, 5.0)}
FORWARD = {"inertia": 1.5, "coulomb": 2.0, "viscous": 3.0}

Gains = dict[str, float]


class Record(Protocol):
    """A run of the true machine, one row for each control period."""

    time: np.ndarray
    reference: np.ndarray
    torque: np.ndarray
    true_velocity: np.ndarray


class Truth(NamedTuple):
    """One true machine.

    Attributes:
        identity: of the case.
        case: the generator's.
        now: the gains with which the log is recorded, by the keys of servo.toml.
        bounds: (low, high) of each.
        rating: the drive's largest torque, which the model file tells [N m]; None where nothing is told of it.
    """

    identity: Identity
    case: First | Second
    now: Gains
    bounds: dict[str, tuple[float, float]]
    rating: float | None


def build(identity: Identity, periods: int, drawn: JsonObject | None = None) -> Truth:
    """A machine, and the bounds of its gains: the same for every way of tuning.

    Args:
        identity: of the case.
        periods: of its log.
        drawn: what `settled` returned for it before.
    """
    case = First(identity, periods) if identity.truth == 1 else Second(identity, periods, drawn)
    now, nominal = case.now(), case.nominal
    bounds = {word: (low * now[word], high * now[word]) for word, (low, high) in CONTROLLER.items()}
    for key, factor in FORWARD.items():
        word = f"feedforward.{key}"
        bounds[word] = (0.0, max(factor * nominal[key], 1.2 * now[word]))
    return Truth(identity, case, now, bounds, case.rating)


def settled(wanted: Sequence[Identity], periods: int) -> list[JsonObject]:
    """What is needed beside the identity to build each machine again: the accepted draw of the second generator."""
    two = [one for one in wanted if one.truth == 2]
    found = dict(zip(two, finish_second(two, periods), strict=True)) if two else {}
    return [found.get(one, {}) for one in wanted]


def run(
    machines: Sequence[tuple[Truth, Gains]], substeps: int | None = None, seconds: float | None = None
) -> list[Record]:
    """Closed loops of true machines with given gains, side by side.

    Args:
        machines: each with its gains.
        substeps: of the integrator in a period of 1 ms; None for the generator's own.
        seconds: of the log that is run; None for all of it.
    """
    found: dict[int, Record] = {}
    for kind, simulate in ((First, run_first), (Second, run_second)):
        places = [i for i, (true, _) in enumerate(machines) if isinstance(true.case, kind)]
        if places:
            some: Any = [(machines[i][0].case, machines[i][1]) for i in places]
            with np.errstate(all="ignore"):  # unstable loops are a part of any search
                found |= dict(zip(places, simulate(some, substeps, seconds), strict=True))
    return [found[i] for i in range(len(machines))]


def error(record: Record) -> float:
    """Rms of reference minus true velocity, after the settling time that `improve` uses [rad/s].

    Infinite for an unstable loop: not finite, or a hundred times the size of the reference.
    """
    left = (record.reference - record.true_velocity)[record.time >= _start(record)]
    value = float(np.sqrt(np.mean(np.square(left))))
    return value if math.isfinite(value) and value < 100.0 * float(np.std(record.reference)) else math.inf


def rough(record: Record) -> float:
    """Roughness of the torque [N m], as `improve` defines it: the power mean of exponent 1/4 of its second difference.

    The low exponent measures noise that is always there, not the few steps at reversals.
    """
    return float(np.mean(np.abs(np.diff(record.torque, n=2)) ** 0.25) ** 4)


def peak(record: Record) -> float:
    """Largest commanded torque after the settling time [N m]."""
    return float(np.max(np.abs(record.torque[record.time >= _start(record)])))


def shares_of_allowed(record: Record, now: Record, rating: float | None) -> dict[str, float]:
    """Roughness and peak of a torque over what `improve` allows of each [1]; infinite for a loop that is none.

    Args:
        record: with other gains.
        now: with the gains that ran.
        rating: the drive's largest torque, where the model file tells it [N m].
    """
    # A roughness that no motor hears is allowed in any case, as in `improve`.
    smooth = max(rough(now), SMOOTH * float(np.sqrt(np.mean(np.square(now.torque)))))
    most = HARDEST * peak(now) if rating is None else rating
    found = {"roughness": rough(record) / (ROUGHEST * smooth), "peak": peak(record) / most}
    return {name: one if math.isfinite(one) else math.inf for name, one in found.items()}


def _start(record: Record) -> float:
    """Time from which errors count [s]."""
    length = len(record.time) * (record.time[1] - record.time[0])
    return LONGEST_SETTLING if length > 2.0 * LONGEST_SETTLING else SETTLING * length


def write(folder: Path, true: Truth, record: Any) -> None:
    """log.csv and servo.toml: the nominal model with the drive's own law, and the bounds of its gains."""
    true.case.write(folder, record)
    path = folder / "servo.toml"
    forward = "".join(f"{word.partition('.')[2]} = {v:.9g}\n" for word, v in true.now.items() if "forward" in word)
    bounds = "".join(f"{word} = [{low:.9g}, {high:.9g}]\n" for word, (low, high) in true.bounds.items())
    limits = "" if true.rating is None else f"[limits]\ntorque = {true.rating:.9g}\n"
    path.write_text(
        f"{path.read_text()}[feedforward]\n{forward}speed = {true.case.turning:.9g}\n[bounds]\n{bounds}{limits}"
    )
