"""read_log: makes a `Log` from a file, a DataFrame or arrays, or says in one sentence why it cannot."""

import hashlib
import os
import pathlib
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import FpjaxWarning, InputError
from ..output.paths import expanded
from .columns.clocks import other_clocks
from .columns.headerless import described
from .columns.mapping import (
    Columns,
    Source,
    find_sources,
    motion_of,
    parse_columns,
    rates_without_angle,
    scale_of,
    torque_without_unit,
    without_unknown_sizes,
)
from .columns.missing import listed, missing_sentence
from .columns.units import find_unit
from .formats.table import RawTable, Request, from_arrays, read_table
from .log import Log, NamedArrays
from .mending.clock import SHORTEST, since_1970
from .mending.doubt import Doubt
from .mending.measured_torque import constant_ratio, following, related
from .mending.resample import Uniform, every
from .mending.stretches import Stretch, stretches
from .mending.unsigned import signed
from .noise import noise_level

MOST_EXTRA = 64  # unmapped columns that are kept
# quantiles: an axis that only moved to its place before the run counts as standing still
MOST_OF_THE_TIME = (0.02, 0.98)
ROUNDED = 0.02  # of the torque's rms: a coarser rounding is reported


def read_log(
    source: str | os.PathLike[str] | NamedArrays,
    *,
    columns: Columns = None,
    torque_scale: float = 1.0,
    linear: bool | None = None,
    dt: float | None = None,
    name: str | None = None,
    repair: bool = False,
    require: tuple[str, ...] = ("torque", "velocity or position"),
    start: float | None = None,
    stop: float | None = None,
    take_every: int = 1,
    strict: bool = False,
) -> Log:
    """Read a log onto one uniform clock, with a warning for everything that was changed in it.

    Args:
        source: path of a .csv (also spaces, tabs, semicolons, decimal commas, UTF-16, no header), .npz, .mat, .json,
            .wpilog, .parquet, .mcap or .db3 (ROS 2) file, or a DataFrame, or a mapping of arrays.
        columns: where the file's names or units differ from the canonical ones: "velocity=gyro_z:deg/s,torque=tau_cmd";
            with a factor "torque=vir*35.15:N"; a current with its scale in N m per A "torque=Iq:A*0.12"; counts
            "position=enc:counts/4096" (counts per turn) or "position=enc:counts*5e-8" (metres per count);
            "torque_measured=Iq:A*0.12" for a torque that the drive measured; "axis=2" of a robot (the third); a
            mapping of the same, or the preset "emps". A file without a header has columns 1, 2, .... A column that is
            not named here is found by its own name, with a unit in brackets ("velocity [deg/s]"), or in a table of the
            names that drives use, which a warning says.
        torque_scale: torque = torque_scale x the column (after its unit) [1].
        linear: whether the axis is linear (m, N); None to infer it from the units, rotary where they do not say.
        dt: control period [s] where it is known: needed for a file without a time column.
        name: for messages and pictures; None for the file's name.
        repair: without effect, accepted for old scripts: repairs are made by default.
        require: columns that must be there; "velocity or position" requires one of the two.
        start: earliest time kept [s], in the log's own time (of dates since 1970, in UTC); None for its beginning.
        stop: latest time kept [s]; None for its end.
        take_every: number of rows that become one: the mean of the torque over them, the motion at the first.
        strict: refuse a log in which anything would have to be changed.

    Returns:
        A `Log`; each entry of its `warnings` was also given as an `FpjaxWarning`.

    Raises:
        InputError: one sentence on the first thing that is wrong.
    """
    del repair
    mapping = parse_columns(columns)
    _check_options(dt, start, stop, take_every)
    begin, end = -np.inf if start is None else start, np.inf if stop is None else stop
    if isinstance(source, str | os.PathLike):
        path = expanded(source)
        name = name or path.name
        table = read_table(path, Request(mapping, _wanted(mapping, name), begin, end))
    else:
        path = None
        table, name = from_arrays(source), name or "the log"
    notes = list(table.warnings)
    sources, guessed = find_sources(_usable(table), mapping, name, table.units, _travel(table))
    notes += guessed + other_clocks(table.columns, sources, table.units, name) + _made_signed(table, sources, name)
    if dt is None and "time" not in sources and table.period is not None:
        dt = table.period
        notes.append(f"{name} has no time column: its head tells a row every {dt:.6g} s; say otherwise with --rate.")
    if table.headless:
        notes.append(f"{name} has no header: its columns are {listed(list(table.columns))}, counted from the left.")
    # a guessed column that holds text was a wrong guess; one that the user mapped is an error that `_in_si` names
    readable = {key for key, each in sources.items() if not (each.guessed and each.column in table.text)}
    _check_present(table, readable | ({"time"} if dt is not None else set()), ("time", *require), name)
    sources, unsized = without_unknown_sizes(sources, mapping, linear, name)
    notes += unsized + torque_without_unit(sources, mapping, name) + rates_without_angle(sources, name)
    notes += _epoch(table, sources, name)
    told = motion_of(sources)
    kind = linear if linear is not None else told
    found, label = _in_si(table, sources, kind, name)
    if "torque" in found and torque_scale != 1.0:
        found["torque"] = found["torque"] * torque_scale
    rows = _common_length(found, name)
    computed = _computed(found, sources, name, notes)
    if "time" not in found:
        assert dt is not None
        found["time"] = np.arange(rows) * dt
    taken = {each.column for each in sources.values()}
    extra = {key: values for key, values in table.columns.items() if key not in taken and values.size == rows}
    if len(extra) > MOST_EXTRA:
        notes.append(f"{name}: of {len(extra)} columns that are not mapped, the first {MOST_EXTRA} are kept.")
        extra = dict(list(extra.items())[:MOST_EXTRA])
    first_row = table.first_row
    del table
    # notes so far are on how the file was understood; those of a stretch are changes, which `strict` refuses
    parts = stretches(found, extra, name, first_row, (begin, end), dt, bool(kind))
    changes = [note for note in parts[0].notes if not isinstance(note, Doubt)]
    if strict and changes:
        raise InputError(f"{changes[0]} (strict: the log is refused for it.)")
    left = parts[0].uniform.time.size // take_every
    if left < SHORTEST:
        raise InputError(f"--every {take_every} leaves {left} rows of {name}: at least {SHORTEST} are needed.")
    measured = computed or ("torque" in sources and sources["torque"].measured)
    unit, digest = label or ("N" if kind else "N m"), "" if path is None else _file_hash(path)
    longest, *further = (
        replace(_as_log(each, take_every, measured), linear=bool(kind), torque_unit=unit, sha256=digest)
        for each in parts
        if each.uniform.time.size // take_every >= SHORTEST
    )
    log = replace(longest, warnings=(*notes, *longest.warnings)).with_further(further)
    for note in log.warnings:
        warnings.warn(note, FpjaxWarning, stacklevel=2)
    return log


def _as_log(stretch: Stretch, take_every: int, measured: bool) -> Log:
    """A stretch as a log, with what is noticed of its torque."""
    uniform, period, notes = stretch.uniform, stretch.dt, stretch.notes
    if take_every > 1:
        uniform, period = every(uniform, take_every, stretch.name, notes), period * take_every
    lag = _about_torque(uniform, stretch.step, measured, period, stretch.name, notes)
    motion = uniform.columns
    return Log(
        time=uniform.time,
        torque=motion["torque"] if "torque" in motion else np.zeros_like(uniform.time),
        velocity=motion.get("velocity"),
        position=motion.get("position"),
        reference=motion.get("reference"),
        dt=period,
        name=stretch.name,
        extra={**uniform.extra, **{key: motion[key] for key in ("torque_measured", "temperature") if key in motion}},
        warnings=tuple(notes),
        jitter=stretch.jitter,
        torque_step=stretch.step,
        torque_measured=measured,
        torque_lag=lag,
        resampled=uniform.resampled,
        since=stretch.since,
    )


def _check_options(dt: float | None, start: float | None, stop: float | None, take_every: int) -> None:
    if dt is not None and not (np.isfinite(dt) and dt > 0.0):
        raise InputError(f"dt must be a positive control period, got {dt:g} s; 0.001 s is usual.")
    if start is not None and stop is not None and not start < stop:
        raise InputError(f"--from {start:.13g} must be before --to {stop:.13g}.")
    if (start is not None and np.isnan(start)) or (stop is not None and np.isnan(stop)):
        raise InputError("--from and --to must be times in seconds, got a value that is not a number.")
    if take_every < 1:
        raise InputError(f"--every must be a whole number of rows from 1 on, got {take_every}.")


def _wanted(mapping: dict[str, str], name: str) -> Any:
    """For readers of large files: gives the time column, its factor to seconds and all needed columns."""

    def wanted(names: list[str], units: dict[str, str]) -> tuple[str, float, list[str]]:
        sources, _ = find_sources(names, mapping, name, units)
        time = sources.get("time")
        factor = 1.0
        if time is not None and time.unit is not None and find_unit(time.unit) is not None:
            factor = scale_of("time", time, None)[0]
        return time.column if time else "", factor, [source.column for source in sources.values()]

    return wanted


def _usable(table: RawTable) -> list[str]:
    """Names of the columns, those of numbers first, so that a guess prefers them to text."""
    return [*table.columns, *table.text]


def _travel(table: RawTable) -> Callable[[str], float]:
    """Range of a column without the 2 % of its values at either end; 0 for text."""

    def travel(column: str) -> float:
        values = table.columns.get(column)
        known = values[np.isfinite(values)] if values is not None else np.zeros(0)
        return float(np.ptp(np.quantile(known, MOST_OF_THE_TIME))) if known.size else 0.0

    return travel


def _made_signed(table: RawTable, sources: Mapping[str, Source], name: str) -> list[str]:
    """Restore the signs of columns that were recorded as unsigned, in the table; a sentence for each."""
    said = []
    for canonical, source in sources.items():
        if canonical in ("time", "temperature") or source.column not in table.columns:
            continue
        mended = signed(table.columns[source.column])
        if mended is not None:
            table.columns[source.column], example = mended
            said.append(
                f"{name}: {source.column!r} holds signed 16-bit numbers that were read as unsigned ({example}): they "
                f"were made signed."
            )
    return said


def _epoch(table: RawTable, sources: dict[str, Source], name: str) -> list[str]:
    """Give stamps that count from 1970 their unit, in the sources; a sentence on it."""
    time = sources.get("time")
    if time is None or time.unit is not None or time.factor != 1.0 or time.column not in table.columns:
        return []
    unit = since_1970(table.columns[time.column])
    if not unit:
        return []
    sources["time"] = time._replace(unit=unit)
    return [f"{name}: the stamps in {time.column!r} count {unit} since 1970."]


def _in_si(
    table: RawTable, sources: Mapping[str, Source], linear: bool | None, name: str
) -> tuple[dict[str, np.ndarray], str]:
    """Canonical columns in SI, and the label that replaces N m ("" where the torque is in SI)."""
    found, label = {}, ""
    for canonical, source in sources.items():
        if source.column in table.text:
            if source.guessed:
                continue
            raise InputError(f"{name}: {table.text[source.column]}, so it cannot be {canonical}: repair that column.")
        factor, own = scale_of(canonical, source, linear)
        label = own if canonical == "torque" and own else label
        values = table.columns[source.column]
        with np.errstate(over="ignore", invalid="ignore"):
            found[canonical] = values if factor == 1.0 else values * factor
    return found, label


def _file_hash(path: pathlib.Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _computed(found: dict[str, np.ndarray], sources: Mapping[str, Source], name: str, notes: list[str]) -> bool:
    """Whether the torque is the measured torque times a constant; then the measured one is removed, with a note."""
    if not {"torque", "torque_measured"} <= set(found):
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        ratio = constant_ratio(found["torque"], found["torque_measured"])
    if ratio is None:
        return False
    notes.append(
        f"{name}: {sources['torque'].column!r} is {ratio:.6g} times {sources['torque_measured'].column!r} in every "
        "row: it was computed from the measured torque and not commanded."
    )
    del found["torque_measured"]
    return True


def _check_present(table: RawTable, found: set[str], require: tuple[str, ...], name: str) -> None:
    lacking = [wanted for wanted in require if not set(wanted.split(" or ")) & found]
    if not lacking:
        return
    names = list(table.columns) + list(table.text)
    if table.headless:
        said = "so its columns must be named by their places"
        if found:
            said = f"and none of its columns was named for {' or for '.join(lacking)}"
        raise InputError(f"{name} has no header, {said}: {described(table.columns)}.")
    if table.unread:
        raise InputError(f"{name} has no column {' and no column '.join(lacking)} of numbers; {table.unread}.")
    sentence = missing_sentence(names, lacking, name)
    if len(names) == 2 and lacking != ["time"]:
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


def _about_torque(
    uniform: Uniform, step: float, measured: bool, dt: float, name: str, notes: list[str]
) -> float | None:
    """The lag of a measured torque [s], or None; and notes on the torque's rounding, noise and delay."""
    torque = uniform.columns.get("torque")
    if torque is None:
        return None
    lag, size = None, float(np.sqrt(np.mean(torque**2)))
    if step > ROUNDED * size > 0.0:
        notes.append(f"{name}: the torque is rounded to steps of {step:.4g}, {100 * step / size:.2g} % of its rms.")
    if measured and np.ptp(torque) > 0.0:
        notes.append(
            f"{name}: the torque was measured by the drive, not commanded: it may lag, and has noise of about "
            f"{noise_level(torque, step):.2g}."
        )
    if "torque_measured" in uniform.columns:
        both = following(torque, uniform.columns["torque_measured"], dt)
        if both is None and related(torque, uniform.columns["torque_measured"]):
            notes.append(f"{name}: the measured torque follows the commanded one; how late it is its noise hides.")
        elif both is None:
            notes.append(f"{name}: the measured torque is unlike the commanded one at any lag: check both columns.")
        else:
            lag = both.lag
            notes.append(
                f"{name}: the measured torque follows the commanded one by {1e3 * both.lag:.3g} ms, {both.gain:.3g} "
                f"times as large (correlation {both.correlation:.2f})."
            )
    return lag
