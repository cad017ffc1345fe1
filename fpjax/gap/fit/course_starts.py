"""Course starts: start values that the course of a missing torque shows, each read from the log that shows it best."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..data.setting import Setting
from .candidate import NOMINAL
from .period_starts import repeating_waves, turning_weight
from .stribeck_starts import stribeck_rise


def with_course_starts(
    setting: Setting,
    records: Sequence[Record],
    train: Sequence[Values],
    courses: Sequence[Values],
    values: dict[str, float],
    given: Sequence[Values] | None = None,
) -> Setting:
    """Sizes with the periods, the unbalance and the Stribeck rise that courses of a missing torque show.

    Args:
        setting: sizes.
        records: of the logs.
        train: indices of the fitted windows, one array a record.
        courses: missing torque of a model along each record [N m], shape (samples,); NaN outside the fitted windows.
        values: of that model by name.
        given: likewise, of the model by which an unbalance is looked for; None for the same.
    """
    which, widest = longest_log(train), widest_log(records, train)
    return replace(
        setting,
        waves=repeating_waves(courses[widest], records[widest], setting),
        weight=turning_weight((courses if given is None else given)[widest], records[widest]),
        rise=stribeck_rise(courses[which], records[which], values, setting),
    )


def longest_log(train: Sequence[Values]) -> int:
    """Index of the log with the most fitted windows."""
    return max(range(len(train)), key=lambda i: len(train[i]))


def widest_log(records: Sequence[Record], train: Sequence[Values]) -> int:
    """Index of the log, of those with fitted windows, that travels furthest: there a torque repeats most often."""
    fitted = [i for i in range(len(records)) if len(train[i])]
    return max(fitted, key=lambda i: float(np.ptp(records[i].angle)))


def without_numbers(starts: tuple[Mapping[str, float], ...] | None) -> tuple[Mapping[str, float], ...] | None:
    """Starts by name, of a contact or a spring, without the nominal numbers: those hold beside the nominal model."""
    return None if starts is None else tuple({k: v for k, v in one.items() if k not in NOMINAL} for one in starts)
