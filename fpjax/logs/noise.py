"""What a column is like from sample to sample: the step that it is rounded to, and its noise."""

import numpy as np

FEW_VALUES = 0.2  # distinct values per sample, below which a column is quantised


def quantisation(values: np.ndarray) -> float | None:
    """The step that all values are multiples of; None where there is none to be seen."""
    distinct = np.unique(values)
    if distinct.size < 3 or distinct.size > FEW_VALUES * values.size + 2:
        distinct = distinct[: 0 if distinct.size < 3 else None]
    if distinct.size < 3:
        return None
    gaps = np.diff(distinct)
    # Rounding to text or to a float makes gaps of no meaning beside the real ones.
    gaps = gaps[gaps > 1e-9 * max(abs(distinct[0]), abs(distinct[-1]))]
    if gaps.size < 3:
        return None
    step = float(np.quantile(gaps, 0.05))
    multiples = gaps / step
    regular = np.mean(np.abs(multiples - np.round(multiples)) < 0.02)
    # The gaps of any finely recorded signal look regular when there are hardly two values a step.
    return step if regular > 0.9 and float(np.ptp(values)) / step < 1e7 else None


def noise_level(values: np.ndarray) -> float:
    """Standard deviation of what changes from sample to sample, in the column's unit."""
    # A smooth signal has no third difference; white noise has one of variance 20 sigma^2.
    return float(np.median(np.abs(np.diff(values, 3)))) / 0.6745 / np.sqrt(20.0)
