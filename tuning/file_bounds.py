"""The bounds of tuned parameters from the [bounds] of a model file."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from fpjax.analysis.placement import default_parameters
from fpjax.blocks.parameters import get_parameter
from fpjax.errors import InputError
from fpjax.model_file import Model
from fpjax.model_file.bounds import gain_names

from .parameters import Parameter


def bounded_parameters(
    model: Model, parameters: Sequence[str | Parameter] | None = None
) -> Sequence[str | Parameter] | None:
    """The parameters to tune, with the model's [bounds] where they have none of their own.

    A gain in [bounds] is not tuned for that reason: it must be among the parameters too. A lower bound of zero makes
    the scale linear, as zero has no logarithm.

    Args:
        model: whose `bounds` are by the file's keys, as "controller.kp".
        parameters: as `tune` takes them; None for its default.

    Returns:
        The same where the model has no bounds; else `Parameter`s, with the model's bounds where they had none.

    Raises:
        InputError: for a gain, or a start, outside the bounds of the same file.
    """
    if not model.bounds:
        return parameters
    words = {name: word for word, name in gain_names(model.loop).items()}
    wanted = default_parameters(model.loop) if parameters is None else parameters
    full = [Parameter(one) if isinstance(one, str) else one for one in wanted]
    return [_bounded(model, one, words.get(one.name, "")) for one in full]


def _bounded(model: Model, one: Parameter, word: str) -> Parameter:
    if word not in model.bounds or one.low is not None or one.high is not None:
        return one
    low, high = model.bounds[word]
    section, _, key = word.partition(".")
    start = float(np.asarray(get_parameter(model.loop, one.name))) if one.start is None else one.start
    if one.start is None and key not in model.sections.get(section, {}):
        # The gain is not in the file: pole placement chose it, and knows no bounds.
        start = min(max(start, low), high)
    if not low <= start <= high:
        raise InputError(
            f"{word} = {start:g} lies outside its own bounds [{low:g}, {high:g}]: widen them, or correct the gain."
        )
    return dataclasses.replace(one, start=start, low=low, high=high, scale=one.scale if low > 0.0 else "linear")
