"""MCAP recordings (ROS 2 or JSON messages), with the `logs` extra; topics are brought to the stamps of one topic."""

import json
import pathlib
from collections.abc import Iterator

from ...errors import InputError
from .messages import Message, gathered
from .table import RawTable, Request, need


def read(path: pathlib.Path, request: Request) -> RawTable:
    """Every number in every message, as `messages.gathered` names them.

    Raises:
        InputError: without the extra, or for a file that is not MCAP.
    """
    need("mcap_ros2.decoder", path)
    try:
        return gathered(_messages(path), path, request)
    except InputError:
        raise
    except Exception as error:  # the mcap readers raise a family of their own for damaged files
        first = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise InputError(f"{path.name} cannot be read as an MCAP recording ({first}): record it again.") from error


def _messages(path: pathlib.Path) -> Iterator[Message]:
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
            yield channel.topic, message.log_time, decoded
