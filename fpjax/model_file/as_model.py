"""A model as users give it to a function: itself, or the path or text of its file."""

import os
from typing import Any

from ..blocks.observers import AbstractObserver
from ..errors import InputError
from ..simulation.input_checks import shown
from ..simulation.loop import ClosedLoop
from ..simulation.precision import double_precision
from .model import Model
from .reading import load_model


def as_model(source: Any, verb: str, also: str = "a ClosedLoop") -> Model | None:
    """The model given, read from its file where it is a path or text; None for a loop or an observer.

    Args:
        source: the user's argument.
        verb: the function whose argument it is, for the message.
        also: what else the argument may be, for the message; "" for nothing.

    Raises:
        InputError: for anything else.
    """
    return None if isinstance(source, ClosedLoop | AbstractObserver) else needed_model(source, verb, also)


def needed_model(source: Any, verb: str, also: str = "") -> Model:
    """`as_model` where nothing but a model will do.

    Raises:
        InputError: for anything else.
    """
    if isinstance(source, Model):
        return source
    if isinstance(source, str | os.PathLike):
        with double_precision():
            return load_model(source)
    raise InputError(
        f"{verb} got {shown(source)}: give {also}{', ' if also else ''}a Model (fpjax.load_model) or the path of a "
        "servo.toml."
    )
