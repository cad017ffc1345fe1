"""tanh, as the smooth friction law needs it.

In double precision it is more accurate than XLA's on the CPU. It is faster for a few simulations side by side, and
about as fast for a chunk of them.

Nearly half the time of a servo loop's step is its tanh. XLA's is one rational function of degree 19 over 18 on |x| < 18
(6.5 units in the last place at worst). Here tanh(x) = 2 t / (1 + t^2) with t = tanh(x / 2). For t a rational function
of lower degree is enough, because the derivative of the doubling by t vanishes at t = 1: an error of t near 1 enters
squared. Elsewhere its error is below a rounding; the roundings of its evaluation add up to 4.5 units in the last place
in double precision, and to 4.9 in single precision.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array

from .elementary import kept, polynomial

# t = x P(x^2) / (2 Q(x^2)), coefficients from the lowest power on, by the bytes of a float. A minimax fit of the
# relative error of tanh(x), the error of t weighted with what the doubling leaves of it (Lawson's iteration on
# Chebyshev nodes, computed with 60 digits): 4.8e-17 and 7.5e-9.
_NUMERATOR = {
    8: (
        1.0,
        0.03602329697583906,
        3.032777575614375e-4,
        8.528053417212005e-7,
        8.069804256861675e-10,
        1.8178666217744514e-13,
    ),
    4: (0.9999999925697171, 0.02976099383164706, 1.1398448215920778e-4),
}
_DENOMINATOR = {
    8: (
        1.0,
        0.1193566303091719,
        0.001916330283326462,
        9.162377962777387e-6,
        1.5182000966882603e-8,
        7.596820001573425e-12,
        5.216420736586561e-16,
    ),
    4: (1.0, 0.1130942764469043, 0.0012052183485393893, 1.2235184490427448e-6),
}
# From this |x| on tanh rounds to 1: 1 - tanh(x) = 2 exp(-2 x) is below half the spacing of the floats under 1 (2^-54
# and 2^-25), so x > 55 / 2 log 2 and 26 / 2 log 2.
_ONE_FROM = {8: 19.0616, 4: 9.011}


def tanh(x: ArrayLike) -> Array:
    """Hyperbolic tangent, float32 or float64 (any other dtype by `jnp.tanh`), in every mode of differentiation.

    Args:
        x: an array.
    """
    x = jnp.asarray(x)
    return _tanh(x) if x.dtype in (np.float32, np.float64) else jnp.tanh(x)


@jax.custom_jvp
@functools.partial(jax.jit, inline=True)  # called outside any jit it is one program, not one for each operation
def _tanh(x: Array) -> Array:
    width = x.dtype.itemsize
    square = x * x
    numerator = 0.5 * x * polynomial(_NUMERATOR[width], square)
    denominator = polynomial(_DENOMINATOR[width], square)
    # 2 t / (1 + t^2) with t = numerator / denominator, as one quotient: a division takes as long as several
    # multiplications.
    product = numerator * denominator
    value = (product + product) / (denominator * denominator + numerator * numerator)
    # Beyond the bound the quotient may be anything, NaN included, and is replaced. A NaN in x is not beyond the bound
    # (the comparison is false), so it stays NaN.
    return jnp.where(jnp.abs(x) >= _ONE_FROM[width], lax.sign(x), value)


@_tanh.defjvp
def _slope(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    # d tanh = 1 - tanh^2, written as (1 + tanh)(1 - tanh): near 1 the difference of squares would cancel to a few
    # digits.
    value = kept(_tanh(*primals))
    (along,) = tangents
    return value, (along + along * value) * (1.0 - value)
