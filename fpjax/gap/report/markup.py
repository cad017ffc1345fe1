"""The HTML elements of a report. All text goes through `text`, which escapes it: names of logs may hold anything."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

from .digits import readable, show, show_estimate, show_percent, show_unit

if TYPE_CHECKING:
    from .digits import Estimate


def text(given: object) -> str:
    """Any text, escaped for an element or an attribute."""
    return escape(str(given), quote=True)


def data(value: float, shown: str) -> str:
    """A number as shown, with the exact value in the attribute, for programs that read the page."""
    return f'<data value="{value!r}">{text(shown)}</data>'


def percent(share: float) -> str:
    """A share in per cent."""
    return data(share, show_percent(share))


def gap_number(raw: Estimate, shown: Estimate) -> str:
    """The size of a gap, shown in the unit of the report and exact in the contract's.

    Args:
        raw: as in `diagnosis.json`.
        shown: the same in the unit of the report.
    """
    if not raw.known:
        return '<span class="quiet">not known</span>'
    unit = show_unit(shown.unit)
    return f'<span class="value">{data(raw.value, show(shown.value))}{f" {text(unit)}" if unit else ""}</span>'


def gap_interval(raw: Estimate, shown: Estimate) -> str:
    """The interval of a gap, "" where it is not known."""
    # The noise floor is computed: its interval is a point.
    if not raw.bounded or raw.low == raw.high:
        return ""
    return f"{data(raw.low, show(shown.low))} to {data(raw.high, show(shown.high))}"


def parameter(estimate: Estimate) -> str:
    """A parameter's value, interval and unit, with the digits that the interval supports."""
    if not estimate.known:
        return '<span class="quiet">not known</span>'
    shown = readable(estimate)
    value, interval = show_estimate(shown)
    unit = show_unit(shown.unit)
    out = f'<span class="value">{data(estimate.value, value)}{f" {text(unit)}" if unit else ""}</span>'
    if interval:
        low, high = interval
        out += f' <span class="interval">[{data(estimate.low, low)} to {data(estimate.high, high)}]</span>'
    return out


def page(title: str, body: str, *, style: str, policy: str, description: str = "") -> str:
    """A whole self-contained page.

    Args:
        title: of the page, plain text.
        body: the <body> element.
        style: its CSS.
        policy: its content security policy.
        description: for search engines and previews, plain text; "" for none.
    """
    about = f'<meta name="description" content="{text(description)}">\n' if description else ""
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="generator" content="fpjax">
{about}<title>{text(title)}</title>
<style>
{style}</style>
</head>
{body}
</html>
"""


def section(name: str, title: str, *parts: str) -> str:
    """A section with a heading that can be linked to."""
    body = "\n".join(part for part in parts if part)
    heading = f'<h2 id="{name}-title">{text(title)}</h2>'
    return f'<section id="{name}" aria-labelledby="{name}-title">\n{heading}\n{body}\n</section>'


def paragraph(*sentences: str) -> str:
    """Plain sentences; "" where there are none."""
    joined = " ".join(sentence for sentence in sentences if sentence)
    return f"<p>{text(joined)}</p>" if joined else ""


def table(headings: list[str], rows: Iterable[tuple[str, list[str]]]) -> str:
    """A table that becomes one card per row on a phone.

    Args:
        headings: of the columns.
        rows: a row's class and its cells, as markup.
    """
    head = "".join(f'<th scope="col">{text(heading)}</th>' for heading in headings)
    body = ""
    for kind, cells in rows:
        tds = ""
        for i, (heading, cell) in enumerate(zip(headings, cells, strict=True)):
            kept = f"<div>{cell}</div>" if cell else ""
            tds += f'<td{" class=first" if i == 0 else ""} data-label="{text(heading)}">{kept}</td>'
        body += f"<tr{f' class={kind}' if kind else ''}>{tds}</tr>\n"
    return f'<table class="cards">\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody>\n</table>'


def figure(name: str, wide: str, narrow: str, caption: str = "") -> str:
    """A picture in its two layouts; the page shows the one that fits."""
    below = f"<figcaption>{text(caption)}</figcaption>" if caption else ""
    layouts = f'<div class="wide">{wide}</div>\n<div class="narrow">{narrow}</div>'
    return f'<figure id="figure-{name}">\n{layouts}\n{below}</figure>'
