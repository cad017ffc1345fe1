"""Forms: the word in `type = ...`, its block and its keys. One table serves both building and writing a block."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jax.core import Tracer

from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from .keys import Key, Units, check_keys, choose, read_values


@dataclass(frozen=True)
class Form:
    """One type of a section.

    Attributes:
        name: the word in `type`.
        block: the class.
        keys: its numbers.
    """

    name: str
    block: type
    keys: tuple[Key, ...]

    def build(self, section: str, table: TomlTable, units: Units, **more: Any) -> Any:
        """The block from a section; `more` holds the fields that are no numbers."""
        check_keys(section, table, ["type", *(key.name for key in self.keys)], f" for type = {self.name!r}")
        values = read_values(section, table, self.keys, units)
        fields = {key.attribute: values[key.name] for key in self.keys}
        return self.block(**fields, **more)

    def describe(self, block: Any) -> JsonObject:
        """The section that builds this block."""
        return {"type": self.name, **numbers(block, self.keys)}


def numbers(block: Any, keys: Sequence[Key]) -> JsonObject:
    """The block's values by key. Values at their default are left out; a batch or a tracer is refused."""
    table = {}
    for key in keys:
        value = getattr(block, key.attribute)
        if value is None:
            continue
        plain = tuple(float(each) for each in np.asarray(value)) if key.many else number(value, key.name)
        if key.required or plain != key.default:
            table[key.name] = list(plain) if isinstance(plain, tuple) else plain
    return table


def number(value: Any, name: str) -> float:
    """A leaf as a Python number.

    Raises:
        InputError: for a leaf that is a batch or a tracer.
    """
    if isinstance(value, Tracer) or np.ndim(value) != 0:
        raise InputError(f"{name} must be a single number, got shape {np.shape(value)}: write one model of the batch.")
    return float(value)


def form_of(section: str, table: TomlTable, forms: Sequence[Form], others: Sequence[str] = ()) -> str:
    """The word in `type`.

    Raises:
        InputError: where it is missing or not known.
    """
    known = [form.name for form in forms] + list(others)
    if "type" not in table:
        raise InputError(f'[{section}] type is missing: write type = "{known[0]}", or one of {", ".join(known)}.')
    return choose(section, "type", table["type"], known)


def pick(forms: Sequence[Form], name: str) -> Form:
    """The form of that name."""
    return next(form for form in forms if form.name == name)


def form_for(block: Any, forms: Sequence[Form], section: str) -> Form:
    """The form that describes this block.

    Raises:
        InputError: for a block of a class that servo.toml cannot hold.
    """
    for form in forms:
        if type(block) is form.block:
            return form
    raise InputError(
        f"servo.toml cannot hold {type(block).__name__} in [{section}]: it knows "
        f"{', '.join(form.block.__name__ for form in forms)}; keep such a loop in Python."
    )
