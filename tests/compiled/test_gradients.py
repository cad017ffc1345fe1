"""Forward mode = reverse mode = finite differences, and the inputs that are refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fpjax import InputError
from fpjax.compiled.gradients import FORWARD_UP_TO, value_and_gradient
from fpjax.compiled.native import native, scan_loop


def cost(parameters, scale=1.0):
    """A loop of 50 steps with a pytree of parameters, one of them a vector."""
    zero = jnp.zeros_like(parameters["a"])

    def step(carry, x):
        return jnp.tanh(parameters["a"] * carry + jnp.dot(parameters["b"], jnp.array([1.0, 0.5])) * x), None

    return scale * scan_loop(step, zero, jnp.linspace(-1.0, 1.0, 50))[0] ** 2


PARAMETERS = {"a": jnp.array(0.7), "b": jnp.array([0.3, -0.9])}


@pytest.mark.parametrize("mode", ["auto", "forward", "reverse"])
def test_against_finite_differences(mode):
    value, gradient = native(value_and_gradient(cost, mode=mode))(PARAMETERS)
    np.testing.assert_allclose(value, cost(PARAMETERS), rtol=1e-14)
    h = 1e-5  # central: error h^2 times a third derivative of order one, plus rounding 1e-16 / h
    for name, leaf in PARAMETERS.items():
        flat = []
        for i in range(leaf.size):
            bump = (h * jnp.eye(leaf.size)[i]).reshape(leaf.shape)
            up, down = (cost(PARAMETERS | {name: leaf + s * bump}) for s in (1.0, -1.0))
            flat.append((up - down) / (2.0 * h))
        np.testing.assert_allclose(gradient[name], jnp.stack(flat).reshape(leaf.shape), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_further_arguments_and_batches(mode):
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, 1.1 * leaf, 0.9 * leaf]), PARAMETERS)
    vector = lambda p, scale: jax.vmap(cost, in_axes=(0, None))(p, scale)  # noqa: E731
    value, gradient = value_and_gradient(vector, mode=mode, batched=True)(batch, 3.0)
    expected, slopes = jax.vmap(jax.value_and_grad(lambda p: cost(p, 3.0)))(batch)
    np.testing.assert_allclose(value, expected, rtol=1e-13)
    for name in slopes:
        np.testing.assert_allclose(gradient[name], slopes[name], rtol=1e-11)


@pytest.mark.parametrize("count", [FORWARD_UP_TO, FORWARD_UP_TO + 1])
def test_auto_goes_by_the_number_of_parameters(count):
    parameters = jnp.linspace(0.1, 0.5, count)
    run = lambda p: cost({"a": p[0], "b": jnp.array([0.3, -0.9])}) + jnp.sum(p)  # noqa: E731
    forward, reverse, auto = (
        str(jax.make_jaxpr(value_and_gradient(run, mode=mode))(parameters)) for mode in ("forward", "reverse", "auto")
    )
    assert forward != reverse
    assert auto == (forward if count <= FORWARD_UP_TO else reverse)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="mode='sideways'"):
        value_and_gradient(cost, mode="sideways")
    with pytest.raises(InputError, match="float parameters"):
        value_and_gradient(lambda p: 1.0 * p)(jnp.array(3))
    with pytest.raises(InputError, match="shape"):
        value_and_gradient(lambda p: p)(jnp.zeros(3))
    with pytest.raises(InputError, match="leading axis"):
        value_and_gradient(lambda p: p["a"], batched=True)({"a": jnp.zeros(3), "b": jnp.zeros(2)})
