"""Output that is read no further, or cannot be written: the command goes on and writes its files."""

import contextlib
import os
import sys
from collections.abc import Iterable, Iterator
from typing import Any


class _Output:
    """A stream that turns to nothing once its reader, such as `head`, has closed the pipe, or it cannot be written.

    Attributes:
        lost: why it could not be written, as on a full disk; "" where it could, or nobody reads it.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.lost = ""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str, /) -> int:
        try:
            self._stream.write(text)
        except OSError as error:
            self._to_nothing(error)
        return len(text)

    def writelines(self, lines: Iterable[str], /) -> None:
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            self._to_nothing(error)

    def _to_nothing(self, error: OSError) -> None:
        if not isinstance(error, BrokenPipeError):
            self.lost = error.strerror or type(error).__name__
        # What the stream still holds goes there too, when the interpreter flushes it at its end.
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, self._stream.fileno())
        os.close(nothing)


@contextlib.contextmanager
def reader_may_leave() -> Iterator[Any]:
    """Within the block, a pipe that is closed at its other end takes what is printed and shows it to nobody.

    Yields:
        The standard output, whose `lost` says why it could not be written.
    """
    with contextlib.ExitStack() as stack:
        nothing = stack.enter_context(open(os.devnull, "w"))
        out, error = (_Output(nothing if stream is None else stream) for stream in (sys.stdout, sys.stderr))
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(error))
        try:
            yield out
        finally:
            out.flush()
            error.flush()
