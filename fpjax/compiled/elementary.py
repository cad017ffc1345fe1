"""Sine, cosine and logarithm, as the loops of many simulations need them: arithmetic that fills a vector.

XLA on the CPU calls the C library for each of these numbers in double precision, and for a sine in single precision:
7 to 17 ns a sine, 1 ns a tanh. These calls took most of the time of a step that needs a sine of the position (cogging,
unbalance, friction that depends on the position) or a power (Stribeck, Dahl). Here they are written out: the argument
is reduced to a short interval, and a polynomial is evaluated there. That takes 1 ns each in a chunk, and no more for
sine and cosine together. With only a few numbers the polynomial's operations wait for one another, and XLA's own
function is used where it is faster. How many numbers there are is known only when a function is lowered, so each
function is a jax primitive. On other devices than the CPU it is always XLA's function.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jax.typing import ArrayLike
from jaxtyping import Array

# Minimax polynomials of the relative error (Remez's exchange algorithm, computed with 50 digits); coefficients from the
# lowest power on, by the bytes of a float (8: double, 4: single precision).
# sin r = r + r^3 S(r^2) to 7e-18 and 7e-9, cos r = 1 - r^2 / 2 + r^4 C(r^2) to 2e-19 and 3e-10, |r| < pi / 4.
_SINE = {
    8: (
        -0.1666666666666664,
        0.008333333333323548,
        -0.00019841269830039545,
        2.755731361253439e-06,
        -2.5050728121243184e-08,
        1.5894325907018896e-10,
    ),
    4: (-0.16666654582526944, 0.008332094685838645, -0.00019503108860348948),
}
_COSINE = {
    8: (
        0.04166666666666665,
        -0.0013888888888882768,
        2.4801587294562403e-05,
        -2.7557315714012116e-07,
        2.0875893703108314e-09,
        -1.1367741193530822e-11,
    ),
    4: (0.04166665455984066, -0.0013887648100847669, 2.4462980904815093e-05),
}
# log((1 + s) / (1 - s)) = 2 s + s^3 L(s^2) to 2e-18, |s| < (sqrt 2 - 1) / (sqrt 2 + 1).
_LOGARITHM = (
    0.666666666666671,
    0.39999999999519825,
    0.28571428729283865,
    0.2222219909099006,
    0.18183571536081145,
    0.15313164506147384,
    0.14810518676078507,
)
# pi / 2 and log 2 as sums of parts (Cody and Waite's reduction). All parts but the last have so few digits that their
# products with a small integer are exact, so the subtraction in the reduction loses nothing.
_QUARTER = {
    8: (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21),
    4: (1.5703125, 0.0004837512969970703, 7.549533620476723e-08, 2.563344151594519e-12),
}
_LOG_2 = (0.6931471803691238, 1.9082149292705877e-10)
_ROOT = 0x3FE6A09E667F3BCD  # the bits of sqrt(1/2)

_WRITTEN_OUT: dict[str, Callable[[Array], list[Array]]] = {}

NAME = (
    "fpjax_elementary"  # the checkpoint name of values that a reverse pass keeps instead of recomputing (see `native`)
)


def sincos(x: ArrayLike) -> tuple[Array, Array]:
    """(sin x, cos x), float32 or float64 (any other dtype by `jnp`), in every mode of differentiation.

    The error is below 2.5 units in the last place where |x| < 1e6 rad (1e4 in float32), next to a zero below 3.5. For
    larger |x| the spacing of the floats x itself is what limits it.

    Args:
        x: an array [rad].
    """
    x = jnp.asarray(x)
    if not _written_out(x):
        return jnp.sin(x), jnp.cos(x)
    s, c = _sincos(x)
    return s, c


def sin(x: ArrayLike) -> Array:
    """Sine; see `sincos`."""
    return sincos(x)[0]


def cos(x: ArrayLike) -> Array:
    """Cosine; see `sincos`."""
    return sincos(x)[1]


def log(x: ArrayLike) -> Array:
    """Natural logarithm, float64 (any other dtype by `jnp.log`), in every mode of differentiation.

    The error is below one unit in the last place. -inf at 0 and where x is subnormal, NaN where x is negative.

    Args:
        x: an array.
    """
    x = jnp.asarray(x)
    return _log(x)[0] if x.dtype == np.float64 and _written_out(x) else jnp.log(x)


def polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    """sum_i coefficients[i] x^i by Horner's rule, two coefficients at least; x and the result of any shape."""
    value = x * coefficients[-1] + coefficients[-2]
    for coefficient in coefficients[-3::-1]:
        value = value * x + coefficient
    return value


def kept(value: Array) -> Array:
    """`value`, computed once: it is not recomputed for every tangent, nor in a reverse pass."""
    # The barrier keeps XLA from duplicating the arithmetic into every consumer; the name is what the reverse pass's
    # checkpoint policy looks for.
    return checkpoint_name(lax.optimization_barrier(value), NAME)


def written_out(primitive: Primitive) -> Callable[[Array], list[Array]] | None:
    """The arithmetic behind one of our primitives, a list of its results; None for any other primitive."""
    return _WRITTEN_OUT.get(primitive.name)


def _written_out(x: Array) -> bool:
    # Without x64 jax turns the constants of a float64 program into float32.
    wide = x.dtype == np.float64 and jax.config.jax_enable_x64  # pyright: ignore[reportAttributeAccessIssue]
    return wide or x.dtype == np.float32


def _primitive(
    name: str,
    plain: Callable[[Array], list[Array]],
    written_out: Callable[[Array], list[Array]],
    slopes: Callable[[Array, list[Array], Array], list[Array]],
    results: int,
    least: dict[int, int],
) -> Callable[[Array], list[Array]]:
    """An elementwise function of one array, a list of results, that is written out on a CPU for enough numbers.

    Args:
        name: of the primitive.
        plain: XLA's own.
        written_out: ours.
        slopes: (x, the results, a tangent of x) -> tangents of the results.
        results: how many there are.
        least: by the bytes of a float, how many numbers are enough.
    """

    def by_size(x: Any) -> Callable[[Array], list[Array]]:
        return written_out if x.size >= least[x.dtype.itemsize] else plain

    def lowered_for_cpu(ctx: mlir.LoweringRuleContext, value: Any) -> Any:
        return mlir.lower_fun(by_size(ctx.avals_in[0]), multiple_results=True)(ctx, value)

    def derived(primals: Sequence[Array], tangents: Sequence[Array]) -> tuple[list[Array], list[Array]]:
        (x,), along = primals, ad.instantiate_zeros(tangents[0])
        values = [kept(value) for value in made.bind(x)]
        return values, slopes(x, values, along)

    def batched(values: Sequence[Array], dims: Sequence[int]) -> tuple[list[Array], list[int]]:
        return made.bind(*values), [dims[0]] * results

    made = Primitive(name)
    made.multiple_results = True
    # Not by way of the primitive: under `disable_jit` that would call itself.
    made.def_impl(jax.jit(lambda x: by_size(x)(x) if jax.default_backend() == "cpu" else plain(x)))
    made.def_abstract_eval(lambda aval: [aval] * results)
    batching.primitive_batchers[made] = batched
    ad.primitive_jvps[made] = derived
    mlir.register_lowering(made, mlir.lower_fun(plain, multiple_results=True))
    mlir.register_lowering(made, lowered_for_cpu, platform="cpu")
    _WRITTEN_OUT[name] = written_out
    return made.bind


# The functions below use `lax.select` and not `jnp.where`: the latter is jitted, so it would be lowered as a call of
# its own and stay one.


def _sine_and_cosine(x: Array) -> list[Array]:
    width = x.dtype.itemsize
    quarters = jnp.floor(
        x * (2.0 / np.pi) + 0.5
    )  # the nearest number of quarter turns; r is what is left, |r| < pi / 4
    r = x
    for part in _QUARTER[width]:
        r = r - quarters * part
    # Only for a huge x, whose spacing is a good part of a turn: it keeps the polynomials, and so the results, bounded.
    r = jnp.minimum(jnp.maximum(r, -np.pi / 2), np.pi / 2)
    square = r * r
    sine = r + r * square * polynomial(_SINE[width], square)
    cosine = 1.0 - (0.5 * square - square * square * polynomial(_COSINE[width], square))
    turn = quarters - 4.0 * jnp.floor(0.25 * quarters)  # the quadrant, 0 to 3
    # In the odd quadrants sine and cosine change places; the signs follow the quadrant.
    odd = (turn == 1.0) | (turn == 3.0)
    up, right = lax.select(odd, cosine, sine), lax.select(odd, sine, cosine)
    return [lax.select(turn >= 2.0, -up, up), lax.select((turn == 1.0) | (turn == 2.0), -right, right)]


def _logarithm(x: Array) -> list[Array]:
    # x = m 2^e with m between sqrt(1/2) and sqrt(2), f = m - 1. e comes from the exponent bits (52 bits up), counted
    # from those of sqrt(1/2), so that m is centred on 1. The final sum is arranged as in fdlibm's e_log.c: the large
    # terms f and f^2 / 2 are added last, and e log 2 in two parts, so that little is rounded away.
    pattern = lax.bitcast_convert_type(x, np.int64)
    exponent = (pattern - _ROOT) >> 52
    f = lax.bitcast_convert_type(pattern - (exponent << 52), np.float64) - 1.0
    e = exponent.astype(np.float64)
    s = f / (2.0 + f)
    square = s * s
    fourth = square * square
    # Even and odd powers in two chains of operations that the processor can run side by side.
    series = square * polynomial(_LOGARITHM[::2], fourth) + fourth * polynomial(_LOGARITHM[1::2], fourth)
    half = 0.5 * f * f
    value = e * _LOG_2[0] - ((half - (s * (half + series) + e * _LOG_2[1])) - f)
    outside = lax.select(x < 0.0, jnp.full_like(x, np.nan), jnp.full_like(x, -np.inf))
    value = lax.select(x < float(np.finfo(np.float64).tiny), outside, value)
    return [lax.select(x < np.inf, value, x)]  # infinity and NaN stay as they are


# The last argument: from how many numbers on our arithmetic was faster than XLA's (`python -m benchmarks speed --only
# functions`), by the bytes of a float.
_sincos = _primitive(
    "fpjax_sincos",
    lambda x: [jnp.sin(x), jnp.cos(x)],
    _sine_and_cosine,
    lambda x, values, along: [along * values[1], -along * values[0]],
    2,
    {8: 1, 4: 8},
)
_log = _primitive("fpjax_log", lambda x: [jnp.log(x)], _logarithm, lambda x, values, along: [along / x], 1, {8: 8})
