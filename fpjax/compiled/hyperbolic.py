"""tanh, as the smooth direction of friction needs it.

In double precision it is more accurate than XLA's on the CPU, and faster for a few simulations side by side; for a
chunk of them about as fast.

In a servo loop nearly all time of a step is its tanh. XLA's is one rational function of degree 19 over 18 on |x| < 18
(6.5 units in the last place at worst). Here tanh(x) = 2 t / (1 + t^2) with t = tanh(x / 2): a smaller rational function
does for t, because the doubling squares away what it misses near 1. What it misses elsewhere is below a rounding; those
of its evaluation add up to 4.5 units in double, 4.9 in single precision.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array

from .elementary import kept, polynomial

# t = x P(x^2) / (2 Q(x^2)), lowest power first; least largest relative error of tanh(x), weighted by how much of it the
# doubling leaves (Lawson's iteration on Chebyshev nodes, 60 digits): 4.8e-17 and 7.5e-9.
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
# From here on tanh is 1 to the last digit.
_ONE_FROM = {8: 19.0616, 4: 9.011}


def tanh(x: ArrayLike) -> Array:
    """Hyperbolic tangent, float32 or float64 (any other dtype by `jnp.tanh`), in every mode of differentiation.

    Args:
        x: an array.
    """
    x = jnp.asarray(x)
    return _tanh(x) if x.dtype in (np.float32, np.float64) else jnp.tanh(x)


@jax.custom_jvp
@functools.partial(jax.jit, inline=True)  # outside of any jit one program, not one an operation
def _tanh(x: Array) -> Array:
    width = x.dtype.itemsize
    square = x * x
    numerator = 0.5 * x * polynomial(_NUMERATOR[width], square)
    denominator = polynomial(_DENOMINATOR[width], square)
    product = numerator * denominator
    value = (product + product) / (denominator * denominator + numerator * numerator)
    # Past the bound the quotient may be anything, not a number included; not a number itself is not past it.
    return jnp.where(jnp.abs(x) >= _ONE_FROM[width], lax.sign(x), value)


@_tanh.defjvp
def _slope(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    value = kept(_tanh(*primals))
    (along,) = tangents
    return value, (along + along * value) * (1.0 - value)
