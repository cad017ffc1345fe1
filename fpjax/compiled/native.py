"""One native loop on the CPU: the loop that every simulation, tuning and diagnosis runs in.

XLA on the CPU compiles a `while` into one native function only while its body touches less than 1 KB; above that every
step is a chain of small kernel calls, ten times slower and more. `native` asks for the one function whatever the size,
through the metadata that XLA itself puts on small loops. From jax 0.12 on XLA compiles every loop so without being
asked; `native` then takes the rest of the program into the same kernel, so that its pieces are not handed to threads.
`scan_loop` is `lax.scan` in the form that was measured to be fastest: each step's new carry is computed once, and the
memory of reverse mode is bounded.

Both only change how fast a result comes, never what it is (beyond rounding).
"""

import contextlib
import contextvars
import functools
import os
import pathlib
import sys
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import TypeVar, cast

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jaxtyping import PyTree

from ..errors import InputError
from .elementary import NAME as ELEMENTARY
from .one_kernel import one_kernel
from .stored import store_in

F = TypeVar("F", bound=Callable[..., object])
C = TypeVar("C")
X = TypeVar("X")
Y = TypeVar("Y")
T = TypeVar("T")

CHECKPOINTS = ("none", "step", "nested", "auto")  # in the order of their levels of blocks: 0, 1, 2, by size
MOST_LEVELS = 4
# With this many candidates the vectors are not filled: a reverse pass gains 5 to 15 % from unrolling more steps.
FEW = range(2, 9)
GPUS = ("gpu", "cuda", "rocm")

# Names of jax's primitives whose values a checkpointed step keeps: recomputing one in the reverse pass takes longer
# than loading it.
_EXPENSIVE = """
div tanh exp exp2 expm1 log log1p logistic pow sqrt cbrt sin cos tan sinh cosh asin acos atan atan2 asinh acosh atanh
erf erfc
"""

_switch: contextvars.ContextVar[bool | None] = contextvars.ContextVar("native", default=None)
# Set while `fpjax.compiled.gradients` traces a reverse pass: (candidates, bytes allowed for the residuals).
_reverse: contextvars.ContextVar[tuple[int, int] | None] = contextvars.ContextVar("reverse", default=None)


def native_enabled() -> bool:
    """Whether `native` asks XLA for one kernel, where it compiles for a CPU.

    It does, unless `native_mode` or else the environment variable `FPJAX_NATIVE` ("0" off, "1" on) says otherwise. Read
    when a function is traced: what is compiled stays as it was compiled.
    """
    chosen = _switch.get()
    if chosen is None:
        word = os.environ.get("FPJAX_NATIVE", "").strip().lower()
        if word in ("0", "off", "false", "no"):
            chosen = False
        elif word in ("", "auto", "1", "on", "true", "yes"):
            chosen = True
        else:
            raise InputError(
                f"FPJAX_NATIVE={word!r} is neither 0 nor 1: use 0 for the plain loop, 1 to ask "
                "for one kernel, which is what happens where it is unset."
            )
    return chosen


@contextlib.contextmanager
def native_mode(enabled: bool | None) -> Iterator[None]:
    """Within the block: `native` on (True), off (False) or as the environment says (None), for new traces."""
    token = _switch.set(enabled)
    try:
        yield
    finally:
        _switch.reset(token)


def platform() -> str:
    """The kind of device that what is traced now will run on: "cpu", "gpu".

    The default device's; arguments that were put elsewhere are not known to a trace.
    """
    device = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    return jax.default_backend() if device is None else getattr(device, "platform", device)


def native(fn: F) -> F:
    """`fn`, compiled by XLA on the CPU as one kernel; the same numbers, `fn` itself elsewhere.

    Put it around the outermost function that holds the loop, the gradient included:
    `native(value_and_gradient(cost))`, not the other way round. It works under vmap, grad, jvp,
    lax.map, shard_map and an outer jit.

    Where the trace of `fn` holds what cannot stand in a kernel (sort, linear algebra, FFT, callbacks, collectives),
    it is evaluated as it stands, from the same trace.

    Args:
        fn: positional arrays and pytrees of arrays in, a pytree of arrays out.
    """

    # The settings in force are static arguments of the jit, so that a trace made outside `reverse_pass` or
    # `native_mode` is not reused within it.
    def evaluated(enabled: bool, ambient: object, arguments: tuple[PyTree, ...]) -> PyTree:
        # Under `disable_jit` nothing is compiled, and evaluating our primitive would call itself without end.
        plain = not enabled or jax.config.jax_disable_jit  # pyright: ignore[reportAttributeAccessIssue]
        return fn(*arguments) if plain else one_kernel(fn, arguments)

    compiled = jax.jit(evaluated, static_argnums=(0, 1))

    @functools.wraps(fn)
    def wrapped(*arguments):
        return compiled(native_enabled(), _reverse.get(), arguments)

    return cast(F, wrapped)


def scan_loop(
    step: Callable[[C, X], tuple[C, Y]],
    carry: C,
    xs: X,
    *,
    length: int | None = None,
    checkpoint: str = "auto",
    unroll: int | None = None,
) -> tuple[C, Y]:
    """`lax.scan(step, carry, xs)`, the same result, with bounded memory in reverse mode.

    Args:
        step: `step(carry, x)` -> (carry, y).
        carry: what evolves.
        xs: pytree with leading axis time, or None with `length`.
        length: number of steps where `xs` does not give it.
        checkpoint: "none" keeps what every step needs for its derivative; "step" keeps the carry of every step;
            "nested" keeps the carry every sqrt(time) steps and costs one more forward pass; "auto" is "none", but
            within `gradients.value_and_gradient` "step", "nested" or deeper blocks by size.
        unroll: steps in one turn of the loop; by default 2, on a GPU and in a reverse pass of few candidates 4
            (measured best).

    Raises:
        InputError: for an unknown checkpoint, and where there is no common length.
    """
    if checkpoint not in CHECKPOINTS:
        raise InputError(f"checkpoint={checkpoint!r} is not known: use one of {CHECKPOINTS}.")
    length = _length(xs, length)
    step, carry = alike_on_devices(step, carry, xs)
    levels = _levels(carry, length) if checkpoint == "auto" else CHECKPOINTS.index(checkpoint)
    if unroll is None:
        candidates, _ = _reverse.get() or (1, 0)
        # On a GPU a turn of the loop is a launch or more, however many steps it holds.
        unroll = 4 if candidates in FEW or platform() in GPUS else 2
    if levels == 0:
        return lax.scan(step if platform() in GPUS else _whole_carry(step), carry, xs, length=length, unroll=unroll)
    kept = jax.checkpoint(step, prevent_cse=False, policy=_is_expensive)
    return _in_blocks(_whole_carry(kept), carry, xs, length, levels, unroll)


def once(value: T) -> T:
    """`value`, computed once: on a CPU XLA else computes a cheap operation anew in every fusion that uses its result.

    In a long step without expensive operations that multiplies. It changes no number, and nothing at all before jax
    0.12, where XLA drops the barrier before it fuses (seen on jax 0.7 and 0.10).

    Args:
        value: a pytree of arrays, of any size.
    """
    return value if platform() in GPUS or not jax.tree.leaves(value) else lax.optimization_barrier(value)


def alike_on_devices(step: Callable[[C, X], tuple[C, Y]], carry: C, xs: X) -> tuple[Callable[[C, X], tuple[C, Y]], C]:
    """Within `shard_map`, a carry that varies over the same devices before and after a step; elsewhere both as given.

    A loop at rest begins with constants, which are the same on every device; after one step they hold the candidate,
    which is not. Its check of what varies (`check_vma`) takes that for an error, unless the constants are declared.

    Args:
        step: `step(carry, x)` -> (carry, y).
        carry: before the first step.
        xs: pytree with leading axis time.
    """
    if not jax.sharding.get_abstract_mesh().manual_axes:
        return step, carry
    first = jax.tree.map(lambda leaf: leaf[0], xs)
    # A fixed point: a state may come to vary only through another one, so steps are traced until no axis is added.
    over = _varies(jax.tree.leaves((carry, first)))
    while (more := over | _varies(_outputs(step, _declared(carry, over), first))) != over:
        over = more
    if not over:
        return step, carry

    def stepped(carry: C, x: X) -> tuple[C, Y]:
        carry, y = step(carry, x)
        return _declared(carry, over), y

    return stepped, _declared(carry, over)


def _outputs(step: Callable[..., PyTree], carry: PyTree, x: PyTree) -> PyTree:
    return jax.make_jaxpr(lambda: step(carry, x)[0])().out_avals


def _varies(values: PyTree) -> frozenset[str]:
    """The device axes over which any of these arrays (or their abstract values) varies."""
    over: frozenset[str] = frozenset()
    for value in values:
        abstract = value if isinstance(value, ShapedArray) else jax.typeof(value)
        kind = getattr(abstract, "manual_axis_type", None)  # `vma` before jax 0.9
        over |= getattr(abstract, "vma", frozenset()) if kind is None else kind.varying
    return over


def _declared(tree: C, over: frozenset[str]) -> C:
    def one(leaf: PyTree) -> PyTree:
        missing = tuple(sorted(over - _varies([leaf])))
        return _vary(leaf, missing) if missing else leaf

    return jax.tree.map(one, tree)


def _vary(leaf: PyTree, axes: tuple[str, ...]) -> PyTree:
    """The same array, declared to vary over these device axes."""
    if hasattr(lax, "pcast"):
        return lax.pcast(leaf, axes, to="varying")
    return cast(ModuleType, lax).pvary(leaf, axes)  # jax before 0.8


def _is_expensive(primitive: Primitive, *operands: object, **parameters: object) -> bool:
    """What a checkpointed step keeps besides its carry: 5 to 15 % faster, for a few more numbers per step."""
    del operands
    return primitive.name in _EXPENSIVE.split() or parameters.get("name") == ELEMENTARY


def _in_blocks(step: Callable[[C, X], tuple[C, Y]], carry: C, xs: X, length: int, levels: int, unroll: int) -> PyTree:
    """The loop as blocks of blocks: only the carries at the starts of the blocks are kept, one level at a time."""
    blocks = _blocks(length, levels)
    if blocks < 2:
        return lax.scan(step, carry, xs, length=length, unroll=unroll)
    size = length // blocks
    # Every block has the same number of steps, so that one compiled loop serves all; the remainder runs as a shorter
    # block.
    head = jax.tree.map(lambda x: x[: blocks * size].reshape(blocks, size, *x.shape[1:]), xs)
    block = jax.checkpoint(lambda c, x: _in_blocks(step, c, x, size, levels - 1, unroll), prevent_cse=False)
    carry, ys = lax.scan(block, carry, head, length=blocks)
    ys = jax.tree.map(lambda y: y.reshape(blocks * size, *y.shape[2:]), ys)
    rest = length - blocks * size
    if rest:
        carry, tail = _in_blocks(step, carry, jax.tree.map(lambda x: x[blocks * size :], xs), rest, 1, unroll)
        ys = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), ys, tail)
    return carry, ys


def _blocks(length: int, levels: int) -> int:
    """How many blocks keep the fewest carries: those at their starts, those within one, and those of the rest."""
    if levels < 2 or length < 4:
        return 1
    root = length ** (1.0 / levels)

    def carries(blocks: int) -> float:
        size = length // blocks
        return blocks + (levels - 1) * size ** (1.0 / (levels - 1)) + length - blocks * size

    # The optimum lies near length^(1/levels); the search around it also finds divisors that leave a short remainder.
    return min(range(max(2, int(0.6 * root)), int(1.7 * root) + 2), key=carries)


def _length(xs: PyTree, length: int | None) -> int:
    lengths: set[int] = {leaf.shape[0] for leaf in jax.tree.leaves(xs)}
    if length is not None:
        lengths.add(length)
    if len(lengths) != 1:
        raise InputError(
            f"A loop needs one length, but xs and length give {sorted(lengths) or 'none'}: "
            "give every leaf of xs the same leading axis, or xs=None and length=N."
        )
    return lengths.pop()


def _whole_carry(step: Callable[[C, X], tuple[C, Y]]) -> Callable[[C, X], tuple[C, Y]]:
    """`step`, with a barrier that makes XLA compute each new carry once.

    Without the barrier XLA fuses the unrolled second step into the first, and recomputes the first for every state of
    the second (jax 0.12: 40 % slower at 64 candidates). On a GPU that saves launches and is faster: no barrier there.
    """

    def stepped(carry: C, x: X) -> tuple[C, Y]:
        carry, y = step(carry, x)
        return (lax.optimization_barrier(carry) if jax.tree.leaves(carry) else carry), y

    return stepped


def _levels(carry: PyTree, length: int) -> int:
    """How deep checkpoints are nested: 0 in a plain run; in a reverse pass the fewest levels that fit its scratch."""
    reverse = _reverse.get()
    if reverse is None:
        return 0
    candidates, allowed = reverse
    size = candidates * sum(leaf.size * leaf.dtype.itemsize for leaf in map(jnp.asarray, jax.tree.leaves(carry)))
    # With n levels about n * length^(1/n) carries are alive at once, for n - 1 further forward passes.
    return next((n for n in range(1, MOST_LEVELS) if n * length ** (1.0 / n) * size <= allowed), MOST_LEVELS)


@contextlib.contextmanager
def reverse_pass(*, candidates: int, scratch: int) -> Iterator[None]:
    """Within the block, loops with checkpoint="auto" bound their memory for a reverse pass.

    They keep about `scratch` [bytes] of carries at most, for `candidates` simulations at once.
    """
    token = _reverse.set((candidates, scratch))
    try:
        yield
    finally:
        _reverse.reset(token)


def enable_compilation_cache(directory: str | os.PathLike[str] | None = None) -> pathlib.Path:
    """Keep compiled programs on disk for the next process: jax's cache and `fpjax.compiled.stored`. Never on by itself.

    Args:
        directory: by default `FPJAX_CACHE`, or else a folder of ours in the user's cache folder.

    Returns:
        The folder.

    Raises:
        InputError: where it cannot be written.
    """
    folder = pathlib.Path(directory or os.environ.get("FPJAX_CACHE") or _user_cache()).expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"The compilation cache cannot be kept in {folder} ({error.strerror}): give a folder "
            "that can be written, or go without."
        ) from error
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # By default jax keeps only what took over a second to compile, which would leave out most programs here.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    store_in(folder)
    return folder


def _user_cache() -> pathlib.Path:
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    elif sys.platform == "darwin":
        base = "~/Library/Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return pathlib.Path(base) / "fpjax"
