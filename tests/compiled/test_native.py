"""One kernel or the plain loop: the same numbers, and the fast path is really taken."""

import os
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.sharding import Mesh, PartitionSpec

import fpjax
from fpjax import InputError
from fpjax.compiled import hyperbolic
from fpjax.compiled.elementary import sin
from fpjax.compiled.native import (
    enable_compilation_cache,
    native,
    native_enabled,
    native_mode,
    reverse_pass,
    scan_loop,
)
from fpjax.compiled.one_kernel import what_forbids_one_kernel

STEPS = 300


def servo(gains, checkpoint="none", steps=STEPS):
    """Tracking cost of a small nonlinear loop whose carry is a pytree of scalars."""
    table = jnp.sin(jnp.linspace(0.0, 6.0, steps)).astype(gains.dtype)
    zero = jnp.zeros_like(gains[0])

    def step(carry, reference):
        velocity, integral, cost = carry
        error = reference - velocity
        torque = gains[0] * error + gains[1] * integral - jnp.tanh(30.0 * velocity)
        cost = cost + 1e-3 * error**2
        return (velocity + 1e-3 * torque, integral + 1e-3 * error, cost), None

    carry, _ = scan_loop(step, (zero, zero, zero), table, checkpoint=checkpoint)
    return carry[2]


GAINS = jnp.stack([jnp.linspace(20.0, 60.0, 6), jnp.linspace(1.0, 9.0, 6)], axis=1)


def _shard_map(run, check=False):
    mesh = Mesh(np.array(jax.devices()[:2]), ("candidates",))
    spec = PartitionSpec("candidates")
    return jax.jit(jax.shard_map(run, mesh=mesh, in_specs=spec, out_specs=spec, check_vma=check))(GAINS)


UNDER = {
    "alone": lambda wrap: wrap(servo)(GAINS[0]),
    "jit": lambda wrap: jax.jit(wrap(servo))(GAINS[0]),
    "vmap": lambda wrap: jax.vmap(wrap(servo))(GAINS),
    "around vmap": lambda wrap: wrap(jax.vmap(servo))(GAINS),
    "jit of vmap": lambda wrap: jax.jit(jax.vmap(wrap(servo)))(GAINS),
    "grad inside": lambda wrap: wrap(jax.grad(servo))(GAINS[0]),
    "grad outside": lambda wrap: jax.grad(wrap(servo))(GAINS[0]),
    "jit of grad": lambda wrap: jax.jit(jax.value_and_grad(wrap(servo)))(GAINS[0]),
    "jvp": lambda wrap: jax.jvp(wrap(servo), (GAINS[0],), (jnp.ones(2),)),
    "hessian": lambda wrap: jax.hessian(wrap(servo))(GAINS[0]),
    "vmap of grad": lambda wrap: jax.vmap(jax.grad(wrap(servo)))(GAINS),
    "map": lambda wrap: lax.map(wrap(servo), GAINS),
    "map of vmap": lambda wrap: lax.map(wrap(jax.vmap(servo)), GAINS.reshape(3, 2, 2)),
    "nested": lambda wrap: wrap(jax.vmap(wrap(servo)))(GAINS),
    "shard_map": lambda wrap: _shard_map(jax.vmap(wrap(servo))),
    "checked shard_map": lambda wrap: _shard_map(jax.vmap(wrap(servo)), check=True),
}


# By default; `long` the others.
FEW = ("alone", "jit of vmap", "jit of grad", "jvp", "vmap of grad", "map of vmap", "nested", "shard_map")


@pytest.mark.parametrize(
    "where", [where if where in FEW else pytest.param(where, marks=pytest.mark.long) for where in UNDER]
)
def test_same_numbers_on_and_off(where):
    with native_mode(False):
        off = UNDER[where](native)
    with native_mode(True):
        on = UNDER[where](native)
    plain = UNDER[where](lambda fn: fn)
    for a, b, c in zip(jax.tree.leaves(on), jax.tree.leaves(off), jax.tree.leaves(plain), strict=True):
        # The same operations in another order of fusion: a few units in the last place.
        np.testing.assert_allclose(a, c, rtol=1e-10)
        np.testing.assert_allclose(b, c, rtol=1e-10)


def test_one_kernel_is_asked_for():
    with native_mode(True), jax.default_device(jax.devices("cpu")[0]):
        text = jax.jit(native(jax.vmap(servo))).lower(GAINS).as_text()
    assert 'xla_cpu_small_call = "true"' in text
    with native_mode(False):
        text = jax.jit(native(jax.vmap(servo))).lower(GAINS).as_text()
    assert "xla_cpu_small_call" not in text


def _hurried(fn, *arguments):
    """The shortest of many calls [s], as other work beside this one holds up most of a few; the first compiles."""
    jax.block_until_ready(fn(*arguments))
    times = []
    for _ in range(100):
        start = time.perf_counter()
        jax.block_until_ready(fn(*arguments))
        times.append(time.perf_counter() - start)
    return min(times)


def test_the_cliff_is_gone():
    """Five candidates in float64 took 10 times one candidate when every step was a chain of kernels."""
    if not native_enabled() and jax.__version_info__ < (0, 12):
        pytest.skip("FPJAX_NATIVE=0: the plain loop has the cliff")
    run = jax.jit(native(jax.vmap(lambda gains: servo(gains, steps=5000))))
    one, five = _hurried(run, GAINS[:1]), _hurried(run, GAINS[:5])
    assert five <= 4.0 * one


def _callback(x):
    return jax.pure_callback(lambda v: np.sort(v), jax.ShapeDtypeStruct(x.shape, x.dtype), x, vmap_method="sequential")


FORBIDDEN = {
    "sort": jnp.sort,
    "cholesky": lambda x: jnp.linalg.cholesky(jnp.diag(x)),
    "solve": lambda x: jnp.linalg.solve(jnp.diag(x), x),
    "fft": lambda x: jnp.abs(jnp.fft.fft(x)),
    "callback": _callback,
    "top_k": lambda x: lax.top_k(x, 2)[0],
}


@pytest.mark.parametrize("name", FORBIDDEN)
def test_what_cannot_stand_in_a_kernel_falls_back(name):
    """XLA fails hard on these inside the kernel, so they must be found within the loop's body."""

    def run(x):
        def step(carry, _):
            return carry + 1e-3 * jnp.sum(FORBIDDEN[name](carry)), None

        return scan_loop(step, x, None, length=5)[0]

    x = jnp.array([3.0, 1.0, 2.0])
    assert what_forbids_one_kernel(jax.make_jaxpr(run)(x).jaxpr) is not None
    expected = run(x)
    with native_mode(True):
        np.testing.assert_allclose(jax.jit(native(run))(x), expected, rtol=1e-12)


ALLOWED = {
    "arithmetic": lambda x: jnp.clip(jnp.abs(x) ** 1.5 + x**3 - x / 3.0, -4.0, 4.0) + jnp.sign(x) + x % 0.7,
    "functions": lambda x: (
        jnp.sin(x) + jnp.cos(x) * jnp.exp(-x) + jnp.log1p(x**2) + jnp.arctan2(x, 1.0 + x) + jnp.sqrt(x**2)
    ),
    "hyperbolic": lambda x: jnp.tanh(x) + jnp.sinh(x) - jax.nn.sigmoid(x) + jax.scipy.special.erf(x) + jnp.arcsinh(x),
    "rounding": lambda x: jnp.floor(x) + jnp.ceil(x) + jnp.round(x) + jnp.where(jnp.isfinite(x), x, 0.0),
    "integers": lambda x: x * ((jnp.int32(5) << jnp.int32(2)) & jnp.int32(7)).astype(x.dtype),
    "reductions": lambda x: x + jnp.sum(x) + jnp.max(x) * jnp.min(x) + jnp.prod(x) + jnp.argmax(x).astype(x.dtype),
    "cumulative": lambda x: jnp.cumsum(x) + lax.cummax(x),
    "indexing": lambda x: x.at[1].add(x[0]).at[2].set(0.5) + jnp.roll(x, 1) + x[jnp.array([2, 0, 1, 1])],
    "shapes": lambda x: jnp.concatenate([x[2:], x[:2]]) + jnp.flip(x) + jnp.reshape(x, (2, 2)).T.reshape(4),
    "matrices": lambda x: jnp.outer(x, x) @ x,
    "branches": lambda x: lax.cond(x[0] > 0.0, jnp.sin, jnp.cos, x),
    "loops": lambda x: lax.fori_loop(0, 4, lambda i, v: 0.5 * v + 1.0, x),
    "while": lambda x: lax.while_loop(lambda v: jnp.sum(v) > 1.0, lambda v: 0.5 * v, x),
    "lookup": lambda x: x - jnp.arange(5.0)[jnp.clip(2.0 * x + 2.0, 0.0, 4.0).astype(jnp.int32)],
}


@pytest.mark.parametrize("name", ALLOWED)
@pytest.mark.parametrize("batch", [None, pytest.param(3, marks=pytest.mark.long), 300])
def test_what_is_allowed_compiles_in_one_kernel(name, batch):
    def run(x):
        return scan_loop(lambda carry, _: (0.5 * ALLOWED[name](carry), None), x, None, length=5)[0]

    x = jnp.array([0.3, -0.2, 0.9, 0.1])
    if batch is not None:
        x = jnp.outer(jnp.linspace(0.5, 1.5, batch), x)
        run = jax.vmap(run)
    assert what_forbids_one_kernel(jax.make_jaxpr(run)(x).jaxpr) is None
    with native_mode(True):
        np.testing.assert_allclose(jax.jit(native(run))(x), run(x), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", ["arithmetic", "hyperbolic"])
def test_a_later_vmap_that_is_too_large_for_one_kernel(name):
    """XLA before 0.12 gives these operations to its threads, and cannot do so within a kernel."""
    run = native(lambda x: scan_loop(lambda carry, _: (0.5 * ALLOWED[name](carry), None), x, None, length=5)[0])
    x = jnp.outer(jnp.linspace(0.5, 1.5, 3000), jnp.array([0.3, -0.2, 0.9, 0.1]))
    with native_mode(True):
        on = jax.jit(jax.vmap(run))(x)
    with native_mode(False):
        off = jax.jit(jax.vmap(run))(x)
    np.testing.assert_allclose(on, off, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("unroll", [1, 2])
def test_operations_are_counted_through_calls(unroll):
    """XLA inlines calls before it fuses: ten tanh of 500 candidates, or ten calls of 2,000, are one large operation."""

    def ten_times(fn, x):
        def step(value, _):
            for i in range(10):
                value = fn(x * value + 0.1 * i)
            return value, None

        return lax.scan(step, jnp.zeros_like(x) + 0.1, None, length=20, unroll=unroll)[0]

    for fn, size in ((hyperbolic.tanh, 500), (jax.jit(lambda v: jnp.sin(v) * 0.9 + 0.01 * v * v), 2000)):
        run = jax.vmap(lambda x, fn=fn: ten_times(fn, x))
        x = jnp.linspace(0.5, 1.5, size)
        with native_mode(True):
            on = jax.jit(native(run))(x)
        np.testing.assert_allclose(on, run(x), rtol=1e-10)


def test_constants_captured_tracers_and_passed_through_arguments():
    """XLA before 0.12 ends the process where an argument of the kernel is a constant array."""
    table, kept = jnp.sin(jnp.linspace(0.0, 30.0, STEPS)), jnp.linspace(0.0, 1.0, STEPS)

    def run(gain, table, unused, flags):
        def step(carry, x):
            return carry + 0.1 * (gain * x[0] - jnp.tanh(carry)) + x[1], None

        return scan_loop(step, jnp.zeros_like(gain), (table, kept))[0], table, gain, flags

    def outer(wrap, gain):
        def within(scale):
            captured = wrap(lambda g: run(g * scale, table, table, kept > 0.5)[0])(gain)
            return (
                captured,
                wrap(run)(gain, table, kept, kept > 0.5),
                wrap(run)(jnp.array(2.0), table * 2.0, kept, True),
            )

        return jax.vmap(within)(jnp.array([1.0, 2.0]))

    with native_mode(True):
        on = jax.jit(lambda gain: outer(native, gain))(jnp.array(0.3))
    off = outer(lambda fn: fn, jnp.array(0.3))
    for a, b in zip(jax.tree.leaves(on), jax.tree.leaves(off), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_traced_once():
    count = 0

    def run(x):
        nonlocal count
        count += 1
        return servo(x)

    with native_mode(True):
        wrapped = native(run)
        wrapped(GAINS[0])
        wrapped(GAINS[1])
    assert count == 1


def test_the_switch(monkeypatch):
    monkeypatch.setenv("FPJAX_NATIVE", "0")
    assert not native_enabled()
    with native_mode(True):
        assert native_enabled()
    monkeypatch.setenv("FPJAX_NATIVE", "1")
    assert native_enabled()
    with native_mode(False):
        assert not native_enabled()
    monkeypatch.setenv("FPJAX_NATIVE", "perhaps")
    with pytest.raises(InputError, match="FPJAX_NATIVE='perhaps'"):
        native_enabled()
    monkeypatch.delenv("FPJAX_NATIVE")
    assert native_enabled()


@pytest.mark.parametrize("steps", [1, 5, 51, *(pytest.param(n, marks=pytest.mark.long) for n in (2, 3, 9, 50, 299))])
@pytest.mark.parametrize("checkpoint", ["step", "nested", "deeper"])
def test_checkpoints_change_no_number(steps, checkpoint):
    def run(gain, checkpoint):
        def step(carry, x):
            carry = {"v": jnp.tanh(gain * carry["v"] + x["a"]) + x["b"]}
            return carry, (carry["v"], 2.0 * carry["v"])

        xs = {"a": jnp.linspace(0.0, 1.0, steps), "b": jnp.linspace(1.0, -1.0, steps)}
        carry, ys = scan_loop(step, {"v": jnp.array(0.1)}, xs, checkpoint=checkpoint)
        return carry["v"] + jnp.sum(ys[0] ** 2), ys

    (plain, ys), slope = jax.value_and_grad(run, has_aux=True)(jnp.array(0.7), "none")
    with reverse_pass(candidates=1, scratch=0):  # no memory at all: as many levels as there are
        name = "auto" if checkpoint == "deeper" else checkpoint
        (value, zs), other = jax.value_and_grad(run, has_aux=True)(jnp.array(0.7), name)
    np.testing.assert_allclose(value, plain, rtol=1e-13)
    np.testing.assert_allclose(other, slope, rtol=1e-11)
    for y, z in zip(ys, zs, strict=True):
        np.testing.assert_allclose(z, y, rtol=1e-13)


def _scratch(steps, checkpoint):
    """Bytes that the gradients of six runs hold besides their inputs and outputs."""
    gradient = jax.jit(jax.vmap(jax.grad(lambda gains: servo(gains, checkpoint, steps))))
    return gradient.lower(GAINS).compile().memory_analysis().temp_size_in_bytes


def test_nested_memory_does_not_grow_with_the_horizon():
    carries = 8 * 6 * 3  # bytes a step: what it needs of the carry (the cost is linear) and its tanh
    table = 2 * 8 * 16_000  # the reference and its copy in blocks, shared by all candidates
    assert _scratch(16_000, "none") >= 16_000 * carries
    assert 16_000 * 8 * 6 * 2 <= _scratch(16_000, "step") <= 1.2 * 16_000 * carries + table
    assert _scratch(16_000, "nested") <= 4 * 126 * carries + table


def _auto_scratch(steps, **reverse):
    def grad(gains):
        with reverse_pass(**reverse):
            return jax.grad(lambda g: servo(g, "auto", steps))(gains)

    return jax.jit(jax.vmap(grad)).lower(GAINS).compile().memory_analysis().temp_size_in_bytes


def test_auto_checkpoint_follows_the_reverse_pass():
    assert _auto_scratch(4_000, candidates=1, scratch=10**6) == _scratch(4_000, "step")
    assert _auto_scratch(4_000, candidates=64, scratch=10**6) == _scratch(4_000, "nested")


@pytest.mark.long  # compiles three horizons
def test_deeper_blocks_hold_the_memory_at_any_horizon():
    allowed = 20_000
    for steps in (1_000, 30_000, 300_000):
        table = 4 * 8 * steps  # the reference, its copies in blocks and its slices, shared by all candidates
        assert _auto_scratch(steps, candidates=6, scratch=allowed) <= 4 * allowed + table


def test_bad_loops_are_refused():
    with pytest.raises(InputError, match="checkpoint='some'"):
        scan_loop(lambda c, x: (c, x), 0.0, jnp.zeros(3), checkpoint="some")
    with pytest.raises(InputError, match="one length"):
        scan_loop(lambda c, x: (c, x), 0.0, (jnp.zeros(3), jnp.zeros(4)))
    with pytest.raises(InputError, match="one length"):
        scan_loop(lambda c, x: (c, x), 0.0, None)


def test_compilation_cache_is_filled_and_only_when_asked(tmp_path):
    program = (
        "import sys, jax\n"
        "from fpjax.compiled.native import enable_compilation_cache\n"
        "assert jax.config.jax_compilation_cache_dir is None\n"
        "enable_compilation_cache(sys.argv[1])\n"
        "jax.jit(lambda x: x * 2.0)(3.0)\n"
    )
    folder = tmp_path / "cache"
    alone = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}  # the tests' own
    subprocess.run([sys.executable, "-c", program, str(folder)], check=True, timeout=120, env=alone)
    assert any(folder.iterdir())


def test_compilation_cache_folder_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be kept"):
        enable_compilation_cache(tmp_path / "file" / "cache")


def test_a_whole_simulation_stands_in_one_kernel():
    # jax 0.7 to 0.11: XLA ended the process where an array that nothing uses (here the times) reached the kernel.
    loop = fpjax.ClosedLoop(
        fpjax.OneMass(inertia=10.0, friction=fpjax.Coulomb(coulomb=2.0)), fpjax.ProportionalIntegral(150.0, 200.0)
    )
    found = {}
    for asked in (True, False):
        jax.clear_caches()
        with native_mode(asked):
            run = fpjax.simulate(
                loop, fpjax.Sine(1.0, 10.0), dt=1e-4, duration=0.5, measures={"error": fpjax.MeanAbsolute()}
            )
        found[asked] = float(run.measures["error"])
    assert found[True] == pytest.approx(found[False], rel=1e-9)


def test_without_jit_it_is_the_function():
    """`jax.disable_jit`, with which people debug a step, evaluates it operation by operation."""
    run = native(lambda x: scan_loop(lambda c, _: (0.5 * c + sin(c), None), x, None, length=5)[0])
    start = jnp.linspace(0.1, 1.0, 9)
    expected = run(start)
    with jax.disable_jit():
        np.testing.assert_allclose(run(start), expected, rtol=1e-14)
