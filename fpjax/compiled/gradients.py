"""Value and gradient of a cost that holds a long loop, by the mode that was measured to be faster.

Forward mode carries a tangent of the loop's states for each parameter, and stores nothing over time. Reverse mode takes
the same time for any number of parameters, and its memory is bounded by checkpoints (`native.scan_loop`).
"""

import math
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..errors import InputError
from .native import GPUS, platform, reverse_pass

Parameters = TypeVar("Parameters")

MODES = ("auto", "forward", "reverse")

# Up to this many parameters forward mode was faster (docs/performance.md).
FORWARD_UP_TO = 4

# What one reverse pass may keep of the carries of its steps [bytes]: about a second-level cache. This counts whole
# carries. What is really kept was measured as about two thirds of it, because some states enter linearly (the
# accumulated cost does), and a linear operation's derivative does not need their values.
SCRATCH = 1_500_000
# On a GPU, where the whole batch is one chunk, each further level of blocks costs launches: a small part of its memory.
SCRATCH_GPU = 1_000_000_000


def value_and_gradient(
    fn: Callable[..., jax.Array],
    *,
    mode: str = "auto",
    batched: bool = False,
    scratch: int | None = None,
) -> Callable[..., tuple[jax.Array, PyTree]]:
    """A function of the same arguments that returns (value, gradient by the first argument).

    Wrap the result, not `fn`, in `native`.

    Args:
        fn: `fn(parameters, *others)` -> scalar, its loops `scan_loop`s with checkpoint="auto".
        mode: "forward", "reverse", or "auto": forward up to four parameters.
        batched: `fn` maps parameters with a leading axis B on every leaf to B values, each of its own candidate only,
            and so does the gradient.
        scratch: what reverse mode may keep [bytes]; by default 1.5 MB, on a GPU 1 GB.

    Raises:
        InputError: for an unknown mode, parameters that are not floats, and a value that is not a scalar (or B).
    """
    if mode not in MODES:
        raise InputError(f"mode={mode!r} is not known: use one of {MODES}.")

    def evaluated(parameters: PyTree, *others: PyTree) -> tuple[jax.Array, PyTree]:
        parameters = jax.tree.map(jnp.asarray, parameters)
        candidates, count = _sizes(parameters, batched)
        cost = lambda p: fn(p, *others)  # noqa: E731
        if mode == "forward" or (mode == "auto" and count <= FORWARD_UP_TO):
            return _forward(cost, parameters, candidates)
        with reverse_pass(candidates=candidates or 1, scratch=default_scratch() if scratch is None else scratch):
            value, pull = jax.vjp(cost, parameters)
            _check(value, candidates)
            (gradient,) = pull(jnp.ones_like(value))
        return value, gradient

    return evaluated


def default_scratch() -> int:
    """What reverse mode may keep [bytes], on the device that is traced for."""
    return SCRATCH_GPU if platform() in GPUS else SCRATCH


def _sizes(parameters: PyTree, batched: bool) -> tuple[int | None, int]:
    """(the number of candidates, None where there is no such axis; parameters of one of them)."""
    leaves = jax.tree.leaves(parameters)
    if any(not jnp.issubdtype(leaf.dtype, jnp.floating) for leaf in leaves) or not leaves:
        raise InputError(
            f"A gradient needs float parameters, not {[str(leaf.dtype) for leaf in leaves]}: "
            "pass integers and flags as further arguments."
        )
    if not batched:
        return None, sum(leaf.size for leaf in leaves)
    sizes = {leaf.shape[:1] for leaf in leaves}
    if len(sizes) != 1 or sizes == {()}:
        raise InputError(
            f"batched=True needs one leading axis on every parameter, not {sorted(sizes)}: "
            "broadcast them to the number of candidates."
        )
    (size,) = sizes
    return size[0], sum(math.prod(leaf.shape[1:]) for leaf in leaves)


def _check(value: jax.Array, candidates: int | None) -> None:
    expected = () if candidates is None else (candidates,)
    if value.shape != expected:
        raise InputError(
            f"The cost must have shape {expected}, not {value.shape}: sum or average what the function returns."
        )


def _forward(
    cost: Callable[[PyTree], jax.Array], parameters: PyTree, candidates: int | None
) -> tuple[jax.Array, PyTree]:
    leaves, structure = jax.tree.flatten(parameters)
    lead = () if candidates is None else (candidates,)
    inner = [leaf.shape[len(lead) :] for leaf in leaves]
    counts = [math.prod(shape) for shape in inner]
    total = sum(counts)
    starts = [sum(counts[:i]) for i in range(len(counts))]

    def directions(leaf: jax.Array, shape: tuple[int, ...], start: int, count: int) -> jax.Array:
        one_hot = jnp.eye(total, count, -start, dtype=leaf.dtype)
        one_hot = one_hot.reshape(total, *(1 for _ in lead), *shape)
        return jnp.broadcast_to(one_hot, (total, *leaf.shape))

    tangents = jax.tree.unflatten(
        structure, [directions(*each) for each in zip(leaves, inner, starts, counts, strict=True)]
    )

    def along(tangent: PyTree) -> tuple[jax.Array, jax.Array]:
        return jax.jvp(cost, (parameters,), (tangent,))

    # `tangents` has the leading axis of all parameters of one candidate, (total, [B,] *shape of the leaf): row i moves
    # parameter i of every candidate at once. As a candidate's value depends on its own parameters only, one pass for
    # each parameter gives the gradients of the whole batch.

    # The value does not depend on the direction: it is computed once, outside the vmap.
    value, slopes = jax.vmap(along, out_axes=(None, 0))(tangents)
    _check(value, candidates)
    slopes = jnp.moveaxis(slopes, 0, -1)  # ([B,] total)
    gradient = [
        slopes[..., start : start + count].reshape(leaf.shape).astype(leaf.dtype)
        for leaf, start, count in zip(leaves, starts, counts, strict=True)
    ]
    return value, jax.tree.unflatten(structure, gradient)
