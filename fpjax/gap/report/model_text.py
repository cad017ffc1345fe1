"""The corrected model as servo.toml text, with what changed against the nominal one marked."""

import base64
import math
from dataclasses import dataclass

from ...analysis.placement import default_parameters
from ...errors import InputError
from ...model_file import dump_model, load_model
from .markup import text

# Relative difference below which a value is unchanged: single precision keeps seven digits.
_SAME = 1e-6


@dataclass(frozen=True)
class Line:
    """One line of the corrected model.

    Attributes:
        text: as it stands in the file.
        change: "" for none, `changed` or `added`.
        was: the nominal value, where changed.
    """

    text: str
    change: str = ""
    was: str = ""


def compare(nominal: str, corrected: str) -> tuple[list[Line], list[str]]:
    """(lines of the corrected model, marked; entries of the nominal one that are gone, as `section.key = value`).

    Args:
        nominal: `servo.toml` text; without it nothing is marked.
        corrected: likewise.
    """
    if not nominal.strip():
        return [Line(line) for line in corrected.splitlines()], []
    given = {name: value for _, name, value in _entries(nominal)}
    whole = {name: value for _, name, value in _entries(_spelled_out(nominal))}
    # Defaults that the author left out are known from the file as the package writes it; given values keep their text.
    old = whole | given
    new = {name for _, name, _ in _entries(corrected)}
    # By line number: the marks go to the text as it is written, which tomllib does not give.
    lines, marks = [], {number: (name, value) for number, name, value in _entries(corrected)}
    sections = {name.rpartition(".")[0] for name in old}
    for number, line in enumerate(corrected.splitlines()):
        if number in marks:
            name, value = marks[number]
            if name not in old:
                lines.append(Line(line, "added"))
            # a recorded reference is the same log, whose path is absolute in what the package writes
            elif _same(old[name], value) or name == "reference.file":
                lines.append(Line(line))
            else:
                lines.append(Line(line, "changed", old[name]))
        else:
            section = _section(line)
            lines.append(Line(line, "added" if section and section not in sections else ""))
    return lines, [f"{name} = {value}" for name, value in whole.items() if name not in new]


def to_html(nominal: str, corrected: str) -> str:
    """The model as a block of code, and a link that saves it."""
    lines, gone = compare(nominal, corrected)
    shown = []
    for line in lines:
        was = f'<span class="was">was {text(line.was)}</span>' if line.was else ""
        kind = f"line {line.change}".strip()
        shown.append(f'<span class="{kind}">{text(line.text)}{was}</span>')
    lost = f'<p class="quiet">No longer in the model: {text(", ".join(gone))}.</p>' if gone else ""
    return f"<pre><code>{''.join(shown)}</code></pre>\n{lost}\n{save_link(corrected, 'corrected.toml')}"


def save_link(model: str, name: str) -> str:
    """A link that saves a model's text as a file of that name."""
    address = f"data:text/plain;charset=utf-8;base64,{base64.b64encode(model.encode()).decode()}"
    return f'<p><a download="{name}" href="{address}">Save as {name}</a></p>'


def use_sentence(model: str) -> str:
    """What the corrected model can be used for; it is read back to find out."""
    try:
        read = load_model(model)
        for needed in (read.needed_controller, read.needed_reference, read.needed_duration):
            needed()
    except InputError as error:
        return f"The machine is complete; to simulate a loop around it, the file needs more. {error}"
    try:
        default_parameters(read.loop)
    except InputError:
        return "fpjax simulate runs this file as it is."
    return "fpjax simulate and fpjax tune take this file as it is."


def count_changes(nominal: str, corrected: str) -> int:
    """Number of values that differ from the nominal model, those added or gone included."""
    lines, gone = compare(nominal, corrected)
    return sum(bool(line.change) and not _section(line.text) for line in lines) + len(gone)


def _entries(model: str) -> list[tuple[int, str, str]]:
    """(line number, section.key, value) of each `key = value` line; comments are not part of a value."""
    found, section = [], ""
    for number, line in enumerate(model.splitlines()):
        if named := _section(line):
            section = named
        elif "=" in line and not line.lstrip().startswith("#"):
            key, _, value = line.partition("=")
            found.append((number, f"{section}.{key.strip()}".lstrip("."), _without_comment(value)))
    return found


def _spelled_out(nominal: str) -> str:
    """The nominal model as the package writes it, with the defaults that its author left out.

    A default that is only written out is not a change. A file that cannot be read stays as it is.
    """
    try:
        return dump_model(load_model(nominal))
    except InputError:
        return nominal


def _section(line: str) -> str:
    """The name in a line that is a section header, else ""."""
    stripped = _without_comment(line)
    return stripped.strip("[] ") if stripped.startswith("[") and stripped.endswith("]") and "=" not in stripped else ""


def _without_comment(value: str) -> str:
    """A line without its comment; a # within quotes is not one."""
    quote = ""
    for i, letter in enumerate(value):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter == "#":
            return value[:i].strip()
    return value.strip()


def _same(one: str, other: str) -> bool:
    try:
        return math.isclose(float(one), float(other), rel_tol=_SAME)
    except ValueError:
        return one == other
