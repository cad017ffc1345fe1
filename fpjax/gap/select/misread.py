"""Misread: errors of the velocity column beside the causes of a verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..thresholds import Thresholds
from .readings import ROUNDING
from .statement import Seen, Verdict, is_number


def told_readings(found: Verdict, seen: Seen, t: Thresholds) -> tuple[str, ...]:
    """The readings' errors that are causes.

    Every column is rounded, and every sensor reads a little wrong. Where nothing else is amiss that is all there is;
    else a rounding is a cause if it matters as other causes do, or as another error of the reading must.

    Args:
        found: without the readings.
        seen: sizes.
        t: thresholds.
    """
    little = seen.misread.get(ROUNDING, np.inf) <= t.matters and seen.rounded <= t.reading
    slight = seen.slight | ({ROUNDING} if little else set())
    others = set(seen.readings) - seen.slight - {ROUNDING}
    amiss = found.word == "unexplained" or bool(found.causes) or bool(others)
    told = [name for name in seen.readings if not amiss or name not in slight]
    return tuple(sorted(told, key=lambda name: -seen.misread.get(name, 0.0)))


def with_readings(
    found: Verdict, readings: Sequence[str], taken: Mapping[str, float], whole: float, seen: Seen, t: Thresholds
) -> Verdict:
    """A wrong reading makes no torque: it is a cause beside the others, in its place by size, or alone without a gap.

    Args:
        found: without the readings.
        readings: errors of the velocity column that are told, the largest first.
        taken: by cause, the energy that it takes of the gap's [1]: a reading's error that makes more comes before it.
        whole: energy beside which a reading's error counts where nothing is asserted, of the gap's [1].
        seen: sizes.
        t: thresholds.
    """
    word, main, asserted = found.word, dict(found.main), found.causes
    right = {name: t.right_read * seen.doubts.get(name, ("", 1.0))[1] for name in readings}
    among = dict(found.among) | right
    instead = {other: t.right_read * (1.0 - sure) for other, sure in seen.doubts.values() if sure < 1.0}
    among |= {other: max(share, among.get(other, 0.0)) for other, share in instead.items()}
    energy = {name: taken.get(name, whole) for name in asserted} | {n: seen.misread.get(n, 0.0) for n in readings}
    first, names = readings[0], _in_place(asserted, readings, energy)
    # One wrong number beside right ones is a cause of the machine; several and nothing else are a guessed model.
    guessed = len(asserted) > 1 and all(is_number(name) for name in asserted)
    leads = word == "no_gap" or guessed or energy[first] > (energy[asserted[0]] if asserted else whole)
    if leads:
        # More is misread than the machine's own cause makes, or what is missing is a guessed nominal model's.
        word = "explained" if word == "no_gap" else word
        probability = right[first] if not asserted else min(right[first], found.probability)
        if word == "unexplained":
            probability = max(1.0 - sum(main.values()), 0.0)
        names = (first, *(name for name in names if name != first))
        room = (1.0 - t.right_read) / max(sum(main.values()), 1.0 - t.right_read)
        main = {name: share * room for name, share in main.items()} | {first: right[first]}
        other, sure = seen.doubts.get(first, ("", 1.0))
        if other:
            main[other] = t.right_read * (1.0 - sure)
    else:
        rest = max(right[first] - sum(main.values()), 0.0)
        if word == "unexplained" and main:
            # The reading is wrong, but it makes no torque: what is missing has another main cause.
            rest = min(rest, t.behind * max(main.values()))
        main = main | {first: rest}
        probability = sum(main[name] for name in asserted[:1]) if asserted else max(1.0 - sum(main.values()), 0.0)
    return replace(found, word=word, causes=names, probability=probability, main=main, among=among)


def _in_place(asserted: Sequence[str], readings: Sequence[str], energy: Mapping[str, float]) -> tuple[str, ...]:
    """The causes, which keep their order, with each reading's error behind the last that makes as much or more."""
    names = list(asserted)
    for reading in readings:
        more = [place for place, name in enumerate(names) if energy[name] >= energy[reading]]
        names.insert(more[-1] + 1 if more else 0, reading)
    return tuple(names)
