"""Octaves of a column: the undecimated transform with a cubic B-spline.

After Starck and Murtagh, "Astronomical Image and Data Analysis" (2006). Every octave has the column's samples.
"""

import numpy as np

from ...logs.arrays import Values

SPLINE = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0


def details(values: Values, octaves: int) -> tuple[list[Values], Values]:
    """(what a column holds in each octave, the fastest first, each of its shape; the rest): together the column.

    Args:
        values: shape (samples,).
        octaves: their number.
    """
    found, rest = [], values
    for octave in range(octaves):
        hole = 1 << octave
        padded = np.pad(rest, 2 * hole, mode="reflect" if len(rest) > 2 * hole else "edge")
        smooth = np.sum([w * padded[i * hole : i * hole + len(rest)] for i, w in enumerate(SPLINE)], axis=0)
        found.append(rest - smooth)
        rest = smooth
    return found, rest


def passed(frequency: Values, octaves: int) -> tuple[list[Values], Values]:
    """(what each octave passes of a wave [1], the rest), of frequencies in cycles per sample, each of their shape."""
    found, rest = [], np.ones(len(frequency))
    for octave in range(octaves):
        angle = 2.0 * np.pi * frequency * 2.0**octave
        smooth = rest * (SPLINE[2] + 2.0 * (SPLINE[1] * np.cos(angle) + SPLINE[0] * np.cos(2.0 * angle)))
        found.append(rest - smooth)
        rest = smooth
    return found, rest


def gains(octaves: int, weights: tuple[float, ...] = (1.0,)) -> Values:
    """Standard deviation in each octave [1], shape (octaves,), of white noise of 1 that a filter has weighed.

    Args:
        octaves: their number.
        weights: of the filter; (1, -1) is a difference.
    """
    one = np.zeros((8 << octaves) + 1)
    one[len(one) // 2 : len(one) // 2 + len(weights)] = weights
    return np.array([np.sqrt(np.sum(part**2)) for part in details(one, octaves)[0]])
