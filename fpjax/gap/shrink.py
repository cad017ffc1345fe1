"""Shrink: how large the gap is before and after, and after each cause, on withheld data."""

import dataclasses
from typing import Any

import numpy as np

from . import assemble
from .attribute import Fitted, Search
from .decision import Decision
from .diagnosis import Gap, Step
from .measure import measure_gap, noise_floor, rms, rms_interval


def gap_and_steps(search: Search, decision: Decision, compared: tuple[Any, ...]) -> tuple[Gap, tuple[Step, ...]]:
    """The gap on withheld data, and the ladder."""
    before, after, measured = [], [], []
    for c in compared:
        keep = c.withheld & np.isfinite(c.before) & np.isfinite(c.after)
        before.append((c.before - c.measured)[keep])
        after.append((c.after - c.measured)[keep])
        measured.append(c.after - c.measured)
    first = compared[0]
    if search.imposed:
        floor = assemble.torque_floor_of(search, decision.chosen)
    else:
        floor = noise_floor(first.measured, measured[0], search.records[0].reference)
    if not search.imposed and decision.structure < 1.05:
        # Nothing but noise is left: then what is left is the best estimate of the floor.
        level = min(rms(np.concatenate(after)), rms(np.concatenate(before)))
        floor = dataclasses.replace(floor, value=level, interval=rms_interval(np.concatenate(after)))
    gap = measure_gap(np.concatenate(before), np.concatenate(after), floor, signal=first.signal, unit=first.unit)
    steps = []
    for previous, fitted in zip(decision.path[:-1], decision.path[1:], strict=True):
        left = []
        for which, c in enumerate(compared):
            trace = assemble.residual_trace(search, fitted, which)
            left.append(trace[c.withheld & np.isfinite(trace)])
        added = next((n for n in fitted.names if n not in previous.names), fitted.names[-1])
        values = np.concatenate(left)
        steps.append(Step(added, rms(values), rms_interval(values)))
    return gap, tuple(steps)


def withheld_rms(search: Search, fitted: Fitted) -> float:
    """What a fit leaves of the channel that the gap is told in, rms over the withheld windows, in its unit."""
    found = []
    for which in range(len(search.records)):
        _, withheld = assemble.window_of(search, which)
        trace = assemble.residual_trace(search, fitted, which)
        found.append(trace[withheld & np.isfinite(trace)])
    return rms(np.concatenate(found))
