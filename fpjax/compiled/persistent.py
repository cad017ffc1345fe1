"""The loop on a GPU: one kernel that holds all steps, one candidate a lane, instead of a kernel launch for every step.

`scan_loop` becomes a primitive here while `persistent()` is on (`batch.map_chunks` turns it on where it computes on a
GPU). Lowered for CUDA it is a Pallas kernel for the Triton backend; anywhere else, or where Triton has no rule for what
a step does, it is `lax.scan`. It knows vmap and forward mode; reverse mode takes the plain scan.

Lowered and shape-checked for CUDA in the tests, and run there by Pallas's interpreter; never run on a GPU.
"""

import contextlib
import contextvars
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import ShapedArray, eval_jaxpr
from jax.extend.core import Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir

from ..errors import FpjaxWarning

# Candidates of one block: four warps, one candidate a thread.
LANES = 128

_mode: contextvars.ContextVar[str | None] = contextvars.ContextVar("persistent", default=None)


@contextlib.contextmanager
def persistent(*, interpret: bool = False) -> Iterator[None]:
    """Within the block, loops traced by `scan_loop` become persistent kernels where they are lowered for a GPU.

    Args:
        interpret: run the kernel by Pallas's interpreter on any platform, for tests.
    """
    token = _mode.set("interpret" if interpret else "cuda")
    try:
        yield
    finally:
        _mode.reset(token)


def persistent_mode() -> str | None:
    """None where loops are plain scans, else "cuda" or "interpret": part of the key of a cached trace."""
    return _mode.get()


def is_persistent() -> bool:
    """Whether loops are being traced for one kernel on a GPU."""
    return _mode.get() is not None


def fits(carry: Any, xs: Any) -> bool:
    """Whether a loop has the form that a lane can hold: scalar states, one scalar a step from each table."""
    return all(np.ndim(leaf) == 0 for leaf in jax.tree.leaves(carry)) and all(
        np.ndim(leaf) == 1 for leaf in jax.tree.leaves(xs)
    )


def persistent_loop(step: Callable[[Any, Any], tuple[Any, Any]], carry: Any, xs: Any, length: int) -> tuple[Any, Any]:
    """(the carry after `length` steps, the empty outputs) of steps that store nothing.

    Args:
        step: `step(carry, x)` -> (carry, a pytree without leaves).
        carry: pytree of scalars.
        xs: pytree of tables of shape (length,).
        length: number of steps.
    """
    start, structure = jax.tree.flatten(jax.tree.map(jnp.asarray, carry))
    tables, rows = jax.tree.flatten(jax.tree.map(jnp.asarray, xs))
    states = len(start)
    outputs: list[Any] = []

    def flat(*values: Any) -> list[Any]:
        after, output = step(jax.tree.unflatten(structure, values[:states]), rows.unflatten(values[states:]))
        outputs.append(output)
        return [jnp.asarray(new, old.dtype) for new, old in zip(jax.tree.leaves(after), start, strict=True)]

    scalars = [jax.ShapeDtypeStruct((), value.dtype) for value in (*start, *tables)]
    closed = jax.make_jaxpr(flat)(*scalars)
    # What the step closes over (the candidate's gains) becomes an operand, for vmap and jvp to see.
    constants = [jnp.asarray(const) for const in closed.consts]
    inner, count = closed.jaxpr, len(constants)
    program = jax.make_jaxpr(lambda *v: eval_jaxpr(inner, v[:count], *v[count:]))(*constants, *scalars)
    interpret = _mode.get() == "interpret"
    result = loop_p.bind(
        *constants, *start, *tables, program=program, constants=count, states=states, length=length, interpret=interpret
    )
    return jax.tree.unflatten(structure, result), outputs[-1]


# The primitive. `program` is one step of one lane, all scalars. Operands: constants of shape () or of the batch, states
# of the batch, tables of shape (length,) or (length, *batch).


def _split(values: Sequence[Any], constants: int, states: int) -> tuple[list[Any], list[Any], list[Any]]:
    values = list(values)
    return values[:constants], values[constants : constants + states], values[constants + states :]


def _as_scan(*values: Any, program: Any, constants: int, states: int, length: int, interpret: bool) -> list[Any]:
    del interpret
    consts, carry, tables = _split(values, constants, states)
    axes = (
        *(0 if np.ndim(value) else None for value in consts),
        *(0 for _ in carry),
        *(0 if np.ndim(table) > 1 else None for table in tables),
    )
    step = jaxpr_as_fun(program)
    for _ in range(np.ndim(carry[0])):
        step = jax.vmap(step, in_axes=axes)
    turn = lambda c, x: (tuple(step(*consts, *c, *x)), None)  # noqa: E731
    return list(lax.scan(turn, tuple(carry), tables, length=length, unroll=2)[0])


def _as_kernel(*values: Any, program: Any, constants: int, states: int, length: int, interpret: bool) -> list[Any]:
    """The batch axes become one, in blocks of `LANES`; what all lanes share is a scalar of the block."""
    from jax.experimental import pallas
    from jax.experimental.pallas import triton

    consts, carry, tables = _split(values, constants, states)
    batch = carry[0].shape
    size = int(np.prod(batch))
    blocks = -(-size // LANES)

    def lanes(value: Any) -> Any:
        value = value.reshape(size)
        return jnp.concatenate([value, jnp.broadcast_to(value[-1:], (blocks * LANES - size,))])

    flags = [bool(np.ndim(value)) for value in consts]
    wide = [np.ndim(table) > 1 for table in tables]
    consts = [lanes(c) if flag else c.reshape(1) for c, flag in zip(consts, flags, strict=True)]
    carry = [lanes(value) for value in carry]
    tables = [jax.vmap(lanes)(table) if flag else table for table, flag in zip(tables, wide, strict=True)]
    axes = (*(0 if flag else None for flag in flags), *(0 for _ in carry), *(0 if flag else None for flag in wide))
    step = jax.vmap(jaxpr_as_fun(program), in_axes=axes)

    def kernel(*refs: Any) -> None:
        const_refs, carry_refs, rest = _split(refs, constants, states)
        table_refs, outs = rest[: len(tables)], rest[len(tables) :]
        fixed = [ref[...] if flag else ref[0] for ref, flag in zip(const_refs, flags, strict=True)]

        def turn(index: Any, state: Any) -> Any:
            row = [ref[index, :] if flag else ref[index] for ref, flag in zip(table_refs, wide, strict=True)]
            return tuple(step(*fixed, *state, *row))

        state = lax.fori_loop(0, length, turn, tuple(ref[...] for ref in carry_refs))
        for out, value in zip(outs, state, strict=True):
            out[...] = value

    lane = pallas.BlockSpec((LANES,), lambda i: (i,))
    one = pallas.BlockSpec((1,), lambda i: (0,))
    every = pallas.BlockSpec((length,), lambda i: (0,))
    each = pallas.BlockSpec((length, LANES), lambda i: (0, i))
    call = pallas.pallas_call(
        kernel,
        grid=(blocks,),
        in_specs=[
            *(lane if flag else one for flag in flags),
            *(lane for _ in carry),
            *(each if f else every for f in wide),
        ],
        out_specs=[lane for _ in carry],
        out_shape=[jax.ShapeDtypeStruct(value.shape, value.dtype) for value in carry],
        compiler_params=None if interpret else triton.CompilerParams(num_warps=LANES // 32, num_stages=1),
        interpret=interpret,
    )
    return [value[:size].reshape(batch) for value in call(*consts, *carry, *tables)]


def _lower(ctx: Any, *values: Any, **parameters: Any) -> Any:
    run = _as_kernel if parameters["interpret"] else _as_scan
    return mlir.lower_fun(lambda *v: run(*v, **parameters), multiple_results=True)(ctx, *values)


def _lower_cuda(ctx: Any, *values: Any, **parameters: Any) -> Any:
    try:
        with warnings.catch_warnings():
            # jax 0.12 says that Triton's way into Pallas will go one day; the loop is then a scan, see KNOWN_GAPS.md.
            warnings.simplefilter("ignore", DeprecationWarning)
            return mlir.lower_fun(lambda *v: _as_kernel(*v, **parameters), multiple_results=True)(ctx, *values)
    except (
        NotImplementedError,
        LookupError,
        ImportError,
    ) as error:  # Triton has no rule for something that the step does
        warnings.warn(f"The loop runs step by step on the GPU, not as one kernel: {error}", FpjaxWarning, stacklevel=2)
        return mlir.lower_fun(lambda *v: _as_scan(*v, **parameters), multiple_results=True)(ctx, *values)


def _batched(values: Any, dims: Any, **parameters: Any) -> Any:
    size = next(v.shape[d] for v, d in zip(values, dims, strict=True) if d is not None)
    consts, carry, tables = _split(list(zip(values, dims, strict=True)), parameters["constants"], parameters["states"])

    def whole(value: Any, dim: int | None, shape: tuple[int, ...], at: int = 0) -> Any:
        value = jnp.moveaxis(value, dim, at) if dim is not None else jnp.expand_dims(value, at)
        missing = len(shape) - value.ndim
        value = value.reshape(*value.shape, *(1 for _ in range(missing)))
        return jnp.broadcast_to(value, shape)

    value, dim = carry[0]
    batch = (size, *(n for i, n in enumerate(value.shape) if i != dim)) if dim is not None else (size, *value.shape)
    new = [whole(v, d, batch) if d is not None or np.ndim(v) else v for v, d in consts]
    new += [whole(v, d, batch) for v, d in carry]
    length = parameters["length"]
    for v, d in tables:
        new.append(whole(v, d, (length, *batch), 1) if d is not None or np.ndim(v) > 1 else v)
    out = loop_p.bind(*new, **parameters)
    return out, (0,) * len(out)


def _pushed(primals: Any, tangents: Any, **parameters: Any) -> Any:
    """Forward mode: the states and their tangents in one loop, the step and its derivative in one program."""
    constants, states = parameters["constants"], parameters["states"]
    step = jaxpr_as_fun(parameters["program"])
    consts, carry, tables = _split(primals, constants, states)
    const_dots, carry_dots, table_dots = _split(tangents, constants, states)
    moved = [not isinstance(dot, ad.Zero) for dot in (*const_dots, *table_dots)]
    moved_consts, moved_tables = moved[:constants], moved[constants:]
    some_consts = [dot for dot, flag in zip(const_dots, moved_consts, strict=True) if flag]
    some_tables = [dot for dot, flag in zip(table_dots, moved_tables, strict=True) if flag]

    def both(*values: Any) -> list[Any]:
        rest = list(values)

        def take(count: int) -> list[Any]:
            taken, rest[:] = rest[:count], rest[count:]
            return taken

        fixed, fixed_dots = take(constants), take(len(some_consts))
        now, now_dots, row, row_dots = take(states), take(states), take(len(tables)), take(len(some_tables))
        dots = iter((*fixed_dots, *now_dots, *row_dots))
        flags = [*moved_consts, *(True for _ in now), *moved_tables]
        points = [*fixed, *now, *row]
        varied = [point for point, flag in zip(points, flags, strict=True) if flag]

        def of_varied(*varied: Any) -> list[Any]:
            given = iter(varied)
            return step(*(next(given) if flag else point for point, flag in zip(points, flags, strict=True)))

        after, after_dots = jax.jvp(of_varied, tuple(varied), tuple(dots))
        return [*after, *after_dots]

    operands = [*consts, *some_consts, *carry, *map(ad.instantiate_zeros, carry_dots), *tables, *some_tables]
    program = jax.make_jaxpr(both)(*(jax.ShapeDtypeStruct((), operand.dtype) for operand in operands))
    out = loop_p.bind(
        *operands,
        program=program,
        constants=constants + len(some_consts),
        states=2 * states,
        length=parameters["length"],
        interpret=parameters["interpret"],
    )
    return out[:states], out[states:]


def _shapes(*avals: Any, constants: int, states: int, **parameters: Any) -> list[Any]:
    del parameters
    return [ShapedArray(aval.shape, aval.dtype) for aval in _split(avals, constants, states)[1]]


loop_p = Primitive("fpjax_persistent_loop")
loop_p.multiple_results = True
loop_p.def_impl(lambda *values, **parameters: jax.jit(lambda *v: loop_p.bind(*v, **parameters))(*values))
loop_p.def_abstract_eval(_shapes)
batching.primitive_batchers[loop_p] = _batched
ad.primitive_jvps[loop_p] = _pushed
mlir.register_lowering(loop_p, _lower)
mlir.register_lowering(loop_p, _lower_cuda, platform="cuda")
