"""The report's sections, each a function from what is told to markup; "" where there is nothing to tell."""

import math
from typing import Any

from .contents import Candidate, Contents
from .digits import show_percent, show_unit
from .markup import (
    data,
    figure,
    gap_interval,
    gap_number,
    paragraph,
    parameter,
    percent,
    section,
    table,
    text,
)
from .model_text import count_changes, to_html
from .text import (
    confidence_sentence,
    set_twin_sentences,
    tracking_sentence,
    twin_sentences,
    verdict_sentence,
    verdict_title,
    where_sentence,
)
from .words import effect_meaning, effect_name, effect_title, join, parameter_name, state_meaning

# Below this a candidate is folded away: it is counted, and one click shows it.
_FOLDED = 0.005


def header(contents: Contents) -> str:
    """The verdict: a word, how sure, one sentence, four numbers."""
    inputs = [str(entry.get("name", "")) for entry in contents.provenance.get("inputs", ()) if isinstance(entry, dict)]
    origin = " · ".join(["Sim-to-real gap", *(name for name in inputs if name)])
    sure = confidence_sentence(contents)
    badge = f'<span class="badge">{text(verdict_title(contents))}</span>'
    confidence = (
        f'<span class="confidence">Confidence: <b>{text(sure[:1].lower() + sure[1:].rstrip("."))}</b></span>'
        if sure
        else ""
    )
    return (
        f'<header class="{contents.verdict}">\n<p class="origin">{text(origin)}</p>\n'
        f'<div class="verdict">{badge}{confidence}</div>\n<h1>{_sentence(contents)}</h1>\n{_facts(contents)}\n</header>'
    )


def _sentence(contents: Contents) -> str:
    """The verdict's sentence with the effects' names in bold."""
    out = text(verdict_sentence(contents))
    named = [effect for cause in contents.causes for effect in (cause, *contents.twins_of(cause))]
    # longest first, and each once: a name within another's markup is not marked again
    names = sorted({text(effect_name(effect, contents.motion)) for effect in named}, key=len, reverse=True)
    for i, name in enumerate(names):
        out = out.replace(name, f"\x00{i}\x01")
    for i, name in enumerate(names):
        out = out.replace(f"\x00{i}\x01", f"<strong>{name}</strong>")
    return out


def _facts(contents: Contents) -> str:
    tiles = [("before", "Difference" if contents.verdict == "no_gap" else "Gap before", contents.before)]
    if contents.verdict != "no_gap":
        tiles.append(("after", "Gap after" if contents.causes else "Gap after the best attempt", contents.after))
    tiles.append(("floor", "Noise floor", contents.floor))
    cells = []
    for kind, title, gap in tiles:
        interval = gap_interval(gap, contents.readable(gap))
        told = f"<small>90 % interval {interval}</small>" if interval else ""
        cells.append(
            f'<div class="is-{kind}"><dt>{title}</dt><dd>{gap_number(gap, contents.readable(gap))}{told}</dd></div>'
        )
    if contents.closed.known and contents.verdict != "no_gap":
        closed = contents.closed
        interval = (
            f"<small>90 % interval {percent(closed.low)} to {percent(closed.high)}</small>" if closed.bounded else ""
        )
        cells.append(f'<div class="is-closed"><dt>Gap closed</dt><dd>{percent(closed.value)}{interval}</dd></div>')
    return f'<dl class="facts">{"".join(cells)}</dl>'


def record(contents: Contents, pictures: dict[str, tuple[str, str]]) -> str:
    """Measured against simulated on the withheld part; or commanded against needed, where the gap is told in torque."""
    in_torque = contents.signal == "torque"
    title = "Commanded against needed" if in_torque else "Measured against simulated"
    if "record" not in pictures:
        note = "The diagnosis holds no withheld series to draw."
        return section("record", title, paragraph(note))
    restarted = any(series.starts.size for series in contents.series)
    how = "None of these samples was used for the fit."
    if in_torque:
        how += " The measured motion is imposed on each model, which says what torque that motion needed."
    elif restarted:
        how += (
            " The simulation is driven by the recorded command, in windows; each starts where it fits its window best."
        )
    return section(
        "record",
        title,
        paragraph(how),
        paragraph(tracking_sentence(contents)),
        figure("record", *pictures["record"]),
    )


def where(contents: Contents, pictures: dict[str, tuple[str, str]]) -> str:
    """The maps of where the gap lies."""
    parts = [paragraph(where_sentence(contents))]
    if "where" in pictures:
        caption = "Shares of the energy of what the nominal model cannot account for; in colour, what stands out."
        if contents.verdict == "no_gap":
            caption = "Shares of the energy of the residual, which here is noise."
        parts.append(figure("where", *pictures["where"], caption))
    if "residual" in pictures:
        effort = "force" if contents.motion == "linear" else "torque"
        parts.append(f"<h3>The {effort} that the nominal model cannot account for</h3>")
        caption = "A model that is right leaves a flat band around zero; the median's shape is the missing law."
        parts.append(figure("residual", *pictures["residual"], caption))
    if "left" in pictures:
        parts.append("<h3>Where what is left lies</h3>")
        parts.append(figure("left", *pictures["left"], "The same shares of what the best attempt leaves."))
    if not any(parts):
        nothing = "Nothing stands above the noise, so there is no place to show."
        parts.append(paragraph(nothing if contents.verdict == "no_gap" else "No map was made for this log."))
    return section("where", "Where the gap lies", *parts)


def ranking(contents: Contents) -> str:
    """Every effect with its probability, what it leaves, and its parameters."""
    if not contents.ranking:
        return section("ranking", "Which effect", paragraph("No effect was fitted."))
    shown = [c for c in contents.ranking if c.probability >= _FOLDED or c.effect in contents.causes]
    folded = [c for c in contents.ranking if c not in shown]
    if not shown:
        shown, folded = folded[:5], folded[5:]
    probabilities = [c.probability for c in contents.ranking if math.isfinite(c.probability)]
    none = 1.0 - sum(probabilities)
    rest = "Effects that this log cannot tell apart share their probability."
    if none >= 0.005:
        rest += f" {show_percent(none)} is left for none of these."
    out = [paragraph(rest + " Brackets hold 90 % intervals."), _ranking_table(contents, shown)]
    if folded:
        noun = "effect" if len(folded) == 1 else "effects"
        summary = f"<summary>{len(folded)} more {noun}, each less likely</summary>"
        out.append(f"<details>{summary}\n{_ranking_table(contents, folded)}</details>")
    return section("ranking", "Which effect", *out)


def _ranking_table(contents: Contents, candidates: list[Candidate]) -> str:
    twins = set().union(*(contents.twins_of(cause) for cause in contents.causes)) - set(contents.causes)
    headings = ["Effect", "Probability", "Gap after", "Parameters found", "Not told apart from"]
    if not any(c.twins for c in candidates):
        headings.pop()
    rows = []
    for candidate in candidates:
        kind = "cause" if candidate.effect in contents.causes else "twin" if candidate.effect in twins else ""
        cells = [_effect_cell(contents, candidate), _probability_cell(candidate)]
        cells.append(gap_number(candidate.gap_after, contents.readable(candidate.gap_after)))
        items = "".join(_parameter_item(candidate, name) for name in candidate.parameters)
        cells.append(f'<ul class="found">{items}</ul>' if items else "")
        if len(headings) == 5:
            cells.append(text(join([effect_name(t, contents.motion) for t in candidate.twins])))
        rows.append((kind, cells))
    return table(headings, rows)


def _effect_cell(contents: Contents, candidate: Candidate) -> str:
    title = text(effect_title(candidate.effect, contents.motion))
    pill = '<span class="pill">asserted</span>' if candidate.effect in contents.causes else ""
    meaning = text(effect_meaning(candidate.effect, contents.motion))
    code = f'<code class="effect">{text(candidate.effect)}</code>'
    return f'<span class="name">{title}</span>{pill}<small>{meaning}</small>{code}'


def _parameter_item(candidate: Candidate, name: str) -> str:
    note = "<small>at the end of what was allowed: do not trust it</small>" if name in candidate.at_bound else ""
    return f"<li>{text(parameter_name(name))}<br>{parameter(candidate.parameters[name])}{note}</li>"


def _probability_cell(candidate: Candidate) -> str:
    if not math.isfinite(candidate.probability):
        return '<span class="quiet">not known</span>'
    # a companion may be certain and yet not the main cause: what people want to know is whether it is one at all
    companion = candidate.cause > candidate.probability + 0.005
    told = candidate.cause if companion else candidate.probability
    note = "<small>as a companion</small>" if companion and candidate.probability < 0.005 else ""
    bar = f'<span class="bar"><i style="width:{100.0 * min(max(told, 0.0), 1.0):.1f}%"></i></span>'
    return f"<span>{percent(told)}{bar}{note}</span>"


def shrink(contents: Contents, pictures: dict[str, tuple[str, str]]) -> str:
    """How far the gap shrinks."""
    if contents.verdict == "no_gap":
        lead = "There is no gap to close: the nominal model's error is the noise floor's."
    elif contents.steps and contents.causes:
        lead = "Causes are added one by one, most important first; pale is what each one took away."
    else:
        lead = "No cause is asserted; the best attempt is there for comparison."
    caption = (
        "Lines over the bars are 90 % intervals; dashed, what a perfect model would leave."
        if contents.before.bounded
        else ""
    )
    drawn = figure("shrink", *pictures["shrink"], caption) if "shrink" in pictures else ""
    rows = []
    for step in contents.steps:
        shown = contents.readable(step.gap)
        interval = gap_interval(step.gap, shown)
        names = [effect_title(step.added, contents.motion)]
        names += [effect_name(twin, contents.motion) for twin in contents.twins_of(step.added)]
        rows.append(("", [f"+ {text(join(names, 'or'))}", gap_number(step.gap, shown), interval or "not known"]))
    steps = table(["Added", "Gap after", "90 % interval"], rows) if len(rows) > 1 else ""
    return section("shrink", "How far the gap shrinks", paragraph(lead), drawn, steps)


def apart(contents: Contents) -> str:
    """What cannot be told apart, and what to do about it."""
    twins = twin_sentences(contents)
    parts = [paragraph(sentence) for sentence in (*twins, *set_twin_sentences(contents))]
    if not parts:
        parts = [paragraph("No two likely effects leave the same trace in this log.")]
    if contents.experiments:
        parts.append("<h3>The next experiment</h3>")
        items = ""
        for separates, do in contents.experiments:
            names = join([effect_name(effect, contents.motion) for effect in separates], "from")
            told = f'<br><span class="quiet">Tells {text(names)}.</span>' if separates else ""
            items += f"<li>{text(do)}{told}</li>"
        parts.append(f'<ul class="todo">{items}</ul>')
    return section("apart", "What cannot be told apart", *parts)


def identifiability(contents: Contents) -> str:
    """How well this log fixes each parameter."""
    if not contents.identifiability:
        return section(
            "identifiability", "What this log fixes", paragraph("The diagnosis holds no analysis of its parameters.")
        )
    rows = []
    for fixing in contents.identifiability:
        meaning = state_meaning(fixing.state)
        state = f"{text(parameter_name(fixing.state))}{f'<small>{text(meaning)}</small>' if meaning else ''}"
        rows.append(
            (
                "",
                [
                    f'<span class="name">{text(parameter_name(fixing.parameter))}</span>',
                    parameter(fixing.estimate),
                    state,
                ],
            )
        )
    lead = "Parameters of the last fit, with 90 % intervals."
    return section(
        "identifiability", "What this log fixes", paragraph(lead), table(["Parameter", "Value", "In this log"], rows)
    )


def model(contents: Contents) -> str:
    """The corrected model, with what changed marked."""
    if not contents.model.strip():
        return section(
            "model",
            "The corrected model",
            paragraph(contents.model_missing or "The diagnosis holds no corrected model."),
        )
    use = "fpjax simulate and fpjax tune take this file as it is: gains can be tuned again in a simulator that fits."
    if contents.verdict == "unexplained":
        use = "This is the best attempt, and it does not fit: do not tune gains in it."
    if not contents.nominal.strip():
        lead = use
    else:
        changes = count_changes(contents.nominal, contents.model)
        if not changes:
            lead = "Nothing changed: this is the nominal model."
        else:
            values = "one value differs" if changes == 1 else f"{changes} values differ"
            lead = f"Marked: {values} from the nominal model. {use}"
    return section("model", "The corrected model", paragraph(lead), to_html(contents.nominal, contents.model))


def warnings(contents: Contents) -> str:
    """What the reader should know before trusting the result."""
    if not contents.warnings:
        return section("warnings", "Warnings", paragraph("None."))
    items = "".join(f"<li>{text(sentence)}</li>" for sentence in contents.warnings)
    return section("warnings", "Warnings", f'<ul class="warnings">{items}</ul>')


def provenance(contents: Contents) -> str:
    """From what, with what and when this was made."""
    known = contents.provenance
    pairs: list[tuple[str, str]] = []
    if known.get("command"):
        pairs.append(("Command", f"<code>{text(known['command'])}</code>"))
    if known.get("started"):
        pairs.append(("Started", text(known["started"])))
    if contents.seconds:
        total = sum(contents.seconds.values())
        stages = ", ".join(
            f"{text(stage)} {data(spent, f'{spent:.1f}')} s" for stage, spent in contents.seconds.items()
        )
        pairs.append(("Time", f"{total:.1f} s: {stages}"))
    versions = known.get("versions") or {}
    if versions:
        pairs.append(("Versions", text(", ".join(f"{name} {version}" for name, version in versions.items()))))
    if known.get("seeds"):
        seeds = known["seeds"]
        listed = [f"{name} {seed}" for name, seed in seeds.items()] if isinstance(seeds, dict) else map(str, seeds)
        pairs.append(("Seeds", text(", ".join(listed))))
    if known.get("windows"):
        windows = known["windows"]
        told = f"{windows['fitted']} fitted, {windows['withheld']} withheld, of {windows['seconds']:g} s"
        pairs.append(("Windows", text(told)))
    if contents.allowed:
        pairs.append(("Effects tried", text(f"only {', '.join(contents.allowed)}")))
    listed = "".join(f"<dt>{title}</dt><dd>{told}</dd>" for title, told in pairs)
    inputs = [entry for entry in known.get("inputs", ()) if isinstance(entry, dict)]
    rows = [("", _input_cells(entry)) for entry in inputs]
    files = table(["Input", "Role", "Samples", "SHA-256"], rows) if rows else ""
    if not (pairs or rows):
        return section("provenance", "Provenance", paragraph("The diagnosis does not say what it was made from."))
    return section("provenance", "Provenance", files, f'<dl class="facts-list">{listed}</dl>' if listed else "")


def _input_cells(entry: dict[str, Any]) -> list[str]:
    samples = entry.get("samples")
    return [
        f'<span class="name">{text(entry.get("name", ""))}</span>',
        text(entry.get("role", "")),
        "" if samples is None else text(samples),
        f'<code class="hash">{text(entry.get("sha256", ""))}</code>',
    ]


def units_note(contents: Contents) -> str:
    """What "gap" means here, for the footer."""
    unit = show_unit(contents.scale[1])
    return f"Gaps are rms errors of the {contents.signal} on withheld data{f', in {unit}' if unit else ''}."
