"""index.html: every case with its verdict, its checks and its pictures."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

from fpjax.output.json_object import JsonObject

HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Real records</title><style>
body{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#1d2430}
h1{font-size:1.5rem}h2{font-size:1.15rem;margin:2.2rem 0 .2rem}p{margin:.3rem 0}.quiet{color:#667}
table{border-collapse:collapse;margin:.6rem 0;width:100%}td,th{padding:.25rem .6rem .25rem 0;text-align:left;
border-bottom:1px solid #e3e6ea;vertical-align:top}.yes{color:#2a6fbb}.no{color:#b3471d;font-weight:600}
img{max-width:100%;border:1px solid #e3e6ea;margin:.3rem 0}
</style></head><body>
"""


def write_gallery(out: Path, results: list[JsonObject]) -> None:
    """Write index.html beside the cases' folders."""
    right, sure = sum(one["right"] for one in results), sum(one["wrongly_sure"] for one in results)
    parts = [HEAD, "<h1>Records of real machines</h1>"]
    parts.append(f"<p>{right} of {len(results)} as documented, {sure} wrongly sure.</p><table>")
    parts.append("<tr><th>case</th><th>verdict</th><th>causes</th><th>missing torque, withheld</th><th></th></tr>")
    parts += [_row(one) for one in results]
    parts.append("</table>")
    parts += [_section(one) for one in results]
    (out / "index.html").write_text("\n".join([*parts, "</body></html>\n"]))


def _row(one: JsonObject) -> str:
    mark = '<span class="yes">as documented</span>' if one["right"] else '<span class="no">not as documented</span>'
    cells = (
        f'<a href="#{escape(one["case"])}">{escape(one["case"])}</a>',
        escape(str(one["verdict"]).replace("_", " ")),
        escape(_causes(one)),
        escape(gap_words(one["gap"], one["causes"])),
        mark,
    )
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _causes(one: JsonObject) -> str:
    return ", ".join(name.replace("_", " ") for name in one["causes"]) or "none asserted"


def gap_words(gap: JsonObject | None, causes: Sequence[str]) -> str:
    """The missing torque before and after the asserted causes, as words with its unit."""
    if not gap or gap.get("before") is None:
        return "not given"
    from ..withheld.score import number

    before, unit = f"{number(gap['before']):.3g}", gap.get("unit", "")
    if not causes:
        return f"{before} {unit}, none of it closed" if number(gap["before"]) > 0.0 else "none on the withheld windows"
    return f"{before} to {number(gap['after']):.3g} {unit}"


def _section(one: JsonObject) -> str:
    name = escape(one["case"])
    lines = [f'<h2 id="{name}">{name}</h2>', f"<p>{escape(one['question'])}</p>"]
    lines.append(f'<p class="quiet">{escape(one["records"])}. {escape(one["source"])}</p>')
    if one["error"]:
        lines.append(f'<p class="no">{escape(one["error"])}</p>')
    lines.append(f"<p><b>{escape(str(one['verdict']).replace('_', ' '))}</b>: {escape(_causes(one))}</p><table>")
    for check in one["checks"]:
        word, style = {True: ("yes", "yes"), False: ("no", "no"), None: ("not asked", "quiet")}[check["passed"]]
        lines.append(
            f'<tr><td class="{style}">{word}</td><td>{escape(check["sentence"])}</td>'
            f"<td>{escape(check['found'])}</td></tr>"
        )
    lines.append("</table>")
    if one["report"]:
        lines.append(f'<p><a href="{escape(one["report"])}">the whole report</a></p>')
    for picture in one["pictures"]:
        lines.append(f'<img loading="lazy" src="{escape(picture)}" alt="{escape(Path(picture).stem)}">')
    return "\n".join(lines)
