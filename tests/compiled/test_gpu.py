"""What is chosen for a GPU, checked without one: the same numbers, other loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fpjax.compiled import batch, gradients, native
from fpjax.compiled.batch import map_chunks
from fpjax.compiled.native import platform, scan_loop


def cost(candidate):
    step = lambda carry, _: (carry + 0.01 * jnp.sin(candidate["kp"] * carry), None)  # noqa: E731
    return scan_loop(step, jnp.ones_like(candidate["kp"]), None, length=20)[0]


@pytest.mark.parametrize(("kind", "chunks"), [("cpu", 2), ("gpu", 1)])
def test_a_gpu_takes_the_whole_batch_at_once(kind, chunks, monkeypatch):
    monkeypatch.setattr(batch, "platform", lambda: kind)
    many = {"kp": jnp.linspace(1.0, 2.0, 70)}
    mapped = lambda b: map_chunks(cost, b)  # noqa: E731
    loops = [e for e in jax.make_jaxpr(mapped)(many).eqns if e.primitive.name == "scan"]
    assert len(loops) == chunks - 1  # around the chunks
    np.testing.assert_allclose(jax.jit(mapped)(many), jax.vmap(cost)(many), rtol=1e-12)
    assert batch._chunk_on(kind, 10**6, 8) == (64 if kind == "cpu" else 10**6)


@pytest.mark.parametrize("wanted", ["cpu", "gpu"])
def test_a_loop_for_a_gpu_has_fewer_turns(wanted, monkeypatch):
    monkeypatch.setattr(native, "platform", lambda: wanted)
    step = lambda carry, x: (jnp.sin(carry) + x, None)  # noqa: E731
    run = lambda xs: scan_loop(step, jnp.array(0.1), xs)[0]  # noqa: E731
    (loop,) = (e for e in jax.make_jaxpr(run)(jnp.ones(9)).eqns if e.primitive.name == "scan")
    barriers = [e for e in loop.params["jaxpr"].eqns if e.primitive.name == "optimization_barrier"]
    assert (loop.params["unroll"], len(barriers)) == ((2, 1) if wanted == "cpu" else (4, 0))
    expected = 0.1
    for _ in range(9):
        expected = np.sin(expected) + 1.0
    np.testing.assert_allclose(run(jnp.ones(9)), expected, rtol=1e-14)


def test_the_platform_is_that_of_the_default_device():
    assert platform() == jax.default_backend()
    with jax.default_device(jax.devices("cpu")[0]):
        assert platform() == "cpu"


def test_reverse_mode_may_keep_more_on_a_gpu(monkeypatch):
    monkeypatch.setattr(gradients, "platform", lambda: "cpu")
    assert gradients.default_scratch() == gradients.SCRATCH
    monkeypatch.setattr(gradients, "platform", lambda: "gpu")
    assert gradients.default_scratch() == gradients.SCRATCH_GPU
