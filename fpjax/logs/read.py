"""read_log: a file, a DataFrame or arrays -> `Log`, or one sentence on why not."""

import hashlib
import os
import pathlib
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import FpjaxWarning, InputError
from .clock import (
    JITTER_WARNED,
    LONGEST_FILLED,
    SHORTEST,
    Clock,
    drop_repeats,
    fill,
    gap_sentence,
    read_clock,
    repairable,
)
from .columns import CANONICAL, Columns, find_sources, listed, missing_sentence, motion_of, parse_columns, scale_of
from .log import Log
from .table import Table, from_arrays, read_table


def read_log(
    source: str | os.PathLike[str] | Any,
    *,
    columns: Columns = None,
    torque_scale: float = 1.0,
    linear: bool | None = None,
    dt: float | None = None,
    name: str | None = None,
    repair: bool = False,
    require: tuple[str, ...] = ("torque", "velocity or position"),
) -> Log:
    """Read a log and check it.

    Args:
        source: path of a .csv, .npz, .mat, .parquet or .mcap file, or a DataFrame, or a mapping of arrays.
        columns: where the file's names or units are not the contract's: "velocity=gyro_z:deg/s,torque=tau_cmd", with
            a factor "torque=vir*35.15:N", a mapping of the same, or the preset "emps". Columns that are not named
            here are found by their own names, any case, with a unit in brackets ("velocity [deg/s]").
        torque_scale: torque = torque_scale x the column (after its unit) [1].
        linear: whether the axis is linear (m, N); None to tell from the units given, rotary where they say nothing.
        dt: control period [s] of a file without a time column.
        name: for messages and pictures; None for the file's name.
        repair: drop repeated rows, fill gaps of up to ten periods and lone NaNs (two, and one per cent of the
            rows, at most), with a warning that says what was done, instead of refusing.
        require: columns that must be there; "velocity or position" asks for one of them.

    Returns:
        A `Log`; each entry of its `warnings` was also given as an `FpjaxWarning`.

    Raises:
        InputError: one sentence on the first thing that cannot be.
    """
    mapping = parse_columns(columns)
    if isinstance(source, str | os.PathLike):
        path = pathlib.Path(source)
        table, name = read_table(path, mapping), name or path.name
    else:
        path = None
        table, name = from_arrays(source), name or "the log"
    sources = find_sources(list(table.columns) + list(table.text), mapping, name)
    if "time" not in sources and dt is not None:
        _check_period(dt)
    _check_present(table, set(sources) | ({"time"} if dt is not None else set()), ("time", *require), name)
    told = motion_of(sources)
    kind = linear if linear is not None else told
    found, torque_unit, notes = {}, "N" if kind else "N m", list(table.warnings)
    for canonical in CANONICAL:
        if canonical in sources:
            column = sources[canonical].column
            if column in table.text:
                raise InputError(
                    f"{name}: {table.text[column]}, so it cannot be {canonical}: repair that row or column."
                )
            factor, label = scale_of(canonical, sources[canonical], kind)
            torque_unit = label if canonical == "torque" and label else torque_unit
            found[canonical] = table.columns[column] * factor
    if "torque" in found:
        found["torque"] = found["torque"] * torque_scale
    rows = _common_length(found, name)
    if "time" not in found:
        assert dt is not None
        found["time"] = np.arange(rows) * dt
    taken = {source.column for source in sources.values()}
    extra = {key: values for key, values in table.columns.items() if key not in taken and values.size == rows}
    if rows < SHORTEST:
        raise InputError(f"{name} is too short: {rows} rows, where at least {SHORTEST} are needed; record for longer.")
    clock, found, extra = _uniform(found, extra, name, table.first_row, repair, notes)
    for note in notes:
        warnings.warn(note, FpjaxWarning, stacklevel=2)
    grid = clock.start + clock.dt * np.arange(int(clock.places[-1]) + 1)
    return Log(
        time=grid,
        torque=found.get("torque", np.zeros_like(grid)),
        velocity=found.get("velocity"),
        position=found.get("position"),
        reference=found.get("reference"),
        dt=clock.dt,
        name=name,
        linear=bool(kind),
        torque_unit=torque_unit,
        extra=extra,
        warnings=tuple(notes),
        jitter=clock.jitter,
        sha256="" if path is None else _file_hash(path),
    )


def _file_hash(path: pathlib.Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _check_period(dt: float) -> None:
    if not (np.isfinite(dt) and dt > 0.0):
        raise InputError(f"dt = {dt:g} s cannot be a control period: it must be above zero, such as 0.001.")


def _check_present(table: Table, found: set[str], require: tuple[str, ...], name: str) -> None:
    lacking = [wanted for wanted in require if not set(wanted.split(" or ")) & found]
    if not lacking:
        return
    names = list(table.columns) + list(table.text)
    sentence = missing_sentence(names, lacking, name)
    if len(names) == 2:
        sentence = (
            f"{name} has two columns ({listed(names)}), and a log needs three: time, torque, and one of velocity and "
            f"position; record the missing one too."
        )
    raise InputError(sentence)


def _common_length(found: Mapping[str, np.ndarray], name: str) -> int:
    lengths = {key: values.size for key, values in found.items()}
    if len(set(lengths.values())) > 1:
        each = ", ".join(f"{key} {length}" for key, length in lengths.items())
        raise InputError(f"{name}: the columns have different lengths ({each}): export them from one run.")
    return next(iter(lengths.values()))


def _uniform(
    found: dict[str, np.ndarray],
    extra: dict[str, np.ndarray],
    name: str,
    first_row: int,
    repair: bool,
    notes: list[str],
) -> tuple[Clock, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Columns on the uniform grid, after the checks on NaN and on the stamps."""
    _check_finite({"time": found["time"]}, name, first_row, repair=False, notes=notes)
    time = found.pop("time")
    if repair and np.any(np.diff(time) == 0.0):
        keep = drop_repeats(time, {**found, **extra})
        dropped = int((~keep).sum())
        if dropped and repairable(dropped, time.size):
            notes.append(f"{name}: {dropped} rows that repeat the row before were dropped.")
            time = time[keep]
            found = {key: values[keep] for key, values in found.items()}
            extra = {key: values[keep] for key, values in extra.items()}
    found = _check_finite(found, name, first_row, repair, notes)
    clock = read_clock(time, name, first_row)
    if clock.missing:
        longest = int(np.diff(clock.places).max()) - 1
        fillable = repair and longest <= LONGEST_FILLED and repairable(clock.missing, time.size)
        if not fillable:
            raise InputError(gap_sentence(clock, time, name, first_row))
        notes.append(f"{name}: {clock.missing} missing samples were filled (torque held, motion interpolated).")
        found, extra = fill(clock, found), fill(clock, extra)
    if clock.jitter > JITTER_WARNED * clock.dt:
        notes.append(
            f"{name}: the stamps jitter by up to {100.0 * clock.jitter / clock.dt:.2g} % of the period "
            f"{clock.dt:.4g} s; each sample was taken as of its nearest period's start."
        )
    return clock, found, extra


def _check_finite(
    found: dict[str, np.ndarray], name: str, first_row: int, repair: bool, notes: list[str]
) -> dict[str, np.ndarray]:
    whole = {}
    for key, values in found.items():
        bad = ~np.isfinite(values)
        count = int(bad.sum())
        if count == 0:
            whole[key] = values
            continue
        rows = np.flatnonzero(bad)
        runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
        longest = max(run.size for run in runs)
        if repair and repairable(count, values.size) and longest <= LONGEST_FILLED:
            good = np.flatnonzero(~bad)
            if key in ("torque", "reference"):
                whole[key] = values[good[np.maximum(np.searchsorted(good, np.arange(values.size), "right") - 1, 0)]]
            else:
                whole[key] = np.interp(np.arange(values.size), good, values[good])
            notes.append(f"{name}: {count} values of {key} that are not numbers were filled.")
            continue
        kind = "NaN" if np.isnan(values[rows[0]]) else "infinite"
        raise InputError(
            f"{name}: {key} is {kind} in {count} of {values.size} rows (first in row {rows[0] + first_row}): remove "
            f"those rows at the ends of the log, record again"
            f"{'' if repair or key == 'time' else ', or let --repair fill lone ones'}."
        )
    return whole
