"""Values that are not readings: numbers far outside any sensor's range, and empty cells."""

import numpy as np

from ...errors import InputError
from ..arrays import runs_of
from .clock import LONGEST_FILLED
from .doubt import Doubt

LARGEST = 1e30  # [SI units]: no torque, speed or angle of a machine is near it
SMALLEST = 1e-60  # [SI units]: products of such values underflow to zero
ABSURD = 1e6  # times the column's 99 % quantile
FEW = 0.01  # share of the rows: with more, the whole column is wrong and is refused
LEAST_MARKED = 3  # rows: a number that marks what was not read comes again
MOST_MARKS = 4  # different ones in a column
MARKED = 5.0  # times the largest of the other values: no saturated sensor is so far from its other readings
MOST_MARKED = 0.5  # of the rows
FEW_OTHERS = 10  # values: a column of so few is a command of steps


def without_absurd(values: np.ndarray, column: str, name: str, first_row: int, notes: list[str]) -> np.ndarray:
    """The column with NaN in place of single values that no sensor gives (1e308 in a log of newton metres).

    Args:
        values: [SI units], shape (rows,).
        column: canonical name, for messages.
        name: of the log, for messages.
        first_row: the number that a user sees on the first row.
        notes: gains a sentence for what was done.

    Raises:
        InputError: for a column that holds such numbers throughout.
    """
    finite = np.isfinite(values)
    if not finite.any():
        return values
    size = np.abs(values)
    sample = size[:: max(1, size.size // 200_000)]
    sample = sample[np.isfinite(sample)]
    usual = float(np.quantile(sample, 0.99)) if sample.size else 0.0
    # at least 1e9, so that a column of tiny readings with one honest large one is not touched
    limit = min(LARGEST, max(ABSURD * usual, 1e9) if usual > 0.0 else LARGEST)
    absurd = finite & (size > limit)
    count = int(absurd.sum())
    if count > FEW * values.size + 2:
        raise InputError(
            f"{name}: {column} has values of up to {np.max(size[finite]):.3g} in {count} of {values.size} rows, which "
            f"no machine has: check that column and its unit."
        )
    if count:
        worst = int(np.argmax(absurd))
        notes.append(
            f"{name}: {column} reads {values[worst]:.3g} in row {worst + first_row}"
            f"{f' and the like in {count - 1} more' if count > 1 else ''}, which no sensor gives: left out."
        )
        values = np.where(absurd, np.nan, values)
    if usual < SMALLEST and usual > 0.0:
        notes.append(f"{name}: {column} is no larger than {usual:.3g}, which was taken as zero: check its unit.")
        values = np.where(np.isfinite(values), 0.0, values)
    else:
        notes += _marked(values, column, name, first_row)
    return values


def _marked(values: np.ndarray, column: str, name: str, first_row: int) -> list[str]:
    """A sentence where numbers, far from all others, come again and again: a drive's marks for no reading.

    Nothing is dropped for it, since a command may have two such levels. A column that takes no more than a few other
    values is not looked at.
    """
    size = np.where(np.isfinite(values), np.abs(values), -1.0)
    tried, marks, largest = list[float](), list[float](), 0.0
    # The largest values are taken away one by one, since a mark hides behind a larger one: those that leave much
    # smaller ones alone are marks.
    while len(tried) < MOST_MARKS:
        mark = float(values[np.argmax(size)])
        if np.sum(values == mark) < LEAST_MARKED:
            break
        tried.append(mark)
        size[values == mark] = -1.0
        if abs(mark) > MARKED * size.max() > 0.0:
            marks, largest = list(tried), float(size.max())
    marked = np.isin(values, marks)
    others = values[~marked & np.isfinite(values)]
    steps = np.unique(others[:: max(1, others.size // 1000)]).size <= FEW_OTHERS
    if not marks or np.mean(marked) > MOST_MARKED or steps:
        return []
    first = np.argmax(marked) + first_row
    return [
        Doubt(
            f"{name}: {column} is {' or '.join(f'{mark:.6g}' for mark in marks)} (in SI units) in {marked.sum()} rows "
            f"(first in row {first}) and at most {largest:.3g} elsewhere: is it a drive's mark for no reading, a limit "
            "or a step? Where it is a mark, leave those cells empty."
        )
    ]


def unread_rows(columns: dict[str, np.ndarray]) -> np.ndarray | None:
    """Mask of the rows in runs of more than ten without a reading of some column, shape (rows,); None without any."""
    found: np.ndarray | None = None
    for values in columns.values():
        bad = ~np.isfinite(values)
        if not bad.any():
            continue
        begins, ends = runs_of(bad).T
        long = ends - begins > LONGEST_FILLED
        # what is missing at the ends cannot be interpolated, however short
        long |= (begins == 0) | (ends == values.size)
        if long.any():
            found = np.zeros(values.size, bool) if found is None else found
            for begin, end in zip(begins[long], ends[long], strict=True):
                found[begin:end] = True
    return found


def filled(
    values: np.ndarray, time: np.ndarray, column: str, held: bool, name: str, first_row: int, notes: list[str]
) -> np.ndarray:
    """The column with its short runs of NaN filled: a torque is held, a motion is interpolated over time.

    Args:
        values: shape (rows,), NaN where nothing was read.
        time: [s], shape (rows,).
        column: canonical name, for messages.
        held: whether the last value is held (what a drive does with a command) and not interpolated.
        name: of the log, for messages.
        first_row: the number that a user sees on the first row.
        notes: gains a sentence for what was done.
    """
    bad = ~np.isfinite(values)
    count = int(bad.sum())
    if not count:
        return values
    good = np.flatnonzero(~bad)
    if held:
        found = values[good[np.maximum(np.searchsorted(good, np.arange(values.size), "right") - 1, 0)]]
    else:
        found = np.interp(time, time[good], values[good])
    notes.append(
        f"{name}: {count} {'value' if count == 1 else 'values'} of {column} that "
        f"{'is not a number' if count == 1 else 'are not numbers'} "
        f"(first in row {np.argmax(bad) + first_row}) {'was' if count == 1 else 'were'} filled "
        f"({'held' if held else 'interpolated'})."
    )
    return found
