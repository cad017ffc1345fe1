"""run.json: the command, the inputs' hashes, seeds, versions and times, so that a figure can be traced.

A folder of results is marked with the file `run.unfinished` before the first result is written. `run.json` is written
last, and only then the mark is removed. A marked folder may hold outputs of two different runs, so readers refuse them.
"""

import contextlib
import datetime
import hashlib
import importlib.metadata
import json
import os
import pathlib
import platform
import secrets
import sys
import time
from collections.abc import Iterator
from typing import Any, BinaryIO

from .._version import __version__
from ..errors import InputError
from .json_object import JsonObject
from .paths import expanded

RUN, MARK = "run.json", "run.unfinished"
FINISHED = "finished.json"  # written last into a subfolder whose results are complete on their own
_PACKAGES = ("jax", "jaxlib", "numpy", "scipy", "equinox", "optax", "optimistix", "matplotlib")


class RunFile:
    """The provenance of a run, written beside its results.

    Attributes:
        folder: folder of the results; None for a run that writes nothing.
        command: the command as typed.
        inputs: the files read, with role, name, SHA-256 and size.
        seeds: of the random draws, by their purpose.
        seconds: wall time by stage [s].
        notes: sentences shown to the user.

    Raises:
        InputError: for a folder in which another folder has the name of a run file.
    """

    def __init__(self, folder: pathlib.Path | None, command: list[str]) -> None:
        for name in (RUN, MARK):
            if folder is not None and (folder / name).is_dir():
                raise InputError(
                    f"{folder / name} is a folder, and a run writes a file of that name: choose another --out."
                )
        self.folder, self.command = folder, command
        self.inputs: list[JsonObject] = []
        self.seeds: dict[str, int] = {}
        self.seconds: dict[str, float] = {}
        self.notes: list[str] = []
        self.outputs: list[str] = []
        self._marked, self._earlier = False, list[str]()
        self.started = datetime.datetime.now(datetime.UTC)
        self._begin = self._stage_begin = time.perf_counter()
        self._stage: str | None = None

    def read(self, path: str | os.PathLike[str], role: str) -> pathlib.Path:
        """Note an input file with its hash. A file that cannot be read is not noted: its own reader reports the error.

        Raises:
            InputError: for an output of a run that did not finish.
        """
        path = pathlib.Path(path)
        refuse_unfinished(path)
        try:
            if not path.is_file():  # reading a pipe or a device might never end
                return path
            digest, size = hashlib.sha256(), 0
            with path.open("rb") as stream:
                while block := stream.read(1 << 20):
                    digest.update(block)
                    size += len(block)
        except (OSError, ValueError):  # a name too long, a zero byte in it
            return path
        self.inputs.append({"role": role, "name": path.name, "sha256": digest.hexdigest(), "bytes": size})
        return path

    def stage(self, name: str) -> None:
        """Begin a stage; it ends with the next one."""
        self._end_stage()
        self._stage, self._stage_begin = name, time.perf_counter()

    def _end_stage(self) -> None:
        if self._stage is not None:
            spent = time.perf_counter() - self._stage_begin
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + spent
        self._stage = None

    def path(self, name: str) -> pathlib.Path:
        """The path of a result in the folder, noted as an output, after the folder was marked unfinished."""
        assert self.folder is not None
        if name not in self.outputs:
            self.outputs.append(name)
        self.mark()
        return self.folder / name

    def without(self, name: str) -> None:
        """This run has no such result: one that an earlier run left in the folder would pass for its own, and goes."""
        if self.folder is None:
            return
        self.mark()
        if name in self._earlier and name not in self.outputs:
            (self.folder / name).unlink(missing_ok=True)

    def mark(self) -> None:
        """Mark the folder unfinished, because from now on it may hold outputs of two runs."""
        if self.folder is None:
            return
        if not self._marked:
            # The outputs of an earlier run are noted in the mark: until this run has finished, they are refused too.
            run, unfinished = _read(self.folder / RUN), _read(self.folder / MARK)
            self._earlier = sorted({*_names(run, "outputs", "earlier"), *_names(unfinished, "outputs", "earlier")})
        content = {
            "command": self.command,
            "process": os.getpid(),
            "started": self.started.isoformat(timespec="seconds"),
            "outputs": self.outputs,
            "earlier": self._earlier,
        }
        write_json(self.folder / MARK, content)
        if not self._marked:  # only after the mark is on the disk: a crash in between leaves one of the two files
            (self.folder / RUN).unlink(missing_ok=True)
            sync_folder(self.folder)
        self._marked = True

    def write(self, status: str = "completed") -> None:
        """Write run.json, if there is a folder.

        A run that ends before its first output leaves an earlier complete run untouched. A run that ends after its
        first output, but not as "completed", leaves the folder marked. An interrupted run marks the folder in any case
        unless a complete run is there.
        """
        self._end_stage()
        if self.folder is None:
            return
        if status != "completed" and not self._marked and (_read(self.folder / RUN) or {}).get("status") == "completed":
            return
        if status == "interrupted" and not self._marked:
            self.mark()
        content = {
            "command": self.command,
            "status": status,
            "inputs": self.inputs,
            "outputs": self.outputs,
            "seeds": self.seeds,
            "versions": versions(),
            "started": self.started.isoformat(timespec="seconds"),
            "seconds": {
                **{name: round(spent, 3) for name, spent in self.seconds.items()},
                "total": round(time.perf_counter() - self._begin, 3),
            },
            "notes": self.notes,
        }
        # What runs before this one left here and this one did not write: a later one that lacks it knows it for theirs.
        earlier = [name for name in self._earlier if name not in self.outputs and (self.folder / name).exists()]
        write_json(self.folder / RUN, content | ({"earlier": earlier} if earlier else {}))
        if status == "completed":
            (self.folder / MARK).unlink(missing_ok=True)
            sync_folder(self.folder)


def refuse_unfinished(path: pathlib.Path) -> None:
    """Refuse a file that belongs to an unfinished run.

    Raises:
        InputError: for such a file.
    """
    for folder in (path.parent, path.parent.parent):  # a run over several logs has a subfolder for each
        mark = _read(folder / MARK)
        if mark is None or mark.get("process") == os.getpid():
            continue
        if folder != path.parent and (path.parent / FINISHED).exists():
            continue
        name = path.name if folder == path.parent else f"{path.parent.name}/{path.name}"
        if name in _names(mark, "outputs", "earlier"):
            raise InputError(_unfinished(path, folder / MARK, mark))


def _unfinished(path: pathlib.Path, marked: pathlib.Path, mark: JsonObject) -> str:
    command = mark.get("command")
    typed = " ".join(map(str, command)) if isinstance(command, list) else "fpjax"
    return (
        f"{path} is an output of a run that has not finished ({typed[:200]}, begun {mark.get('started')}): run that "
        f"again, or delete {marked} to use the file as it is."
    )


def read_run(folder: str | os.PathLike[str]) -> JsonObject:
    """The contents of `run.json` of a finished run.

    Args:
        folder: of the results.

    Raises:
        InputError: for a folder without run.json, or one that is marked unfinished.
    """
    folder = pathlib.Path(folder)
    if (folder / MARK).exists():
        raise InputError(f"{folder} holds a run that has not finished: run its command again.")
    content = _read(folder / RUN)
    if content is None:
        raise InputError(f"{folder} has no {RUN} that can be read: give the --out of a finished run.")
    if content.get("status") != "completed":
        ended = str(content.get("status"))[:40]
        raise InputError(f"{folder} holds a run that was not completed ({ended}): run its command again.")
    return content


def _read(path: pathlib.Path) -> JsonObject | None:
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _names(content: JsonObject | None, *keys: str) -> list[str]:
    lists = [(content or {}).get(key) for key in keys]
    return [name for each in lists if isinstance(each, list) for name in each if isinstance(name, str)]


def versions() -> dict[str, str]:
    """Versions of the packages on which a result may depend, without importing any of them."""
    found = {"fpjax": __version__, "python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    jax = sys.modules.get("jax")
    if jax is not None:
        found["backend"] = jax.default_backend()
    return found


def made_folder(folder: str | os.PathLike[str]) -> pathlib.Path:
    """The folder, created if missing.

    Raises:
        InputError: where it cannot be created.
    """
    folder = pathlib.Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be made ({error.strerror or error}): give a folder that can be written."
        ) from error
    return folder


def open_folder(out: str | os.PathLike[str] | None) -> pathlib.Path | None:
    """The folder of the results, created and tested for writing before anything is computed.

    Raises:
        InputError: where it cannot be written.
    """
    if out is None:
        return None
    if not os.fspath(out):
        raise InputError("The folder of the results is an empty text: name one, or give . for this folder.")
    folder = expanded(out)
    probe = folder / f".fpjax-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"{folder} cannot be written ({error.strerror or error}): give a folder that can be written."
        ) from error
    return folder


@contextlib.contextmanager
def whole_file(path: pathlib.Path) -> Iterator[BinaryIO]:
    """Write a file atomically: it appears under its name complete and on the disk, or not at all.

    Args:
        path: of the file; an earlier file of this name stays until the new one is complete.

    Yields:
        The file to write to.

    Raises:
        InputError: where it cannot be written, a full disk included; no partial file is left.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.partial")
    try:
        with partial.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
        sync_folder(path.parent)
    except BaseException as error:  # also after an interrupt no partial file is left
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(
                f"{path} cannot be written ({error.strerror or error}): use another folder, or make room there."
            ) from error
        raise


def sync_folder(folder: pathlib.Path) -> None:
    """Flush a folder's entries to the disk, which makes a rename in it permanent; where a system cannot, do nothing."""
    if os.name == "nt":  # Windows cannot open a folder, and its journal keeps the order of renames
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError:
        pass  # some network file systems cannot sync a folder; there the rename is on the server already
    finally:
        os.close(handle)


def write_whole(path: pathlib.Path, content: str | bytes) -> None:
    """Write a file atomically: complete, or not at all.

    Raises:
        InputError: where it cannot be written.
    """
    with whole_file(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def write_json(path: pathlib.Path, content: Any) -> None:
    """Write a JSON file; numbers that are not finite become null."""
    write_whole(path, json.dumps(plain(content), indent=1, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """A value as JSON can hold it: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, dict):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(part) for part in value]
    if isinstance(value, str | bool | int) or value is None:
        return value
    if isinstance(value, float):
        return value if value - value == 0.0 else None  # infinity less infinity is NaN, so false for both
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return str(value)
