"""ROS 2 bags in SQLite (.db3); topics are brought to the stamps of one topic. ROS need not be installed."""

import contextlib
import pathlib
import sqlite3
import struct
import urllib.parse
from collections.abc import Iterator

from ...errors import InputError
from .cdr import KNOWN, Definitions, decode, parse_definitions, short_name
from .messages import Message, gathered
from .table import RawTable, Request


def read(path: pathlib.Path, request: Request) -> RawTable:
    """Every number in every message whose type is known, as `messages.gathered` names them.

    Raises:
        InputError: for a file that is not such a bag, or has messages of unknown types only.
    """
    unknown: set[str] = set()
    try:
        uri = f"file:{urllib.parse.quote(str(path.absolute()))}?mode=ro"
        with contextlib.closing(sqlite3.connect(uri, uri=True)) as bag:
            table = gathered(_messages(bag, unknown), path, request)
    except InputError as error:
        if unknown and "no numeric messages" in str(error):
            raise InputError(
                f"{path.name} holds messages of types that are not known here ({', '.join(sorted(unknown)[:6])}): "
                f"record joint states, or convert the bag to MCAP, which holds its definitions."
            ) from error
        raise
    except (sqlite3.Error, struct.error, IndexError) as error:
        raise InputError(f"{path.name} cannot be read as a ROS 2 bag ({error}): record it again.") from error
    if unknown:
        table.warnings.append(
            f"{path.name}: topics of types that are not known were left out ({', '.join(sorted(unknown)[:6])})."
        )
    return table


def _messages(bag: sqlite3.Connection, unknown: set[str]) -> Iterator[Message]:
    definitions = dict(KNOWN) | _own(bag)
    for place, name, kind in bag.execute("SELECT id, name, type FROM topics").fetchall():
        for stamp, data in bag.execute(
            "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp", (place,)
        ):
            try:
                yield name, stamp, decode(data, short_name(kind), definitions)
            except KeyError:
                unknown.add(kind)
                break


def _own(bag: sqlite3.Connection) -> Definitions:
    """The message definitions in the bag itself; none in bags from before ROS Iron."""
    try:
        rows = bag.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        ).fetchall()
    except sqlite3.Error:
        return {}
    found: Definitions = {}
    for kind, encoding, text in rows:
        if encoding == "ros2msg":
            found |= parse_definitions(text, short_name(kind))
    return found
