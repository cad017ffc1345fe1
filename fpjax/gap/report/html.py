"""report.html: one self-contained file, and every picture as PNG beside it."""

from __future__ import annotations

import base64
import functools
import hashlib
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import InputError
from ...output.runfile import write_whole
from ..answer.files import PICTURES
from . import sections
from .heading import header
from .markup import page, text
from .pictures import draw_overview, draw_pictures
from .sentences import TITLES, verdict_sentence, verdict_title
from .svg import to_png, to_svg
from .theme import css_variables

if TYPE_CHECKING:
    from ..answer.answer import Answer

_NAVIGATION = (
    ("record", "Record"),
    ("where", "Where"),
    ("ranking", "Which effect"),
    ("shrink", "How far"),
    ("apart", "Not distinguished"),
    ("identifiability", "Identifiability"),
    ("model", "Model"),
    ("warnings", "Warnings"),
    ("provenance", "Provenance"),
)


def write_report(diagnosis: Answer, out_dir: str | Path) -> Path:
    """Write `report.html` and its `PICTURES`.

    A picture for which the diagnosis has no data is left out; one that an earlier report left in the folder goes.

    Args:
        diagnosis: from `fpjax.gap.diagnose`.
        out_dir: the folder, created if needed.

    Returns:
        The path of `report.html`.

    Raises:
        InputError: where the folder cannot be written, or the verdict is not one of the contract's.
    """
    if diagnosis.verdict not in TITLES:
        raise InputError(f"The diagnosis' verdict is {diagnosis.verdict!r}; a report knows {', '.join(TITLES)}.")
    folder = Path(out_dir)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # First: it is there seconds before the page, and holds the whole answer on one sheet.
        write_whole(folder / "overview.png", to_png(draw_overview(diagnosis)))
        pictures = draw_pictures(diagnosis)
        # Each picture twice: the page shows the layout that fits, without a script.
        drawn = {
            picture.name: (
                to_svg(picture.wide, f"{picture.name}-wide", picture.description),
                to_svg(picture.narrow, f"{picture.name}-narrow", picture.description),
            )
            for picture in pictures
        }
        for picture in pictures:
            write_whole(folder / f"{picture.name}.png", to_png(picture.wide))
        if (folder / "report.html").exists():  # pictures of these names are then of that report
            for name in set(PICTURES) - {"overview.png", *(f"{picture.name}.png" for picture in pictures)}:
                (folder / name).unlink(missing_ok=True)
        write_whole(folder / "report.html", to_page(diagnosis, drawn))
    except OSError as error:
        raise InputError(
            f"The report cannot be written to {folder} ({error.strerror}): give a folder that can be written to."
        ) from error
    return folder / "report.html"


def to_page(diagnosis: Answer, pictures: dict[str, tuple[str, str]]) -> str:
    """The page as HTML.

    Args:
        diagnosis: what is reported.
        pictures: wide and narrow SVG by name.
    """
    style = css_variables() + files("fpjax.gap.report").joinpath("report.css").read_text("utf-8")
    body = "\n".join(
        (
            sections.record(diagnosis, pictures),
            sections.where(diagnosis, pictures),
            sections.ranking(diagnosis, pictures),
            sections.shrink(diagnosis, pictures),
            sections.apart(diagnosis),
            sections.identifiability(diagnosis),
            sections.model(diagnosis),
            sections.warnings(diagnosis),
            sections.provenance(diagnosis),
        )
    )
    whole = f"""<body>
{header(diagnosis)}
<main>
{_navigation(diagnosis)}
{body}
</main>
<footer>{text(sections.units_note(diagnosis))} Written by fpjax.</footer>
<script>{_script()}</script>
</body>"""
    title = f"{verdict_title(diagnosis)}: sim-to-real gap"
    return page(title, whole, style=style, policy=_policy(), description=verdict_sentence(diagnosis))


def _navigation(diagnosis: Answer) -> str:
    """Links to the sections; the one to warnings with their number."""
    links = []
    for name, title in _NAVIGATION:
        if name == "warnings" and diagnosis.warnings:
            count = len(diagnosis.warnings)
            links.append(f'<a class="alert" href="#warnings">{count} warning{"s" if count > 1 else ""}</a>')
        else:
            links.append(f'<a href="#{name}">{text(title)}</a>')
    return f'<nav aria-label="Sections">{"".join(links)}</nav>'


@functools.cache
def _script() -> str:
    """The script that zooms the pictures."""
    return "\n" + files("fpjax.gap.report").joinpath("zoom.js").read_text("utf-8")


def _policy() -> str:
    """The content security policy: no external resource, and no script but the one with this hash."""
    digest = base64.b64encode(hashlib.sha256(_script().encode()).digest()).decode()
    return f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"
