"""MCAP recordings (ROS 2 or JSON messages), by the `logs` extra; topics are brought onto one topic's stamps."""

import json
import pathlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from .table import Table, need

MOST_ELEMENTS = 16  # of an array field: joint states are short, images are not columns


def read(path: pathlib.Path, wanted: Mapping[str, str]) -> Table:
    """Every number in every message, as columns "/topic.field" (array elements "/topic.field.0"), and "time".

    The stamps are those of the topic that carries the torque (or, where none is mapped, of the topic with the most
    messages): the header's stamp where a message has one, else the time of logging. Other topics are interpolated
    onto them, and a warning says so.

    Raises:
        InputError: without the extra, or for a file that is no MCAP.
    """
    need("mcap_ros2.decoder", path)
    topics: dict[str, dict[str, list[float]]] = {}
    try:
        for topic, stamp, message in _messages(path):
            fields: dict[str, float] = {}
            _flatten(fields, "", message)
            series = topics.setdefault(topic, {"": []})
            series[""].append(stamp)
            for name, value in fields.items():
                column = series.setdefault(name, [])
                column.extend([float("nan")] * (len(series[""]) - 1 - len(column)))
                column.append(value)
    except InputError:
        raise
    except Exception as error:  # the mcap readers raise a family of their own for damaged files
        first = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise InputError(f"{path.name} is no MCAP recording that can be read ({first}): record it again.") from error
    numeric = {topic: series for topic, series in topics.items() if len(series) > 1}
    if not numeric:
        raise InputError(f"{path.name} holds no numeric messages: its topics are {', '.join(topics) or 'none'}.")
    return _joined(numeric, _base_topic(numeric, wanted))


def _messages(path: pathlib.Path) -> Iterator[tuple[str, float, Any]]:
    from mcap.reader import make_reader  # type: ignore[import-not-found]
    from mcap_ros2.decoder import DecoderFactory  # type: ignore[import-not-found]

    factory = DecoderFactory()
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.message_encoding == "json":
                decoded = json.loads(message.data)
            else:
                decode = factory.decoder_for(channel.message_encoding, schema)
                if decode is None:
                    continue
                decoded = decode(message.data)
            yield channel.topic, _stamp(decoded, message.log_time), decoded


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
            _flatten(fields, f"{prefix}.{name}", inner)
    elif isinstance(value, list | tuple | np.ndarray):
        if len(value) <= MOST_ELEMENTS:
            for index, inner in enumerate(value):
                _flatten(fields, f"{prefix}.{index}", inner)
    elif hasattr(value, "__slots__"):
        for name in value.__slots__:
            _flatten(fields, f"{prefix}.{name.removeprefix('_')}", getattr(value, name))


def _base_topic(topics: Mapping[str, Any], wanted: Mapping[str, str]) -> str:
    chosen = wanted.get("torque") or wanted.get("velocity") or wanted.get("position") or ""
    named = [topic for topic in topics if chosen.startswith(f"{topic}.")]
    return max(named, key=len) if named else max(topics, key=lambda topic: len(topics[topic][""]))


def _joined(topics: Mapping[str, dict[str, list[float]]], base: str) -> Table:
    stamps = np.asarray(topics[base][""])
    columns: dict[str, np.ndarray] = {"time": stamps - stamps[0] if stamps.size else stamps}
    others = []
    for topic, series in topics.items():
        own = np.asarray(series[""])
        for name, values in series.items():
            if not name:
                continue
            padded = np.asarray(values + [float("nan")] * (own.size - len(values)))
            columns[topic + name] = padded if topic == base else np.interp(stamps, own, padded)
        others += [] if topic == base else [topic]
    warnings = []
    if others:
        warnings.append(f"Topics {', '.join(others)} were interpolated onto the stamps of {base}.")
    return Table(columns, first_row=1, warnings=warnings, time_known=True)
