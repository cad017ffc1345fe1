"""TOML text <-> nested dictionaries: read by tomllib, written here (tomllib cannot write)."""

import math
import os
import pathlib
import stat
import tomllib
from collections.abc import Mapping
from typing import Any

from ..errors import InputError
from .json_object import JsonObject, TomlTable
from .paths import expanded

LARGEST = 20_000_000  # largest model file [bytes]: about a learned table of a million points


def read_source(source: str | os.PathLike[str]) -> tuple[str, pathlib.Path | None]:
    """(text, path) of a servo.toml given by its path or as text.

    Args:
        source: a path, or text (anything with a line break or a "=").

    Raises:
        InputError: for a file that is not there or cannot be read.
    """
    if isinstance(source, str) and ("\n" in source or "=" in source or not source.strip()):
        return source, None
    if not isinstance(source, str | os.PathLike):
        raise InputError(
            f"A model cannot be read from {type(source).__name__} {str(source)[:40]!r}: give a Model "
            "(fpjax.load_model), or the path or the text of a servo.toml."
        )
    path = expanded(source)
    try:
        _check_regular(path)
        return path.read_bytes().decode("utf-8-sig", "strict" if path.suffix == ".toml" else "replace"), path
    except InputError:  # first, because it is a ValueError too
        raise
    except FileNotFoundError:
        raise InputError(f"{path} does not exist: {_neighbour(path)}") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a folder, not a model: name the servo.toml in it.") from None
    except (OSError, UnicodeDecodeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(f"{str(path)[:200]!r} cannot be read ({reason}): give a servo.toml.") from None


def _check_regular(path: pathlib.Path) -> None:
    """Refuse pipes and devices, whose reading might never end, and files that are far too long for a model."""
    found = path.stat()
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path} is a pipe or a device, not a file: save the model to a file first.")
    if found.st_size > LARGEST:
        raise InputError(
            f"{path} has {found.st_size / 1e6:.0f} MB, but a model has at most {LARGEST / 1e6:.0f} MB: is it a log? "
            "Give a servo.toml."
        )


def _neighbour(path: pathlib.Path) -> str:
    import difflib

    try:
        names = [entry.name for entry in path.parent.iterdir() if entry.suffix == ".toml"]
    except OSError:
        return f"the folder {path.parent} does not exist either."
    near = difflib.get_close_matches(path.name, names, n=1)
    return f"did you mean {near[0]!r}?" if near else "give the path of a servo.toml."


def parse(text: str, name: str) -> JsonObject:
    """The sections of a model file.

    Raises:
        InputError: where the text is not valid TOML, naming the line.
    """
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{name} is not valid TOML: {reason[:200]}; correct that line.") from None


def write(sections: TomlTable, comments: Mapping[tuple[str, str], str] | None = None) -> str:
    """TOML text of sections (a mapping, or a list of mappings for [[section]]); numbers are written exactly.

    Args:
        sections: by name, in the order to write.
        comments: by (section, key), a comment after the value.
    """
    blocks = []
    for name, tables in sections.items():
        several = isinstance(tables, list)
        for table in tables if several else [tables]:
            lines = [f"[[{name}]]" if several else f"[{name}]"]
            for key, value in table.items():
                comment = (comments or {}).get((name, key), "")
                line = f"{key} = {_value(value)}"
                lines.append(f"{line:<28} # {comment}" if comment else line)
            blocks.append("\n".join(lines))
    return "\n\n".join(blocks) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(item) for item in value)}]"
    number = float(value)
    if not math.isfinite(number):
        raise InputError(f"{number} cannot be written into a model file: every value must be finite.")
    text = repr(number)  # the shortest digits that read back to the same number
    return text


def _string(value: str) -> str:
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}" for c in escaped) + '"'
