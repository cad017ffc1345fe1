"""Told: a diagnosis in a few lines of plain text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .diagnosis import Diagnosis, Ranked

SHOWN = 5  # entries of the ranking that are printed


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    gap = diagnosis.gap
    causes = " + ".join(diagnosis.causes)
    rounding = diagnosis.causes == ("velocity_quantisation",)
    if diagnosis.verdict == "no_gap":
        return "No gap: nothing beyond the noise of the sensors."
    if diagnosis.verdict == "explained" and rounding:
        return f"Explained by {causes}: all that the simulation's error holds is the reading's rounding."
    if diagnosis.verdict == "explained":
        return f"Explained by {causes}: {gap.closed:.1%} of the gap is closed on withheld data."
    if diagnosis.causes:
        beside = " is seen; the best attempt beside it" if rounding else ""
        return (
            f"Not fully explained: {causes}{beside} closes {gap.closed:.1%} of the gap, and what remains has "
            f"structure: {nothing_closes(diagnosis.allowed)}."
        )
    return f"Unexplained: there is a gap, and {nothing_closes(diagnosis.allowed)}."


def nothing_closes(allowed: Sequence[str], it: str = "it") -> str:
    """`no effect of the vocabulary closes it`, or which effects were tried where the vocabulary was restricted.

    Args:
        allowed: names of the effects that were tried; empty for the whole vocabulary.
        it: what is not closed.
    """
    if not allowed:
        return f"no effect of the vocabulary closes {it}"
    if len(allowed) == 1:
        return f"the one effect that was allowed ({allowed[0]}) does not close {it}"
    return f"none of the {len(allowed)} effects that were allowed ({', '.join(allowed)}) closes {it}"


def told(diagnosis: Diagnosis) -> str:
    """The verdict, the gap, the head of the ranking, what has an exact twin, and the warnings."""
    gap = diagnosis.gap
    lines = [verdict_sentence(diagnosis)]
    lines.append(
        f"gap ({gap.signal}, rms, withheld): before {gap.before:.4g}, after {gap.after:.4g}, "
        f"noise floor {gap.noise_floor:.4g} {gap.unit}"
    )
    if diagnosis.tracking is not None:
        error = diagnosis.tracking
        lines.append(
            f"closed-loop tracking error ({error.signal}, rms, withheld): {error.measured:.4g} measured; predicted "
            f"{error.before:.4g} before, {error.after:.4g} {error.unit} after the correction"
        )
    lines += [_entry(entry, entry.effect in diagnosis.causes) for entry in diagnosis.ranking[:SHOWN]]
    lines += [f"note: {sentence}" for sentence in diagnosis.same_as]
    lines += [f"warning: {warning}" for warning in diagnosis.warnings]
    return "\n".join(lines)


def _entry(entry: Ranked, asserted: bool) -> str:
    values = ", ".join(
        f"{name} {p.value:.4g} [{p.low:.4g}, {p.high:.4g}] {p.unit}" for name, p in entry.parameters.items()
    )
    same = f" (not told apart from {', '.join(entry.indistinguishable_from)})" if entry.indistinguishable_from else ""
    # A companion may be certain without being the main cause.
    probability = max(entry.probability, entry.cause_probability if asserted else 0.0)
    return f"  {probability:6.1%}  {entry.effect:28s} gap {entry.gap_after:.4g}  {values}{same}"
