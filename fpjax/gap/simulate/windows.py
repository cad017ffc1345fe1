"""Windows: where the lanes of a replay lie in their log, and the rows in which they reach a kernel."""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int, PyTree


class Windows(eqx.Module):
    """Where the lanes' windows lie, and estimates of the machine's state there; every field of shape (lanes,).

    Attributes:
        start: index of the first sample in `Tables`.
        time: of that sample, from the log's start [s].
        velocity: smoothed reading there [rad/s].
        slope: its rate of change [rad/s^2].
        position: there [rad]; measured or integrated.
        hidden: estimates of two hidden states: of bristles, their deflection over that at sliding [1], and 0; of a
            transmission, the twist [rad] and the relative speed [rad/s].
        integrated: 1 where the position is the integral of the velocity reading, 0 where it is measured.

    Lanes reach a kernel as one array of rows, since each argument of a call costs as much as a hundred lane-steps.
    """

    start: Int[Array, " lanes"]
    time: Float[Array, " lanes"]
    velocity: Float[Array, " lanes"]
    slope: Float[Array, " lanes"]
    position: Float[Array, " lanes"]
    hidden: tuple[Float[Array, " lanes"], Float[Array, " lanes"]]
    integrated: Float[Array, " lanes"]

    # The fields of one row each, in the order of `as_rows`.
    ROWS: ClassVar[tuple[str, ...]] = ("time", "velocity", "slope", "position", "integrated")


def as_rows(
    vector: Float[np.ndarray, "parameters lanes"], states: Float[np.ndarray, "states lanes"], fields: dict[str, PyTree]
) -> Float[np.ndarray, "rows lanes"]:
    """The lanes as one array, without their `start` (an integer), shape (rows, lanes).

    Args:
        vector: parameters, (parameters, lanes).
        states: start values, (states, lanes).
        fields: of `Windows`, each of shape (lanes,), but `hidden` of (2, lanes).
    """
    return np.concatenate([vector, states, fields["hidden"], *(fields[name][None] for name in Windows.ROWS)])


def from_rows(
    rows: Float[Array, "rows lanes"], start: Int[Array, " lanes"], parameters: int
) -> tuple[Float[Array, "{parameters} lanes"], Float[Array, "states lanes"], Windows]:
    """(vector, states, windows) of `as_rows`.

    Args:
        rows: (rows, lanes).
        start: index of the windows' first samples in `Tables`, (lanes,).
        parameters: how many rows are the vector's.
    """
    last = rows.shape[0] - len(Windows.ROWS)
    windows = Windows(
        start=start, hidden=(rows[last - 2], rows[last - 1]), **dict(zip(Windows.ROWS, rows[last:], strict=True))
    )
    return rows[:parameters], rows[parameters : last - 2], windows
