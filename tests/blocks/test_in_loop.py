"""The common suite, each block inside a closed loop, through the one scan that every caller uses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tolerances
from catalogue import in_a_loop, one_of_each_kind
from catalogue_case import DT, moving
from catalogue_machine import SENSORS
from compiling import quick

import fpjax as fp
from fpjax.compiled.gradients import value_and_gradient

SAMPLES = 40


pytestmark = pytest.mark.each_block

ids = pytest.mark.parametrize("case", one_of_each_kind(), ids=str)
compiled_whole = pytest.mark.parametrize("case", in_a_loop(), ids=str)


def measures():
    return {
        "velocity": fp.MeanSquare(),
        "last": fp.Final(_velocity),
        "torque": fp.MeanSquare(_torque),
    }


def _velocity(signals):
    return signals.velocity


def _torque(signals):
    return signals.torque


def runner(case):
    """(cost(xi): the run with parameter i moved by xi_i times its own size, number of parameters, run count)."""
    tree = case.loop(case.build())
    moved, count = moving(tree)

    def cost(xi, dt):
        loop, reference = moved(xi)
        stepper = fp.make_stepper(dt=dt, samples=SAMPLES, stepping=case.stepping)
        inputs = fp.make_inputs(loop, reference, stepper, jax.random.key(3))
        finals, _, state = fp.roll(loop, inputs, stepper, measures())
        rest = sum(jnp.sum(leaf) for leaf in jax.tree.leaves(state))
        return 1e3 * finals["velocity"] + finals["last"] + 1e-3 * finals["torque"] + 1e-3 * rest

    return cost, count, _moved_names(tree)


def _moved_names(tree):
    names = []
    for name in fp.parameter_names(tree):
        names += [name] * int(np.size(fp.get_parameter(tree, name)))
    return names


@compiled_whole
def test_gradients_batches_and_traces(case):
    cost, count, names = runner(case)
    traces = 0

    def counted(xi, dt):
        nonlocal traces
        traces += 1
        return cost(xi, dt)

    traced = jax.jit(counted)  # once, for all that follows
    compiled = quick(traced)
    dt = jnp.asarray(DT)
    zero = jnp.zeros(count)
    value, gradient = quick(value_and_gradient(cost, mode="reverse"))(zero, dt)
    assert np.all(np.isfinite(gradient))
    size = max(float(jnp.max(jnp.abs(gradient))), float(jnp.abs(value)))
    # One direction that no entry can hide in; test_blocks_alone compares entry by entry.
    direction = jnp.asarray(np.random.default_rng(1).uniform(0.5, 1.5, count))
    _, forward = quick(lambda xi, dt, along: jax.jvp(lambda x: traced(x, dt), (xi,), (along,)))(zero, dt, direction)
    tolerance = tolerances.REVERSE_IS_FORWARD_IN_A_LOOP * size * count
    np.testing.assert_allclose(jnp.dot(gradient, direction), forward, rtol=0, atol=tolerance)

    step = tolerances.DIFFERENCE_STEP
    jumps = () if not case.jumps else tuple(f".{name}" for name in case.jumps)
    kept = [i for i in range(count) if not (jumps and names[i].endswith(jumps))]
    if not case.rough:
        differences = [
            float(compiled(zero.at[i].set(step), dt) - compiled(zero.at[i].set(-step), dt)) / (2.0 * step) for i in kept
        ]
        np.testing.assert_allclose(
            differences, np.asarray(gradient)[kept], rtol=0, atol=tolerances.FINITE_DIFFERENCE_IN_A_LOOP * size
        )

    # Another gain, reference, parameter or step is the same program; and a batch is a loop.
    xis = jnp.asarray(0.02 * np.random.default_rng(2).uniform(0, 1, (3, count)))
    rows = np.asarray([compiled(xi, dt) for xi in xis])
    compiled(xis[0], 0.5 * dt)
    assert traces == 1
    batch = quick(jax.vmap(traced, in_axes=(0, None)))(xis, dt)
    size = np.max(np.abs(rows))
    np.testing.assert_allclose(batch, rows, rtol=0, atol=tolerances.VMAP_IS_LOOP_IN_A_LOOP * size)


@compiled_whole
def test_jit_is_eager(case):
    loop, reference = case.loop(case.build())
    stepper = fp.make_stepper(dt=DT, samples=6, stepping=case.stepping)
    inputs = fp.make_inputs(loop, reference, stepper, jax.random.key(3))
    compiled = quick(lambda loop, inputs: fp.roll(loop, inputs, stepper, measures(), ("velocity", "torque")))
    first = jax.tree.leaves(compiled(loop, inputs))
    with jax.disable_jit():
        plain = jax.tree.leaves(fp.roll(loop, inputs, stepper, measures(), ("velocity", "torque")))
    for one, other in zip(first, plain, strict=True):
        size = float(jnp.max(jnp.abs(other)))
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerances.JIT_IS_EAGER_IN_A_LOOP * size + 1e-300)


@ids
def test_dtype_is_kept(case):
    loop, reference = fp.astype(case.loop(case.build()), jnp.float32)
    shapes = jax.eval_shape(
        lambda loop, reference: fp.simulate(
            loop,
            reference,
            dt=jnp.float32(DT),
            samples=SAMPLES,
            stepping=case.stepping,
            measures=measures(),
            record=("torque", "friction"),
            key=jax.random.key(3),
        ),
        loop,
        reference,
    )
    floating = [leaf.dtype for leaf in jax.tree.leaves(shapes) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    assert set(floating) == {jnp.dtype(jnp.float32)}


@pytest.mark.parametrize("case", [case for case in SENSORS if case.stepping == "sampled"], ids=str)
def test_a_sampled_sensor_refuses_continuous_stepping(case):
    loop, reference = case.loop(case.build())
    with pytest.raises(fp.InputError, match="sampled"):
        fp.simulate(loop, reference, dt=DT, samples=4)
