"""Many candidates of one loop at once: chunks on the CPU, and on a GPU one kernel that holds the whole time loop.

On a GPU a `lax.scan` launches a kernel or more for every step. Here the same step function is traced inside one Pallas
kernel (Triton backend): a lane simulates a candidate from the first sample to the last with its state in registers, and
nothing is launched in between. The kernel is chosen on a GPU by itself; elsewhere it is not even imported.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from .batch import map_chunks
from .errors import InputError
from .loop import ClosedLoop
from .metrics import AbstractMeasure
from .parameters import set_parameters
from .simulate import Inputs, Stepper, advance, loop_dtype, roll

LANES = 128  # candidates of one program: four warps of 32


class Problem(eqx.Module):
    """One loop, what drives it and what is measured on it: everything that candidates share.

    Attributes:
        loop: the closed loop whose parameters the candidates change.
        inputs: tables from `make_inputs`.
        stepper: how time passes.
        measures: what is accumulated, by name.
    """

    loop: ClosedLoop
    inputs: Inputs
    stepper: Stepper
    measures: dict[str, AbstractMeasure]


def roll_many(problem: Problem, values: dict[str, Any], *, kernel: bool | None = None) -> dict[str, Array]:
    """The measures of every candidate.

    Args:
        problem: what the candidates share.
        values: parameters by dotted name, each of shape (candidates,), in their own units.
        kernel: use the one-kernel form; None for "on a GPU".

    Returns:
        Measures by name, each of shape (candidates,).

    Raises:
        InputError: for a parameter that is not there, or candidates of different number.
    """
    if kernel is None:
        kernel = jax.default_backend() == "gpu"
    if kernel:
        return roll_lanes(problem, values)
    dynamic, static = eqx.partition(problem, eqx.is_array)
    leaves, treedef = jax.tree.flatten(static)
    return map_chunks(_measure_one(tuple(leaves), treedef), values, (dynamic,))


def roll_lanes(
    problem: Problem, values: dict[str, Any], *, tangents: bool = False, interpret: bool = False, lanes: int = LANES
) -> Any:
    """`roll_many` as one Pallas kernel, one candidate a lane; optionally with the derivative by each value.

    Args:
        problem: what the candidates share.
        values: parameters by dotted name, each of shape (candidates,).
        tangents: also return the derivative of each measure by each value, by forward mode inside the kernel.
        interpret: run Pallas' interpreter instead of compiling for a GPU: for tests, slow.
        lanes: candidates of one program, a power of two.

    Returns:
        Measures by name, each of shape (candidates,); with `tangents` a pair of that and
        {measure: {parameter: derivative}}, in the measure's unit per the parameter's.
    """
    sizes = {np.shape(value) for value in values.values()}
    if len(sizes) != 1 or len(next(iter(sizes))) != 1:
        raise InputError(f"values have shapes {sorted(sizes)}: give one array of shape (candidates,) a parameter.")
    set_parameters(problem.loop, values)  # refuses unknown names and impossible values while they are concrete
    dtype = loop_dtype(problem.loop)
    columns = {name: jnp.asarray(value, dtype=dtype) for name, value in values.items()}
    return _lanes(problem, columns, tangents, interpret, lanes)


@functools.lru_cache(maxsize=32)
def _measure_one(leaves: tuple[Any, ...], treedef: Any) -> Any:
    # The same function object for the same problem, so that nothing is compiled again.
    static = jax.tree.unflatten(treedef, leaves)

    def measure_one(candidate: dict[str, Array], dynamic: Problem) -> dict[str, Array]:
        problem = eqx.combine(dynamic, static)
        loop = set_parameters(problem.loop, candidate)
        return roll(loop, problem.inputs, problem.stepper, problem.measures)[0]

    return measure_one


@eqx.filter_jit
def _lanes(problem: Problem, columns: dict[str, Array], tangents: bool, interpret: bool, lanes: int) -> Any:
    from jax.experimental import pallas as pl

    candidates = next(iter(columns.values())).shape[0]
    padded = -(-candidates // lanes) * lanes
    # Padding repeats the last candidate: a valid one, whose result is cut off again.
    columns = {name: jnp.pad(value, (0, padded - candidates), mode="edge") for name, value in columns.items()}
    names = list(columns)
    # Scalars of the loop travel as arrays of one element, tables as they are: a kernel may not capture arrays.
    shared, treedef, static = _shared(problem)
    tables = jax.tree.leaves(problem.inputs)
    inputs_structure = jax.tree.structure(problem.inputs)
    outputs = list(problem.measures)

    def kernel(*refs: Any) -> None:
        column_refs, refs = refs[: len(names)], refs[len(names) :]
        shared_refs, refs = refs[: len(shared)], refs[len(shared) :]
        table_refs, out_refs = refs[: len(tables)], refs[len(tables) :]
        scalars = [ref[0] for ref in shared_refs]
        parts = eqx.combine(jax.tree.unflatten(treedef, scalars), static)
        lane = _Lane(*parts)
        rows = {name: ref[...] for name, ref in zip(names, column_refs, strict=True)}

        def sample(index: Any) -> Inputs:
            return jax.tree.unflatten(inputs_structure, [ref[index] for ref in table_refs])

        if tangents:
            finals, derivatives = _run_tangents(lane, rows, sample)
            written = [finals[out] for out in outputs]
            written += [derivatives[name][out] for out in outputs for name in names]
        else:
            finals = _run_primal(lane, rows, sample)
            written = [finals[out] for out in outputs]
        for ref, value in zip(out_refs, written, strict=True):
            ref[...] = value

    row = pl.BlockSpec((lanes,), lambda i: (i,))
    whole = pl.BlockSpec(memory_space=pl.ANY)
    dtype = next(iter(columns.values())).dtype
    count = len(outputs) * (1 + len(names) * tangents)
    results = pl.pallas_call(
        kernel,
        out_shape=[jax.ShapeDtypeStruct((padded,), dtype)] * count,
        grid=(padded // lanes,),
        in_specs=[row] * len(names) + [whole] * (len(shared) + len(tables)),
        out_specs=[row] * count,
        interpret=interpret,
        compiler_params=_compiler_params(lanes) if not interpret else None,
    )(*columns.values(), *shared, *tables)
    results = [result[:candidates] for result in results]
    finals = dict(zip(outputs, results[: len(outputs)], strict=True))
    if not tangents:
        return finals
    rest = iter(results[len(outputs) :])
    return finals, {out: {name: next(rest) for name in names} for out in outputs}


def _shared(problem: Problem) -> tuple[list[Array], Any, Any]:
    parts = (problem.loop, problem.stepper, problem.measures)
    dynamic, static = eqx.partition(parts, eqx.is_array)
    leaves, treedef = jax.tree.flatten(dynamic)
    if any(leaf.ndim for leaf in leaves):
        raise InputError(
            "A kernel holds scalar parameters only, and this loop has arrays (a TransferFunction's matrices): "
            "pass kernel=False, the scan takes them."
        )
    return [jnp.reshape(leaf, (1,)) for leaf in leaves], treedef, static


class _Lane(eqx.Module):
    """What one program knows besides its candidates."""

    loop: ClosedLoop
    stepper: Stepper
    measures: dict[str, AbstractMeasure]

    def start(self, candidate: dict[str, Array]) -> Any:
        loop = set_parameters(self.loop, candidate)
        zero = jnp.zeros_like(self.stepper.dt.astype(loop_dtype(loop)))
        totals = {name: measure.init(zero) for name, measure in self.measures.items()}
        return loop.init(), totals

    def step(self, candidate: dict[str, Array], carry: Any, sample: Inputs) -> Any:
        loop = set_parameters(self.loop, candidate)
        state, totals = carry
        dt = self.stepper.dt.astype(loop_dtype(loop))
        state, signals = advance(loop, state, sample, dt, self.stepper)
        return state, {name: measure.update(totals[name], signals) for name, measure in self.measures.items()}

    def finish(self, carry: Any) -> dict[str, Array]:
        return {name: m.final(carry[1][name], self.stepper.samples) for name, m in self.measures.items()}


def _run_primal(lane: _Lane, rows: dict[str, Array], sample: Any) -> dict[str, Array]:
    step = jax.vmap(lane.step, in_axes=(0, 0, None))
    carry = jax.vmap(lane.start)(rows)
    carry = lax.fori_loop(0, lane.stepper.samples, lambda k, c: step(rows, c, sample(k)), carry)
    return jax.vmap(lane.finish)(carry)


def _run_tangents(
    lane: _Lane, rows: dict[str, Array], sample: Any
) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    """Forward mode with one tangent carry a parameter beside the one primal carry."""
    names = list(rows)
    zero = {name: jnp.zeros_like(value) for name, value in rows.items()}
    directions = {name: {**zero, name: jnp.ones_like(rows[name])} for name in names}
    start, finish = jax.vmap(lane.start), jax.vmap(lane.finish)
    step = jax.vmap(lane.step, in_axes=(0, 0, None))
    carry = start(rows)
    slopes = {name: jax.jvp(start, (rows,), (directions[name],))[1] for name in names}

    def body(k: Any, both: Any) -> Any:
        carry, slopes = both
        row = sample(k)

        def move(candidate: Any, at: Any) -> Any:
            return step(candidate, at, row)

        # The primal is traced once for each direction and merged again by the compiler.
        moved = {name: jax.jvp(move, (rows, carry), (directions[name], slopes[name])) for name in names}
        return moved[names[0]][0], {name: tangent for name, (_, tangent) in moved.items()}

    carry, slopes = lax.fori_loop(0, lane.stepper.samples, body, (carry, slopes))
    finals = finish(carry)
    return finals, {name: jax.jvp(finish, (carry,), (slopes[name],))[1] for name in names}


def _compiler_params(lanes: int) -> Any:
    from jax.experimental.pallas import triton

    return triton.CompilerParams(num_warps=max(1, lanes // 32))
