"""From a jaxpr to a `Program`: calls are inlined, constants folded, arrays split into scalars.

Primitives that only move numbers (slices, reshapes, a gather at known indices) leave no code: the primitive itself is
run once on the indices of the numbers. What depends on parameters alone is computed by jax here, as in the simulation.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..compiled.elementary import written_out
from ..errors import InputError
from .operations import ELEMENTWISE, FLOATS, OPERATIONS
from .program import Atom, Builder, FixedNumber, Program, Variable

MOST_OPERATIONS = 20_000  # more than this comes from an unrolled loop that is too long for a drive
_ALL = 10**9  # any number of operands

_CALL_WORDS = """
jit pjit closed_call core_call remat remat2 checkpoint custom_jvp_call custom_vjp_call custom_vjp_call_jaxpr
fpjax_one_kernel
"""
_CALLS = frozenset(_CALL_WORDS.split())
_IDENTITY = frozenset(("copy", "copy_p", "optimization_barrier", "name", "stop_gradient", "pvary", "pcast"))
# Primitives that move numbers, by how many of their first operands are moved. The operands after these are indices, and
# must be known when the code is written.
_MOVES = {
    "broadcast_in_dim": 1, "reshape": 1, "squeeze": 1, "expand_dims": 1, "transpose": 1, "slice": 1, "rev": 1,
    "split": 1, "unstack": 1, "concatenate": _ALL, "stack": _ALL, "pad": 2, "gather": 1, "dynamic_slice": 1,
    "dynamic_update_slice": 2,
}  # fmt: skip
_REDUCTIONS = {
    "reduce_sum": "add", "reduce_prod": "mul", "reduce_max": "max", "reduce_min": "min", "reduce_and": "and",
    "reduce_or": "or",
}  # fmt: skip

# IEEE 754 rounds these correctly, so the compiler folds them to the same bits as jax: expressions of parameters may
# keep the parameters' names in the C code.
_KEPT = frozenset(["add", "sub", "mul", "div", "neg"])

Scalars = Any  # numpy arrays of atoms, dtype object: numpy has no type for such elements


def flatten(closed: Any, arguments: Sequence[Any]) -> Program:
    """The program of a traced function.

    Args:
        closed: a closed jaxpr.
        arguments: for each of its inputs either an array of `FixedNumber`, dtype object, of the input's shape (a
            parameter that is known now), or None (an input of the program).

    Returns:
        The program; inputs and outputs in the order of the jaxpr's, arrays element by element.

    Raises:
        InputError: naming every primitive that cannot be written in C.
    """
    flattener = _Flattener()
    inputs: list[Variable] = []
    values: list[Scalars] = []
    for variable, known in zip(closed.jaxpr.invars, arguments, strict=True):
        if known is not None:
            values.append(known)
            continue
        made = _empty(variable.aval.shape)
        for place in np.ndindex(*variable.aval.shape):
            made[place] = flattener.builder.variable(variable.aval.dtype.name)
            inputs.append(made[place])
        values.append(made)
    outputs = flattener.run(closed.jaxpr, closed.consts, values)
    if flattener.missing:
        flattener.refuse()
    return flattener.builder.program(inputs, [atom for value in outputs for atom in value.ravel()])


def constants(value: Any, name: str = "") -> Scalars:
    """An array's numbers as constants, named after the parameter and their index in it; same shape, dtype object."""
    value = np.asarray(value)
    made = _empty(value.shape)
    for place in np.ndindex(*value.shape):
        suffix = "".join(f"_{index}" for index in place)
        made[place] = FixedNumber(value[place], f"{name}{suffix}" if name else "")
    return made


class _Flattener:
    """Evaluates a jaxpr on arrays of atoms: each primitive appends its operations to the builder."""

    def __init__(self) -> None:
        self.builder = Builder(MOST_OPERATIONS, _too_long)
        self.missing: dict[str, str] = {}

    def refuse(self) -> None:
        named = ", ".join(f"{name} ({where})" if where else name for name, where in sorted(self.missing.items()))
        verb = "is a primitive" if len(self.missing) == 1 else "are primitives"
        raise InputError(
            f"The control law cannot be written as C: {named} {verb} of jax that the export does not know; write that "
            f"part of the block with arithmetic, select and the functions of <math.h>."
        )

    def run(self, jaxpr: Any, consts: Sequence[Any], values: Sequence[Scalars]) -> list[Scalars]:
        known: dict[Any, Scalars] = {}
        for variable, value in zip(jaxpr.constvars, consts, strict=True):
            known[variable] = value if _is_scalars(value) else constants(value)
        known.update(zip(jaxpr.invars, values, strict=True))
        for equation in jaxpr.eqns:
            operands = [constants(v.val) if hasattr(v, "val") else known[v] for v in equation.invars]
            results = self.equation(equation, operands)
            known.update(zip(equation.outvars, results, strict=True))
        return [constants(v.val) if hasattr(v, "val") else known[v] for v in jaxpr.outvars]

    def equation(self, equation: Any, operands: list[Scalars]) -> list[Scalars]:
        name, parameters = equation.primitive.name, equation.params
        if name in _CALLS:
            return self.inlined(_inner(parameters), operands)
        if name in _IDENTITY:
            return operands
        # The order matters: folding comes first, so that whatever depends on parameters alone is computed by jax
        # itself, with the same rounding as in the simulation.
        if all(self.is_known(operand) for operand in operands):
            return self.folded(equation, operands)
        if (own := written_out(equation.primitive)) is not None:
            # Our own sine, cosine and logarithm: the arithmetic behind them is written into the C code.
            shape = equation.invars[0].aval
            return self.inlined(jax.make_jaxpr(own)(jax.ShapeDtypeStruct(shape.shape, shape.dtype)), operands)
        if name in _MOVES:
            return self.moved(equation, operands)
        if name in _REDUCTIONS:
            return [self.reduced(_REDUCTIONS[name], operands[0], parameters["axes"], equation.outvars[0].aval)]
        special: Callable[..., list[Scalars]] | None = getattr(self, f"_{name}", None)
        if special is not None:
            return special(equation, operands)
        if name in ELEMENTWISE:
            return [self.elementwise(equation, operands)]
        return self.unknown(equation)

    def is_known(self, value: Scalars) -> bool:
        return all(self.builder.value(atom) is not None for atom in value.ravel())

    def numbers(self, value: Scalars) -> np.ndarray:
        flat = [self.builder.value(atom) for atom in value.ravel()]
        return np.array(flat, dtype=np.dtype(value.flat[0].kind) if flat else None).reshape(value.shape)

    def folded(self, equation: Any, operands: list[Scalars]) -> list[Scalars]:
        """An equation of parameters alone: sums and products keep the parameters' names; the compiler folds them."""
        name = equation.primitive.name
        if name == "convert_element_type" and equation.outvars[0].aval.dtype == equation.invars[0].aval.dtype:
            return operands
        if name in _MOVES and name != "pad":
            return self.moved(equation, operands)
        found = equation.primitive.bind(
            *(jnp.asarray(self.numbers(operand)) for operand in operands), **equation.params
        )
        results = [np.asarray(each) for each in (found if equation.primitive.multiple_results else [found])]
        named = any(isinstance(atom, Variable) or atom.name for operand in operands for atom in operand.ravel())
        if not (named and name in _KEPT and results[0].dtype.name in FLOATS):
            return [constants(value) for value in results]
        made = self.elementwise(equation, operands)
        for place in np.ndindex(*made.shape):
            if isinstance(made[place], Variable):
                self.builder.known[made[place].index] = results[0][place]  # type: ignore[assignment]
        return [made]

    def inlined(self, closed: Any, operands: list[Scalars]) -> list[Scalars]:
        return self.run(getattr(closed, "jaxpr", closed), getattr(closed, "consts", ()), operands)

    def unknown(self, equation: Any) -> list[Scalars]:
        """Note a primitive that cannot be written, and go on with placeholders, so that the error names all of them."""
        self.missing.setdefault(equation.primitive.name, _where(equation))
        made = []
        for variable in equation.outvars:
            value = _empty(variable.aval.shape)
            for place in np.ndindex(*value.shape):
                value[place] = self.builder.variable(variable.aval.dtype.name)
            made.append(value)
        return made

    def elementwise(self, equation: Any, operands: list[Scalars]) -> Scalars:
        write, aval = ELEMENTWISE[equation.primitive.name], equation.outvars[0].aval
        made = _empty(aval.shape)
        spread: list[Scalars] = [np.broadcast_to(operand, aval.shape) for operand in operands]
        for place in np.ndindex(*aval.shape):
            atoms = [operand[place] for operand in spread]
            result = write(self.emit, atoms, equation.params, aval.dtype.name)
            if result is None:
                self.missing.setdefault(f"{equation.primitive.name} of {atoms[0].kind}", _where(equation))
                result = self.builder.variable(aval.dtype.name)
            made[place] = result
        return made

    def emit(self, name: str, atoms: Sequence[Atom], kind: str) -> Atom:
        assert name in OPERATIONS, name
        return self.builder.emit(name, atoms, kind)

    def moved(self, equation: Any, operands: list[Scalars]) -> list[Scalars]:
        """Run the primitive on the indices of the atoms that it moves, and pick the atoms at the resulting indices."""
        count = min(_MOVES[equation.primitive.name], len(operands))
        if not all(self.is_known(operand) for operand in operands[count:]):
            return self.unknown(equation)  # an index that is only known when the drive runs
        # All moved operands in one flat pool; each operand's array of atoms becomes an array of indices into the pool.
        pool = np.concatenate([operand.ravel() for operand in operands[:count]])
        starts = np.cumsum([0, *(operand.size for operand in operands[:count])])
        places = [
            jnp.asarray(start + np.arange(operand.size).reshape(operand.shape), dtype=np.int32)
            for start, operand in zip(starts[:-1], operands[:count], strict=True)
        ]
        fixed = [jnp.asarray(self.numbers(operand)) for operand in operands[count:]]
        found = equation.primitive.bind(*places, *fixed, **equation.params)
        found = found if equation.primitive.multiple_results else [found]
        return [_taken(pool, np.asarray(each)) for each in found]

    def reduced(self, name: str, operand: Scalars, axes: Sequence[int], aval: Any) -> Scalars:
        kept = [axis for axis in range(operand.ndim) if axis not in axes]
        # In the order of the elements; XLA may sum in another order, which is a difference of rounding only.
        rows = operand.transpose([*kept, *axes]).reshape(*aval.shape, -1)
        made = _empty(aval.shape)
        for place in np.ndindex(*aval.shape):
            atoms = list(rows[place])
            total = atoms[0]
            for atom in atoms[1:]:
                total = self.emit(name, (total, atom), aval.dtype.name)
            made[place] = total
        return made

    def _dot_general(self, equation: Any, operands: list[Scalars]) -> list[Scalars]:
        (left_sum, right_sum), (left_batch, right_batch) = equation.params["dimension_numbers"]
        left, right = operands
        own = [a for a in range(left.ndim) if a not in (*left_sum, *left_batch)]
        other = [a for a in range(right.ndim) if a not in (*right_sum, *right_batch)]
        aval = equation.outvars[0].aval
        length = math.prod(left.shape[a] for a in left_sum)
        batch = math.prod(left.shape[a] for a in left_batch)
        # A batch of matrix products: (batch, rows, length) by (batch, columns, length).
        lefts = left.transpose([*left_batch, *own, *left_sum]).reshape(batch, -1, length)
        rights = right.transpose([*right_batch, *other, *right_sum]).reshape(batch, -1, length)
        made = _empty((batch, lefts.shape[1], rights.shape[1]))
        kind = aval.dtype.name
        for b, i, j in np.ndindex(*made.shape):
            terms = [self.emit("mul", pair, kind) for pair in zip(lefts[b, i], rights[b, j], strict=True)]
            total = terms[0]
            for term in terms[1:]:
                total = self.emit("add", (total, term), kind)
            made[b, i, j] = total
        return [made.reshape(aval.shape)]

    def _cond(self, equation: Any, operands: list[Scalars]) -> list[Scalars]:
        """Every branch is computed and one result is selected, which is right because none has side effects."""
        (index,), rest = operands[0].reshape(1), operands[1:]
        branches = [self.inlined(branch, rest) for branch in equation.params["branches"]]
        made = [value.copy() for value in branches[-1]]
        for number in reversed(range(len(branches) - 1)):
            if index.kind == "bool":
                chosen = self.emit("not", (index,), "bool")
            else:
                # jax clips the index into the range of the branches; the comparison by <= does the same.
                chosen = self.emit("le", (index, FixedNumber(np.dtype(index.kind).type(number))), "bool")
            for target, value in zip(made, branches[number], strict=True):
                for place in np.ndindex(*target.shape):
                    pair = (chosen, value[place], target[place])
                    target[place] = self.emit("select", pair, target[place].kind)
        return made

    def _scan(self, equation: Any, operands: list[Scalars]) -> list[Scalars]:
        """A loop of known length, unrolled."""
        given = equation.params
        # Constants, carry and rows are told apart by shapes and not by the equation's parameters, whose names differ
        # between versions of jax: the loop's body sees a stacked operand with one axis less.
        inner, length = given["jaxpr"].jaxpr, given["length"]
        rows_in = sum(o.aval.ndim > i.aval.ndim for o, i in zip(equation.invars, inner.invars, strict=True))
        carried = sum(o.aval.ndim == i.aval.ndim for o, i in zip(equation.outvars, inner.outvars, strict=True))
        consts = len(operands) - carried - rows_in
        fixed, carry, rows = operands[:consts], operands[consts : consts + carried], operands[consts + carried :]
        order = range(length - 1, -1, -1) if given["reverse"] else range(length)
        stacked: list[list[Any]] = [[None] * length for _ in equation.outvars[carried:]]
        for step in order:
            found = self.inlined(given["jaxpr"], [*fixed, *carry, *(_at(row, step) for row in rows)])
            carry = found[:carried]
            for place, value in zip(stacked, found[carried:], strict=True):
                place[step] = value
        return [*carry, *(_stacked(values) for values in stacked)]


def _at(row: Scalars, step: int) -> Scalars:
    made = _empty(row.shape[1:])
    made[...] = row[step]
    return made


def _stacked(values: list[Scalars]) -> Scalars:
    made = _empty((len(values), *values[0].shape))
    for step, value in enumerate(values):
        made[step] = value
    return made


def _inner(parameters: dict[str, Any]) -> Any:
    for name in ("jaxpr", "call_jaxpr", "fun_jaxpr"):
        if name in parameters:
            return parameters[name]
    raise AssertionError(sorted(parameters))


def _taken(pool: np.ndarray, places: np.ndarray) -> Scalars:
    made = _empty(places.shape)
    for place in np.ndindex(*places.shape):
        made[place] = pool[places[place]]
    return made


def _is_scalars(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == object


def _empty(shape: tuple[int, ...]) -> Scalars:
    return np.empty(shape, dtype=object)


def _where(equation: Any) -> str:
    """The user's file and line of an equation; "" where this jax does not say."""
    try:
        from jax._src import source_info_util

        frame = source_info_util.user_frame(equation.source_info.traceback)
        return f"{frame.file_name.rsplit('/', 1)[-1]} line {frame.start_line}" if frame else ""
    except Exception:  # a private part of jax, used only for the text of an error: whatever fails there, do without
        return ""


def _too_long() -> Exception:
    return InputError(
        f"The control law takes more than {MOST_OPERATIONS} operations a step once its loops and arrays are written "
        f"out, which is too much for a drive: use a smaller block (fewer periods of delay, a lower order)."
    )
