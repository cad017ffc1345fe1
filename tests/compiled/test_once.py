"""Values that are computed once: the barrier that keeps XLA from computing them anew for every use."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from fpjax.compiled.native import once
from fpjax.compiled.one_kernel import _operations


def _multiplications(hold):
    """How many multiplications XLA compiles of a chain whose results are all used twice."""

    def chain(x):
        for _ in range(8):
            x = hold(x * jnp.roll(x, 1) + 0.5)
        return x

    return jax.jit(chain).lower(jnp.ones(64)).compile().as_text().count(" multiply(")


@pytest.mark.skipif(
    jax.__version_info__ < (0, 12), reason="XLA drops the barrier before it fuses (seen on jax 0.7 and 0.10)"
)
def test_once_computes_a_value_once():
    assert _multiplications(once) <= 8 < _multiplications(lambda x: x)


def test_once_changes_no_number():
    def chain(x, hold):
        pair = hold({"a": x * x, "b": jnp.sin(x)})
        return pair["a"] * pair["b"] + pair["a"]

    x = jnp.linspace(0.1, 1.0, 7)
    assert once(()) == ()
    for of in (lambda f: f, lambda f: jax.vmap(jax.grad(f)), lambda f: jax.jit(jax.vmap(jax.jacfwd(f)))):
        np.testing.assert_allclose(of(lambda x: chain(x, once))(x), of(lambda x: chain(x, lambda y: y))(x), rtol=1e-14)


def test_a_barrier_on_a_part_of_the_carry_parts_no_steps():
    def most(step, unroll):
        def run(x):
            return lax.scan(step, (x, x), None, length=20, unroll=unroll)[0]

        return max(_operations(jax.make_jaxpr(run)(jnp.ones(50)).jaxpr))

    def whole(carry, _):
        return once((jnp.tanh(carry[0]), carry[0] * carry[1])), None

    def part(carry, _):
        return (once(jnp.tanh(carry[0])), carry[0] * carry[1]), None

    assert most(whole, 4) == most(whole, 1)
    assert most(part, 4) == 4 * most(part, 1)
