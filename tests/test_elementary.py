"""Sine, cosine and logarithm against numpy in extended precision, their derivatives, and that friction uses them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fpjax.elementary import cos, log, sin, sincos
from fpjax.friction.base import safe_power
from fpjax.friction.general import fourier

RNG = np.random.default_rng(5)
FLOATS = [np.float64, np.float32]


def _units(found, exact, dtype):
    return np.max(np.abs(np.asarray(found).astype(np.longdouble) - exact) / np.spacing(np.abs(exact).astype(dtype)))


@pytest.mark.parametrize(
    ("dtype", "reach"), [*((np.float64, r) for r in (1.0, 1e2, 1e4, 1e6)), *((np.float32, r) for r in (1.0, 1e2, 1e4))]
)
def test_sine_and_cosine_within_two_and_a_half_units(dtype, reach):
    quarters = np.arange(-4000, 4000) * (np.pi / 2.0) * (reach / 6300.0)
    x = np.concatenate([RNG.uniform(-reach, reach, 100_000), quarters]).astype(dtype)
    s, c = jax.jit(sincos)(x)
    exact = x.astype(np.longdouble)
    assert _units(s, np.sin(exact), dtype) < 2.5
    assert _units(c, np.cos(exact), dtype) < 2.5


@pytest.mark.parametrize("dtype", FLOATS)
def test_far_away_sine_and_cosine_err_by_what_the_angle_is_rounded(dtype):
    for reach in (1e8, 1e12, 1e30):
        x = RNG.uniform(-reach, reach, 10_000).astype(dtype)
        s, c = (np.asarray(part, np.longdouble) for part in jax.jit(sincos)(x))
        assert np.max(np.abs([s, c])) < 1.01
        allowed = np.spacing(np.abs(x)) + 3.0 * np.finfo(dtype).eps
        exact = x.astype(np.longdouble)
        assert np.all(np.abs(s - np.sin(exact)) <= allowed)
        assert np.all(np.abs(c - np.cos(exact)) <= allowed)
    for x in (np.inf, -np.inf, np.nan):
        assert np.all(np.isnan(np.asarray(sincos(np.asarray(x, dtype)))))


@pytest.mark.parametrize("dtype", [np.float64])
def test_logarithm_within_a_unit(dtype):
    limits = np.finfo(dtype)
    wide = np.exp(RNG.uniform(np.log(float(limits.tiny)), np.log(float(limits.max)), 100_000))
    x = np.concatenate([wide, RNG.uniform(0.5, 2.0, 100_000), 1.0 + RNG.uniform(-1e-3, 1e-3, 100_000)]).astype(dtype)
    x = x[x >= limits.tiny]
    assert _units(jax.jit(log)(x), np.log(x.astype(np.longdouble)), dtype) < 1.0
    special = np.array([0.0, -0.0, 1.0, np.inf, -1.0, -np.inf, np.nan], dtype)
    expected = np.array([-np.inf, -np.inf, 0.0, np.inf, np.nan, np.nan, np.nan], dtype)
    np.testing.assert_array_equal(log(special), expected)


@pytest.mark.parametrize(("mine", "theirs"), [(sin, jnp.sin), (cos, jnp.cos), (log, jnp.log)])
def test_derivatives_are_those_of_jax(mine, theirs):
    x = jnp.linspace(0.01, 40.0, 501)
    for derive in (jax.grad, lambda f: jax.grad(jax.grad(f)), jax.jacfwd, lambda f: jax.jacfwd(jax.grad(f))):
        np.testing.assert_allclose(jax.vmap(derive(mine))(x), jax.vmap(derive(theirs))(x), rtol=1e-12, atol=1e-12)


def test_other_dtypes_are_left_to_jax():
    x = jnp.linspace(0.5, 3.0, 7).astype(jnp.bfloat16)
    for mine, theirs in ((sin, jnp.sin), (cos, jnp.cos), (log, jnp.log)):
        np.testing.assert_array_equal(mine(x), theirs(x))


@pytest.mark.parametrize(
    "step",
    [
        lambda x: fourier((x, x), (x, x), 7.0 * x),
        lambda x: safe_power(x, 1.3),
    ],
    ids=["position", "power"],
)
def test_what_a_step_of_friction_computes_calls_no_library_function(step):
    """A sine, cosine or logarithm of XLA's is a call for each number; what is written out fills a vector."""
    program = str(jax.make_jaxpr(step)(jnp.linspace(0.1, 1.0, 8)))
    assert not [word for word in ("= sin ", "= cos ", "= log ", "= pow ") if word in program]
