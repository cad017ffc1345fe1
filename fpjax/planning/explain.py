"""Explanations: from which part of a run its evidence comes, and one sentence for each pair of rivals."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..gap.effects.experiments import PLAINEST, SIGNATURE, TELLS, experiment_for, family_of
from .answer import MATERIAL, NEEDED, Separation
from .measurement_model import MeasurementModel
from .trial import RunComparison

REST, FAST = 0.1, 0.5  # shares of the top speed below and above which a sample counts as a reversal and as fast
HARD = 0.5  # share of the largest acceleration above which a sample counts as hard acceleration

BY_MOTION = (
    "limit", "time", "angle", "rest", "load", "speed", "inertia", "late_actuator", "constant", "direction",
)  # fmt: skip
"""Families of effects that a motion alone can show, the plainest first."""

BESIDE = {
    "gain": "a known torque: a weight on a lever, or a known mass or inertia added",
    "reading": "a second sensor: the encoder position beside the rate sensor, or a known turn",
    "late_sensor": "a second sensor: the encoder position beside the rate sensor",
    "late_actuator": "a second sensor: the encoder position beside the rate sensor, or the measured motor current",
    "transmission": "a second sensor: an encoder on the load beside the one on the motor",
    "constant": "a release at rest with the drive off",
    "direction": "a release at rest with the drive off",
}
"""What separates exact twins, which no run does, by the family of either."""


def kinds_of_samples(
    measurement: MeasurementModel, speed: np.ndarray, acceleration: np.ndarray, unit: str
) -> np.ndarray:
    """The kind of motion at each sample of the windows, in words, shape (samples, windows).

    Args:
        measurement: gives the windows.
        speed: of the motion [rad/s], shape (samples of the run,).
        acceleration: of the motion [rad/s^2], shape (samples of the run,).
        unit: of the speed.
    """
    top, hard = float(np.max(np.abs(speed))), float(np.max(np.abs(acceleration)))
    at = measurement.starts[None, :] + np.arange(measurement.samples)[:, None]
    v, a = np.abs(speed[at]) / top, np.abs(acceleration[at]) / hard
    kinds = np.full(at.shape, f"speeds from {REST * top:.2g} to {FAST * top:.2g} {unit}", dtype=object)
    # Later lines win: a reversal is a reversal whatever its acceleration.
    kinds[a > HARD] = "hard acceleration"
    kinds[v > FAST] = f"speeds above {FAST * top:.2g} {unit}"
    kinds[v < REST] = f"reversals, below {REST * top:.2g} {unit}"
    return kinds


def where_from(measurement: MeasurementModel, kinds: np.ndarray, left: np.ndarray) -> str:
    """The part of the run from which most of the evidence comes, in words.

    Args:
        measurement: gives the modes.
        kinds: from `kinds_of_samples`.
        left: the remaining misfit, in standard deviations, shape (modes, windows).
    """
    modes = measurement.modes
    if np.sum(left[modes.sensor] ** 2) > 0.5 * np.sum(left**2):
        return "most of it from the two sensors' disagreement"
    # `left` is in turned coefficients: turned back, or the samples of half an octave would be mixed.
    torque = np.where(modes.sensor[:, None], 0.0, modes.plain(left.T).T)
    # From modes back to samples: the square of the missed torque over its deviation, shape (samples, windows).
    course = (modes.torque @ torque) ** 2
    total = max(float(np.sum(course)), 1e-300)
    shares = {kind: float(np.sum(course[kinds == kind])) / total for kind in np.unique(kinds)}
    largest = max(shares, key=lambda kind: shares[kind])
    energy = np.cumsum(np.sum(torque**2, axis=1)) / max(float(np.sum(torque**2)), 1e-300)
    # The frequency below which half of the misfit's energy lies.
    middle = float(modes.frequency[~modes.sensor][np.searchsorted(energy[~modes.sensor], 0.5)])
    return f"{100 * shares[largest]:.0f} % of it from {largest}, half of it above {middle:.2g} Hz"


def not_visible(
    nats: float, share: float | None, *, nowhere: bool, nearest: str = "", apart: float = float("nan")
) -> str:
    """Why a run does not make an effect of the size in plan.json visible; "" where it does.

    Args:
        nats: that it brings.
        share: of the commanded torque that the effect's is [1]; None for an error of a reading.
        nowhere: no motion that was tried shows it.
        nearest: the effect that is hardest to tell from it.
        apart: evidence over that effect [nats]; NaN where there is none.
    """
    if nowhere and nats < NEEDED:
        return (
            "no motion that was tried within the limits reaches where it begins; an effect of this size needs a larger "
            "torque, speed or travel, or does no harm within them."
        )
    if nats < NEEDED:
        return f"the evidence stays below the {NEEDED:g} nats that are needed: a longer run shows more."
    if share is not None and share < MATERIAL:
        return (
            f"its torque is less than {MATERIAL:.1%} of what this run commands, which the diagnosis calls no gap: it "
            "shows where friction and not acceleration takes the torque."
        )
    if apart < NEEDED:
        return (
            f"{nearest.replace('_', ' ')} would make nearly the same log (less than the {NEEDED:g} nats apart that are "
            "needed): other speeds or a longer travel tell the two apart."
        )
    return ""


def separations(
    names: Sequence[str], comparisons: Sequence[RunComparison], nats: np.ndarray, wheres: Sequence[str],
    twins: Mapping[frozenset[str], str],
) -> tuple[Separation, ...]:  # fmt: skip
    """Every pair of rivals with the expected evidence between them, the smallest first, exact twins last.

    Args:
        names: of the variants.
        comparisons: of the trial.
        nats: of each comparison, shape (comparisons,).
        wheres: of each comparison, from `where_from`.
        twins: pairs that no run separates.
    """
    # Each pair is compared in both directions; the direction of smaller evidence counts.
    pairs: dict[tuple[str, str], int] = {}
    for index, one in enumerate(comparisons):
        low, high = sorted((one.log, one.model))
        pair = names[low], names[high]
        if pair not in pairs or nats[index] < nats[pairs[pair]]:
            pairs[pair] = index
    found = [_separation(pair, float(nats[i]), wheres[i], twins.get(frozenset(pair), "")) for pair, i in pairs.items()]
    return tuple(sorted(found, key=lambda one: (one.twins, one.nats)))


def _separation(pair: tuple[str, str], nats: float, where: str, twin: str) -> Separation:
    first, second = (name.replace("_", " ") for name in pair)
    experiment = experiment_for(*pair).do
    families = [family_of(name) for name in pair]
    if twin:
        sentence = (
            f"{first} and {second} are exact twins, inseparable by any run with these sensors ({twin.rstrip('.')}); "
            f"what separates them is {beside(pair)}."
        )
        return Separation(pair, float("nan"), True, "", experiment, sentence)
    chosen = next((family for family in BY_MOTION if family in families), None)
    alike = chosen is None or families[0] == families[1]
    why = "the two differ in shape" if alike or chosen is None else TELLS[chosen]
    told = f"{first} and {second}: with this run the two differ by {nats:.3g} nats, {NEEDED:g} needed"
    if nats >= NEEDED:
        sentence = f"{told}; because {why}: {where}."
    else:
        sentence = f"{told}: it will not decide between them. {experiment}"
    return Separation(pair, nats, False, where, experiment, sentence)


def beside(pair: tuple[str, str]) -> str:
    """What separates two exact twins: a sensor or a known torque, not a motion."""
    families = [family_of(name) for name in pair]
    for family in PLAINEST:
        if family in families and family in BESIDE:
            return BESIDE[family]
    chosen = next((family for family in PLAINEST if family in families), None)
    return "another experiment" if chosen is None else SIGNATURE[chosen][0].lower() + SIGNATURE[chosen][1:]
