"""Recorded messages of several topics, turned into columns."""

import pathlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from ...errors import InputError
from .join_topics import Topics, joined
from .table import RawTable, Request

MOST_ELEMENTS = 16  # of an array field: joint states are short, images are not columns
Message = tuple[str, int, Any]  # topic, time of logging [ns], decoded message


def gathered(messages: Iterable[Message], path: pathlib.Path, request: Request) -> RawTable:
    """Every number in every message, as columns "/topic.field" (array elements "/topic.field.0"), and "time".

    The stamps are those of the topic with the torque (see `join`): the header's stamp where a message has one, else
    the time of logging, which is later by the transport.

    Raises:
        InputError: where no message holds a number.
    """
    topics: dict[str, dict[str, list[float]]] = {}
    for topic, log_time, message in messages:
        fields: dict[str, float] = {}
        _flatten(fields, "", message)
        series = topics.setdefault(topic, {"": []})
        series[""].append(_stamp(message, log_time))
        for name, value in fields.items():
            column = series.setdefault(name, [])
            # a field that was not in earlier messages (arrays may grow) is NaN there
            column.extend([float("nan")] * (len(series[""]) - 1 - len(column)))
            column.append(value)
    numeric: Topics = {}
    for topic, series in topics.items():
        stamps = np.asarray(series.pop(""))
        if series and stamps.size > 1:
            padding = {name: values + [float("nan")] * (stamps.size - len(values)) for name, values in series.items()}
            numeric[topic] = (stamps, {topic + name: np.asarray(values) for name, values in padding.items()})
    if not numeric:
        raise InputError(f"{path.name} holds no numeric messages: its topics are {', '.join(topics) or 'none'}.")
    return joined(numeric, request)


def _stamp(message: Any, log_time: int) -> float:
    header = message.get("header") if isinstance(message, dict) else getattr(message, "header", None)
    stamp = header.get("stamp") if isinstance(header, dict) else getattr(header, "stamp", None)
    if stamp is None:
        return log_time * 1e-9
    parts: Any = stamp if isinstance(stamp, dict) else {name: getattr(stamp, name, 0) for name in ("sec", "nanosec")}
    return float(parts.get("sec", 0)) + float(parts.get("nanosec", 0)) * 1e-9 or log_time * 1e-9


def _flatten(fields: dict[str, float], prefix: str, value: Any) -> None:
    if isinstance(value, bool | int | float):
        fields[prefix] = float(value)
    elif isinstance(value, dict):
        for name, inner in value.items():
            if f"{prefix}.{name}" == ".header":  # its stamp is the time
                continue
            _flatten(fields, f"{prefix}.{name}", inner)
    elif isinstance(value, list | tuple | np.ndarray):
        if len(value) <= MOST_ELEMENTS:
            for index, inner in enumerate(value):
                _flatten(fields, f"{prefix}.{index}", inner)
    elif hasattr(value, "__slots__"):
        for name in value.__slots__:
            if f"{prefix}.{name.removeprefix('_')}" == ".header":
                continue
            _flatten(fields, f"{prefix}.{name.removeprefix('_')}", getattr(value, name))
