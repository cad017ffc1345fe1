"""One owner of a folder at a time: a lock that the system itself gives back when its owner ends, however it ends."""

import contextlib
import errno
import os
import socket
import sys
import warnings
from pathlib import Path

from fpjax.errors import FpjaxWarning, InputError

NAME = ".lock"
_CANNOT = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK, errno.EINVAL}


class FolderLock:
    """Held from its making until `release`, or until the process ends.

    The file stays behind: taking it away would let two processes lock two files of one name.
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
            if error.errno in _CANNOT:
                warnings.warn(
                    f"{folder} is on a file system without locks: see to it that no other sweep writes there.",
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
        """Give it back; a second time does nothing."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def _owner(path: Path) -> str:
    try:
        words = path.read_text(errors="replace")[:100]
    except OSError:
        return ""
    return f" ({words})" if words else ""


def _lock(handle: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        # Far behind the text, so that others may read who owns it.
        os.lseek(handle, 1 << 20, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        os.lseek(handle, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
