"""Arrays in signatures of numpy code. The jax code has `jaxtyping.Array`; this module must not import jax."""

import numpy as np

Values = np.ndarray
"""Several numbers; the docstring says which, in which unit and of which shape."""
Numbers = np.ndarray | np.floating
"""An array, or what numpy gives in place of an array without axes."""
