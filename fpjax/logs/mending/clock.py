"""The clock of a log: from recorded stamps to one control period, and which rows belong to one run.

A control period is a constant of the machine, and the stamps are noisy measurements of it. What is decided here:

* Rows whose stamp repeats are dropped, and rows that were written a few places late are sorted. Where time runs
  backwards or stops for long, or a needed column has no readings for long, the log is cut there; its longest part
  leads.
* The period is fitted to the stamps of the whole part and rounded to the few digits in which a drive's period is
  configured.

Every change is reported with its number; with `strict` the log is refused instead.
"""

from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from .doubt import Doubt

SHORTEST = 20  # [rows]
JITTER_WARNED, JITTER_ALLOWED = 0.01, 0.25  # of a period
UNCLOCKED = 0.02  # share of steps below half the median, from which on the stamps do not come from a regular clock
LONGEST_FILLED = 10  # [periods]
FEW_AT_START = 0.002  # share of the rows: so many before a long first step are a start-up, and are dropped
PARTS = 64  # of a log with breaks that are looked at: a wrong time column has millions
LATE = 5  # [rows] by which a row may have been written late
COARSE = 0.2  # share of repeated stamps, from which on the clock is coarse and the rows are not repeated
SURE_GROUPS, ALIKE_GROUPS = 5, 2  # groups of rows of one stamp that tell the period; so few where all are as long
ALIKE = 0.05  # relative deviation of their periods, beside that of one row
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-8, 1e4  # [s]
LATEST = 1e13  # [s]: beyond it a float64 does not resolve a millisecond
MOST_FILLED = LONGEST_FILLED + 2  # [periods per row]: a finer grid would consist of invented samples
USUAL = (1e-5, 0.05)  # [s]: control periods of drives and of their loggers
SLOW = 0.2  # [s]: no servo has a control period this long, so the stamps are probably in another unit
EPOCH = (1e9, 1e10)  # [s] since 1970: of the years 2001 to 2286
DAY = 86400.0  # [s]
DAYS = (2e4, 8e5)  # stamps in days: Excel counts from 1900, MATLAB from the year 0
TIME_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s]


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


@dataclass(frozen=True)
class Rows:
    """Which rows are used, in which order, and their stamps.

    Attributes:
        chosen: rows of the file, in order; None for all of them as they are.
        time: their stamps [s], increasing.
        left: rows of each other run, where several were joined together.
    """

    chosen: np.ndarray | None
    time: np.ndarray
    left: list[np.ndarray]


def check_window(rows: int, span: tuple[float, float], name: str) -> None:
    """Refuse a part of a log that is too short.

    Args:
        rows: in the part.
        span: first and last time of the whole log [s].
        name: of the log, for messages.

    Raises:
        InputError: for such a part.
    """
    if rows < SHORTEST:
        dated = " since 1970, in UTC" if span[0] >= EPOCH[0] else ""
        raise InputError(
            f"{name}: --from and --to leave {rows} rows, where at least {SHORTEST} are needed: it runs from "
            f"{span[0]:.13g} to {span[1]:.13g} s{dated}."
        )


def in_order(time: np.ndarray, name: str, first_row: int, notes: list[str], dt: float | None = None) -> Rows:
    """Increasing stamps: repeated rows dropped, late rows sorted, the longest run taken where time runs backwards.

    Args:
        time: stamps as recorded [s].
        name: of the log, for messages.
        first_row: the number that a user sees on the first row.
        notes: gains a sentence for each thing that was done.
        dt: the control period [s] where it is known.

    Raises:
        InputError: where too few stamps are numbers, all of them are equal, or so many that they tell no period.
    """
    chosen: np.ndarray | None = None
    left: list[np.ndarray] = []
    bad = ~np.isfinite(time)
    if bad.any():
        if bad.sum() > 0.5 * time.size:
            raise InputError(f"{name}: time is not a number in {bad.sum()} of {time.size} rows: check the time column.")
        chosen = np.flatnonzero(~bad)
        notes.append(
            f"{name}: {bad.sum()} rows without a time were dropped (first in row {np.argmax(bad) + first_row})."
        )
        time = time[chosen]
    if (np.diff(time) < 0.0).any():
        time = _over_midnight(time, name, first_row, notes)
    steps = np.diff(time)
    if (steps < 0.0).any():
        order = np.argsort(time, kind="stable")
        if np.max(np.abs(order - np.arange(time.size))) <= LATE:
            late = int((steps < 0.0).sum())
            notes.append(
                f"{name}: {_count(late, 'row')} came late and {'was' if late == 1 else 'were'} put in order of time."
            )
            chosen = order if chosen is None else chosen[order]
            time = time[order]
        else:
            ends = np.flatnonzero(steps < 0.0) + 1
            runs = longest_first(np.concatenate([[0], ends, [time.size]]))
            begin, end = runs[0].start, runs[0].stop
            notes.append(
                f"{name}: time runs backwards in {_rows(ends, first_row)} (from {time[ends[0] - 1]:.10g} s to "
                f"{time[ends[0]]:.10g} s), as in several runs joined together: the longest, rows {begin + first_row} "
                f"to {end - 1 + first_row}, was taken."
            )
            known = np.arange(time.size) if chosen is None else chosen
            left = [known[run] for run in runs[1:]]
            chosen, time = known[begin:end], time[begin:end]
        steps = np.diff(time)
    repeated = steps == 0.0
    if repeated.any() and time[-1] > time[0]:
        if repeated.mean() > COARSE:
            time = _spread(time, name, dt)
            notes.append(
                f"{name}: its stamps are coarser than its rows ({100 * repeated.mean():.3g} % repeat the one before): "
                f"the rows were spread evenly between them."
            )
        else:
            keep = np.concatenate([[True], ~repeated])
            rows = np.flatnonzero(repeated) + 1
            notes.append(
                f"{name}: time repeats in {_rows(rows, first_row)}: the later of rows with one time were dropped."
            )
            chosen = np.flatnonzero(keep) if chosen is None else chosen[keep]
            time = time[keep]
    elif repeated.any():
        raise InputError(f"{name}: time is {time[0]:g} s in every row, so there is no clock: check the time column.")
    if _in_days(time):
        notes.append(
            Doubt(
                f"{name}: its stamps begin at {time[0]:.10g} and are {np.median(np.diff(time)):.3g} apart, which is no "
                f"control period in s: do they count days? Then say so with --columns time=NAME*86400."
            )
        )
    return Rows(chosen, time, left)


def _over_midnight(time: np.ndarray, name: str, first_row: int, notes: list[str]) -> np.ndarray:
    """Stamps that are times of day, a day later after each midnight: there they fall back by a day less a period."""
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    after = (steps < 0.0) & (steps + DAY >= 0.0) & (steps + DAY <= (LONGEST_FILLED + 1) * usual)
    if not after.any() or time.min() < 0.0 or time.max() > DAY:
        return time
    notes.append(
        f"{name}: its stamps are times of day that pass midnight after row {np.argmax(after) + first_row}: a day was "
        "added to those after it."
    )
    return time + DAY * np.concatenate([[0.0], np.cumsum(after)])


def _in_days(time: np.ndarray) -> bool:
    """Whether stamps are those of a control period if they count days, as Excel and MATLAB do."""
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    return bool(DAYS[0] <= time[0] <= DAYS[1] and USUAL[0] <= step * DAY <= USUAL[1])


def likely_unit(period: float) -> str | None:
    """The unit in which steps of this size are a usual control period; None where they can be one in seconds.

    Args:
        period: between two rows, taken as seconds.
    """
    if period <= SLOW:
        return None
    fitting = {unit: period * size for unit, size in TIME_UNITS.items() if USUAL[0] <= period * size <= USUAL[1]}
    # Of two that fit, the one nearest to 1 kHz, in which most drives and their logs run.
    return min(fitting, key=lambda unit: abs(np.log(fitting[unit] / 1e-3)), default=None)


def since_1970(time: np.ndarray) -> str:
    """The unit of stamps that count from 1970: "ms", "us", "ns"; "" for seconds and for stamps that do not.

    Of the four units, the years 2001 to 2286 have numbers of their own, and rows of a servo's log are close together in
    it: microseconds since a computer was started can be as many as milliseconds since 1970.

    Args:
        time: stamps as recorded, in the unknown unit.
    """
    known = time[np.isfinite(time)]
    if known.size < 2:
        return ""
    step = float(np.median(np.abs(np.diff(known))))
    for unit, size in TIME_UNITS.items():
        if EPOCH[0] <= known.min() * size and known.max() * size < EPOCH[1] and step * size < SLOW:
            return unit
    return ""


def _spread(time: np.ndarray, name: str, dt: float | None) -> np.ndarray:
    """Stamps of a coarse clock: the rows that share a stamp are spread evenly up to the next stamp."""
    first = np.flatnonzero(np.concatenate([[True], np.diff(time) > 0.0]))
    size = np.diff(np.append(first, time.size))
    stamps = time[first]
    ahead = np.append(np.diff(stamps), np.median(np.diff(stamps)))
    rate = ahead / size
    # the first and the last group may be cut, so they are spread by the period that the others have
    inner = rate[1:-1]
    within = np.arange(time.size) - np.repeat(first, size)
    if dt is not None:
        # Rows lie dt apart, up to the next stamp; the first ones, which may be cut, just before it. A pause stays one.
        rate = np.minimum(dt, rate)
        stamps[0] = max(stamps[0], stamps[1] - size[0] * rate[0])
        return np.repeat(stamps, size) + within * np.repeat(rate, size)
    # A stamp tells the rows of its group to one.
    alike = inner.size >= ALIKE_GROUPS and np.ptp(inner) <= (ALIKE + 1.0 / np.min(size[1:-1])) * np.median(inner)
    if inner.size < SURE_GROUPS and not alike:
        raise InputError(
            f"{name}: time has only {first.size} different values in {time.size} rows ({stamps[0]:.10g} to "
            f"{stamps[-1]:.10g} s), too few to tell how far apart its rows are: export it with more digits, or give "
            f"the rows per second with --rate (in Python dt=, the seconds between two rows)."
        )
    period = np.median(inner)
    rate[0], rate[-1] = min(period, rate[0]), period  # and never beyond the next stamp
    return np.repeat(stamps, size) + within * np.repeat(rate, size)


def longest_stretch(
    time: np.ndarray, unread: np.ndarray | None, name: str, first_row: int, notes: list[str]
) -> tuple[slice, list[slice]]:
    """(rows of the longest part without a long pause and without long runs of empty rows, those of the other parts).

    Args:
        time: increasing stamps [s].
        unread: rows in a long run without readings; None where there are none.
        name: of the log, for messages.
        first_row: the number that a user sees on the first row.
        notes: gains a sentence where the log was cut.
    """
    steps = np.diff(time)
    period = float(np.median(steps))
    wide = steps > (LONGEST_FILLED + 1) * period
    # A logger often writes a row or two and then pauses while the drive starts: joining them would invent samples.
    early = max(3, int(FEW_AT_START * time.size))
    wide[:early] |= steps[:early] > 2.5 * period
    ends = np.flatnonzero(wide) + 1
    if unread is not None and unread.any():
        ends = np.concatenate([ends, np.flatnonzero(np.diff(unread.astype(np.int8)) != 0) + 1])
    if not ends.size:
        return slice(0, time.size), []
    best, *others = longest_first(np.unique(np.concatenate([[0], ends, [time.size]])), unread)
    at = int(ends[np.argmax(steps[ends - 1])])
    cause = f"time jumps by {steps[at - 1]:.4g} s after row {at - 1 + first_row} (t = {time[at - 1]:.10g} s)"
    if unread is not None and unread.any() and not wide.any():
        cause = f"nothing was read in {_count(int(unread.sum()), 'row')} (first {np.argmax(unread) + first_row})"
    left = time.size - (best.stop - best.start)
    there = f"{time[0]:.10g} to {time[-1]:.10g} s are there"
    rest = "" if left < early + 1 else f"; for another one use --from and --to ({there})"
    notes.append(
        f"{name}: {cause}, so the log was cut there and its longest stretch taken, {time[best.start]:.10g} to "
        f"{time[best.stop - 1]:.10g} s, without {_count(left, 'row')}{rest}."
    )
    return best, others


def longest_first(edges: np.ndarray, unread: np.ndarray | None = None) -> list[slice]:
    """The parts between edges, the longest `PARTS` of them, the longest first.

    Args:
        edges: first row of each part and the end of the last, increasing.
        unread: rows in a long run without readings, which are no part; None where there are none.
    """
    sizes = np.diff(edges)
    if unread is not None:
        sizes = np.where(unread[edges[:-1]], 0, sizes)
    first = np.argsort(-sizes, kind="stable")[:PARTS]
    return [slice(int(edges[one]), int(edges[one + 1])) for one in first if sizes[one] > 0]


def read_clock(time: np.ndarray, name: str, dt: float | None = None) -> Clock:
    """The clock behind increasing stamps [s].

    Args:
        time: increasing stamps [s].
        name: of the log, for messages.
        dt: the control period [s] where it is known; None for the one that the stamps agree on.

    Raises:
        InputError: for a grid that no memory holds.
    """
    steps = np.diff(time)
    period = float(np.median(steps)) if dt is None else dt
    if not SHORTEST_PERIOD <= period <= LONGEST_PERIOD or np.abs(time[[0, -1]]).max() > LATEST:
        unit = "*86400 for days" if _in_days(time) else f":{likely_unit(period) or 'ms'}"
        raise InputError(
            f"{name}: a row every {period:.3g} s from {time[0]:.6g} to {time[-1]:.6g} s is no control period: check "
            f"the unit of time, as in --columns time=NAME{unit}."
        )
    counts = np.maximum(np.round(steps / period), 1.0)
    if dt is None:
        # Steps that alternate (10 and 12 ms) have their mean as period, and a median that is off.
        period = float(np.mean(steps[counts == 1.0]))
        counts = np.maximum(np.round(steps / period), 1.0)
    if counts.sum() > MOST_FILLED * time.size:
        raise InputError(
            f"{name}: a row comes every {np.median(steps):.4g} s, which a period of {period:.4g} s cannot be made of: "
            f"give dt as the log's own, or leave it out."
        )
    places = np.concatenate([[0.0], np.cumsum(counts)])
    spread = places - places.mean()
    centred = time - time.mean()
    if dt is None:
        period = float(spread @ centred / (spread @ spread))
        residual = centred - period * spread
        error = float(np.sqrt(residual @ residual / max(time.size - 2, 1) / (spread @ spread)))
        period = _short_number(period, max(3.0 * error, 1e-3 * period / places[-1]))
        # A clock that drifts against its own count (steps that are no multiple) is counted anew.
        if np.abs(centred - period * spread).max() > JITTER_ALLOWED * period:
            median = float(np.median(steps))
            if np.mean(steps < 0.5 * median) > UNCLOCKED:
                # nothing ticks behind such stamps (a device that was polled): no more rows than came are in them
                period = _short_number(median, 0.02 * median)
            places = np.round((time - time[0]) / period)
            places = np.maximum.accumulate(places)
    start = float(np.mean(time - period * places))
    if abs(np.abs(time - (start + period * places)).max()) > JITTER_ALLOWED * period:
        start = float(time[0])
    start = 0.0 if abs(start) < JITTER_WARNED * period else start
    deviation = np.abs(time - (start + period * places))
    return Clock(period, start, places.astype(np.int64), float(deviation.max()))


def _short_number(period: float, error: float) -> float:
    """The period [s] or rate [Hz] with the fewest digits within the estimate's error: a drive's period is typed in."""
    for digits in range(1, 8):
        for candidate in (float(f"{period:.{digits}g}"), 1.0 / float(f"{1.0 / period:.{digits}g}")):
            if abs(candidate - period) <= error:
                return candidate
    return period


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def _rows(rows: np.ndarray, first_row: int) -> str:
    shown = ", ".join(str(row + first_row) for row in rows[:3])
    return f"row {shown}" if rows.size == 1 else f"{rows.size} rows ({shown}{', ...' if rows.size > 3 else ''})"
