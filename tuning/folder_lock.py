"""A lock on a folder: one process at a time; the operating system releases it when the process ends, even if killed."""

import contextlib
import errno
import os
import socket
import sys
import warnings
from pathlib import Path

from fpjax.errors import FpjaxWarning, InputError

NAME = ".lock"
# errno of file systems that have no locks (some network file systems).
_NO_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK, errno.EINVAL}


class FolderLock:
    """A lock held from construction until `release` or the end of the process.

    The file is left behind on purpose. If it were deleted, one process could hold a lock on the deleted file while
    another one locks a new file of the same name.
    """

    def __init__(self, folder: Path):
        """Take the lock.

        Args:
            folder: an existing folder.

        Raises:
            InputError: where another process holds it.
            OSError: where the folder cannot be written.
        """
        path = folder / NAME
        self._handle: int | None = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NONBLOCK", 0), 0o666)
        try:
            _lock(self._handle)
        except OSError as error:
            if error.errno in _NO_LOCKS:
                warnings.warn(
                    f"{folder} is on a file system without locks: make sure that no other sweep writes there.",
                    FpjaxWarning,
                    stacklevel=3,
                )
                return
            owner = _owner(path)
            self.release()
            raise InputError(
                f"{folder} belongs to a sweep that is still running{owner}: wait for it, end it, or use another folder."
            ) from None
        with contextlib.suppress(OSError):
            os.ftruncate(self._handle, 0)
            os.write(self._handle, f"process {os.getpid()} on {socket.gethostname()}".encode())

    def release(self) -> None:
        """Release the lock; a second call does nothing."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def _owner(path: Path) -> str:
    """The process that wrote its name into the lock file, in brackets; "" where it cannot be read."""
    try:
        words = path.read_text(errors="replace")[:100]
    except OSError:
        return ""
    return f" ({words})" if words else ""


def _lock(handle: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        # msvcrt locks bytes against reading too: a byte far beyond the owner's name leaves that readable.
        os.lseek(handle, 1 << 20, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        os.lseek(handle, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
