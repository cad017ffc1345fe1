"""Lane kernel: a function of many lanes, each a machine and a window of its own, compiled and kept on disk."""

from collections.abc import Callable

import jax
from jaxtyping import Array, PyTree

from ...compiled.stored import Stored, description
from ..effects.always import names_of_own
from ..effects.effect import Effect, EffectParameter

LANES = 64  # run by one call: the fastest chunk in double precision on a core, smaller ones waste its vectors


def lane_kernel(
    run: Callable[..., PyTree],
    fixed: PyTree,
    effects: tuple[Effect, ...],
    parameters: tuple[EffectParameter, ...],
    *made_of: object,
) -> Callable[..., PyTree]:
    """`run(fixed, *lanes)`, compiled for `LANES` lanes at once; kept on disk where programs are (`Stored`).

    Args:
        run: a function of a pytree that stays from call to call, and of the lanes.
        fixed: the structure of that pytree. It is passed as its leaves: flattening blocks takes as long as a window.
        effects: that `run` sets from a vector; a user's own are compiled in every process.
        parameters: of these effects, in the order of the vector.
        made_of: whatever else the trace of `run` depends on (`fpjax.compiled.stored.description`).

    512 bit vectors are a fifth faster; one native kernel (`fpjax.compiled.native`) is not, since a step
    computes so much here.
    """

    def flat(leaves: list[Array], *lanes: Array) -> PyTree:
        return run(jax.tree.unflatten(fixed, leaves), *lanes)

    options = {"xla_cpu_prefer_vector_width": "512"} if jax.default_backend() == "cpu" else None
    names, own = names_of_own(effects), [p.name for p in parameters]
    of = None if names is None else description(run.__qualname__, options, names, own, fixed, made_of)
    return Stored(jax.jit(flat, compiler_options=options), of)
