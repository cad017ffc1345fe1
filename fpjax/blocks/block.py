"""What every block shares: parameters as array leaves, checked where they are concrete."""

import dataclasses
import textwrap
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from ..errors import InputError


class Block(eqx.Module):
    """A pure piece of the loop: an immutable pytree whose parameters are array leaves.

    Because the parameters are leaves, `jax.grad`, `jax.vmap` and a sweep reach each of them by name, and changing
    one never recompiles. A block has `init` (its state), `derivative` or `step` (how the state moves) and `readout`
    (its signals); a block without a state uses the empty tuple.
    """

    def __check_init__(self) -> None:
        # After the checks of each block's own class, which say more. In a user's own block infinity may mean no bound.
        if type(self).__module__.startswith("fpjax."):
            for field in dataclasses.fields(self):
                require_finite(self, field.name)

    def __repr__(self) -> str:
        """The block with its numbers."""
        return show_fields(self)


LINE = 100  # a representation longer than this [characters] gets a line for each field
MOST_SHOWN = 8  # a longer array is shown by its shape and range


def show_fields(module: eqx.Module) -> str:
    """A module with the values of its fields: one line, or a line a field where that would be long."""
    parts = [
        f"{field.name}={_shown(getattr(module, field.name))}" for field in dataclasses.fields(module) if field.repr
    ]
    name = type(module).__name__
    line = f"{name}({', '.join(parts)})"
    if len(line) <= LINE and "\n" not in line:
        return line
    lines = textwrap.indent(",\n".join(parts), "  ")
    return f"{name}(\n{lines},\n)"


def _shown(value: object) -> str:
    if not isinstance(value, jax.Array | np.ndarray) or isinstance(value, Tracer):
        return repr(value)
    if not jnp.issubdtype(value.dtype, jnp.number):
        return repr(value)
    numbers = np.asarray(value)
    if numbers.ndim == 0:
        return f"{numbers.item():.7g}"
    if numbers.size > MOST_SHOWN or not numbers.size:
        ends = f" from {numbers.min():.4g} to {numbers.max():.4g}" if numbers.size else ""
        return f"<{'x'.join(map(str, numbers.shape))} numbers{ends}>"
    return np.array2string(numbers, separator=", ", precision=6, floatmode="maxprec")


def as_parameter(value: Any) -> Any:
    """A number as an array leaf of JAX's default float type; arrays and tracers keep their dtype."""
    if isinstance(value, (jax.Array, jax.ShapeDtypeStruct)):
        return value
    if isinstance(value, np.ndarray) and np.issubdtype(value.dtype, np.floating):
        return jnp.asarray(value)
    if isinstance(value, (bool, int, float, np.number, list, tuple, np.ndarray)):
        return jnp.asarray(value, dtype=jnp.result_type(float))
    if isinstance(value, str):
        raise InputError(f"A block's parameter must be a number or an array, got the text {value!r}.")
    return value  # a placeholder of a tree transformation (None, a spec), not a number


def as_optional(value: Any) -> Any:
    """Like `as_parameter`; None stays None and means that the feature is not there at all."""
    return None if value is None else as_parameter(value)


def with_arrays(tree: PyTree) -> PyTree:
    """The blocks with every plain number in them as an array leaf, so that a user's own block need not convert its own.

    Args:
        tree: a block, or any pytree of blocks.
    """

    def one(leaf: PyTree) -> PyTree:
        number = isinstance(leaf, int | float) and not isinstance(leaf, bool)
        return as_parameter(float(leaf)) if number else leaf

    return jax.tree.map(one, tree)


def _concrete(value: object) -> np.ndarray | None:
    """The value as numpy; None where it cannot be checked: absent, traced, no number, or a placeholder of a tree."""
    if value is None or isinstance(value, Tracer):
        return None
    if not isinstance(value, (jax.Array, np.ndarray, float, int)):
        return None
    return np.asarray(value) if jnp.issubdtype(getattr(value, "dtype", float), jnp.number) else None


def require_positive(owner: object, name: str, unit: str) -> None:
    """Raise `InputError` unless the concrete field `name` of `owner` is finite and above zero."""
    value = _concrete(getattr(owner, name))
    if value is not None and not np.all(np.isfinite(value) & (value > 0)):
        raise InputError(
            f"{type(owner).__name__}: {name} must be finite and above zero, got {_show(value)} {unit}; check its sign "
            f"and its unit ({unit})."
        )


def require_not_negative(owner: object, name: str, unit: str) -> None:
    """Raise `InputError` unless the concrete field `name` of `owner` is finite and at least zero."""
    value = _concrete(getattr(owner, name))
    if value is not None and not np.all(np.isfinite(value) & (value >= 0)):
        raise InputError(
            f"{type(owner).__name__}: {name} must be finite and not negative, got {_show(value)} {unit}; check its "
            f"sign and its unit ({unit})."
        )


def require_finite(owner: object, name: str) -> None:
    """Raise `InputError` unless the concrete field `name` of `owner`, or each entry of its tuple, is finite."""
    field = getattr(owner, name, None)
    for entry in field if isinstance(field, tuple) else (field,):
        value = _concrete(entry)
        if value is not None and not np.all(np.isfinite(value)):
            count = f"{np.sum(~np.isfinite(value))} of {value.size} numbers are not: fill what is missing"
            raise InputError(
                f"{type(owner).__name__}: {name} must be finite, {count if value.ndim else f'got {value:g}; check it'}."
            )


def require_below(owner: object, name: str, limit: float) -> None:
    """Raise `InputError` unless the concrete field `name` of `owner` is below `limit` [1]."""
    value = _concrete(getattr(owner, name))
    if value is not None and not np.all(value < limit):
        raise InputError(f"{type(owner).__name__}: {name} must be below {limit:g}, got {_show(value)}.")


def require_share(owner: object, name: str) -> None:
    """Raise `InputError` unless the concrete field `name` of `owner` is from 0 to 1."""
    value = _concrete(getattr(owner, name))
    if value is not None and not np.all((value >= 0) & (value <= 1)):
        raise InputError(f"{type(owner).__name__}: {name} must be from 0 to 1, got {_show(value)}: it is a share.")


def require_not_below(owner: object, name: str, other: str, unit: str) -> None:
    """Raise `InputError` unless the concrete field `name` of `owner` is at least its field `other`."""
    value, least = _concrete(getattr(owner, name)), _concrete(getattr(owner, other))
    if value is not None and least is not None and not np.all(value >= least):
        told = f"{name} must be at least {other} = {_show(least)} {unit}, got {_show(value)} {unit}."
        raise InputError(f"{type(owner).__name__}: {told}")


def _show(value: np.ndarray) -> str:
    return f"{float(value):g}" if value.ndim == 0 else f"an array from {value.min():g} to {value.max():g}"
