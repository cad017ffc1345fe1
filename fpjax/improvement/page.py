"""improve.html: the decision, the changes and the predictions on one self-contained page."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from ..gap.report.digits import show_unit
from ..gap.report.markup import page, text
from ..gap.report.names import effect_name, for_motion
from ..gap.report.svg import to_png, to_svg
from ..gap.report.theme import css_variables
from ..model_file.keys import Units
from ..output.runfile import made_folder, write_whole
from .pictures import draw_error, draw_gains, draw_machines, draw_overview
from .summary import UNPROMISED, WORDS, headline

if TYPE_CHECKING:
    from .answer import Answer, Range

PAGE, PICTURE = "improve.html", "improve.png"
# The page loads nothing: neither scripts nor anything from another host.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_STYLE = """
.gain{font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;font-size:.9em}
.keep .badge,.cannot_promise .badge{background:var(--muted)}
.unstable .badge{background:var(--before)}
.number{white-space:nowrap}
.new{color:var(--after);font-weight:650}
.old{color:var(--before)}
"""
# Units of the gains as the model file has them, of a rotary axis in SI. An observer's gains are pure numbers there.
_FEEDFORWARD = {"inertia": "kg m^2", "coulomb": "N m", "viscous": "N m s/rad"}
_CONTROLLERS = {
    "pi": {"kp": "N m s/rad", "ki": "N m/rad"},
    "p": {"kp": "N m s/rad"},
    "lead": {"gain": "N m s/rad", "zero": "rad/s", "pole": "rad/s"},
    "position_cascade": {"kp": "1/s", "kv": "N m s/rad", "ki": "N m/rad"},
}
# Pure numbers that a reader may take for decibels.
_FACTORS = {"gain margin": "gain margin, a factor"}
WAY = (
    "Machines are drawn from the diagnosis: the parameters with their uncertainty, the learned laws, and the torque "
    "that nothing explains, with its size and spectrum. The gains were searched on {tuned} of them, for the smallest "
    "mean + 1.28 standard deviations of the tracking error, which nine machines in ten stay below. They are judged "
    "here on {judged} others. A change is proposed where it follows better in at least 95 % of them, by 2 % or more in "
    "the median, without less stability than usual or a rougher torque. The present gains are always candidates too."
)


def write_page(found: Answer, folder: Path) -> Path:
    """Write the page and its picture.

    Args:
        found: the improvement.
        folder: created if missing.

    Returns:
        The path of `improve.html`.

    Raises:
        InputError: where it cannot be written.
    """
    folder = made_folder(folder)
    write_whole(folder / PICTURE, to_png(draw_overview(found)))
    write_whole(folder / PAGE, to_page(found))
    return folder / PAGE


def to_page(found: Answer) -> str:
    """The page's text."""
    style = css_variables() + files("fpjax.gap.report").joinpath("report.css").read_text("utf-8") + _STYLE
    parts = [
        _changes(found),
        _predicted(found),
        _nominal(found),
        _pictures(found),
        _notes(found),
        _way(found),
        _model(found),
    ]
    body = "\n".join(part for part in parts if part)
    whole = f"""<body class="{found.decision}">
<header>
<p class="origin">fpjax improve</p>
<div class="verdict {found.decision}"><span class="badge">{text(WORDS[found.decision].rstrip("."))}</span>
<span class="confidence">diagnosis: {text(_diagnosed(found))}</span></div>
<h1>{text(found.reason if found.decision == "change" else headline(found))}</h1>
{_facts(found)}
</header>
<main>
{body}
</main>
<footer>Numbers are medians over the machines, with 90 % intervals{_no_promise(found)}. Written by fpjax.</footer>
</body>"""
    return page(f"{WORDS[found.decision]} fpjax improve", whole, style=style, policy=_POLICY)


def _no_promise(found: Answer) -> str:
    if found.promised:
        return ""
    why = "too little is known of this machine"
    if found.verdict == "unexplained":
        why = "the diagnosis does not explain this log"
    return f", which are no promise: {why}"


def _diagnosed(found: Answer) -> str:
    words = found.verdict.replace("_", " ")
    return (
        f"{words} ({', '.join(effect_name(cause, _motion(found)) for cause in found.causes)})"
        if found.causes
        else words
    )


def _motion(found: Answer) -> str:
    return "linear" if found.before.torque.unit == "N" else "rotary"


def _facts(found: Answer) -> str:
    if found.decision == "unstable":
        return ""
    rows = [("is-before", "tracking error now", found.before.error)]
    if found.decision == "change":
        rows.append(("is-after", "with the new gains", found.after.error))
        if found.before.reversal is not None and found.after.reversal is not None:
            rows.append(("is-before", "at reversals now", found.before.reversal))
            rows.append(("is-after", "at reversals, new", found.after.reversal))
    cells = "".join(
        f'<div class="{kind}"><dt>{text(name)}</dt><dd>{value.value:.3g} {text(show_unit(value.unit))}'
        f"<small>90 % interval <span>{value.low:.3g} to {value.high:.3g} {text(show_unit(value.unit))}</span></small>"
        "</dd></div>"
        for kind, name, value in rows
    )
    return f'<dl class="facts">{cells}</dl>'


def _changes(found: Answer) -> str:
    if not found.changes:
        return ""
    rows, units = [], _gain_units(found)
    for change in found.changes:
        moved = change.after != change.before
        at = f" <span class=pill>at the {change.at} end of its bounds</span>" if change.at else ""
        unit = f" {text(show_unit(units.get(change.gain, '')))}".rstrip()
        after = f'<span class="new">{change.after:.5g}{unit}</span>{at}' if moved else "stays"
        span = f"{change.low:.4g} to {change.high:.4g}{unit}"
        rows.append([f'<span class="gain">{text(change.gain)}</span>', f"{change.before:.5g}{unit}", after, span])
    return _section("Gains", _table(["gain", "now", "new", "bounds"], rows))


def _gain_units(found: Answer) -> dict[str, str]:
    """Units of the gains by name; a name without one is a pure number, or not known."""
    # Where the gains are kept there is no tuned model; the corrected one has the same units.
    model = found.model or (found.diagnosis.model if found.diagnosis is not None else "")
    if not model.strip():
        return {}
    tables = tomllib.loads(model)
    written = tables.get("units", {})
    linear = written.get("motion") == "linear"
    machine = Units(written.get("motion", "rotary"), written.get("torque", "N" if linear else "N m"))
    own = _CONTROLLERS.get(tables.get("controller", {}).get("type", ""), {})
    sections = {"feedforward": _FEEDFORWARD, "controller": own}
    return {f"{name}.{key}": machine.name(unit) for name, keys in sections.items() for key, unit in keys.items()}


def _predicted(found: Answer) -> str:
    if found.decision == "unstable":  # every number would be infinite
        return ""
    after = dict(found.after.rows())
    changed = found.decision == "change"
    rows = [
        [
            text(for_motion(_FACTORS.get(name, name), _motion(found))),
            _number(value),
            *([_number(after[name]) if name in after else ""] if changed else []),
        ]
        for name, value in found.before.rows()
    ]
    if found.measured is not None:
        told = f'<span class="number">{found.measured:.4g} {text(show_unit(found.before.error.unit))}</span>'
        rows.append(["tracking error in the log, rms", told, *([""] if changed else [])])
    return _section(
        "Predicted" if found.promised else f"{UNPROMISED[found.decision].capitalize()}, not promised",
        _table(["", "now", *(["with the new gains"] if changed else [])], rows),
    )


def _nominal(found: Answer) -> str:
    alone = found.nominal
    if alone is None:
        return ""
    peak = "the drive's own limit"
    if alone.allowed_peak is not None:
        peak = f"{alone.allowed_peak:.4g} {show_unit(alone.peak.unit)}"
    left = "the proposed ones" if found.decision == "change" else "yours"
    rows = [
        [f"tracking error over that with {left}", _number(alone.ratio), ""],
        ["largest torque", _number(alone.peak), text(peak)],
        ["roughness of the torque over that of yours", _number(alone.rough), f"{alone.allowed_rough:g}"],
    ]
    named = ", ".join(f"{text(word)} {value:.5g}" for word, value in alone.gains.items())
    return _section(
        "The gains of the nominal model",
        f"<p>{text(alone.sentence())}</p>{_table(['on these machines', 'predicted', 'allowed'], rows)}"
        f'<p class="gain">{named}</p>',
    )


def _number(value: Range) -> str:
    unit = f" {text(show_unit(value.unit))}".rstrip()
    ends = f'<span class="interval">[{value.low:.4g} to {value.high:.4g}]</span>'
    return f'<span class="number">{value.value:.4g}{unit}</span> {ends}'


def _pictures(found: Answer) -> str:
    if not found.runs or found.ratios is None:
        return ""
    drawn = (
        ("error", draw_error, "Tracking error over time, with the gains now and with the new ones."),
        ("machines", draw_machines, "Each dot is one machine that the log leaves possible; left of the dashed line its "
         "error is smaller with the new gains."),
        ("gains", draw_gains, "Where the gains lie between their bounds."),
    )  # fmt: skip
    return _section(
        "Pictures", "".join(_figure(name, draw(found), draw(found, narrow=True), said) for name, draw, said in drawn)
    )


def _figure(name: str, wide: Figure, narrow: Figure, caption: str) -> str:
    layouts = "".join(
        f'<div class="{kind}">{to_svg(one, f"{name}-{kind}", caption)}</div>'
        for kind, one in (("wide", wide), ("narrow", narrow))
    )
    return f"<figure>{layouts}<figcaption>{text(caption)}</figcaption></figure>"


def _notes(found: Answer) -> str:
    items = "".join(f"<li>{text(note)}</li>" for note in found.notes)
    return _section("Notes", f'<ul class="found">{items}</ul>') if items else ""


def _way(found: Answer) -> str:
    told = WAY.format(tuned=found.tuned_on, judged=found.machines)
    times = ", ".join(f"{stage} {spent:.1f} s" for stage, spent in found.seconds.items())
    spent = f'<p class="quiet">{text(times)}</p>' if times else ""
    return _section("How it was found", f"<p>{text(told)}</p>{spent}")


def _model(found: Answer) -> str:
    if not found.model:
        return ""
    return _section(
        "tuned.toml", "<p>The corrected model with the new gains; fpjax simulate runs it, fpjax export --c writes it "
        f"for the drive.</p><details><summary>show</summary><pre>{text(found.model)}</pre></details>",
    )  # fmt: skip


def _section(title: str, body: str) -> str:
    return f"<section><h2>{text(title)}</h2>{body}</section>"


def _table(header: list[str], rows: list[list[str]]) -> str:
    head = "".join(f'<th scope="col">{text(each)}</th>' for each in header)
    body = "".join(
        "<tr>" + "".join(
            f'<td{" class=first" if place == 0 else ""} data-label="{text(header[place])}">'
            f"{f'<div>{cell}</div>' if cell else ''}</td>"
            for place, cell in enumerate(row)
        ) + "</tr>"
        for row in rows
    )  # fmt: skip
    return f'<table class="cards"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
