"""Parameters by dotted name, as sweeps, tunings and identifications read and set them in any tree of blocks.

A name is the path of attributes to an array leaf, as in `observer.gain_1` or `plant.friction.coulomb`. An entry of a
tuple goes by its index (`parts.0.gain`), an entry of a dictionary by its key.
"""

import dataclasses
import difflib
from collections.abc import Iterator, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, PyTree

from ..errors import InputError

MOST_NAMED = 350  # [characters] of names in a message


def parameter_names(tree: PyTree) -> tuple[str, ...]:
    """Dotted names of all floating-point leaves of `tree`, in order; fields that are None or static have no name."""
    return tuple(".".join(path) for path, _ in _leaves(tree, ()))


def get_parameter(tree: PyTree, name: str) -> Array:
    """The value of one parameter, in its own unit.

    Args:
        tree: a closed loop, a block, or any container of them.
        name: dotted name, one of `parameter_names(tree)`.

    Raises:
        InputError: for an unknown name; the message gives the nearest one.
    """
    for path, leaf in _leaves(tree, ()):
        if ".".join(path) == name:
            return leaf
    raise InputError(_unknown(tree, name))


def get_parameters(tree: PyTree, names: tuple[str, ...] | list[str]) -> dict[str, Array]:
    """The values of several parameters by name, each in its own unit.

    Args:
        tree: a closed loop, a block, or any container of them.
        names: dotted names, each one of `parameter_names(tree)`.

    Raises:
        InputError: for an unknown name; the message gives the nearest one.
    """
    known = {".".join(path): leaf for path, leaf in _leaves(tree, ())}
    for name in names:
        if name not in known:
            raise InputError(_unknown(tree, name))
    return {name: known[name] for name in names}


def set_parameters(tree: PyTree, values: Mapping[str, PyTree]) -> PyTree:
    """A copy of the tree with new values; the structure and the dtypes stay, so nothing recompiles.

    A block checks its concrete values again (a negative inertia is refused); traced values pass unchecked.

    Args:
        tree: a closed loop, a block, or any container of them.
        values: by dotted name, a number or an array of the parameter's shape; for a vmap, with batch axes before it.

    Raises:
        InputError: for an unknown name (the message gives the nearest one), a wrong shape, or an invalid value.
    """
    if not isinstance(values, Mapping):
        raise InputError(
            f"set_parameters got {type(values).__name__} {str(values)[:40]!r} as its values: give them by name, as "
            '{"plant.inertia": 12.0}.'
        )
    names = tuple(values)
    old = get_parameters(tree, names)
    new = [_cast(name, values[name], old[name]) for name in names]
    if not names:
        return tree
    # `tree_at` does not run the blocks' own checks, so every block on the way to a changed leaf is checked again.
    changed = eqx.tree_at(lambda at: [_at(at, name.split(".")) for name in names], tree, new)
    checked: set[int] = set()
    for name in names:
        for owner in _owners(changed, name.split(".")):
            if id(owner) not in checked:
                checked.add(id(owner))
                _check_again(owner)
    return changed


def _leaves(tree: PyTree, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Array]]:
    if eqx.is_inexact_array(tree):
        yield path, tree
        return
    for key, child in _children(tree):
        yield from _leaves(child, (*path, key))


def _children(tree: PyTree) -> list[tuple[str, PyTree]]:
    if isinstance(tree, eqx.Module):
        fields = [field for field in dataclasses.fields(tree) if not field.metadata.get("static", False)]
        return [(field.name, getattr(tree, field.name, None)) for field in fields]
    if isinstance(tree, dict):
        return [(str(key), child) for key, child in tree.items()]
    if isinstance(tree, (tuple, list)):
        return [(str(index), child) for index, child in enumerate(tree)]
    return []


def _at(tree: PyTree, path: list[str]) -> PyTree:
    for key in path:
        tree = dict(_children(tree))[key]
    return tree


def _owners(tree: PyTree, path: list[str]) -> Iterator[PyTree]:
    for key in path:
        if isinstance(tree, eqx.Module):
            yield tree
        tree = dict(_children(tree))[key]


def _check_again(owner: PyTree) -> None:
    for kind in type(owner).__mro__:
        # equinox runs the check of every class in a block's ancestry, without a call of super(): the same is done
        # here
        check = kind.__dict__.get("__check_init__")
        if check is not None:
            check(owner)


def _cast(name: str, value: ArrayLike, old: Array) -> Array:
    if not isinstance(value, (jax.Array, np.ndarray, np.number, int, float, list, tuple)) or isinstance(value, bool):
        raise InputError(f"{name} = {value!r} is not a number: give a number or an array of numbers.")
    new = value.astype(old.dtype) if isinstance(value, jax.Array) else jnp.asarray(value, dtype=old.dtype)
    # the trailing axes must be the parameter's own: what comes before them are batch axes of a vmap
    kept = new.shape[new.ndim - old.ndim :] if new.ndim >= old.ndim else None
    if kept != old.shape:
        raise InputError(
            f"{name} has shape {old.shape}, but the new value has {new.shape}: give a value of the parameter's shape "
            f"(for a vmap, with batch axes before it)."
        )
    return new


def _unknown(tree: PyTree, name: str) -> str:
    known = parameter_names(tree)
    parent, _, last = name.rpartition(".")
    try:
        absent = last in dict(_children(_at(tree, parent.split(".") if parent else [])))
    except (KeyError, TypeError):
        absent = False
    if absent:
        return (
            f"parameter {name!r} is not a number in this loop (it is absent or a whole block): build the block with a "
            f"value for it first, or choose among {_some_of(known, parent)}."
        )
    # Users remember the last words of a name: they are looked for anywhere. Else the last word alone is compared, in
    # the same block only: a feed-forward's coulomb is no friction of the plant.
    near = [each for each in known if f".{each}".endswith(f".{name}")]
    block = [each for each in known if not parent or each.startswith(f"{parent.partition('.')[0]}.")]
    by_word = {each.rpartition(".")[2]: each for each in reversed(block)}
    near = near or [by_word[word] for word in difflib.get_close_matches(last, by_word, n=1)]
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"parameter {name!r} is not known: {hint}Known: {_some_of(known, parent)}."


def _some_of(known: tuple[str, ...], parent: str) -> str:
    """The names for a message, those of the same block first, as many as a message holds."""
    section = parent.partition(".")[0]
    names = sorted(known, key=lambda name: not name.startswith(f"{section}."))
    shown = [name for place, name in enumerate(names) if sum(map(len, names[: place + 1])) + 2 * place <= MOST_NAMED]
    more = len(names) - len(shown)
    return (", ".join(shown) + (f" and {more} others" if more else "")) or "none"
