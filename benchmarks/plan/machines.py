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

# The first log is made ambiguous: short, one speed in one direction, a short travel, an encoder only.
# To and fro at one speed 2 s decide ten of sixteen machines (development seed 12): each reversal shows a friction.
FIRST = 2.0  # length of the first log [s]
SHORT = 0.3  # its travel [rad]
REST, EDGE = 0.2, 0.03  # rest before and after it, and width of the ends of its speed [s]
SLOWEST = 1.0  # lowest frequency of a motion to and fro [Hz]
HABIT_SHARE, HABIT_TRAVEL = 0.3, 0.5  # of the run by habit, which goes faster and further than the first log
EFFECTS = (
    "quadratic_drag", "stribeck", "cogging", "viscous_error", "position_dependent_friction", "unbalance",
    "presliding", "actuator_lag", "compliance", "torque_dead_zone", "friction_drift", "constant_torque",
    "asymmetric_friction", "backlash", "inertia_error", "coulomb_error",
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
    """One stroke at one speed [rad/s], `FIRST` long; the same for every machine that is fast enough."""
    time = _clock(FIRST)
    speed = min(SHORT / (FIRST - 2.0 * REST), KINDS[case.identity.system].speed)
    return 0.5 * speed * (np.tanh((time - REST) / EDGE) - np.tanh((time - FIRST + REST) / EDGE))


def generic_reference(case: first.Case, length: float) -> np.ndarray:
    """What one records as a rule: a sine at 0.3 of the top speed over half a radian [rad/s].

    Args:
        case: of the machine.
        length: of the run [s].
    """
    time, speed = _clock(length), HABIT_SHARE * KINDS[case.identity.system].speed
    return speed * np.sin(2.0 * np.pi * laps_of(speed, HABIT_TRAVEL) * time)


def laps_of(speed: float, travel: float) -> float:
    """Frequency of a motion to and fro that keeps a travel [Hz].

    Args:
        speed: its largest [rad/s].
        travel: its largest [rad]; less where the lowest frequency allows no more.
    """
    return max(SLOWEST, 0.5 * speed / travel)


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
