"""A diagnosis as a few lines of plain text."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ..thresholds import THRESHOLDS

if TYPE_CHECKING:
    from ..effects.estimate import Estimate
    from .answer import Answer
    from .findings import Ranked
    from .gap import Gap

PLACES = {
    "reversal": "at reversals",
    "low_speed": "at low speed",
    "acceleration": "while accelerating",
    "cruise": "at steady speed",
    "limit": "at the largest torques",
}
SHOWN = 5  # entries of the ranking that are printed
CANNOT_BE = "no cause is told, since a unit, a sign, a column or the model cannot be right"
MUCH = 0.4  # share of the energy in one regime from which that regime is named
# What the gaps of a ranking are those of.
GAP_AFTER = (
    "the gap of a cause is what is left with it and the causes before it, that of any other effect what is left with "
    "it in their place, beside inertia, Coulomb and viscous friction fitted anew"
)


def verdict_line(diagnosis: Answer) -> str:
    """The verdict in one sentence."""
    gap = diagnosis.gap
    causes = " + ".join(diagnosis.causes)
    if diagnosis.verdict == "no_gap":
        return "No gap: the simulation misses no torque that matters."
    if diagnosis.only_misread:
        return f"Explained by {causes}: apart from the reading, the simulation misses no torque that matters."
    if diagnosis.verdict == "explained":
        return f"Explained by {causes}: {gap.closed:.1%} of the gap is closed on withheld data."
    if diagnosis.verdict == "partly_explained" and diagnosis.undecided:
        beside = " + ".join(diagnosis.undecided)
        return (
            f"Partly explained by {causes}: {diagnosis.closed_by_causes:.1%} of the gap is closed on withheld data, "
            f"{gap.closed:.1%} with {beside}, which this log does not make sure of{_place(diagnosis)}."
        )
    if diagnosis.verdict == "partly_explained":
        return (
            f"Partly explained by {causes}: {gap.closed:.1%} of the gap is closed on withheld data"
            f"{moving_clause(gap)}, {1.0 - gap.closed:.1%} is left{_place(diagnosis)}."
        )
    if diagnosis.contradiction:
        return f"Unexplained: {CANNOT_BE}. {diagnosis.contradiction}"
    beside = f" beside {causes}" if diagnosis.causes else ""
    if gap.before <= gap.noise_floor:
        return (
            f"Unexplained: on withheld data no gap stands above the noise{beside}; the fitted windows show one, "
            f"and {nothing_closes(diagnosis.allowed)}."
        )
    if attempt := unsure(diagnosis):
        return f"Unexplained: there is a gap; {attempt}."
    return f"Unexplained: there is a gap{beside}, and {nothing_closes(diagnosis.allowed)}."


def unsure(
    diagnosis: Answer, named: Callable[[str], str] = str, percent: Callable[[float], str] = "{:.1%}".format
) -> str:
    """A clause on the best attempt where no cause is asserted, though it closes a good part of the gap; else "".

    Args:
        diagnosis: an unexplained one.
        named: writes an effect's name.
        percent: writes a share.
    """
    # What was not allowed may be the cause, and what is asserted beside the gap has a sentence of its own.
    if not diagnosis.ranking or diagnosis.allowed or diagnosis.causes:
        return ""
    if not diagnosis.gap.closed > 1.0 - THRESHOLDS.part:
        return ""
    return (
        f"the best attempt, led by {named(diagnosis.ranking[0].effect)}, closes {percent(diagnosis.gap.closed)} of it "
        "on withheld data, but this log does not make sure of its causes"
    )


def dominant_sentence(diagnosis: Answer, percent: Callable[[float], str] = "{:.0%}".format) -> str:
    """The variable that the missing torque mostly follows, and how its share is counted; "" where none stands out.

    Args:
        diagnosis: the answer.
        percent: writes a share.
    """
    found = diagnosis.dominant_variable
    if found is None:
        return ""
    effort = "force" if diagnosis.motion == "linear" else "torque"
    name = f"the {effort}" if found.of == "torque" else found.of
    named = ""
    if diagnosis.causes and diagnosis.verdict in ("explained", "partly_explained"):
        what = "causes hold" if len(diagnosis.causes) > 1 else "cause holds"
        named = f", and the {what} {percent(found.named)}"
    return (
        f"The part of the missing {effort} that moves the machine mostly follows the "
        f"{effort if found.of == 'torque' else name}: a curve over {name} alone holds {percent(found.share)} of that "
        f"part's energy{named}. The shares of the gap count vibration too, which hardly moves the machine."
    )


def moving_clause(gap: Gap, percent: Callable[[float], str] = "{:.1%}".format) -> str:
    """How much of the part that moves the machine is closed, as a clause; "" unless far more is than of the whole.

    Args:
        gap: before and after.
        percent: writes a share.
    """
    return f" and {percent(gap.closed_moving)} of the part of it that moves the machine" if gap.rest_vibrates else ""


def _place(diagnosis: Answer) -> str:
    """The regime that holds most of what the causes leave, as the end of a sentence; "" where none holds much."""
    shares = {} if diagnosis.residual_where is None else diagnosis.residual_where.regime
    name = max(shares, key=lambda regime: shares[regime], default="")
    return f", {shares[name]:.0%} of its energy {PLACES[name]}" if name in PLACES and shares[name] >= MUCH else ""


def nothing_closes(allowed: Sequence[str], it: str = "it") -> str:
    """A clause that no effect closes the gap; where the vocabulary was restricted, it names the effects tried.

    Args:
        allowed: names of the effects that were tried; empty for the whole vocabulary.
        it: the word for the gap in the sentence.
    """
    if not allowed:
        return f"no effect of the vocabulary closes {it}"
    if len(allowed) == 1:
        return f"the one effect that was allowed ({allowed[0]}) does not close {it}"
    return f"none of the {len(allowed)} effects that were allowed ({', '.join(allowed)}) closes {it}"


def summary(diagnosis: Answer) -> str:
    """Verdict, gap, tracking error, the first entries of the ranking, learned laws, exact twins, and warnings."""
    gap = diagnosis.gap
    lines = [verdict_line(diagnosis)]
    lines.append(
        f"gap (missing torque, rms, withheld): before {gap.before:.4g}, after {gap.after:.4g}, "
        f"noise floor {gap.noise_floor:.4g} {gap.unit}"
    )
    if diagnosis.tracking is not None:
        error = diagnosis.tracking
        lines.append(
            f"closed-loop tracking error ({error.signal}, rms, withheld): {error.measured:.4g} measured; predicted "
            f"{error.before:.4g} before, {error.after:.4g} {error.unit} after the correction"
        )
    if diagnosis.free_replay is not None:
        free = diagnosis.free_replay
        held = f"; fits held their simulations near it with {free.guide:.3g} Hz" if free.guide > 0.0 else ""
        lines.append(
            f"free simulation over windows of {free.window:.3g} s: departs by {free.before:.3g} of the motion before, "
            f"{free.after:.3g} after{held}"
        )
    causes = set(diagnosis.causes)
    lines += [
        _entry(entry, bool(causes & {entry.effect, *entry.indistinguishable_from}))
        for entry in diagnosis.ranking[:SHOWN]
    ]
    if any(entry.effect not in diagnosis.causes for entry in diagnosis.ranking[:SHOWN]):
        lines.append(f"  ({GAP_AFTER})")
    if diagnosis.dominant_variable is not None:
        lines.append(dominant_sentence(diagnosis))
    if diagnosis.learned:
        follows = ", ".join(f"{law.share:.0%} follows the {law.of}" for law in diagnosis.learned)
        lines.append(f"learned: of the energy of what is left {follows}; with that gap {gap.learned:.4g} {gap.unit}")
    lines += [f"note: {sentence}" for sentence in diagnosis.same_as]
    lines += [f"warning: {warning}" for warning in diagnosis.warnings]
    return "\n".join(lines)


def _entry(entry: Ranked, told: bool) -> str:
    """One line of the ranking; `told`: of a cause, or of what may be one in its place."""
    values = ", ".join(_value(name, p) for name, p in entry.parameters.items())
    twins = ", ".join(entry.indistinguishable_from)
    same = f" (not distinguished from {twins})" if twins else ""
    # The second cause of a pair may be certain without being the main one: the larger probability is shown.
    probability = max(entry.probability, entry.cause_probability if told else 0.0)
    return f"  {probability:6.1%}  {entry.effect:28s} gap {entry.gap_after:.4g}  {values}{same}"


def _value(name: str, found: Estimate) -> str:
    """A parameter with its interval and unit."""
    if math.isfinite(found.low) and math.isfinite(found.high):
        return f"{name} {found.value:.4g} [{found.low:.4g}, {found.high:.4g}] {found.unit}"
    return f"{name} {found.value:.4g} {found.unit}{' (at a bound)' if found.at_bound else ''}"
