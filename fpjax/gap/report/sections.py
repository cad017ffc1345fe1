"""The sections of the report: each function gives the HTML of one section."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ...output.json_object import JsonObject
from ..answer.summary import GAP_AFTER
from .derived_values import NEGLIGIBLE, at_bound, entry_gap, fixed, gap_scale, shown_gap, step_gap, twins_of
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
from .model_text import count_changes, save_link, to_html, use_sentence
from .names import effect_meaning, effect_name, effect_title, for_motion, join, parameter_name, state_meaning
from .sentences import (
    effort_of,
    learned_name,
    replay_sentence,
    set_twin_sentences,
    step_remark,
    tracking_sentence,
    twin_sentences,
    variable_name,
)

if TYPE_CHECKING:
    from ..answer.answer import Answer
    from ..answer.findings import Ranked
    from ..effects.estimate import Estimate


def record(diagnosis: Answer, pictures: dict[str, tuple[str, str]]) -> str:
    """Commanded against needed torque on the withheld part."""
    title = "Commanded against needed"
    if "record" not in pictures:
        note = "The diagnosis holds no withheld series to draw."
        return section("record", title, paragraph(note))
    effort = effort_of(diagnosis)
    how = (
        f"None of these samples was used for the fit. Each model gives the {effort} that the measured motion needed; "
        f"its difference to the commanded {effort} is the missing {effort} of that model."
    )
    caption = "The curves hold the noise of the sensors too; in the size of the gap, the noise's share is taken out."
    return section(
        "record",
        title,
        paragraph(how),
        paragraph(tracking_sentence(diagnosis)),
        paragraph(replay_sentence(diagnosis)),
        figure("record", *pictures["record"], caption),
    )


def where(diagnosis: Answer, pictures: dict[str, tuple[str, str]]) -> str:
    """Where the gap lies: maps over time, velocity, position and frequency."""
    parts = []  # the sentence on it is at the head of the page
    if "where" in pictures:
        caption = f"Shares of the energy of the missing {effort_of(diagnosis)}; in colour, what stands out."
        if diagnosis.nothing_missing:
            caption = "Shares of the energy of the residual, which here does not matter."
        parts.append(figure("where", *pictures["where"], caption))
    if "residual" in pictures:
        effort = effort_of(diagnosis)
        parts.append(f"<h3>The {effort} that the nominal model misses</h3>")
        caption = (
            f"Commanded minus needed {effort}: a correct model leaves a flat band around zero. The shape of the median "
            f"is that of the missing law, with the sign of friction."
        )
        parts.append(figure("residual", *pictures["residual"], caption))
    if "left" in pictures:
        leaves = "the causes leave" if diagnosis.causes else "the best attempt leaves"
        parts.append("<h3>Where the rest lies</h3>")
        parts.append(figure("left", *pictures["left"], f"The same shares of what {leaves}."))
    if not any(parts):
        nothing = "Nothing stands above the noise, so there is no place to show."
        parts.append(paragraph(nothing if diagnosis.nothing_missing else "No map was made for this log."))
    elif diagnosis.gap.before <= diagnosis.gap.noise_floor and "where" not in pictures:
        parts.insert(0, paragraph("Nothing stands above the noise on withheld data, so there is no map of it."))
    return section("where", "Where the gap lies", *parts)


def ranking(diagnosis: Answer, pictures: dict[str, tuple[str, str]]) -> str:
    """Every effect with its probability, the gap that it leaves, and its parameters."""
    if not diagnosis.ranking:
        return section("ranking", "Which effect", paragraph("No effect was fitted."))
    shown = [c for c in diagnosis.ranking if c.probability >= NEGLIGIBLE or c.effect in diagnosis.causes]
    folded = [c for c in diagnosis.ranking if c not in shown]
    if not shown:
        shown, folded = folded[:5], folded[5:]
    probabilities = [c.probability for c in diagnosis.ranking if math.isfinite(c.probability)]
    none = 1.0 - sum(probabilities)
    # Main-cause probabilities sum to at most 1; the remainder is that of no effect of the vocabulary.
    rest = "Effects that this log cannot distinguish share their probability."
    if none >= 0.005:
        rest += f" {show_percent(none)} is the probability that it is none of these."
    rest += f" Brackets hold 90 % intervals; {GAP_AFTER}."
    out = [paragraph(rest), _ranking_table(diagnosis, shown, learned=True)]
    if folded:
        noun = "effect" if len(folded) == 1 else "effects"
        summary = f"<summary>{len(folded)} more {noun}, each less likely</summary>"
        out.append(f"<details>{summary}\n{_ranking_table(diagnosis, folded)}</details>")
    if "learned" in pictures:
        out.append("<h3>What no named effect explains</h3>")
        caption = (
            f"The rest, learned as a {effort_of(diagnosis)} with the sign of friction. It is not an effect of the "
            f"vocabulary and has no probability; the table shows how much of the gap it removes, measured by "
            f"simulating with it."
        )
        out.append(figure("learned", *pictures["learned"], caption))
    return section("ranking", "Which effect", *out)


def _ranking_table(diagnosis: Answer, candidates: list[Ranked], *, learned: bool = False) -> str:
    # Twins of the causes are marked in the table, as they are as likely.
    twins = set().union(*(twins_of(diagnosis, cause) for cause in diagnosis.causes)) - set(diagnosis.causes)
    headings = ["Effect", "Probability", "Gap after", "Parameters found", "Not distinguished from"]
    if not any(c.indistinguishable_from for c in candidates):
        headings.pop()
    rows = []
    for candidate in candidates:
        kind = "cause" if candidate.effect in diagnosis.causes else "twin" if candidate.effect in twins else ""
        cells = [_effect_cell(diagnosis, candidate), _probability_cell(candidate)]
        gap = entry_gap(diagnosis, candidate)
        cells.append(gap_number(gap, shown_gap(diagnosis, gap)))
        items = "".join(_parameter_item(candidate, name, diagnosis.motion) for name in candidate.parameters)
        cells.append(f'<ul class="found">{items}</ul>' if items else "")
        if len(headings) == 5:
            cells.append(text(join([effect_name(t, diagnosis.motion) for t in candidate.indistinguishable_from])))
        rows.append((kind, cells))
    if learned and diagnosis.learned:
        # After the causes and before effects that are not asserted: its share is measured, as theirs are.
        rows.insert(
            sum(c.effect in diagnosis.causes for c in candidates), ("", _learned_cells(diagnosis, len(headings)))
        )
    return table(headings, rows)


def _learned_cells(diagnosis: Answer, count: int) -> list[str]:
    """The learned laws as a row of the ranking's table."""
    name, beside = learned_name(diagnosis), "the causes" if diagnosis.causes else "the best attempt"
    gap = diagnosis.gap.estimate("learned")
    taken = "".join(
        f"<li>{text(variable_name(law.of, diagnosis))}<br>{percent(law.share)} of what is left</li>"
        for law in diagnosis.learned
    )
    return [
        f'<span class="name">{text(name[:1].upper() + name[1:])}</span><small>beside {beside}; drawn below</small>',
        '<span class="quiet">measured, not a named effect</span>',
        gap_number(gap, shown_gap(diagnosis, gap)),
        f'<ul class="found">{taken}</ul>',
        "",
    ][:count]


def _effect_cell(diagnosis: Answer, candidate: Ranked) -> str:
    title = text(effect_title(candidate.effect, diagnosis.motion))
    pill = '<span class="pill">asserted</span>' if candidate.effect in diagnosis.causes else ""
    meaning = text(effect_meaning(candidate.effect, diagnosis.motion))
    code = f'<code class="effect">{text(candidate.effect)}</code>'
    return f'<span class="name">{title}</span>{pill}<small>{meaning}</small>{code}'


def _parameter_item(candidate: Ranked, name: str, motion: str) -> str:
    note = "<small>at a bound of the search: not a measurement</small>" if name in at_bound(candidate) else ""
    return f"<li>{text(parameter_name(name, motion))}<br>{parameter(candidate.parameters[name])}{note}</li>"


def _probability_cell(candidate: Ranked) -> str:
    if not math.isfinite(candidate.probability):
        return '<span class="quiet">not known</span>'
    # The second cause of a pair may be certain and not the main one: then the probability of being a cause is shown.
    companion = candidate.cause_probability > candidate.probability + 0.005
    told = candidate.cause_probability if companion else candidate.probability
    note = "<small>as a second cause</small>" if companion and candidate.probability < 0.005 else ""
    bar = f'<span class="bar"><i style="width:{100.0 * min(max(told, 0.0), 1.0):.1f}%"></i></span>'
    return f"<span>{percent(told)}{bar}{note}</span>"


def shrink(diagnosis: Answer, pictures: dict[str, tuple[str, str]]) -> str:
    """How far the gap shrinks."""
    if diagnosis.nothing_missing:
        lead = "There is no gap to close: what the nominal model misses does not matter."
    elif diagnosis.steps and diagnosis.causes:
        lead = "Causes are added one by one, most important first; pale is the part that each one removes."
    else:
        lead = "No cause is asserted; the best attempt is there for comparison."
    caption = (
        "Lines over the bars are 90 % intervals; the dashed line is the noise floor, which noise alone exceeds in one "
        "log of twenty."
        if diagnosis.gap.estimate("before").bounded
        else ""
    )
    drawn = figure("shrink", *pictures["shrink"], caption) if "shrink" in pictures else ""
    rows = []
    for step in diagnosis.steps:
        gap = step_gap(diagnosis, step)
        shown = shown_gap(diagnosis, gap)
        names = [effect_title(step.added, diagnosis.motion)]
        names += [effect_name(twin, diagnosis.motion) for twin in twins_of(diagnosis, step.added)]
        detail = step_remark(diagnosis, step.added)
        rows.append(
            ("", [f"+ {text(join(names, 'or'))}{detail}", gap_number(gap, shown), _interval(gap, shown) or "not known"])
        )
    if diagnosis.learned:
        gap = diagnosis.gap.estimate("learned")
        shown = shown_gap(diagnosis, gap)
        name = learned_name(diagnosis)
        rows.append(("", [f"+ {text(name[:1].upper() + name[1:])}", gap_number(gap, shown), _interval(gap, shown)]))
    steps = table(["Added", "Gap after", "90 % interval"], rows) if len(rows) > 1 else ""
    return section("shrink", "How far the gap shrinks", paragraph(lead), drawn, steps)


def _interval(gap: Estimate, shown: Estimate) -> str:
    """The interval with its unit, for a column of its own."""
    interval = gap_interval(gap, shown)
    return f"{interval} {text(show_unit(shown.unit))}".strip() if interval else ""


def apart(diagnosis: Answer) -> str:
    """Effects that cannot be distinguished, and the experiments that would do it."""
    twins = twin_sentences(diagnosis)
    parts = [paragraph(sentence) for sentence in (*twins, *set_twin_sentences(diagnosis))]
    if not parts:
        parts = [paragraph("No two likely effects make the same log here.")]
    if diagnosis.next_experiment:
        parts.append("<h3>The next experiment</h3>")
        items = ""
        for experiment in diagnosis.next_experiment:
            names = join([effect_name(effect, diagnosis.motion) for effect in experiment.separates], "from")
            do = for_motion(experiment.do, diagnosis.motion)
            items += f'<li>{text(do)}<br><span class="quiet">Distinguishes {text(names)}.</span></li>'
        parts.append(f'<ul class="todo">{items}</ul>')
    return section("apart", "What cannot be distinguished", *parts)


def identifiability(diagnosis: Answer) -> str:
    """How well this log determines each parameter."""
    if not diagnosis.identifiability:
        return section(
            "identifiability",
            "What this log determines",
            paragraph("The diagnosis holds no analysis of its parameters."),
        )
    rows = []
    for fixing in diagnosis.identifiability:
        size = abs(fixing.value)
        meaning = state_meaning(fixing.verdict, fixing.standard_deviation / size if size > 0.0 else math.inf)
        state = text(parameter_name(fixing.verdict, diagnosis.motion))
        state += f"<small>{text(meaning)}</small>" if meaning else ""
        rows.append(
            (
                "",
                [
                    f'<span class="name">{text(parameter_name(fixing.parameter, diagnosis.motion))}</span>',
                    parameter(fixed(fixing)),
                    state,
                ],
            )
        )
    lead = "Parameters of the last fit, with 90 % intervals."
    return section(
        "identifiability",
        "What this log determines",
        paragraph(lead),
        table(["Parameter", "Value", "In this log"], rows),
    )


def model(diagnosis: Answer) -> str:
    """The corrected model, with what changed marked."""
    # Without a cause nothing was corrected.
    attempt = diagnosis.verdict == "unexplained" and not diagnosis.causes
    title = "The best attempt as a model" if attempt else "The corrected model"
    if not diagnosis.model.strip():
        return section(
            "model",
            title,
            paragraph(diagnosis.model_missing or "The diagnosis holds no corrected model."),
        )
    use = use_sentence(diagnosis.model)
    if diagnosis.verdict == "partly_explained":
        use += f" Tune with a margin for the {show_percent(1.0 - diagnosis.closed_by_causes)} that is left."
    if diagnosis.verdict == "unexplained":
        use = "This is the best attempt, and it does not fit: do not tune gains in it."
    if not diagnosis.nominal.strip():
        lead = use
    else:
        changes = count_changes(diagnosis.nominal, diagnosis.model)
        if not changes:
            lead = "Nothing changed: this is the nominal model."
        else:
            values = "one value differs" if changes == 1 else f"{changes} values differ"
            lead = f"Marked: {values} from the nominal model. {use}"
    parts = [paragraph(lead), to_html(diagnosis.nominal, diagnosis.model)]
    if diagnosis.learned_model:
        told = (
            f"The same with the {learned_name(diagnosis)} as tables ([[learned]]): an interpolation of this log "
            f"without a named cause. It simulates better within the speeds and positions of the log."
        )
        parts += [paragraph(told), save_link(diagnosis.learned_model, "learned.toml")]
    return section("model", title, *parts)


def warnings(diagnosis: Answer) -> str:
    """The warnings."""
    if not diagnosis.warnings:
        return section("warnings", "Warnings", paragraph("None."))
    items = "".join(f"<li>{text(sentence)}</li>" for sentence in diagnosis.warnings)
    return section("warnings", "Warnings", f'<ul class="warnings">{items}</ul>')


def provenance(diagnosis: Answer) -> str:
    """Inputs, versions and date of the diagnosis."""
    known = diagnosis.provenance
    pairs: list[tuple[str, str]] = []
    if known.get("command"):
        pairs.append(("Command", f"<code>{text(known['command'])}</code>"))
    if known.get("started"):
        pairs.append(("Started", text(known["started"])))
    if diagnosis.seconds:
        total = sum(diagnosis.seconds.values())
        stages = ", ".join(
            f"{text(stage)} {data(spent, f'{spent:.1f}')} s" for stage, spent in diagnosis.seconds.items()
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
        told = f"{windows['fitted']} fitted, {windows['withheld']} withheld, of {windows['seconds']:.4g} s"
        pairs.append(("Windows", text(told)))
    if diagnosis.allowed:
        pairs.append(("Effects tried", text(f"only {', '.join(diagnosis.allowed)}")))
    listed = "".join(f"<dt>{title}</dt><dd>{told}</dd>" for title, told in pairs)
    inputs = [entry for entry in known.get("inputs", ()) if isinstance(entry, dict)]
    rows = [("", _input_cells(entry)) for entry in inputs]
    files = table(["Input", "Role", "Samples", "SHA-256"], rows) if rows else ""
    if not (pairs or rows):
        return section("provenance", "Provenance", paragraph("The diagnosis holds no provenance."))
    return section("provenance", "Provenance", files, f'<dl class="facts-list">{listed}</dl>' if listed else "")


def _input_cells(entry: JsonObject) -> list[str]:
    samples = entry.get("samples")
    return [
        f'<span class="name">{text(entry.get("name", ""))}</span>',
        text(entry.get("role", "")),
        "" if samples is None else text(samples),
        f'<code class="hash">{text(entry.get("sha256", ""))}</code>',
    ]


def units_note(diagnosis: Answer) -> str:
    """The definition of the gap, for the footer."""
    unit = show_unit(gap_scale(diagnosis)[1])
    return (
        f"The gap is the {effort_of(diagnosis)} that is missing in a model's command for the measured motion, rms on "
        f"withheld data with the noise's share taken out{f', in {unit}' if unit else ''}."
    )
