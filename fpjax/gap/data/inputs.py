"""Inputs: logs and model are read, the logs put on one clock."""

import dataclasses
import os
from collections.abc import Sequence

import numpy as np

from ...logs import Log, LogSource, read_log
from ...logs.mending.resample import at_period
from ...model_file import Model, ModelSource, load_model
from .checks import SAME_PERIOD, wrong_kinds
from .record import FEWEST, LEAST, LONGEST, MOST, SECONDS

SIMILAR_PERIOD = 0.1  # relative difference of periods up to which logs are resampled onto that of the first
OTHER_PERIOD = 4.0  # ratio of periods above which logs are not put together: most of the faster one would be lost
ENOUGH = 0.9  # of the longest stretch's windows: shorter ones see less of a slow torque


def read_logs(logs: LogSource | Sequence[LogSource] | None) -> list[list[Log]]:
    """For each log (a `Log`, a path or a mapping of arrays) its longest stretch and the further ones that tell more."""
    if logs is None:
        return []
    several = isinstance(logs, Sequence) and not isinstance(logs, str | os.PathLike)
    every: Sequence[LogSource] = logs if several else [logs]  # pyright: ignore[reportAssignmentType]
    read = [one if isinstance(one, Log) else read_log(one) for one in every]
    given = {id(one) for one in read}  # a stretch that was given by itself is not taken twice
    return [_in_one_time([one, *(part for part in _that_tell_more(one) if id(part) not in given)]) for one in read]


def _that_tell_more(log: Log) -> list[Log]:
    """Further stretches of a log that could be diagnosed by themselves and look like it.

    One in which the machine rests is left out, or whose columns contradict each other where the log's own do not. So
    are those without a position: how far the machine went in the pause is not known, and what depends on the position
    would stand at another place there.
    """
    longest = min(SECONDS[1] / log.dt, max(LONGEST), log.samples / FEWEST)  # window of the log by itself [samples]
    parts, samples = [], log.samples
    for part in log.further:
        # Neither windows as short as a short stretch allows, nor parts of the log left out for another stretch.
        if part.position is None or part.samples < max(LEAST, ENOUGH * FEWEST * longest) or samples + len(part) > MOST:
            continue
        parts.append(part)
        samples += len(part)
    if not parts:
        return []
    wrong = wrong_kinds(log)
    return [part for part in parts if np.any(part.torque) and wrong_kinds(part) <= wrong]


def _in_one_time(logs: list[Log]) -> list[Log]:
    """Stretches whose time counts from the start of the first of them."""
    begin = min(log.since for log in logs)
    return [dataclasses.replace(log, since=log.since - begin) if begin else log for log in logs]


def on_one_clock(logs: Sequence[Log]) -> list[Log]:
    """The logs at one period: that of the first, from which drives of one kind differ by some per cent.

    Of runs that were recorded at different rates it is the longest: none is told more often than it was recorded. Those
    that differ by far are left as they are, and refused when they are put together.
    """
    if not logs:
        return []
    periods = [log.dt for log in logs]
    if max(periods) > OTHER_PERIOD * min(periods):
        return list(logs)
    period = max(periods) if max(periods) > (1.0 + SIMILAR_PERIOD) * min(periods) else periods[0]
    return [at_period(log, period) if abs(log.dt / period - 1.0) > SAME_PERIOD else log for log in logs]


def with_earlier_torque(log: Log, late: float, lag: float) -> Log:
    """The log with its torque as it acted, where it was recorded later.

    Args:
        log: as recorded.
        late: by how much [s].
        lag: the part of it that is the time constant of a first-order digital filter [s], which is taken back; the rest
            is a dead time, after which the last value stands for what follows.
    """
    row = np.arange(len(log.torque))
    torque = np.interp(row + (late - lag) / log.dt, row, log.torque)
    # y[k] = y[k-1] + (x[k] - y[k-1]) / (1 + p) is p rows late.
    torque = torque + lag / log.dt * np.diff(torque, prepend=torque[0])
    return dataclasses.replace(log, torque=torque)


def about_late_torque(logs: Sequence[Log], late: float, lag: float) -> str:
    """What was noticed of a torque that was recorded later than it acted, and done; as `with_earlier_torque`."""
    names = ", ".join(log.name for log in logs)
    said = f"{names}: the torque is recorded {1e3 * late:.3g} ms later than it acted"
    if lag > 0.0:
        said += f", {'' if lag == late else f'{1e3 * lag:.3g} ms of it '}as by a first-order filter"
    return f"{said}: the column was corrected before the gap was measured."


def read_model(model: ModelSource) -> Model:
    """A `Model`, or the path or text of one."""
    return model if isinstance(model, Model) else load_model(model)
