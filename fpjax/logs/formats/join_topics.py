"""Topics with stamps of their own, brought to the stamps of one of them."""

from collections.abc import Mapping

import numpy as np

from ..columns.names import guess
from .table import RawTable, Request

Topics = dict[str, tuple[np.ndarray, dict[str, np.ndarray]]]  # by topic: its stamps [s], its fields


def joined(topics: Topics, request: Request) -> RawTable:
    """One table of all topics: a command is held until its next message, a measurement is interpolated.

    The stamps are those of the topic with the torque; where no torque is mapped or known by its name, those of the
    topic with the most messages.

    Args:
        topics: each with at least two messages, fields by their full column name.
        request: with the user's mapping of columns.
    """
    base = _base(topics, request.mapped)
    stamps = topics[base][0]
    order = np.argsort(stamps, kind="stable")
    stamps = stamps[order]
    columns: dict[str, np.ndarray] = {"time": stamps - stamps[0] if stamps.size else stamps}
    others = []
    for topic, (own, fields) in topics.items():
        if topic == base:
            columns.update({name: values[order] for name, values in fields.items()})
            continue
        others.append(topic)
        sorted_ = np.argsort(own, kind="stable")
        known = guess(fields, {})
        held = {each.column for kind in ("torque", "reference") for each in known.get(kind, [])}
        for name, values in fields.items():
            if name in held:
                last = np.searchsorted(own[sorted_], stamps, side="right") - 1
                columns[name] = values[sorted_][np.maximum(last, 0)]
            else:
                columns[name] = _between(stamps, own[sorted_], values[sorted_])
    warnings = []
    if others:
        shown = ", ".join(others[:6]) + (f" and {len(others) - 6} more" if len(others) > 6 else "")
        warnings.append(f"Topics {shown} were interpolated onto the stamps of {base} (commands held).")
    return RawTable(columns, first_row=1, warnings=warnings)


def _between(stamps: np.ndarray, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A measurement at other stamps; NaN more than a period before its first and after its last message."""
    period = float(np.median(np.diff(own)))
    outside = (stamps < own[0] - period) | (stamps > own[-1] + period)
    return np.where(outside, np.nan, np.interp(stamps, own, values))


def _base(topics: Topics, mapped: Mapping[str, str]) -> str:
    # a mapping is text such as "/topic.field:deg/s*2": it begins with the column's name; the longest fitting topic is
    # meant
    words = [mapped[name] for name in ("torque", "torque_measured", "velocity", "position") if name in mapped]
    for word in words:
        named = [t for t, (_, fields) in topics.items() if any(word.startswith(field) for field in fields)]
        if named:
            return max(named, key=len)
    by_name = guess([field for _, fields in topics.values() for field in fields], {})
    for kind in ("torque", "torque_measured"):
        for each in by_name.get(kind, [])[:1]:
            return next(topic for topic, (_, fields) in topics.items() if each.column in fields)
    return max(topics, key=lambda topic: topics[topic][0].size)
