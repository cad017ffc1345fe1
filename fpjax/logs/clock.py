"""The clock of a log: from recorded stamps to one control period, or one sentence on why there is none.

What is decided here. A control period is a constant of the machine, so stamps are only evidence of it:

* Jitter below a quarter of a period is the logger's, not the machine's: samples keep their values and take the place
  on the uniform grid that their stamp is nearest to (no interpolation: it would blur a torque that was held). Above
  one per cent of a period the log carries a warning with the number.
* Repeated, decreasing or missing stamps mean that rows are not what they seem: that is an error, unless `repair` asks
  for what can honestly be done (identical rows dropped, gaps of up to ten periods filled: torque and reference held,
  motion interpolated), which is then a warning with the number.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError

SHORTEST = 20  # rows
JITTER_WARNED, JITTER_ALLOWED = 0.01, 0.25  # of a period
LONGEST_FILLED = 10  # periods
MOST_REPAIRED = 0.01  # of the rows
HELD = ("torque", "reference")


@dataclass(frozen=True)
class Clock:
    """One control period and the place of each row on the grid.

    Attributes:
        dt: control period [s].
        start: time of place 0 [s].
        places: index on the uniform grid of each row, increasing by one where nothing is missing.
        jitter: largest deviation of a stamp from the grid [s].
    """

    dt: float
    start: float
    places: np.ndarray
    jitter: float

    @property
    def missing(self) -> int:
        """Periods without a row."""
        return int(self.places[-1]) + 1 - self.places.size


def read_clock(time: np.ndarray, name: str, first_row: int) -> Clock:
    """The clock behind increasing stamps [s].

    Raises:
        InputError: for repeated, decreasing or irregular stamps.
    """
    steps = np.diff(time)
    if np.any(steps == 0.0):
        rows = np.flatnonzero(steps == 0.0) + 1
        raise InputError(
            f"{name}: time repeats in {_rows(rows, first_row)} (first at t = {time[rows[0]]:g} s): remove the repeated "
            f"rows, or let --repair drop those that repeat the row before in full."
        )
    if np.any(steps < 0.0):
        rows = np.flatnonzero(steps < 0.0) + 1
        raise InputError(
            f"{name}: time runs backwards in {_rows(rows, first_row)} (from {time[rows[0] - 1]:g} s to "
            f"{time[rows[0]]:g} s): did the clock jump, or are these several runs? Split the log there."
        )
    period = float(np.median(steps))
    counts = np.maximum(np.round(steps / period), 1.0)
    if counts.sum() > 1e8:
        worst = int(np.argmax(steps))
        raise InputError(_jump(name, time, worst, steps, period, first_row))
    places = np.concatenate([[0.0], np.cumsum(counts)])
    spread = places - places.mean()
    period = float(spread @ (time - time.mean()) / (spread @ spread))
    residual = time - time.mean() - period * spread
    error = float(np.sqrt(residual @ residual / max(time.size - 2, 1) / (spread @ spread)))
    period = _short_number(period, max(3.0 * error, 1e-3 * period / places[-1]))
    start = float(time.mean() - period * places.mean())
    start = 0.0 if abs(start) < JITTER_WARNED * period else start
    deviation = np.abs(time - (start + period * places))
    if deviation.max() > JITTER_ALLOWED * period:
        # A clock that jumps by a fraction of a period shifts all stamps after it; jitter comes and goes.
        worst = int(np.argmax(np.abs(steps - period)))
        share = 100.0 * np.mean(np.abs(steps - period) > JITTER_ALLOWED * period)
        raise InputError(
            f"{name}: time is irregular: about {period:.4g} s a row, but {np.min(steps):.4g} to {np.max(steps):.4g} s "
            f"({share:.2g} % of the steps are off by more than a quarter; the worst in row {worst + 1 + first_row}); "
            f"log at the control period, or resample the log to a uniform clock."
        )
    return Clock(period, start, places.astype(np.int64), float(deviation.max()))


def _short_number(period: float, error: float) -> float:
    """The period [s] or rate [Hz] with the fewest digits within the estimate's error: a drive's period is typed in."""
    for digits in range(1, 8):
        for candidate in (float(f"{period:.{digits}g}"), 1.0 / float(f"{1.0 / period:.{digits}g}")):
            if abs(candidate - period) <= error:
                return candidate
    return period


def repairable(count: int, rows: int) -> bool:
    """Whether so few rows are damaged that mending them does not make up a log."""
    return count <= 2 + MOST_REPAIRED * rows


def gap_sentence(clock: Clock, time: np.ndarray, name: str, first_row: int) -> str:
    """What is missing, where, and what to do."""
    steps = np.diff(clock.places)
    gaps = np.flatnonzero(steps > 1)
    worst = int(gaps[np.argmax(steps[gaps])])
    if steps[worst] > LONGEST_FILLED:
        return _jump(name, time, worst, np.diff(time), clock.dt, first_row)
    count = "1 sample is" if clock.missing == 1 else f"{clock.missing} samples are"
    return (
        f"{name}: {count} missing in {gaps.size} place{'s' if gaps.size > 1 else ''} (first after row "
        f"{gaps[0] + first_row}, t = {time[gaps[0]]:g} s, at {clock.dt:.4g} s a row): log without drops, "
        f"or let --repair fill them."
    )


def _jump(name: str, time: np.ndarray, worst: int, steps: np.ndarray, period: float, first_row: int) -> str:
    return (
        f"{name}: time jumps by {steps[worst]:.4g} s after row {worst + first_row} (t = {time[worst]:g} s; a row is "
        f"{period:.4g} s): did the clock jump or the logger stop? Split the log there, or cut it to one side."
    )


def fill(clock: Clock, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns on the uniform grid: torque and reference held over a gap, the rest interpolated."""
    grid = np.arange(int(clock.places[-1]) + 1)
    before = np.searchsorted(clock.places, grid, side="right") - 1
    return {
        name: values[before] if name in HELD else np.interp(grid, clock.places, values)
        for name, values in columns.items()
    }


def drop_repeats(time: np.ndarray, columns: dict[str, np.ndarray]) -> np.ndarray:
    """Which rows to keep: not those that repeat the stamp and every value of the row before."""
    same = np.diff(time) == 0.0
    for values in columns.values():
        same &= (np.diff(values) == 0.0) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    return np.concatenate([[True], ~same])


def _rows(rows: np.ndarray, first_row: int) -> str:
    shown = ", ".join(str(row + first_row) for row in rows[:3])
    return f"row {shown}" if rows.size == 1 else f"{rows.size} rows ({shown}{', ...' if rows.size > 3 else ''})"
