"""What an interrupted benchmark left in its folder, for `--resume`."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

from fpjax import InputError
from fpjax.output.json_object import JsonObject


def unfinished(path: Path, settings: JsonObject, needed: Sequence[str]) -> JsonObject:
    """The content of an interrupted run's file.

    Args:
        path: of the file.
        settings: of this run; those in the file must be equal.
        needed: further keys that the file must have.

    Raises:
        InputError: where there is none, or one with other options.
    """
    try:
        content: JsonObject = json.loads(path.read_text())
        found = {name: content[name] for name in ("settings", *needed)}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"--resume: {path} holds no interrupted run ({type(error).__name__}): run without --resume."
        ) from error
    if found["settings"] != settings:
        raise InputError(f"--resume: {path} was begun with {found['settings']}, not {settings}: give the same options.")
    return found


def read_cost(value: float | None) -> float:
    """A cost from JSON, which has no infinity: a run that diverged is null there."""
    return math.inf if value is None else value
