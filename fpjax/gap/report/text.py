"""The report's sentences, as plain text: the verdict, where the gap lies, what cannot be told apart."""

import math
import re

from ..told import nothing_closes
from .contents import Contents, Place
from .digits import readable, show_percent, show_unit, show_with_unit
from .words import EFFECTS, effect_name, is_wrong_value, join, motion_units, regime_name, sure


def verdict_title(contents: Contents) -> str:
    """Two or three words: the answer before the sentence."""
    return {"no_gap": "No gap", "explained": "Explained", "unexplained": "Unexplained"}[contents.verdict]


def verdict_sentence(contents: Contents) -> str:
    """The verdict in one sentence, without the confidence."""
    before, after, floor = (
        show_with_unit(contents.readable(e)) for e in (contents.before, contents.after, contents.floor)
    )
    over_floor = f", against a noise floor of {floor}" if contents.floor.known else ""
    if contents.verdict == "no_gap":
        return (
            f"The simulation agrees with the log: on withheld data the {contents.signal} differs by {before} rms"
            f"{over_floor}, and no effect beats chance."
        )
    if contents.verdict == "explained" and contents.causes == ("velocity_quantisation",):
        return f"{_lacks(contents)}: the {contents.signal} error on withheld data, {before} rms, is rounding alone."
    if contents.verdict == "explained":
        shrink = f"the {contents.signal} error on withheld data falls from {before} to {after} rms" + _of_closable(
            contents
        )
        return f"{_lacks(contents)}; with {_it(contents)} put right, {shrink}."
    differs = f"The simulation differs from the log by {before} rms in {contents.signal} on withheld data{over_floor}"
    if contents.causes:
        part = f"{_asserted(contents)} explains part of it"
        if contents.causes == ("velocity_quantisation",):
            part = f"{_asserted(contents)} is part of it"
        return f"{differs}; {part}, and {_nothing_closes(contents, f'the {after} left')}."
    attempt = contents.after.known and contents.before.known and contents.after.value < contents.before.value
    rest = f"; the best attempt still leaves {after}" if attempt else ""
    return f"{differs}, and {_nothing_closes(contents, 'this gap')}{rest}."


def confidence_sentence(contents: Contents) -> str:
    """How sure the verdict is, in words and as a number; "" where it is not known."""
    if not math.isfinite(contents.confidence):
        return ""
    words = sure(contents.confidence)
    return f"{words[:1].upper()}{words[1:]} ({show_percent(contents.confidence)})."


def where_sentence(contents: Contents) -> str:
    """Where most of the gap lies; "" where nothing stands out or there is no gap."""
    if contents.verdict == "no_gap":
        return ""
    units = motion_units(contents.motion)
    parts = []
    regimes = sorted(((s, r) for r, s in contents.regimes.items() if s > 0.0), reverse=True)
    if regimes:
        share, regime = regimes[0]
        parts.append(f"{show_percent(share)} of the gap's energy lies {regime_name(regime, contents.motion)}")
    told = {
        "time": "from",
        "velocity": "at velocities of",
        "position": "at positions of",
        "frequency": "at frequencies of",
    }
    for axis, before in told.items():
        largest = max(contents.where.get(axis, ()), key=lambda place: place.share, default=None)
        # what holds less than a fifth is on the map, and too little for a sentence
        if largest is not None and largest.share >= 0.2:
            parts.append(f"{show_percent(largest.share)} {before} {show_range(largest, units[axis])}")
    if not parts:
        return ""
    text = join(parts)
    return f"{text[:1].upper()}{text[1:]}." if regimes else f"Of the gap's energy, {text}."


def show_range(place: Place, unit: str) -> str:
    """`2.4 to 2.8 s`, both ends with the digits that their distance earns."""
    width = abs(place.high - place.low)
    decimals = max(0, 1 - math.floor(math.log10(width))) if width > 0.0 else 2
    low, high = (f"{end:.{min(decimals, 6)}f}".replace("-", "−") for end in (place.low, place.high))
    return f"{low} to {high}\u202f{show_unit(unit)}"


def twin_sentences(contents: Contents) -> list[str]:
    """One sentence per class of effects that this log cannot tell apart."""
    sentences = []
    for group in contents.classes():
        names = [effect_name(effect, contents.motion) for effect in group]
        probability = sum(c.probability for c in contents.ranking if c.effect in group and math.isfinite(c.probability))
        names = join(names)
        share = f"; together they hold {show_percent(min(probability, 1.0))}" if probability > 0.0 else ""
        sentences.append(f"{names[:1].upper()}{names[1:]} leave the same trace in this log{share}.")
    return sentences


def set_twin_sentences(contents: Contents) -> list[str]:
    """One sentence per set of several effects that together make the same log as what was found."""
    sentences = []
    for sentence in contents.same_as:
        if " + " in sentence:  # one for one is told with the classes
            told = re.sub(r"\w+", lambda word: _named(word.group(), contents.motion), sentence).replace(" + ", " with ")
            sentences.append(f"{told[:1].upper()}{told[1:]}")
    return sentences


def _named(word: str, motion: str) -> str:
    return effect_name(word, motion) if word in EFFECTS else word


def tracking_sentence(contents: Contents) -> str:
    """The closed loop's tracking error, predicted before and after, against the measured one; "" where not known."""
    known = {name: readable(estimate) for name, estimate in contents.tracking.items() if estimate.known}
    if "measured" not in known or not ({"before", "after"} & set(known)):
        return ""
    predicted = [
        f"{show_with_unit(known[name])} {name} the correction" for name in ("before", "after") if name in known
    ]
    measured = show_with_unit(known["measured"])
    told = join(predicted)
    return f"Closed-loop tracking error on withheld data: {measured} rms measured; the simulator predicts {told}."


def _alternatives(contents: Contents) -> list[str]:
    """Each cause with those that it cannot be told from: `a constant torque or asymmetric friction`."""
    told: set[str] = set()
    names = []
    for cause in contents.causes:
        if cause in told:
            continue
        group = [cause, *(t for t in contents.twins_of(cause) if t not in contents.causes)]
        told.update(group)
        names.append(join([effect_name(effect, contents.motion) for effect in group], "or"))
    return names


def _asserted(contents: Contents) -> str:
    """The causes in one phrase, which says so where this log leaves a choice."""
    names = _alternatives(contents)
    open_ones = [i for i, name in enumerate(names) if " or " in name]
    if not open_ones:
        return join(names)
    if len(open_ones) == 1:
        names[open_ones[0]] += " (this log cannot tell which)"
    text = ", and ".join((", ".join(names[:-1]), names[-1])) if len(names) > 1 else names[0]
    return text if len(open_ones) == 1 else f"{text} (in each case this log cannot tell which)"


def _nothing_closes(contents: Contents, it: str) -> str:
    """Who was tried and failed: the vocabulary, or what was allowed of it."""
    return nothing_closes([effect_name(effect, contents.motion) for effect in contents.allowed], it)


def _lacks(contents: Contents) -> str:
    verb = "has" if contents.causes and all(map(is_wrong_value, contents.causes)) else "lacks"
    if any(map(is_wrong_value, contents.causes)) and verb == "lacks":
        return f"The gap comes from {_asserted(contents)}"
    return f"The simulation {verb} {_asserted(contents)}"


def _it(contents: Contents) -> str:
    return "that" if len(contents.causes) == 1 else "both" if len(contents.causes) == 2 else "all of them"


def _of_closable(contents: Contents) -> str:
    if not contents.closed.known:
        return ""
    return f", {show_percent(contents.closed.value)} of what a perfect model would close"
