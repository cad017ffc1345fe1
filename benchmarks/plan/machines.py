"""Machines whose first log is ambiguous: a short travel, one speed, an encoder only; and second runs without a plan."""

import dataclasses
from pathlib import Path

import numpy as np

from fpjax.output.json_object import JsonObject

from ..withheld import first
from ..withheld.identity import Identity, identities
from ..withheld.truth.integrate import simulate
from ..withheld.truth.machine import Record
from ..withheld.truth.systems import KINDS

# The first log is made ambiguous: short, at one low speed, within a short travel, with an encoder only.
FIRST = 4.0  # length of the first log [s]
SHARE, SHORT = 0.3, 0.5  # its speed over the top speed [1], and its largest travel [rad]
SLOWEST = 1.0  # lowest frequency of its motion to and fro [Hz]
EFFECTS = (
    "quadratic_drag", "stribeck", "cogging", "viscous_error", "position_dependent_friction", "unbalance",
    "presliding", "actuator_lag", "compliance", "torque_dead_zone", "friction_drift", "constant_torque",
)  # fmt: skip
TRAVEL = 2.0 * np.pi  # of every machine in the second run [rad]
HEADROOM = 1.3  # torque limit over the torque that the withheld benchmark's own reference needs


def chosen(count: int, seed: int) -> list[Identity]:
    """One machine for each effect; the kinds of machines alternate, and are shifted from seed to seed.

    Args:
        count: how many.
        seed: of their draws.
    """
    alone = [one for one in identities(seed, 1) if one.set == "single" and one.sensors == "encoder"]
    systems, found = list(KINDS), []
    for number, effect in enumerate(EFFECTS[:count]):
        wanted = systems[(number + seed // 2) % len(systems)]
        found += [one for one in alone if one.effects == (effect,) and one.system == wanted]
    return found


def limits_of(case: first.Case, length: float) -> dict[str, float]:
    """The limits of the machine, as options of `fpjax plan`: speed, torque, travel, duration.

    Args:
        case: of the machine.
        length: of the run [s].
    """
    kind = KINDS[case.identity.system]
    return {"speed": kind.speed, "torque": HEADROOM * case.plan.peak, "travel": TRAVEL, "duration": length}


def _clock(length: float) -> np.ndarray:
    return np.arange(round(length / first.DT) + 1) * first.DT


def first_reference(case: first.Case) -> np.ndarray:
    """To and fro at one speed within a short travel [rad/s], `FIRST` long."""
    time, speed = _clock(FIRST), SHARE * KINDS[case.identity.system].speed
    laps = max(SLOWEST, 0.5 * speed / SHORT)
    return speed * np.tanh(4.0 * np.sin(2.0 * np.pi * laps * time))


def generic_reference(case: first.Case, length: float) -> np.ndarray:
    """What one records as a rule: a sine of the speed, frequency and about the travel of the first log [rad/s].

    Args:
        case: of the machine.
        length: of the run [s].
    """
    time, speed = _clock(length), SHARE * KINDS[case.identity.system].speed
    return speed * np.sin(2.0 * np.pi * max(SLOWEST, 0.5 * speed / SHORT) * time)


def sweep_reference(case: first.Case, length: float) -> np.ndarray:
    """The harder comparison: a sine sweep up to the machine's highest frequency, as large as the plan's own
    limits let it be [rad/s].

    Args:
        case: of the machine.
        length: of the run [s].
    """
    kind, limits, time = KINDS[case.identity.system], limits_of(case, length), _clock(length)
    low, high = 0.2, kind.highest
    wave = np.sin(2.0 * np.pi * (low * time + (high - low) * time**2 / (2.0 * time[-1])))
    nominal = case.plan.nominal
    most = (0.9 * limits["torque"] - nominal["coulomb"] - nominal["viscous"] * kind.speed) / nominal["inertia"]
    # Factors by which a sweep at full speed exceeds the torque (after friction), the travel, and the speed itself.
    over = (
        np.max(np.abs(np.gradient(wave, first.DT))) * kind.speed / most,
        np.ptp(np.cumsum(wave)) * first.DT * kind.speed / limits["travel"],
        1.0,
    )
    return kind.speed * wave / max(over)


def run(wanted: list[tuple[first.Case, np.ndarray, int]]) -> list[Record]:
    """The true machines on references that begin with the log; they stand still before.

    Args:
        wanted: of each run: its machine, its reference [rad/s], what its noise is drawn for.
    """
    machines = []
    for case, reference, purpose in wanted:
        rng = first.generator(case.identity, purpose)
        total = first.PREROLL + len(reference)
        whole = np.concatenate([np.zeros(first.PREROLL), reference])
        machines.append(
            dataclasses.replace(
                case.machine, reference=whole, velocity_normal=rng.normal(size=total),
                position_normal=rng.normal(size=total), disturbance=None, held_reading=None, held_command=None,
            )
        )  # fmt: skip
    return simulate(machines)


def write(place: Path, case: first.Case, record: Record) -> None:
    """log.csv and servo.toml; the log last, so that a folder with one is whole."""
    first.write(place / "partial", case, record)
    (place / "partial" / "servo.toml").replace(place / "servo.toml")
    (place / "partial" / "log.csv").replace(place / "log.csv")
    (place / "partial").rmdir()


def label_of(case: first.Case, record: Record) -> JsonObject:
    """The label of a case, as `score_case` reads it."""
    one = case.identity
    return first.label_of(case, record) | {
        "case": one.name, "truth": 1, "seed": one.seed, "half": "development", "set": one.set, "group": one.group,
        "sensors": one.sensors, "system": one.system, "effects": list(one.effects), "outside": None, "linear": False,
    }  # fmt: skip
