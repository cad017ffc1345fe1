"""Arrays of numpy: their names in signatures, their root mean square. No jax here: `fpjax inspect` starts without."""

import numpy as np

Values = np.ndarray
"""Several numbers; the docstring says which, in which unit and of which shape."""
Numbers = np.ndarray | np.floating
"""An array, or what numpy gives in place of an array without axes."""


def rms(values: Values) -> float:
    """Root mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0


def runs_of(true: Values) -> Values:
    """(first, behind the last) of each run of true values, shape (runs, 2), of a mask of shape (samples,)."""
    return np.flatnonzero(np.diff(true.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
