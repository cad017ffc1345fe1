"""From recorded rows to stretches without a break, each on one uniform clock.

A drive's log often holds several runs: time that starts anew, a pause between two motions, a link that was lost. What
lies between two stretches was not recorded and is not made up; they are runs of one machine, each a log of its own.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from ...errors import InputError
from ..noise import rounding_step
from .clock import LONGEST_FILLED, PARTS, SHORTEST, check_window, in_order, longest_stretch, read_clock
from .invalid_values import filled, unread_rows, without_absurd
from .resample import HELD, Uniform, to_grid
from .wrapping import find_wrapping

MOST = 16  # stretches: a log that is in more pieces is not worth the time of them all
PAUSED = 2.0  # times all that was recorded: over so long a whole, time does not count from the first stretch on
OTHER_ROWS = 0.2  # share of the rows that may be empty: samples that were lost are filled, rows of others are not
OFF_GRID = 0.1  # [periods]: stamps of one clock are closer to its grid
LIKE_A_TURN = 0.01  # relative deviation of a wrapping from 360 degrees, or from the counts of an encoder
LEAST_COUNTS = 256
SIMILAR = 0.1  # relative difference of the periods of two stretches


class Stretch(NamedTuple):
    """Rows without a break.

    Attributes:
        name: of the log; with the numbers of its rows where it is not the longest.
        uniform: the columns on the uniform grid.
        dt: control period [s].
        jitter: largest deviation of a stamp from the grid [s].
        step: rounding step of the torque as recorded; 0 where none is seen.
        since: from the start of the first stretch [s]; 0 where time starts anew between them or a pause is long.
        wrapped: a position that wraps was made continuous: how many turns lie in a break is not known.
        rows: numbers of its first and last row, as a user sees them.
        notes: what was changed in it, a sentence each.
    """

    name: str
    uniform: Uniform
    dt: float
    jitter: float
    step: float
    since: float
    wrapped: bool
    rows: tuple[int, int]
    notes: list[str]


def stretches(
    columns: dict[str, np.ndarray], extra: dict[str, np.ndarray], name: str, first_row: int,
    window: tuple[float, float], dt: float | None, linear: bool,
) -> list[Stretch]:  # fmt: skip
    """The longest stretch of a log (of its longest run), then the longest of the others, in their order.

    Args:
        columns: canonical columns with the time [s], in SI, shape (rows,) each.
        extra: other columns.
        name: of the log, for messages.
        first_row: the number that a user sees on the first row.
        window: (earliest, latest) time kept [s].
        dt: the control period [s] where it is known.
        linear: whether the motion is in metres; an angle may wrap.

    Raises:
        InputError: for a log without enough rows, or whose columns cannot be read.
    """
    time = columns["time"]
    rows = np.arange(time.size)
    if np.isfinite(window).any():
        rows = np.flatnonzero((time >= window[0]) & (time <= window[1]))
        if rows.size < time.size:
            check_window(rows.size, (np.nanmin(time), np.nanmax(time)), name)
    first, left = _longest(columns, extra, rows, name, first_row, dt, linear)
    if first.wrapped:
        return [first]
    parts, tried = [first], 0
    while left and len(parts) < MOST and tried < PARTS:
        left.sort(key=lambda rows: rows.size)
        rows, tried = left.pop(), tried + 1
        try:
            found, rest = _longest(columns, extra, rows, name, first_row, first.dt, linear)
        except InputError:
            continue  # a part of a log that can be read is no reason to refuse it
        left += rest
        if found.wrapped:
            return [first]
        if _comparable(found, first, time[rows]):
            parts.append(found)
    if len(parts) == 1:
        return parts
    first, *further = _timed(parts)
    further = [one._replace(name="{}, rows {} to {}".format(name, *one.rows)) for one in further]
    count = f"{len(further)} further stretch{'es are' if len(further) > 1 else ' is'}"
    shown = ", ".join("{} to {}".format(*one.rows) for one in further[:3])
    said = (
        f"{name}: {count} kept beside it (rows {shown}{', ...' if len(further) > 3 else ''}): a diagnosis takes those "
        "that tell more as further runs of the machine, and lists them."
    )
    return [first._replace(notes=[*first.notes, said]), *further]


def _timed(parts: list[Stretch]) -> list[Stretch]:
    """The first stretch, then the others by their rows, with the time since the earliest where it goes on."""
    first, ordered = parts[0], sorted(parts, key=lambda one: one.rows)
    spans = [(float(one.uniform.time[0]), float(one.uniform.time[-1])) for one in ordered]
    recorded, whole = sum(end - start for start, end in spans), spans[-1][1] - spans[0][0]
    # in a pause that is longer than all that was recorded the machine may have become another one: it cools down
    goes_on = all(end <= start for (_, end), (start, _) in itertools.pairwise(spans))
    if goes_on and whole < PAUSED * recorded:
        ordered = [one._replace(since=start - spans[0][0]) for one, (start, _) in zip(ordered, spans, strict=True)]
    return sorted(ordered, key=lambda one: one.rows != first.rows)


def _comparable(one: Stretch, first: Stretch, time: np.ndarray) -> bool:
    """Whether a stretch can stand beside the first one: the same columns at the same period."""
    same = one.uniform.columns.keys() == first.uniform.columns.keys()
    return same and abs(float(np.median(np.diff(time))) / first.dt - 1.0) < SIMILAR


def _longest(
    columns: dict[str, np.ndarray], extra: dict[str, np.ndarray], rows: np.ndarray, name: str, first_row: int,
    dt: float | None, linear: bool,
) -> tuple[Stretch, list[np.ndarray]]:  # fmt: skip
    """The longest stretch of some rows, and the rows of each other one."""
    notes: list[str] = []
    time = columns["time"]
    check_length(rows.size, name)
    first = int(rows[0])
    ordered = in_order(time[rows] if rows.size < time.size else time, name, first_row + first, notes, dt)
    left = [rows[run] for run in ordered.left]
    if ordered.chosen is not None:
        rows = rows[ordered.chosen]
    check_length(rows.size, name)
    # a copy of every column of a large log is avoided where all rows are kept in their order
    everything = rows.size == time.size and rows[0] == 0 and rows[-1] == rows.size - 1 and ordered.chosen is None
    time = ordered.time
    found = {key: values if everything else values[rows] for key, values in columns.items() if key != "time"}
    extra = {key: values if everything else values[rows] for key, values in extra.items()}
    empty = ~np.any([np.isfinite(values) for values in found.values()], axis=0) if found else np.zeros(rows.size, bool)
    if empty.mean() > OTHER_ROWS and _between(time, empty):
        notes.append(
            f"{name}: {empty.sum()} of {rows.size} rows hold none of the columns that are needed, as those of other "
            "topics do, and were dropped."
        )
        rows, time = rows[~empty], time[~empty]
        found = {key: values[~empty] for key, values in found.items()}
        extra = {key: values[~empty] for key, values in extra.items()}
        check_length(rows.size, name)
    first = int(rows[0])
    found = {key: without_absurd(values, key, name, first_row + first, notes) for key, values in found.items()}
    found = _held_between_messages(_without_empty(found, name, notes), name, notes)
    part, others = longest_stretch(time, unread_rows(found), name, first_row + first, notes)
    left += [rows[each] for each in others]
    check_length(part.stop - part.start, name)
    if part.stop - part.start < time.size:
        time, rows = time[part], rows[part]
        found = {key: values[part] for key, values in found.items()}
        extra = {key: values[part] for key, values in extra.items()}
    row, mended = first_row + int(rows[0]), len(notes)
    if not linear:
        found = _unwrapped(found, time, name, row, notes)
    wrapped = len(notes) > mended
    found = {key: filled(v, time, key, key in HELD, name, row, notes) for key, v in found.items()}
    clock = read_clock(time, name, dt)
    uniform = to_grid(clock, time, found, extra, name, notes)
    check_length(uniform.time.size, name)
    step = rounding_step(found["torque"]) if "torque" in found else 0.0
    seen = int(rows[0]) + first_row, int(rows[-1]) + first_row
    return Stretch(name, uniform, clock.dt, clock.jitter, step, 0.0, wrapped, seen, notes), left


def check_length(rows: int, name: str) -> None:
    """Refuse a log of too few rows.

    Raises:
        InputError: for such a log.
    """
    if rows < SHORTEST:
        raise InputError(f"{name} is too short: {rows} rows, where at least {SHORTEST} are needed; record for longer.")


def _between(time: np.ndarray, empty: np.ndarray) -> bool:
    """Whether most rows without a value lie between the periods of those with one: rows of a topic of its own.

    Samples that were lost lie on the same grid as those that were not.

    Args:
        time: stamps of all rows [s], ascending.
        empty: which rows hold no value, a boolean for each.
    """
    kept, others = time[~empty], time[empty]
    others = others[others > kept[0]] if kept.size > 2 else others[:0]
    period = float(np.quantile(np.diff(kept), 0.05)) if kept.size > 2 else 0.0
    if not others.size or period <= 0.0:
        return False
    phase = (others - kept[np.searchsorted(kept, others, side="right") - 1]) / period
    return float(np.mean(np.abs(phase - np.round(phase)) > OFF_GRID)) > 0.5


def _without_empty(found: dict[str, np.ndarray], name: str, notes: list[str]) -> dict[str, np.ndarray]:
    """Drop columns without a single number where another can replace them; refuse the log where none can."""
    empty = [key for key, values in found.items() if not np.isfinite(values).any()]
    for key in empty:
        other = {"velocity": "position", "position": "velocity"}.get(key)
        if key == "torque" or (other is not None and (other not in found or other in empty)):
            raise InputError(f"{name}: {key} holds no numbers at all: map another column with --columns {key}=NAME.")
        notes.append(f"{name}: {key} holds no numbers at all and was left out.")
    return {key: values for key, values in found.items() if key not in empty}


def _held_between_messages(found: dict[str, np.ndarray], name: str, notes: list[str]) -> dict[str, np.ndarray]:
    """The columns with a command held where it has rows of its own, as in a table made of several topics.

    Such a command comes only when it changes: between two of its rows nothing is missing.
    """
    motion = [np.isfinite(found[key]) for key in ("velocity", "position") if key in found]
    for key in HELD:
        if key not in found or not motion:
            continue
        values, read = found[key], np.flatnonzero(np.isfinite(found[key]))
        if read.size in (0, values.size) or any(each[read].any() for each in motion):
            continue
        if np.diff(read, append=values.size).max() <= LONGEST_FILLED:
            continue
        last = np.searchsorted(read, np.arange(values.size), side="right") - 1
        found = found | {key: np.where(last < 0, np.nan, values[read[np.maximum(last, 0)]])}
        notes.append(
            f"{name}: {key} has {read.size} rows of its own, none with a motion: each value was held until the next."
        )
    return found


def _unwrapped(
    found: dict[str, np.ndarray], time: np.ndarray, name: str, first_row: int, notes: list[str]
) -> dict[str, np.ndarray]:
    """The columns with an angle, and its reference, that turn on where they jumped from one end to the other."""
    wrapping = find_wrapping(found["position"], time, found.get("velocity")) if "position" in found else None
    if wrapping is None:
        return found
    position = wrapping.removed(found["position"])
    count = len(wrapping.after)
    reference = wrapping.beside(position, found["reference"]) if "reference" in found else None
    times = "once" if count == 1 else f"{count} times"
    notes.append(
        f"{name}: position jumps by {wrapping.period:.6g} rad {times} (first after row "
        f"{wrapping.after[0] + first_row}) while the machine moves on: it wraps, and was made continuous"
        f"{', its reference with it' if reference is not None else ''}{_like_a_turn(wrapping.period)}."
    )
    return found | {"position": position} | ({} if reference is None else {"reference": reference})


def _like_a_turn(period: float) -> str:
    """What a period of a position that was read in rad says of its unit, for the end of a sentence; "" for nothing."""
    counts = 2 ** round(math.log2(period)) if period > 0.0 else 0
    if abs(period - 360.0) < LIKE_A_TURN * 360.0:
        return "; degrees wrap so: then say so with --columns position=NAME:deg"
    if counts >= LEAST_COUNTS and abs(period - counts) < LIKE_A_TURN * counts:
        return (
            f"; a counter of {counts:g} counts wraps so: then say so with --columns position=NAME:counts/N, with N the "
            f"counts of one turn of the machine (of the counter, if it wraps once a turn)"
        )
    return ""
