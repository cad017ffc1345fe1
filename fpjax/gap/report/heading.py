"""The head of the report: verdict, confidence, one sentence, four numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..answer.summary import dominant_sentence
from .derived_values import at_bound, shown_gap, twins_of
from .digits import show_percent, show_unit
from .markup import gap_interval, gap_number, paragraph, percent, text
from .names import effect_name, join, parameter_name
from .sentences import (
    confidence_sentence,
    learned_sentence,
    verdict_sentence,
    verdict_title,
    where_sentence,
)

if TYPE_CHECKING:
    from ..answer.answer import Answer


def header(diagnosis: Answer) -> str:
    """The head as HTML: verdict, confidence, one sentence, four numbers."""
    inputs = [str(entry.get("name", "")) for entry in diagnosis.provenance.get("inputs", ()) if isinstance(entry, dict)]
    origin = " · ".join(["Sim-to-real gap", *(name for name in inputs if name)])
    sure = confidence_sentence(diagnosis)
    # The badge of a partly explained gap is filled as far as the gap is closed.
    closed = f' style="--closed:{diagnosis.closed_by_causes:.0%}"' if diagnosis.verdict == "partly_explained" else ""
    badge = f'<span class="badge"{closed}>{text(verdict_title(diagnosis))}</span>'
    confidence = (
        f'<span class="confidence">Confidence: <b>{text(sure[:1].lower() + sure[1:].rstrip("."))}</b></span>'
        if sure
        else ""
    )
    return (
        f'<header class="{diagnosis.verdict}">\n<p class="origin">{text(origin)}</p>\n'
        f'<div class="verdict">{badge}{confidence}</div>\n<h1>{_sentence(diagnosis)}</h1>\n'
        f"{_facts(diagnosis)}{_caution(diagnosis)}{paragraph(where_sentence(diagnosis))}"
        f"{paragraph(dominant_sentence(diagnosis, show_percent))}{paragraph(learned_sentence(diagnosis))}\n</header>"
    )


def _sentence(diagnosis: Answer) -> str:
    """The sentence of the verdict as HTML, with the effects' names in bold."""
    out = text(verdict_sentence(diagnosis))
    named = [effect for cause in diagnosis.causes for effect in (cause, *twins_of(diagnosis, cause))]
    # Longest first, and replaced by placeholders before markup: a name may be part of another one.
    names = {text(effect_name(effect, diagnosis.motion)) for effect in named}
    # The first word of the sentence has a capital.
    names = sorted(names | {name[:1].upper() + name[1:] for name in names}, key=len, reverse=True)
    for i, name in enumerate(names):
        out = out.replace(name, f"\x00{i}\x01")
    for i, name in enumerate(names):
        out = out.replace(f"\x00{i}\x01", f"<strong>{name}</strong>")
    return out


def _caution(diagnosis: Answer) -> str:
    """A caution about parameters of the causes that ended at a bound of the search; "" for none."""
    limited = [entry for entry in diagnosis.ranking if entry.effect in diagnosis.causes and at_bound(entry)]
    names = [
        f"{parameter_name(name, diagnosis.motion)} of {effect_name(e.effect, diagnosis.motion)}"
        for e in limited
        for name in at_bound(e)
    ]
    return paragraph(f"At a bound of the search, and so not measured: {join(names)}.") if names else ""


def _facts(diagnosis: Answer) -> str:
    """The gap before and after, the noise floor and the share closed, as tiles with intervals."""
    tiles = [("before", "Difference" if diagnosis.nothing_missing else "Gap before", diagnosis.gap.estimate("before"))]
    if not diagnosis.nothing_missing:
        title = "Gap after" if diagnosis.causes else "Gap after the best attempt"
        tiles.append(("after", title, diagnosis.gap.estimate("after")))
    if diagnosis.learned:
        tiles.append(("after", "With what was learned", diagnosis.gap.estimate("learned")))
    tiles.append(("floor", "Noise floor", diagnosis.gap.estimate("noise_floor")))
    cells = []
    for kind, title, size in tiles:
        interval = gap_interval(size, shown_gap(diagnosis, size))
        unit = f" {text(show_unit(shown_gap(diagnosis, size).unit))}".rstrip()
        below = f"<small>90 % interval <span>{interval}{unit}</span></small>" if interval else ""
        number = gap_number(size, shown_gap(diagnosis, size))
        cells.append(f'<div class="is-{kind}"><dt>{title}</dt><dd>{number}{below}</dd></div>')
    closed = diagnosis.gap.estimate("closed")
    # Of a gap below the floor there is no share to close.
    if closed.known and not diagnosis.nothing_missing and not diagnosis.gap.before <= diagnosis.gap.noise_floor:
        interval = (
            f"<small>90 % interval <span>{percent(closed.low)} to {percent(closed.high)}</span></small>"
            if closed.bounded
            else ""
        )
        with_them = " with what is not sure" if diagnosis.undecided else ""
        title = f"Gap closed{with_them}" if diagnosis.causes else "Closed by the best attempt"
        cells.append(f'<div class="is-closed"><dt>{title}</dt><dd>{percent(closed.value)}{interval}</dd></div>')
    return f'<dl class="facts">{"".join(cells)}</dl>'
