"""Positions that wrap: a drive that reports an angle within a range jumps by that range where the machine turns on."""

from dataclasses import dataclass

import numpy as np

FASTER = 8.0  # step (or speed, where samples are lost) of a jump, over the largest beside the jumps [1]
WHOLE = 0.95  # of the range of all positions: a jump is at least as large, since it leads from one end to the other
ALIKE = 0.02  # relative spread of the jumps beside what the machine moves meanwhile
FOLLOWS = 0.125  # of the period: rms distance of a reference from the position that it is of
STAYS = 3  # rows: what is over sooner is a wrong value, not a position beyond an end
ONWARD = 0.75  # share of the jumps that lead back against the motion; at an end a position may dither
SEEN = 3  # jumps of a period that is neither a whole number of turns nor of a known protocol
MOST = 0.2  # share of the rows: a motion that wraps more often is too fast for its samples
FULL_TURN = 2.0 * np.pi
PROTOCOL = 25.0  # [rad] of motor drives that send +-12.5 rad (the MIT Mini Cheetah's protocol)


@dataclass(frozen=True)
class Wrapping:
    """Where a position jumps.

    Attributes:
        period: by which [rad].
        after: rows before a jump, shape (jumps,).
        turns: jumps of one `period` each, up positive, shape (jumps,); -1 where the column falls from end to end.
    """

    period: float
    after: np.ndarray
    turns: np.ndarray

    def beside(self, position: np.ndarray, reference: np.ndarray) -> np.ndarray | None:
        """A reference within half a period of a continuous position, shape (rows,); None for another quantity.

        It may have wrapped, or not, and may step. A reference of the speed has no relation to the angle, so that its
        distance would be spread over the period.
        """
        apart = reference - position
        apart = apart - self.period * np.round(apart / self.period)
        near = np.sqrt(np.nanmean(apart**2)) < FOLLOWS * self.period
        return position + apart if near else None

    def removed(self, values: np.ndarray) -> np.ndarray:
        """The column without its jumps, shape (rows,)."""
        steps = np.zeros(values.size)
        steps[self.after + 1] = self.turns
        return values - self.period * np.cumsum(steps)


def find_wrapping(values: np.ndarray, time: np.ndarray, velocity: np.ndarray | None = None) -> Wrapping | None:
    """Where an angle wraps; None where it does not, or where that is not certain.

    Every jump must lead over the whole range of angles, be alike beside the motion, and be much faster than any motion
    in the log; most must lead back against the motion, by the velocity where there is one. Its period is a whole
    number of turns or the range of a known protocol where the jumps agree with one. An unknown period must be seen
    `SEEN` times: a log of two strokes, or of a counter that was set to zero, jumps too.

    Args:
        values: position [rad], NaN where nothing was read, shape (rows,).
        time: increasing [s], shape (rows,).
        velocity: [rad/s], shape (rows,), or None.
    """
    known = np.flatnonzero(np.isfinite(values))
    if known.size < 4 * STAYS:
        return None
    at = values[known]
    step, span = np.diff(at), float(np.ptp(at))
    wide = np.abs(step) > 0.5 * span
    jumps = np.flatnonzero(wide)
    if not jumps.size or jumps.size > MOST * step.size:
        return None
    calm, taken = np.flatnonzero(~wide), np.diff(time[known])
    rate = step / taken
    least = np.min(np.abs(step[jumps])), np.min(np.abs(rate[jumps]))
    most = np.max(np.abs(step[calm])), np.max(np.abs(rate[calm]))
    if least[0] < FASTER * most[0] and least[1] < FASTER * most[1]:
        return None
    # What the machine moves during a jump: as much as beside it.
    moved = np.interp(jumps, calm, rate[calm]) * taken[jumps]
    onward = moved if velocity is None else np.nan_to_num(velocity[known][jumps])
    size = np.abs(step[jumps] - moved)
    period = float(np.mean(size))
    if np.min(size) < WHOLE * span or np.count_nonzero(onward * step[jumps] < 0.0) < ONWARD * jumps.size:
        return None
    if np.max(np.abs(size - period)) > ALIKE * period + np.max(np.abs(moved)):
        return None
    turns = np.sign(step[jumps])
    # A single wrong value jumps too, there and back.
    back = (np.diff(jumps) < STAYS) & (turns[1:] == -turns[:-1])
    if jumps.size > 1 and 2 * np.count_nonzero(back) >= jumps.size:
        return None
    # By how much the motion during a jump may differ from that beside it, in the mean of the jumps.
    place = np.searchsorted(calm, jumps)
    change = rate[calm[np.minimum(place, calm.size - 1)]] - rate[calm[np.maximum(place - 1, 0)]]
    error = float(np.max(np.abs(change)) * np.max(taken[jumps]) / np.sqrt(size.size))
    found = _known_period(period, error)
    if found is None and jumps.size < SEEN:
        return None
    return Wrapping(period if found is None else found, known[jumps], turns)


def _known_period(period: float, error: float) -> float | None:
    """The period [rad] of a known kind that is near; None for none."""
    options = (FULL_TURN * max(round(period / FULL_TURN), 1), PROTOCOL)
    nearest = min(options, key=lambda option: abs(option - period))
    return nearest if abs(nearest - period) < min(max(3.0 * error, 2e-3 * period), ALIKE * period) else None
