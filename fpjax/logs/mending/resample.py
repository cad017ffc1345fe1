"""From rows with stamps to one value per period: rows are kept where stamps only jitter, else interpolated.

A stamp may be off because the logger was late (the reading still belongs to its own period), or it may be right because
the period itself varied. The readings show which: a motion is a smooth function of true time. Of the two assumptions,
the one is taken under which each reading agrees better with its neighbours.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..log import Log
from ..noise import LOOKED_AT
from .clock import JITTER_ALLOWED, JITTER_WARNED, Clock

HELD = ("torque", "reference")
CLEARLY = 0.9  # ratio of the two disagreements, below which one assumption is clearly the better one


class Uniform(NamedTuple):
    """Columns on the uniform grid.

    Attributes:
        time: start of each period [s].
        columns: by name.
        extra: by name, each with the last reading at or before the period's start.
        resampled: whether a value was interpolated or filled.
    """

    time: np.ndarray
    columns: dict[str, np.ndarray]
    extra: dict[str, np.ndarray]
    resampled: bool


def to_grid(
    clock: Clock, time: np.ndarray, columns: dict[str, np.ndarray], extra: dict[str, np.ndarray], name: str,
    notes: list[str],
) -> Uniform:  # fmt: skip
    """Columns on the clock's grid.

    Args:
        clock: from `read_clock`.
        time: increasing stamps [s].
        columns: canonical columns at these stamps, finite.
        extra: other columns at these stamps.
        name: of the log, for messages.
        notes: gains a sentence for what was done.
    """
    share = clock.jitter / clock.dt
    doubled = bool(np.any(np.diff(clock.places) == 0))
    follows = doubled
    if share > JITTER_WARNED and not doubled:
        # large jitter (over a quarter of a period) is believed unless the readings clearly refute it, small jitter
        # only where they clearly confirm it: interpolation smooths the noise and colours it
        ratio = _disagreement(time, clock, columns)
        follows = ratio < CLEARLY or (share > JITTER_ALLOWED and ratio < 1.0 / CLEARLY)
    grid = clock.start + clock.dt * np.arange(int(clock.places[-1]) + 1)
    if follows:
        inside = (grid >= time[0] - 1e-9 * clock.dt) & (grid <= time[-1] + 1e-9 * clock.dt)
        grid = grid[inside]
        steps = np.diff(time)
        notes.append(
            f"{name}: its stamps are {steps.min():.4g} to {steps.max():.4g} s apart: it was resampled onto a control "
            f"period of {clock.dt:.4g} s (torque by its mean over each period, motion by a cubic)."
        )
        found = {
            key: _mean_held(time, values, grid, clock.dt) if key in HELD else _cubic(time, values, grid)
            for key, values in columns.items()
        }
        last = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, time.size - 1)
        return Uniform(grid, found, {key: values[last] for key, values in extra.items()}, True)
    if share > JITTER_WARNED:
        notes.append(
            f"{name}: the stamps jitter by up to {100.0 * share:.2g} % of the period {clock.dt:.4g} s; the readings do "
            f"not, so each was taken as of its own period's start."
        )
    if not clock.missing:
        return Uniform(grid, columns, extra, False)
    notes.append(
        f"{name}: {clock.missing} missing sample{'' if clock.missing == 1 else 's'} of {grid.size} "
        f"{'was' if clock.missing == 1 else 'were'} filled (torque held, motion interpolated)."
    )
    index = np.arange(grid.size)
    last = np.searchsorted(clock.places, index, side="right") - 1
    found = {
        key: values[last] if key in HELD else np.interp(index, clock.places, values) for key, values in columns.items()
    }
    return Uniform(grid, found, {key: values[last] for key, values in extra.items()}, True)


def _disagreement(time: np.ndarray, clock: Clock, columns: dict[str, np.ndarray]) -> float:
    """Distance of the readings from the cubic through their neighbours, with their stamps over with even steps.

    Of position and velocity, the one whose ratio is further from 1 decides.
    """
    ratios = []
    for name in ("position", "velocity"):
        if name not in columns:
            continue
        values = columns[name][:LOOKED_AT]
        by_stamp = _off_neighbours(time[: values.size], values)
        by_place = _off_neighbours(clock.places[: values.size].astype(np.float64), values)
        if by_place > 0.0 and by_stamp > 0.0:
            ratios.append(by_stamp / by_place)
    return min(ratios, key=lambda ratio: -abs(np.log(ratio)), default=1.0)


def _off_neighbours(places: np.ndarray, values: np.ndarray) -> float:
    """Rms distance of the readings from the cubic through two neighbours on either side, per unit of white noise.

    Lagrange's interpolation with uneven nodes. The distance is divided by the factor by which it amplifies white noise,
    1 + the sum of the squared weights, so that steps of different unevenness compare.
    """
    if values.size < 8:
        return 0.0
    around = [places[shift : places.size - 4 + shift] for shift in (0, 1, 3, 4)]
    here = places[2:-2]
    total, power = np.zeros(here.size), np.ones(here.size)
    for k, shift in enumerate((0, 1, 3, 4)):
        weight = np.ones(here.size)
        for j in range(4):
            if j != k:
                weight = weight * (here - around[j]) / (around[k] - around[j])
        total += weight * values[shift : values.size - 4 + shift]
        power += weight**2
    return float(np.sqrt(np.mean((values[2:-2] - total) ** 2 / power)))


def _cubic(time: np.ndarray, values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """The cubic through the two readings before and the two after each time."""
    if time.size < 4:
        return np.interp(grid, time, values)
    first = np.clip(np.searchsorted(time, grid, side="right") - 2, 0, time.size - 4)
    nodes = [time[first + k] for k in range(4)]
    found = np.zeros(grid.size)
    for k in range(4):
        weight = np.ones(grid.size)
        for j in range(4):
            if j != k:
                weight = weight * (grid - nodes[j]) / (nodes[k] - nodes[j])
        found += weight * values[first + k]
    # a cubic overshoots beside a long step: there a straight line is taken
    wide = nodes[2] - nodes[1] > 1.9 * np.median(np.diff(time))
    return np.where(wide, np.interp(grid, time, values), found)


def _mean_held(time: np.ndarray, values: np.ndarray, grid: np.ndarray, dt: float) -> np.ndarray:
    """Mean over each period of a value that is held from stamp to stamp, which keeps the impulse (N m s) unchanged."""
    edges = np.append(grid, grid[-1] + dt)
    ends = np.append(time, max(time[-1], edges[-1]) + dt)
    integral = np.concatenate([[0.0], np.cumsum(values * np.diff(ends))])
    return np.diff(np.interp(edges, ends, integral)) / dt


def at_period(log: Log, dt: float) -> Log:
    """The same log at another control period, for runs of one machine whose clocks differ.

    Torque and reference by their mean over each new period, which keeps the impulse, motion by a cubic; the other
    columns by their last value. A warning says so.

    Args:
        log: on its own clock.
        dt: the new period [s].
    """
    grid = np.arange(log.time[0], log.time[-1] + 1e-9 * dt, dt)
    found = {
        key: _mean_held(log.time, values, grid, dt) if key in HELD else _cubic(log.time, values, grid)
        for key, values in log.columns().items() if key != "time"
    }  # fmt: skip
    last = np.clip(np.searchsorted(log.time, grid, side="right") - 1, 0, log.time.size - 1)
    note = f"{log.name}: its period of {log.dt:.6g} s was resampled onto {dt:.6g} s, the period in common."
    return replace(
        log, time=grid, **found, extra={key: values[last] for key, values in log.extra.items()}, dt=dt,
        warnings=(*log.warnings, note), resampled=True,
    )  # fmt: skip


def every(uniform: Uniform, count: int, name: str, notes: list[str]) -> Uniform:
    """One row from every `count`: the mean of the torque, which keeps its impulse, and the motion at their start.

    Args:
        uniform: the log at its own period.
        count: number of rows that become one.
        name: of the log, for messages.
        notes: gains a sentence for what was done.
    """
    rows = uniform.time.size // count
    notes.append(f"{name}: one row was made of every {count} (torque by its mean, motion at the first of them).")

    def first(values: np.ndarray) -> np.ndarray:
        return values[: rows * count : count].copy()

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: rows * count].reshape(rows, count).mean(axis=1)

    columns = {
        key: mean(values) if key in ("torque", "torque_measured") else first(values)
        for key, values in uniform.columns.items()
    }
    extra = {key: first(values) for key, values in uniform.extra.items()}
    return Uniform(first(uniform.time), columns, extra, uniform.resampled)
