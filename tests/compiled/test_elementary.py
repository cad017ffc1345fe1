"""Sine, cosine and logarithm against numpy in extended precision, their derivatives, and that friction uses them."""

import jax
import jax.ad_checkpoint
import jax.experimental
import jax.numpy as jnp
import numpy as np
import pytest

from fpjax import Actuator, Motion, OneMass, Sine, Stribeck, Unbalance
from fpjax.blocks.actuators import ActuatorState
from fpjax.blocks.friction.base import log_cosh, safe_power
from fpjax.blocks.friction.bristles import Bristles
from fpjax.blocks.friction.general import GeneralFriction
from fpjax.blocks.plants import OneMassState
from fpjax.blocks.plants.sticking import advance_exact
from fpjax.blocks.position_torque import PositionTorque
from fpjax.compiled.elementary import NAME, cos, log, sin, sincos

enable_x64 = jax.enable_x64 if hasattr(jax, "enable_x64") else jax.experimental.enable_x64
RNG = np.random.default_rng(5)
FLOATS = [np.float64, np.float32]


def _units(found, exact, dtype):
    return np.max(np.abs(np.asarray(found).astype(np.longdouble) - exact) / np.spacing(np.abs(exact).astype(dtype)))


@pytest.mark.parametrize(
    ("dtype", "reach"), [*((np.float64, r) for r in (1.0, 1e2, 1e4, 1e6)), *((np.float32, r) for r in (1.0, 1e2, 1e4))]
)
def test_sine_and_cosine_within_two_and_a_half_units(dtype, reach):
    x = RNG.uniform(-reach, reach, 100_000).astype(dtype)
    s, c = jax.jit(sincos)(x)
    exact = x.astype(np.longdouble)
    assert _units(s, np.sin(exact), dtype) < 2.5
    assert _units(c, np.cos(exact), dtype) < 2.5


@pytest.mark.parametrize(("dtype", "reach"), [(np.float64, 1e6), (np.float32, 1e4)])
def test_next_to_a_zero_within_three_and_a_half_units(dtype, reach):
    """The numbers nearest to multiples of pi / 2, where nearly all of the angle cancels, and their neighbours."""
    # pi in extended precision: the second term is what double precision rounds off.
    pi = np.longdouble(np.pi) + np.longdouble(1.2246467991473532e-16)
    quarters = (np.arange(1, int(reach / (np.pi / 2.0))) * pi / 2.0).astype(dtype)
    x = np.concatenate([quarters, np.nextafter(quarters, dtype(0)), np.nextafter(quarters, dtype(np.inf))])
    s, c = (np.asarray(part) for part in jax.jit(sincos)(x))
    exact = x.astype(np.longdouble)
    for found, true in ((s, np.sin(exact)), (c, np.cos(exact))):
        clear = np.abs(true) > 1e-10 if dtype == np.float64 else np.abs(true) > 0.0
        assert _units(found[clear], true[clear], dtype) < 3.5
        assert np.all(np.abs(found[~clear] - true[~clear]) < 1e-12)  # longdouble knows pi no better here


@pytest.mark.parametrize("dtype", FLOATS)
def test_far_away_sine_and_cosine_err_by_what_the_angle_is_rounded(dtype):
    for reach in (1e8, 1e12, 1e30):
        x = RNG.uniform(-reach, reach, 10_000).astype(dtype)
        s, c = (np.asarray(part, np.longdouble) for part in jax.jit(sincos)(x))
        assert np.max(np.abs([s, c])) < 1.01
        # Beyond the range of exact reduction the angle is rounded to its own spacing.
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


MOTION = Motion(jnp.linspace(0.1, 1.0, 8), jnp.linspace(-3.0, 40.0, 8), jnp.linspace(0.0, 1.0, 8))
LAW = GeneralFriction(
    1.0, 0.1, stribeck_torque=0.3, stribeck_exponent=1.3, position_cosine=(0.1,), position_sine=(0.1,)
)
BRISTLES = Bristles(LAW, 1e-3, damping=0.1, exponent=1.5)


@pytest.mark.parametrize(
    "step",
    [
        lambda x: Stribeck(1.0, 1.5, 0.1, exponent=1.3).readout((), MOTION, x),
        lambda x: LAW.level(MOTION) + x,
        lambda x: BRISTLES.advance(x / 4.0, x) + BRISTLES.derivative(x / 4.0, MOTION),
        lambda x: advance_exact(OneMass(0.1, BRISTLES), OneMassState(x, x, x / 4.0), x, x, jnp.asarray(1e-3)),
        lambda x: Unbalance(1.0).readout(Motion(x, x, x)),
        lambda x: PositionTorque((x, x), (x, x), 6.0).readout(MOTION),
        lambda x: Actuator(cogging_amplitude=0.1, cogging_periods=6.0).readout(ActuatorState(None, ()), x, MOTION),
        lambda x: Sine(amplitude=1.0, frequency=2.0).readout(x),
        lambda x: log_cosh(x),
        lambda x: safe_power(x, 1.3),
    ],
)
def test_what_a_step_computes_calls_no_library_function(step):
    """A sine, cosine or logarithm of XLA's is a call for each number; what is written out fills a vector."""
    program = str(jax.make_jaxpr(step)(jnp.linspace(0.1, 1.0, 8)))
    assert not [word for word in ("= sin ", "= cos ", "= log ", "= log1p ", "= pow ") if word in program]
    assert "fpjax_" in program


@pytest.mark.parametrize("function", [sin, cos, log])
def test_a_few_numbers_and_many_are_the_same_function(function):
    """By size it is XLA's or ours: to a few units the same."""
    x = jnp.linspace(0.3, 30.0, 64)
    few = jnp.stack([function(each) for each in x])
    np.testing.assert_allclose(function(x), few, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(jax.vmap(function)(x), few, rtol=1e-14, atol=1e-15)


def test_types_are_those_of_jax():
    with enable_x64(False):
        for x in (2.0, 2, True, np.float64(2.0), jnp.asarray(2.0), np.float32(2.0), jnp.ones(9)):
            for mine, theirs in ((sin, jnp.sin), (log, jnp.log)):
                assert mine(x).dtype == theirs(x).dtype
                assert mine(x).weak_type == theirs(x).weak_type
    with enable_x64(True):
        wide = jnp.linspace(1.0, 2.0, 9)
        assert log(2.0).weak_type
    with enable_x64(False):  # what was made in double precision stays it
        assert sin(wide).dtype == jnp.sin(wide).dtype == np.float64
        np.testing.assert_allclose(log(wide), np.log(wide), rtol=1e-15)


def test_reverse_mode_keeps_the_values(capsys):
    policy = jax.checkpoint_policies.save_only_these_names(NAME)
    for function, kept in ((lambda x: log(x) ** 2, 1), (lambda x: sin(x) ** 2, 2)):
        jax.ad_checkpoint.print_saved_residuals(jax.checkpoint(function, policy=policy), jnp.ones(9))
        assert capsys.readouterr().out.count("elementary.py") == kept  # each from a line of that module
