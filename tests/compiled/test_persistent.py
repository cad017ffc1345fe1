"""The GPU kernel: lowered and shape-checked for CUDA, and equal to the scan when Pallas's interpreter runs it.

It was never run on a GPU (KNOWN_GAPS.md).
"""

import contextlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import AbstractMesh

from fpjax.compiled import persistent as module
from fpjax.compiled.gradients import value_and_gradient
from fpjax.compiled.native import scan_loop
from fpjax.compiled.persistent import LANES, persistent
from fpjax.errors import FpjaxWarning

STEPS = 60


def cost(candidate, table, kept=2.0):
    """A loop with a table, a pytree carry, closed-over gains and constants."""
    zero = jnp.zeros_like(candidate["kp"])

    def step(carry, reference):
        error = reference - carry["velocity"]
        torque = candidate["kp"] * error + carry["integral"] - kept * jnp.tanh(30.0 * carry["velocity"])
        velocity = carry["velocity"] + 1e-2 * torque
        integral = carry["integral"] + 1e-2 * jnp.where(jnp.abs(error) > 0.1, candidate["ki"], 0.5) * error
        return {"velocity": velocity, "integral": integral, "cost": carry["cost"] + jnp.sign(error) * error}, None

    start = {"velocity": zero, "integral": zero, "cost": zero}
    return scan_loop(step, start, table)[0]["cost"]


def table(dtype):
    return jnp.sin(jnp.linspace(0.0, 3.0, STEPS)).astype(dtype)


def candidates(size, dtype):
    return {"kp": jnp.linspace(1.0, 9.0, size).astype(dtype), "ki": jnp.linspace(0.0, 5.0, size).astype(dtype)}


def over_candidates(batch, table):
    return jax.vmap(cost, in_axes=(0, None))(batch, table)


RUNS = {
    "value": over_candidates,
    "forward": value_and_gradient(over_candidates, mode="forward", batched=True),
    "vmap of forward": jax.vmap(value_and_gradient(cost, mode="forward"), in_axes=(0, None)),
    "table of each": lambda b, t: jax.vmap(cost)(b, jax.vmap(lambda kp: t * kp)(b["kp"])),
}
# Rounding of 60 steps: the interpreter fuses in another order than the scan.
RTOL = {jnp.float32: 2e-5, jnp.float64: 1e-12}


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("size", [1, LANES, LANES + 3])
@pytest.mark.parametrize("run", RUNS)
def test_interpreted_kernel_equals_the_scan(run, size, dtype, monkeypatch):
    batch = candidates(size, dtype)
    expected = jax.jit(RUNS[run])(batch, table(dtype))

    def refuse(*values, **parameters):
        raise AssertionError("the kernel was not taken")

    monkeypatch.setattr(module, "_as_scan", refuse)

    def interpreted(batch, table):
        with persistent(interpret=True):
            return RUNS[run](batch, table)

    found = jax.jit(interpreted)(batch, table(dtype))
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
        np.testing.assert_allclose(a, b, rtol=RTOL[dtype], atol=RTOL[dtype])


@contextlib.contextmanager
def cuda():
    """Lower for an H200; jax 0.12 asks which GPU it is, earlier ones take 9.0 where there is none."""
    if jax.__version_info__ < (0, 12):
        yield
        return
    from jax.sharding import AbstractDevice, use_abstract_mesh

    device = AbstractDevice(device_kind="NVIDIA H200", num_cores=None, platform="gpu")
    with use_abstract_mesh(AbstractMesh((), (), abstract_device=device)):
        yield


def lowered(run, batch, table):
    def traced(batch, table):
        with persistent():
            return run(batch, table)

    with cuda():
        return jax.jit(traced).trace(batch, table).lower(lowering_platforms=("cuda",)).as_text()


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("run", RUNS)
def test_lowers_for_cuda_as_one_kernel(run, dtype):
    text = lowered(RUNS[run], candidates(300, dtype), table(dtype))
    assert text.count("custom_call @__gpu$xla.gpu.triton") == 1
    assert "stablehlo.while" not in text
    padded = -(-300 * (2 if run in ("forward", "vmap of forward") else 1) // LANES) * LANES
    assert f"tensor<{padded}x" in text


def test_a_step_that_triton_cannot_do_stays_a_scan():
    def run(batch, table):
        def one(candidate):
            step = lambda c, x: (c + x * jax.scipy.special.gammaln(1.0 + jnp.abs(c)), None)  # noqa: E731
            return scan_loop(step, candidate["kp"], table)[0]

        return jax.vmap(one)(batch)

    with pytest.warns(FpjaxWarning, match="step by step"):
        text = lowered(run, candidates(4, jnp.float64), table(jnp.float64))
    assert "triton" not in text
    assert "stablehlo.while" in text


def test_elsewhere_and_in_reverse_mode_it_is_the_scan():
    batch = candidates(5, jnp.float64)
    for mode in ("forward", "reverse"):
        run = value_and_gradient(over_candidates, mode=mode, batched=True)
        with persistent():
            found = jax.jit(run)(batch, table(jnp.float64))
        expected = run(batch, table(jnp.float64))
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-11)


def test_recorded_loops_are_left_alone():
    with persistent():
        carry, ys = scan_loop(lambda c, x: (c + x, c), jnp.array(0.0), jnp.arange(4.0))
    np.testing.assert_array_equal(ys, [0.0, 0.0, 1.0, 3.0])
    assert float(carry) == 6.0
