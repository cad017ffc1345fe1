"""The primitive behind `native`: a program that XLA on the CPU is asked to compile as one kernel.

It is a primitive, and not only metadata on a call, because the decision needs the final sizes: XLA before 0.12 gives
expensive operations on large arrays to its threads, fails hard where it finds such a call within the kernel, and a
later `vmap` is what makes the arrays large. So the decision is made when the program is lowered.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax import lax
from jax.core import Tracer, eval_jaxpr
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import Jaxpr, JaxprEqn, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir
from jax.interpreters.partial_eval import dce_jaxpr
from jaxtyping import PyTree

ClosedJaxpr = Any  # jax exports the class to no type checker

# What may stand in one kernel. A list of what is allowed, not of what is forbidden: XLA fails hard on a sort, a LAPACK
# or FFI call, a callback or a collective inside the kernel, and a primitive that nobody has tried is better run slowly
# than not at all.
_ELEMENTWISE = """
abs acos acosh add add_any and asin asinh atan atan2 atanh cbrt ceil clamp conj convert_element_type copy copy_p cos
cosh digamma div eq eq_to erf erf_inv erfc exp exp2 expm1 floor ge gt imag integer_pow is_finite le le_to lgamma log
log1p logistic lt lt_to max min mul name ne neg nextafter not or population_count clz pow real reduce_precision rem
round rsqrt select_n shift_left shift_right_arithmetic shift_right_logical sign sin sinh sqrt square stop_gradient sub
tan tanh xor
"""
_STRUCTURE = """
broadcast broadcast_in_dim concatenate dynamic_slice dynamic_update_slice expand_dims gather iota pad reshape rev
scatter scatter-add scatter_add scatter_max scatter_min scatter_mul slice split squeeze transpose bitcast_convert_type
empty empty2 pvary pcast argmax argmin cumlogsumexp cummax cummin cumprod cumsum reduce_and reduce_max reduce_min
reduce_or reduce_prod reduce_sum reduce_xor reduce dot_general mul_add
"""
_CONTROL = """
pjit jit closed_call core_call remat remat2 checkpoint custom_jvp_call custom_vjp_call custom_vjp_call_jaxpr custom_lin
scan while cond optimization_barrier fpjax_one_kernel fpjax_sincos fpjax_log
"""
_ALLOWED = frozenset((_ELEMENTWISE + _STRUCTURE + _CONTROL).split())

# XLA gives an operation to its threads from a cost of 2 x 100,000 cycles on, or from 2 x 256 KB of output on. The cost
# is the number of operations, plus 10 per byte where there are more operations than bytes touched: 11 an operation at
# most. Below these bounds nothing is parallel. Above them the kernel is compiled once on trial: only on the versions of
# jax where a failure is an error (0.7 and 0.8 end the process) and where asking is needed (0.12 makes one kernel of
# every loop by itself).
_SAFE_OPERATIONS = 200_000 // 11
_SAFE_BYTES = 512 * 1024
_ON_TRIAL = (0, 9) <= jax.__version_info__[:2] < (0, 12)


def one_kernel(fn: Callable[..., PyTree], arguments: tuple[PyTree, ...]) -> PyTree:
    """`fn(*arguments)`, traced once, to be lowered for the CPU as one kernel where that can be.

    Args:
        fn: a function of arrays and pytrees of arrays.
        arguments: its arguments.
    """
    closed, shape = jax.make_jaxpr(fn, return_shape=True)(*arguments)
    structure = jax.tree.structure(shape)
    values = jax.tree.leaves(arguments)
    captured = [const for const in closed.consts if isinstance(const, Tracer)]
    if what_forbids_one_kernel(closed.jaxpr) is not None:
        return jax.tree.unflatten(structure, jaxpr_as_fun(closed)(*values))
    if captured:  # tracers that `fn` closes over must become arguments; arrays stay constants of the program
        inner, consts = closed.jaxpr, closed.consts

        def program(captured: list[PyTree], values: list[PyTree]) -> PyTree:
            rest = iter(captured)
            return eval_jaxpr(inner, [next(rest) if isinstance(c, Tracer) else c for c in consts], *values)

        closed = jax.make_jaxpr(program)(captured, values)
    return jax.tree.unflatten(structure, one_kernel_p.bind(*captured, *values, jaxpr=closed))


def what_forbids_one_kernel(jaxpr: Jaxpr) -> str | None:
    """The name of the first primitive in `jaxpr` that cannot stand in one kernel; None if there is none."""
    for equation in jaxpr.eqns:
        if equation.primitive.name not in _ALLOWED:
            return equation.primitive.name
        for inner in _inner_programs(equation):
            found = what_forbids_one_kernel(inner)
            if found is not None:
                return found
    return None


def _inner_programs(equation: JaxprEqn) -> list[Jaxpr]:
    # The parameters of a call, loop or branch hold its inner programs, alone or in a tuple, closed or open.
    found = []
    for value in equation.params.values():
        for inner in value if isinstance(value, (tuple, list)) else (value,):
            inner = getattr(inner, "jaxpr", inner)
            if hasattr(inner, "eqns"):
                found.append(inner)
    return found


def _surely_sequential(jaxpr: Jaxpr) -> bool:
    """Whether nothing in `jaxpr`, were it all one fusion, is large enough to be given to threads."""
    return max(_operations(jaxpr)) < _SAFE_OPERATIONS


def _operations(jaxpr: Jaxpr) -> tuple[float, float]:
    """(operations that may be fused with what stands around `jaxpr`, the most in any loop or branch inside it).

    Calls are inlined before anything is fused, and so are the unrolled steps of one turn of a loop, unless a barrier
    separates them.
    """
    total, apart = 0.0, 0.0
    for equation in jaxpr.eqns:
        programs = _inner_programs(equation)
        inner = [_operations(program) for program in programs]
        most = max((within for _, within in inner), default=0.0)
        if equation.primitive.name in ("scan", "while", "cond"):
            turns = 1 if _is_parted(equation) else int(equation.params.get("unroll", 1))
            apart = max(apart, most, *(turns * own for own, _ in inner))
        elif inner:
            total, apart = total + sum(own for own, _ in inner), max(apart, most)
        else:
            size = max((_size(v.aval) for v in equation.outvars), default=0)
            total += math.inf if size * 8 > _SAFE_BYTES else size * _COSTS.get(equation.primitive.name, 1)
    return total, apart


def _is_parted(loop: JaxprEqn) -> bool:
    """Whether a barrier holds all that one step of a scan hands to the next: one on a part of it parts no steps."""
    for body in _inner_programs(loop):
        held = {id(v) for e in body.eqns if e.primitive.name == "optimization_barrier" for v in e.outvars}
        carried = body.outvars[: loop.params.get("num_carry", len(body.outvars))]
        if not carried or not all(id(v) in held for v in carried):
            return False
    return True


# Operations that XLA expands into many: counted as 40 each, a generous bound (our written-out sine and cosine together
# take about 40). All others count once.
_EXPANDED = "acosh asinh atan2 atanh digamma erf erf_inv erfc fpjax_log fpjax_sincos lgamma nextafter pow rem sinh cosh"
_COSTS: dict[str, int] = dict.fromkeys(_EXPANDED.split(), 40)


def _size(aval: Any) -> int:
    return int(np.prod(aval.shape)) if hasattr(aval, "shape") else 0


def _kernel(closed: ClosedJaxpr) -> Callable[..., PyTree]:
    # In jax 0.7 to 0.11 a check in XLA's ir_emitter.cc ends the process where an array argument of the kernel is
    # unused, or is known to be constant. So unused arguments are left out, and the others pass through a barrier, which
    # hides that they are constant.
    program, used = dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars))
    evaluate = jaxpr_as_fun(closed.replace(jaxpr=program))
    call = jax.jit(lambda *values: evaluate(*values))

    def kernel(*values: PyTree) -> PyTree:
        values = lax.optimization_barrier([value for value, wanted in zip(values, used, strict=True) if wanted])
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return call(*values)

    return kernel


def _compiles(closed: ClosedJaxpr) -> bool:
    shapes = [jax.ShapeDtypeStruct(aval.shape, aval.dtype) for aval in closed.in_avals]
    try:
        jax.jit(_kernel(closed)).lower(*shapes).compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True


def _lower_plain(ctx: mlir.LoweringRuleContext, *values: PyTree, jaxpr: ClosedJaxpr) -> PyTree:
    return mlir.lower_fun(jaxpr_as_fun(jaxpr), multiple_results=True)(ctx, *values)


def _lower_cpu(ctx: mlir.LoweringRuleContext, *values: PyTree, jaxpr: ClosedJaxpr) -> PyTree:
    asked = _surely_sequential(jaxpr.jaxpr) or (_ON_TRIAL and _compiles(jaxpr))
    run = _kernel(jaxpr) if asked else jaxpr_as_fun(jaxpr)
    return mlir.lower_fun(run, multiple_results=True)(ctx, *values)


def _batched(values: Sequence[PyTree], dims: Sequence[int | None], *, jaxpr: ClosedJaxpr) -> PyTree:
    # Traced anew over the batch and bound as one larger kernel: the decision at lowering then sees the sizes with the
    # batch axis.
    run = jax.vmap(jaxpr_as_fun(jaxpr), in_axes=tuple(dims))
    batched = jax.make_jaxpr(run)(*values)
    out = one_kernel_p.bind(*values, jaxpr=batched)
    return out, (0,) * len(out)


def _differentiated(primals: Sequence[PyTree], tangents: Sequence[PyTree], *, jaxpr: ClosedJaxpr) -> PyTree:
    """The derivative is taken of the plain program: ask for one kernel around the gradient, not within it."""
    tangents = [ad.instantiate_zeros(tangent) for tangent in tangents]
    return jax.jvp(jaxpr_as_fun(jaxpr), tuple(primals), tuple(tangents))


one_kernel_p = Primitive("fpjax_one_kernel")
one_kernel_p.multiple_results = True
# Called outside any jit, the primitive compiles itself: an evaluation operation by operation would lose the one
# kernel.
one_kernel_p.def_impl(lambda *values, jaxpr: jax.jit(lambda *v: one_kernel_p.bind(*v, jaxpr=jaxpr))(*values))
one_kernel_p.def_abstract_eval(lambda *avals, jaxpr: jaxpr.out_avals)
batching.primitive_batchers[one_kernel_p] = _batched
ad.primitive_jvps[one_kernel_p] = _differentiated
mlir.register_lowering(one_kernel_p, _lower_plain)
mlir.register_lowering(one_kernel_p, _lower_cpu, platform="cpu")
