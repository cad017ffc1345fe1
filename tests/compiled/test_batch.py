"""Chunks, threads and devices change the time of a batch, not its numbers."""

import concurrent.futures

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fpjax import InputError
from fpjax.compiled.batch import CHUNK_FLOAT32, CHUNK_FLOAT64, batch_size, chunk_for, iterate_chunks, map_chunks
from fpjax.compiled.gradients import value_and_gradient
from fpjax.compiled.native import native_enabled, native_mode, scan_loop

TABLE = jnp.sin(jnp.linspace(0.0, 6.0, 100))


def cost(candidate, table=TABLE):
    """Tracking cost of a small nonlinear loop with two gains."""
    table = table.astype(candidate["kp"].dtype)
    zero = jnp.zeros_like(candidate["kp"])

    def step(carry, reference):
        velocity, integral, total = carry
        error = reference - velocity
        torque = candidate["kp"] * error + candidate["gains"][0] * integral - jnp.tanh(30.0 * velocity)
        return (velocity + 1e-2 * torque, integral + 1e-2 * error, total + error**2), None

    return scan_loop(step, (zero, zero, zero), table)[0][2]


def both(candidate):
    return {"cost": cost(candidate), "row": jnp.stack([candidate["kp"], cost(candidate)])}


def candidates(size, dtype=jnp.float64):
    return {
        "kp": jnp.linspace(1.0, 20.0, size).astype(dtype),
        "gains": jnp.linspace(0.0, 3.0, 2 * size).reshape(size, 2).astype(dtype),
    }


def agree(a, b, rtol):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert x.shape == y.shape
        assert x.dtype == y.dtype
        np.testing.assert_allclose(x, y, rtol=rtol)


# Rounding of 100 steps, whose order of operations differs with the width of the vectors.
RTOL = {jnp.float64: 1e-12, jnp.float32: 1e-5}


@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
@pytest.mark.parametrize(
    "size",
    [1, 5, 63, 64, 65, 200, *(pytest.param(n, marks=pytest.mark.long) for n in (2, 7, 17, 47, 48, 127, 129, 1000))],
)
def test_equal_to_vmap_at_every_size(size, dtype):
    batch = candidates(size, dtype)
    agree(map_chunks(both, batch), jax.vmap(both)(batch), RTOL[dtype])


@pytest.mark.parametrize("enabled", [True, False])
def test_devices_threads_and_chunks_agree(enabled):
    batch = candidates(301)
    expected = jax.vmap(both)(batch)
    one = jax.devices()[:1]
    with native_mode(enabled):
        for options in (
            {"devices": jax.devices()[:2]},
            {"devices": one, "workers": 1},
            {"devices": one, "workers": 2},
            {"devices": one, "workers": 3, "chunk": 16},
            {"chunk": 1000},
        ):
            agree(map_chunks(both, batch, **options), expected, 1e-12)


def test_shared_and_batched_arguments():
    batch, table = candidates(70), 2.0 * TABLE
    expected = jax.vmap(cost, in_axes=(0, None))(batch, table)
    agree(map_chunks(cost, batch, (table,)), expected, 1e-12)
    whole = lambda block, table: jax.vmap(cost, in_axes=(0, None))(block, table)  # noqa: E731
    agree(map_chunks(whole, batch, (table,), batched=True), expected, 1e-12)


@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_gradients_in_chunks(mode):
    batch = candidates(70)
    expected = jax.vmap(jax.value_and_grad(cost))(batch)
    agree(map_chunks(value_and_gradient(cost, mode=mode), batch), expected, 1e-9)
    vector = lambda block: jax.vmap(cost)(block)  # noqa: E731
    agree(map_chunks(value_and_gradient(vector, mode=mode, batched=True), batch, batched=True), expected, 1e-9)


def test_within_a_transformation():
    batch = candidates(70)
    agree(jax.jit(lambda b: map_chunks(both, b))(batch), jax.vmap(both)(batch), 1e-12)
    total = lambda b: jnp.sum(map_chunks(cost, b))  # noqa: E731
    agree(jax.grad(total)(batch), jax.vmap(jax.grad(cost))(batch), 1e-9)


def test_same_shapes_compile_once():
    traces = 0

    def counted(candidate):
        nonlocal traces
        traces += 1
        return cost(candidate)

    one = jax.devices()[:1]
    for _ in range(3):
        map_chunks(counted, candidates(300), devices=one, workers=2)
    assert traces == 1
    map_chunks(counted, jax.tree.map(lambda x: 2.0 * x, candidates(300)), devices=one, workers=2)
    assert traces == 1


def test_pieces_resume_bit_equal():
    batch = candidates(250)
    pieces = list(iterate_chunks(both, batch, size=100))
    assert [piece for piece, _ in pieces] == [slice(0, 100), slice(100, 200), slice(200, 250)]
    whole = jax.tree.map(lambda *parts: np.concatenate(parts), *(result for _, result in pieces))
    agree(whole, jax.tree.map(np.asarray, jax.vmap(both)(batch)), 1e-12)
    resumed = list(iterate_chunks(both, batch, size=100, start=100))
    for (piece, result), (again, other) in zip(pieces[1:], resumed, strict=True):
        assert piece == again
        for x, y in zip(jax.tree.leaves(result), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(x, y)


def test_chunk_by_batch_and_precision():
    double, single = np.zeros(1), np.zeros(1, np.float32)
    assert chunk_for(double, 10**6) == CHUNK_FLOAT64 == 64
    assert chunk_for(single, 10**6) == CHUNK_FLOAT32 == 128
    assert [chunk_for(double, n) for n in (1, 5, 6, 8, 9, 27, 28, 50, 64, 65)] == [1, 5, 8, 8, 9, 27, 48, 50, 64, 48]
    assert [chunk_for(single, n) for n in (1, 3, 4, 9, 47, 100, 128)] == [1, 3, 8, 48, 48, 100, 128]


def test_bad_batches_are_refused():
    with pytest.raises(InputError, match="one leading axis"):
        batch_size({"a": np.zeros(3), "b": np.zeros(4)})
    with pytest.raises(InputError, match="one leading axis"):
        map_chunks(cost, {"kp": 1.0, "gains": np.zeros(2)})
    with pytest.raises(InputError, match="one leading axis"):
        map_chunks(cost, candidates(0))
    with pytest.raises(InputError, match="devices"):
        map_chunks(cost, candidates(3), devices=())
    with pytest.raises(InputError, match="multiple of the piece"):
        list(iterate_chunks(cost, candidates(300), size=100, start=50))


THREADS = {"workers": 2, "devices": jax.local_devices(backend="cpu")[:1]}


def test_within_a_trace_that_the_arguments_do_not_show():
    """The candidates are numbers, and what the function closes over is not."""
    for size in (60, 200):
        gains = np.linspace(0.5, 1.5, size)
        expected = np.sum(np.cos(2.0 * gains) * gains)

        def total(scale, gains=gains):
            return jnp.sum(map_chunks(lambda gain: jnp.sin(gain * scale), gains, **THREADS))

        np.testing.assert_allclose(jax.grad(total)(2.0), expected, rtol=1e-12)
        np.testing.assert_allclose(jax.jit(lambda s, total=total: s * total(2.0))(3.0), 3.0 * total(2.0), rtol=1e-12)


def test_every_thread_computes_under_the_settings_of_the_caller():
    def double(x):
        return jnp.sin(x) * jnp.ones(())

    numbers = np.linspace(0.0, 1.0, 400)
    for enabled in (True, False, True):
        with _enable_x64(enabled):
            for _ in range(2):  # the first call compiles on one thread
                found = map_chunks(double, numbers, **THREADS)
        assert found.dtype == (np.float64 if enabled else np.float32)
        np.testing.assert_allclose(found, np.sin(numbers), rtol=1e-14 if enabled else 1e-6)


def _enable_x64(enabled):
    return (jax if hasattr(jax, "enable_x64") else jax.experimental).enable_x64(enabled)


def test_native_mode_reaches_every_thread():
    seen = set()

    def noted(x):
        seen.add(native_enabled())
        return 2.0 * x

    with native_mode(False):
        map_chunks(noted, np.linspace(0.0, 1.0, 400), **THREADS)
        map_chunks(noted, np.linspace(0.0, 1.0, 400), **THREADS)
    assert seen == {False}


def test_two_callers_at_once():
    """The threads are the first one's; the other computes its parts alone."""
    numbers = np.linspace(0.0, 1.0, 2000)
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        found = [pool.submit(map_chunks, jnp.cos, numbers * scale, **THREADS) for scale in range(8)]
        for scale, result in enumerate(found):
            np.testing.assert_allclose(result.result(timeout=120), np.cos(numbers * scale), rtol=1e-14)


def test_what_fails_in_one_part_leaves_nothing_running():
    def fail(x):
        if x > 0.9:
            raise ValueError("no")
        return np.asarray(x)

    def outer(x):
        return jax.pure_callback(fail, jax.ShapeDtypeStruct((), x.dtype), x, vmap_method="sequential")

    good, bad = np.linspace(0.0, 0.5, 200), np.linspace(0.0, 1.0, 200)
    np.testing.assert_allclose(map_chunks(outer, good, **THREADS), good)
    with pytest.raises(Exception, match="no"):
        map_chunks(outer, bad, **THREADS)
    np.testing.assert_allclose(map_chunks(outer, good, **THREADS), good)


def test_random_keys_are_candidates_too():
    keys = jax.random.split(jax.random.key(0), 200)
    found = map_chunks(lambda key: jax.random.normal(key), keys, **THREADS)
    np.testing.assert_allclose(found, jax.vmap(jax.random.normal)(keys))
