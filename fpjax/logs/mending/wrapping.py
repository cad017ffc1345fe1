"""Positions that wrap: a drive that reports an angle within a range jumps by that range where the machine turns on."""

from dataclasses import dataclass

import numpy as np

FASTER = 8.0  # step (or speed, where samples are lost) of a jump, over the largest beside the jumps [1]
WHOLE = 0.95  # of the range of all positions: a jump is at least as large, since it leads from one end to the other
ALIKE = 0.02  # relative spread of the jumps beside what the machine moves meanwhile
STAYS = 3  # rows: what is over sooner is a wrong value, not a position beyond an end
ONWARD = 0.75  # share of the jumps that lead back against the motion; at an end a position may dither
MOST = 0.2  # share of the rows: a motion that wraps more often is too fast for its samples
FULL_TURN = 2.0 * np.pi
PROTOCOL = 25.0  # [rad] of motor drives that send +-12.5 rad (the MIT Mini Cheetah's protocol)


@dataclass(frozen=True)
class Wrapping:
    """Where a position jumps.

    Attributes:
        period: by which [rad], or m of a linear axis.
        after: rows before a jump, shape (jumps,).
        turns: jumps of one `period` each, up positive, shape (jumps,); -1 where the column falls from end to end.
    """

    period: float
    after: np.ndarray
    turns: np.ndarray

    def removed(self, values: np.ndarray) -> np.ndarray:
        """The column without its jumps, shape (rows,)."""
        steps = np.zeros(values.size)
        steps[self.after + 1] = self.turns
        return values - self.period * np.cumsum(steps)


def find_wrapping(values: np.ndarray, time: np.ndarray, *, linear: bool) -> Wrapping | None:
    """Where a position wraps; None where it does not, or moves too fast to tell.

    Every jump must lead over the whole range of positions, against the motion, be alike beside that motion, and be much
    faster than any motion in the log. Its period is a whole number of turns or the range of a known protocol where the
    jumps agree with one, else their mean.

    Args:
        values: position [rad] or [m], NaN where nothing was read, shape (rows,).
        time: increasing [s], shape (rows,).
        linear: whether the axis is linear: its range is no number of turns.
    """
    known = np.flatnonzero(np.isfinite(values))
    if known.size < 4 * STAYS:
        return None
    at, span = values[known], float(np.ptp(values[known]))
    step, taken = np.diff(at), np.diff(time[known])
    wide = np.abs(step) > 0.5 * span
    jumps = np.flatnonzero(wide)
    if not jumps.size or jumps.size > MOST * step.size:
        return None
    calm = np.flatnonzero(~wide)
    rate = step / taken
    least = np.min(np.abs(step[jumps])), np.min(np.abs(rate[jumps]))
    most = np.max(np.abs(step[calm])), np.max(np.abs(rate[calm]))
    if least[0] < FASTER * most[0] and least[1] < FASTER * most[1]:
        return None
    # What the machine moves during a jump: as much as beside it.
    moved = np.interp(jumps, calm, rate[calm]) * taken[jumps]
    size = np.abs(step[jumps] - moved)
    period = float(np.mean(size))
    if np.min(size) < WHOLE * span or np.count_nonzero(moved * step[jumps] < 0.0) < ONWARD * jumps.size:
        return None
    if np.max(np.abs(size - period)) > ALIKE * period + np.max(np.abs(moved)):
        return None
    turns = np.sign(step[jumps])
    # A single wrong value jumps too, there and back.
    back = (np.diff(jumps) < STAYS) & (turns[1:] == -turns[:-1])
    if jumps.size > 1 and 2 * np.count_nonzero(back) >= jumps.size:
        return None
    if not linear:
        period = _known_period(
            period, float(np.std(size)) / np.sqrt(size.size) + float(np.max(np.abs(moved))) / size.size
        )
    return Wrapping(period, known[jumps], turns)


def _known_period(period: float, error: float) -> float:
    """The period [rad] of a known kind that is near, else the one that was measured."""
    options = (FULL_TURN * max(round(period / FULL_TURN), 1), PROTOCOL)
    nearest = min(options, key=lambda option: abs(option - period))
    return nearest if abs(nearest - period) < max(3.0 * error, 1e-3 * period) else period
