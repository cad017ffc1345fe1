"""Output that nobody reads any more: a command whose reader has enough goes on and writes its files."""

import contextlib
import os
import sys
from collections.abc import Iterable, Iterator
from typing import Any


class _Output:
    """A stream that turns to nothing once its reader, such as `head`, has closed the pipe."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str, /) -> int:
        try:
            self._stream.write(text)
        except BrokenPipeError:
            self._to_nothing()
        return len(text)

    def writelines(self, lines: Iterable[str], /) -> None:
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except BrokenPipeError:
            self._to_nothing()

    def _to_nothing(self) -> None:
        # What the stream still holds goes there too, when the interpreter flushes it at its end.
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, self._stream.fileno())
        os.close(nothing)


@contextlib.contextmanager
def reader_may_leave() -> Iterator[None]:
    """Within the block, a pipe that is closed at its other end takes what is printed and shows it to nobody."""
    with contextlib.ExitStack() as stack:
        nothing = stack.enter_context(open(os.devnull, "w"))
        out, error = (_Output(nothing if stream is None else stream) for stream in (sys.stdout, sys.stderr))
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(error))
        try:
            yield
        finally:
            out.flush()
            error.flush()
