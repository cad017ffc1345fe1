"""WPILOG, the data log of WPILib: numbers and short arrays of numbers, each entry with its own stamps.

Format: "WPILib Data Log File Format Specification", version 1.0. All integers are little-endian. A record consists of
one byte with the lengths of the next three fields, the entry's number, the payload's size, the stamp in microseconds,
and the payload. Records of entry 0 start, end and describe the other entries.
"""

import pathlib
import struct
from typing import NamedTuple

import numpy as np

from ...errors import InputError
from .join_topics import Topics, joined
from .table import RawTable, Request

_TYPES = {"double": "<f8", "float": "<f4", "int64": "<i8", "boolean": "?"}
MOST_ELEMENTS = 16  # of an array: swerve states are short, images are not columns


class _Entry(NamedTuple):
    name: str
    kind: np.dtype
    array: bool
    stamps: list[int]
    values: list[bytes]


def read(path: pathlib.Path, request: Request) -> RawTable:
    """Every number of every entry, as columns by the entry's name (array elements "name.0"), and "time".

    Raises:
        InputError: for a file that is not a WPILOG, or holds no numbers.
    """
    raw = path.read_bytes()
    if len(raw) < 12 or not raw.startswith(b"WPILOG"):
        raise InputError(f"{path.name} is not a WPILOG file (it does not begin with WPILOG): record it again.")
    entries, cut = _entries(raw)
    topics: Topics = {}
    for entry in entries:
        fields = _fields(entry)
        if fields is not None:
            stamps, values = fields
            low, high = request.start, request.stop
            keep = (stamps >= low) & (stamps <= high) if request.cuts else np.ones(stamps.size, bool)
            if keep.sum() > 1:
                topics[entry.name] = (stamps[keep], {name: each[keep] for name, each in values.items()})
    if not topics:
        raise InputError(f"{path.name} holds no entries of numbers: log torque and position as doubles.")
    table = joined(topics, request)
    if cut:
        table.warnings.append(f"{path.name} ends within its last record, which was dropped.")
    return table


def _entries(raw: bytes) -> tuple[list[_Entry], bool]:
    """The entries with their records, and whether the file ends within a record."""
    # header: "WPILOG", two bytes of version, four bytes with the length of an extra text, that text
    at = 12 + struct.unpack_from("<I", raw, 8)[0]
    found: list[_Entry] = []
    by_number: dict[int, _Entry | None] = {}
    while at < len(raw):
        # bits 0-1, 2-3 and 4-6: the number of bytes, less one, of the entry's number, of the size and of the stamp
        lengths = raw[at]
        size_number, size_length, size_stamp = (lengths & 3) + 1, (lengths >> 2 & 3) + 1, (lengths >> 4 & 7) + 1
        begin = at + 1 + size_number + size_length + size_stamp
        number = int.from_bytes(raw[at + 1 : at + 1 + size_number], "little")
        length = int.from_bytes(raw[at + 1 + size_number : at + 1 + size_number + size_length], "little")
        stamp = int.from_bytes(raw[begin - size_stamp : begin], "little")
        if begin + length > len(raw):
            return found, True
        if number == 0:
            _control(raw[begin : begin + length], by_number, found)
        elif (entry := by_number.get(number)) is not None:
            entry.stamps.append(stamp)
            entry.values.append(raw[begin : begin + length])
        at = begin + length
    return found, False


def _control(payload: bytes, by_number: dict[int, _Entry | None], found: list[_Entry]) -> None:
    # A control record begins with its type (0: start of an entry) and the entry's number; name and type of the entry
    # follow, each with its length before it.
    if len(payload) < 9 or payload[0] != 0:
        return
    number = struct.unpack_from("<I", payload, 1)[0]
    words, at = [], 5
    for _ in range(2):
        if at + 4 > len(payload):
            return
        length = struct.unpack_from("<I", payload, at)[0]
        words.append(payload[at + 4 : at + 4 + length].decode("utf-8", "replace"))
        at += 4 + length
    plain = words[1].removesuffix("[]")
    by_number[number] = None
    if plain in _TYPES:
        same = next((e for e in found if e.name == words[0] and e.kind == np.dtype(_TYPES[plain])), None)
        entry = same or _Entry(words[0], np.dtype(_TYPES[plain]), words[1].endswith("[]"), [], [])
        by_number[number] = entry
        if same is None:
            found.append(entry)


def _fields(entry: _Entry) -> tuple[np.ndarray, dict[str, np.ndarray]] | None:
    """(stamps [s], columns by name) from the records that have the most frequent length of the entry."""
    if not entry.values:
        return None
    sizes = np.array([len(value) for value in entry.values])
    usual = int(np.bincount(sizes).argmax()) if sizes.max() < 1 << 16 else -1
    width = usual // entry.kind.itemsize if usual > 0 else 0
    if width == 0 or width * entry.kind.itemsize != usual or width > MOST_ELEMENTS:
        return None
    keep = np.flatnonzero(sizes == usual)
    values = np.frombuffer(b"".join(entry.values[k] for k in keep), dtype=entry.kind).reshape(-1, width)
    stamps = np.array([entry.stamps[k] for k in keep], dtype=np.float64) * 1e-6
    names = [f"{entry.name}.{index}" for index in range(width)] if entry.array else [entry.name]
    with np.errstate(invalid="ignore"):  # a NaN of any kind stays one
        return stamps, {name: values[:, k].astype(np.float64) for k, name in enumerate(names[:width])}
