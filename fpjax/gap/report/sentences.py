"""The sentences of the report, as plain text: verdict, where the gap lies, effects that cannot be distinguished."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from ..answer.summary import CANNOT_BE, MUCH, moving_clause, nothing_closes, unsure
from .derived_values import AXES, classes, main_regime, places, shown_gap, tracking, twins_of
from .digits import readable, show_percent, show_unit, show_with_unit
from .names import EFFECTS, effect_name, is_wrong_value, join, motion_units, regime_name, sure

if TYPE_CHECKING:
    from ..answer.answer import Answer
    from ..answer.findings import Share

DETAIL = 0.01  # share of the gap from which what a detail takes away is told in the verdict's sentence

TITLES = {
    "no_gap": "No gap",
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unexplained": "Unexplained",
}


def verdict_title(diagnosis: Answer) -> str:
    """The verdict in one or two words, as the title."""
    return TITLES[diagnosis.verdict]


def verdict_sentence(diagnosis: Answer) -> str:
    """The verdict in one sentence, without the confidence."""
    gap, effort = diagnosis.gap, effort_of(diagnosis)
    before, after, floor = (
        show_with_unit(shown_gap(diagnosis, gap.estimate(name))) for name in ("before", "after", "noise_floor")
    )
    # Without withheld windows there is no floor to compare with.
    over_floor = f", against a noise floor of {floor}" if math.isfinite(gap.noise_floor) else ""
    if diagnosis.verdict == "no_gap":
        return (
            f"The simulation agrees with the log: the {effort} that it misses on withheld data is {before} rms"
            f"{over_floor}, too little to matter."
        )
    if diagnosis.only_misread:
        little = f"the {effort} missing beside that is too little to matter ({before} rms on withheld data)"
        return f"{_lacks(diagnosis)}; {little}."
    if diagnosis.verdict == "explained":
        shrink = f"the missing {effort} on withheld data falls from {before} to {after} rms" + _of_closable(diagnosis)
        return f"{_lacks(diagnosis)}; with {_it(diagnosis)} corrected{_details(diagnosis)}, {shrink}."
    if diagnosis.verdict == "partly_explained":
        share, regime = main_regime(diagnosis.residual_where)
        place = regime_name(regime, diagnosis.motion)
        where = f", {show_percent(share)} of its energy {place}" if share >= MUCH else ""
        asserted = _asserted(diagnosis)
        verb = "explains" if len(diagnosis.causes) == 1 else "explain"
        if diagnosis.undecided:
            beside = join([effect_name(name, diagnosis.motion) for name in diagnosis.undecided])
            return (
                f"{asserted[:1].upper()}{asserted[1:]} {verb} {show_percent(diagnosis.closed_by_causes)} of the "
                f"missing {effort}; with {beside}, which this log does not make sure of, {show_percent(gap.closed)} is "
                f"closed, and {after} of {before} rms on withheld data is left{where}."
            )
        return (
            f"{asserted[:1].upper()}{asserted[1:]}{_details(diagnosis)}{',' if _details(diagnosis) else ''} {verb} "
            f"{show_percent(gap.closed)} of the missing {effort}{moving_clause(gap, show_percent)}; "
            f"{show_percent(1.0 - gap.closed)} is left ({after} of {before} rms on withheld data){where}."
        )
    differs = f"The simulation misses {before} rms of {effort} on withheld data{over_floor}"
    if diagnosis.contradiction:
        return f"{differs}; {CANNOT_BE}. {diagnosis.contradiction}"
    # Unexplained, from here on: without a gap on withheld data, with an asserted part, or with a best attempt only.
    if gap.before <= gap.noise_floor:
        return (
            f"On withheld data no missing {effort} stands above the noise floor of {floor}; the fitted windows show "
            f"some, and {_nothing_closes(diagnosis, 'it')}."
        )
    if diagnosis.causes:
        return (
            f"{differs}; {_asserted(diagnosis)} is part of it, and {_nothing_closes(diagnosis, f'the {after} left')}."
        )
    rest = f"; the best attempt leaves {after}" if gap.after < gap.before else ""
    share, regime = main_regime(diagnosis.where)
    place = (
        f" {show_percent(share)} of the gap's energy lies {regime_name(regime, diagnosis.motion)}."
        if share >= MUCH
        else ""
    )
    if attempt := unsure(diagnosis, lambda effect: effect_name(effect, diagnosis.motion), show_percent):
        return f"{differs}; {attempt}.{place}"
    return f"{differs}, and {_nothing_closes(diagnosis, 'this gap')}{rest}.{place}"


def learned_name(diagnosis: Answer) -> str:
    """What the learned laws are called: `learned law of velocity`, `learned laws of velocity and position`."""
    names = [variable_name(law.of, diagnosis) for law in diagnosis.learned]
    return f"learned law{'s' if len(names) > 1 else ''} of {join(names)}"


def variable_name(variable: str, diagnosis: Answer) -> str:
    """The name of a learned law's variable: "force" for the torque of a linear axis."""
    return effort_of(diagnosis) if variable == "torque" else variable


def learned_sentence(diagnosis: Answer) -> str:
    """The shares of the rest that follow recorded variables, and that follow none; "" where no law was learned."""
    if not diagnosis.learned:
        return ""
    parts = [f"{show_percent(law.share)} follows the {variable_name(law.of, diagnosis)}" for law in diagnosis.learned]
    nothing = max(1.0 - sum(law.share for law in diagnosis.learned), 0.0)
    after = show_with_unit(shown_gap(diagnosis, diagnosis.gap.estimate("learned")))
    return (
        f"Of the energy of what is left, {join([*parts, f'{show_percent(nothing)} follows no recorded signal'])}: "
        f"simulated with the {learned_name(diagnosis)}, {after} rms is missing on withheld data."
    )


def effort_of(diagnosis: Answer) -> str:
    """`torque`, or `force` of a linear axis."""
    return "force" if diagnosis.motion == "linear" else "torque"


def confidence_sentence(diagnosis: Answer) -> str:
    """The probability of the verdict, in words and as a number; "" where it is not known."""
    if not diagnosis.probability > 0.0:
        return ""
    words = sure(diagnosis.probability)
    return f"{words[:1].upper()}{words[1:]} ({show_percent(diagnosis.probability)})."


def where_sentence(diagnosis: Answer) -> str:
    """Where most of the nominal model's gap lies; "" where nothing stands out or nothing is missing."""
    if diagnosis.nothing_missing:
        return ""
    units = motion_units(diagnosis.motion)
    parts = []
    share, regime = main_regime(diagnosis.where)
    if regime:
        place = regime_name(regime, diagnosis.motion)
        parts.append(f"{show_percent(share)} of the energy of the nominal model's gap lies {place}")
    prepositions = {
        "time": "from",
        "velocity": "at velocities of",
        "position": "at positions of",
        "frequency": "at frequencies of",
    }
    for axis in AXES:
        largest = max(places(diagnosis.where, axis), key=lambda place: place.share, default=None)
        # Less than a fifth is on the map, but too little for a sentence.
        if largest is not None and largest.share >= 0.2:
            spot = f"{prepositions[axis]} {show_range(largest, units[axis])}"
            if axis == "frequency" and largest.start <= 0.0:
                spot = f"below {show_range(largest, units[axis]).partition(' to ')[2]}"
            parts.append(f"{show_percent(largest.share)} {spot}")
    if not parts:
        return ""
    text = join(parts)
    return f"{text[:1].upper()}{text[1:]}." if regime else f"Of the energy of the nominal model's gap, {text}."


def show_range(place: Share, unit: str) -> str:
    """`2.4 to 2.8 s`, both ends rounded to the second digit of their distance."""
    width = abs(place.stop - place.start)
    decimals = max(0, 1 - math.floor(math.log10(width))) if width > 0.0 else 2
    low, high = (f"{end:.{min(decimals, 6)}f}".replace("-", "−") for end in (place.start, place.stop))
    return f"{low} to {high}\u202f{show_unit(unit)}"


def twin_sentences(diagnosis: Answer) -> list[str]:
    """One sentence for each class of effects that this log cannot distinguish."""
    sentences = []
    for group in classes(diagnosis):
        if any(" + " in same and all(effect in same for effect in group) for same in diagnosis.same_as):
            continue  # several together stand for one: `set_twin_sentences` says so
        names = [effect_name(effect, diagnosis.motion) for effect in group]
        probability = sum(
            c.probability for c in diagnosis.ranking if c.effect in group and math.isfinite(c.probability)
        )
        names = join(names)
        share = f"; together they hold {show_percent(min(probability, 1.0))}" if probability > 0.0 else ""
        sentences.append(f"{names[:1].upper()}{names[1:]} cannot be distinguished in this log{share}.")
    return sentences


def set_twin_sentences(diagnosis: Answer) -> list[str]:
    """One sentence for each set of several effects that together make the same log as the causes."""
    sentences = []
    for sentence in diagnosis.same_as:
        if " + " in sentence:  # a single twin is among the classes
            named = re.sub(r"\w+", lambda word: _named(word.group(), diagnosis.motion), sentence).replace(
                " + ", " with "
            )
            sentences.append(f"{named[:1].upper()}{named[1:]}")
    return sentences


def _named(word: str, motion: str) -> str:
    return effect_name(word, motion) if word in EFFECTS else word


def tracking_sentence(diagnosis: Answer) -> str:
    """The closed loop's tracking error, predicted before and after, against the measured one; "" where not known."""
    known = {name: readable(estimate) for name, estimate in tracking(diagnosis).items() if estimate.known}
    if "measured" not in known or not ({"before", "after"} & set(known)):
        return ""
    nominal, corrected = _models(diagnosis)
    models = [("before", nominal), *([("after", corrected)] if corrected else [])]
    predicted = [f"{show_with_unit(known[name])} with the {model}" for name, model in models if name in known]
    if not predicted:
        return ""
    measured = show_with_unit(known["measured"])
    return (
        f"Closed-loop tracking error on withheld data: {measured} rms measured; the simulator predicts "
        f"{join(predicted)}."
    )


def replay_sentence(diagnosis: Answer) -> str:
    """How far free simulations leave the motion, and whether fits were held near it; "" where not known."""
    free = diagnosis.free_replay
    if free is None or not (math.isfinite(free.before) and math.isfinite(free.after)):
        return ""
    before, after = (
        f"{show_percent(x)} of the motion" if x < 2.0 else f"{x:.3g} times the motion"
        for x in (free.before, free.after)
    )
    held = (
        f" The fits held their simulations near the motion, with a bandwidth of {free.guide:.3g}\u202fHz: a free one "
        "leaves it too far for a fit to see why."
        if free.guide > 0.0
        else ""
    )
    nominal, corrected = _models(diagnosis)
    other = f", the {corrected} by {after}" if corrected else ""
    return (
        f"Driven by the recorded {effort_of(diagnosis)} alone, the {nominal} departs over "
        f"{free.window:.3g}\u202fs by {before}{other}.{held}"
    )


def model_names(diagnosis: Answer) -> tuple[str, str]:
    """Names of the nominal and of the other model, as sentences and legends have them."""
    return "nominal model", "corrected model" if diagnosis.causes else "best attempt"


def _models(diagnosis: Answer) -> tuple[str, str]:
    """As `model_names`; the other one is "" where there is no gap: nothing was corrected."""
    nominal, other = model_names(diagnosis)
    return nominal, "" if diagnosis.verdict == "no_gap" else other


def _details(diagnosis: Answer) -> str:
    """The details beside the causes that take part in the share closed, as a clause; "" for none that matters."""
    names, last = [], diagnosis.gap.before
    for step in diagnosis.steps:
        if step.added not in diagnosis.causes and last - step.gap_after > DETAIL * diagnosis.gap.before:
            names.append(effect_name(step.added, diagnosis.motion))
        last = step.gap_after
    return f", with {join(names)} as {'a detail' if len(names) == 1 else 'details'}" if names else ""


def step_remark(diagnosis: Answer, name: str) -> str:
    """What an entry of the steps is that is no cause, in brackets; "" for a cause."""
    if name in diagnosis.causes:
        return ""
    return " (not sure)" if name in diagnosis.undecided else " (a detail)"


def _alternatives(diagnosis: Answer) -> list[str]:
    """Each cause with those that it cannot be distinguished from: `a constant torque or asymmetric friction`."""
    named: set[str] = set()
    names = []
    for cause in diagnosis.causes:
        if cause in named:
            continue
        group = [cause, *(t for t in twins_of(diagnosis, cause) if t not in diagnosis.causes)]
        named.update(group)
        names.append(join([effect_name(effect, diagnosis.motion) for effect in group], "or"))
    return names


def _asserted(diagnosis: Answer) -> str:
    """The causes as one phrase, with a remark where this log leaves alternatives."""
    names = _alternatives(diagnosis)
    open_ones = [i for i, name in enumerate(names) if " or " in name]
    if not open_ones:
        return join(names)
    if len(open_ones) == 1:
        names[open_ones[0]] += " (this log cannot tell which)"
    text = ", and ".join((", ".join(names[:-1]), names[-1])) if len(names) > 1 else names[0]
    return text if len(open_ones) == 1 else f"{text} (in each case this log cannot tell which)"


def _nothing_closes(diagnosis: Answer, it: str) -> str:
    """A clause that no effect closes the gap, with the effects' names where the vocabulary was restricted."""
    return nothing_closes([effect_name(effect, diagnosis.motion) for effect in diagnosis.allowed], it)


def _lacks(diagnosis: Answer) -> str:
    """The clause `The simulation lacks ...`, or `has ...` of wrong values; another one for a mixture of both."""
    verb = "has" if diagnosis.causes and all(map(is_wrong_value, diagnosis.causes)) else "lacks"
    if any(map(is_wrong_value, diagnosis.causes)) and verb == "lacks":
        return f"The gap comes from {_asserted(diagnosis)}"
    return f"The simulation {verb} {_asserted(diagnosis)}"


def _it(diagnosis: Answer) -> str:
    return "that" if len(diagnosis.causes) == 1 else "both" if len(diagnosis.causes) == 2 else "all of them"


def _of_closable(diagnosis: Answer) -> str:
    """The share of the gap that is closed, as the end of a sentence."""
    if not math.isfinite(diagnosis.gap.closed):
        return ""
    closed = diagnosis.gap.closed
    left = "" if closed >= 1.0 else f", {show_percent(1.0 - closed)} is left"
    return f": {show_percent(closed)} of the gap is closed{left}"
