"""Explain: from which part of a run its evidence comes, and one sentence a pair of rivals."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..gap.effects.experiments import PLAINEST, SIGNATURE, TELLS, experiment_for, family_of
from .result import NEEDED, Separation
from .sight import Sight
from .trial import Comparison

SLOW, FAST = 0.2, 0.6  # of the top speed
HARD = 0.5  # of the largest acceleration
HIGH = 0.5  # of the evidence above a frequency, to say so

BESIDE = {
    "gain": "a known torque: a weight on a lever, or a known mass or inertia added",
    "reading": "a second sensor: the encoder position beside the rate sensor, or a known turn",
    "late_sensor": "a second sensor: the encoder position beside the rate sensor",
    "late_actuator": "a second sensor: the encoder position beside the rate sensor, or the measured motor current",
    "transmission": "a second sensor: an encoder on the load beside the one on the motor",
    "constant": "a release at rest with the drive off",
    "direction": "a release at rest with the drive off",
}
"""What tells exact twins apart where no run does, by the family of either."""


def kinds_of_windows(
    sight: Sight, speed: np.ndarray, acceleration: np.ndarray, limits: tuple[float, float]
) -> list[str]:
    """What each window is like.

    Args:
        sight: where the windows lie.
        speed: of the motion [rad/s], shape (samples,).
        acceleration: [rad/s^2], shape (samples,).
        limits: largest (speed, acceleration) of the motion.
    """
    found = []
    for start in sight.starts:
        here = slice(start, start + sight.samples)
        v, a = np.abs(speed[here]) / limits[0], np.abs(acceleration[here]) / limits[1]
        turns = bool(np.any(np.diff(np.sign(speed[here])) != 0))
        if np.quantile(v, 0.9) < SLOW:
            found.append("slow reversals" if turns else "slow motion")
        elif turns:
            found.append("reversals")
        elif np.quantile(a, 0.75) > HARD:
            found.append("hard acceleration")
        else:
            found.append("fast motion" if np.median(v) > FAST else "steady motion")
    return found


def where_from(kinds: Sequence[str], windows: np.ndarray, bands: np.ndarray, frequencies: np.ndarray) -> str:
    """The part of the run that most of the evidence comes from, in words.

    Args:
        kinds: of the windows.
        windows: share of the evidence by window, shape (windows,).
        bands: by octave, shape (bands,).
        frequencies: lowest of each octave [Hz], shape (bands,).
    """
    shares: dict[str, float] = {}
    for kind, share in zip(kinds, windows, strict=True):
        shares[kind] = shares.get(kind, 0.0) + float(share)
    largest = max(shares, key=lambda kind: shares[kind])
    high = np.flatnonzero(np.cumsum(bands[::-1])[::-1] > HIGH)
    above = f", mostly above {frequencies[high[-1]]:.2g} Hz" if len(high) and high[-1] > 1 else ""
    return f"{100 * shares[largest]:.0f} % of it from {largest}{above}"


def separations(
    names: Sequence[str], comparisons: Sequence[Comparison], nats: np.ndarray, wheres: Sequence[str],
    twins: Mapping[frozenset[str], str],
) -> tuple[Separation, ...]:  # fmt: skip
    """Every pair of rivals with what the run brings, the nearest first, exact twins last.

    Args:
        names: of the variants.
        comparisons: of the trial.
        nats: of each comparison, shape (comparisons,).
        wheres: of each comparison, from `where_from`.
        twins: pairs that no run separates.
    """
    pairs: dict[tuple[str, str], int] = {}  # the comparison with the smaller evidence
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
            f"what tells them apart is {beside(pair)}."
        )
        return Separation(pair, float("nan"), True, "", experiment, sentence)
    chosen = next((family for family in PLAINEST if family in families), None)
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
