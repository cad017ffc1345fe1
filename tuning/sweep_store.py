"""The finished chunks of a sweep: one file each, written atomically and checked when read, so that it can be resumed.

A chunk counts when its file is on the disk, has the length that its sweep needs, and ends in the SHA-256 of the
sweep's identity, its own number and its bytes: a damaged file, one of another sweep or one under another name is
computed again.
"""

import contextlib
import dataclasses
import hashlib
import io
import json
import os
import re
import stat
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import jax
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import PyTree

from fpjax.errors import FpjaxWarning, InputError
from fpjax.output.json_object import JsonObject
from fpjax.output.runfile import whole_file, write_whole

from .folder_lock import FolderLock
from .problem import Problem
from .result import versions
from .sweep_axis import Axis

MANIFEST = "sweep.json"
STEPPING = "step, duration or solver"
FORM = 4  # version of the file format; 1 had no checksums, 2 no parts, 3 references to the last digit
NAMED = 5  # most damaged chunks that a warning lists
_CHUNK_NAME = re.compile(r"chunk-(\d{7,})\.npy")
_PARTIAL_NAME = re.compile(r"\.(chunk-\d{7,}|cost)\.npy\..*\.partial")
# A chunk file: an .npy array, then this mark (7 bytes) and a SHA-256 (32 bytes).
_MARK = b"sha256:"
_TAIL = len(_MARK) + hashlib.sha256().digest_size


class SweepStore:
    """Where finished chunks go: a folder, or memory where there is none. One process at a time owns a folder.

    Attributes:
        folder: holds `sweep.json` and `chunk-NNNNNNN.npy`; None for memory.
        identity: `fingerprint` of the sweep; chunks of another sweep are refused.
    """

    def __init__(
        self,
        folder: str | Path | None,
        identity: str,
        total: int,
        columns: int,
        chunk: int,
        dtype: DTypeLike,
        *,
        resume: bool,
        parts: Mapping[str, str] | None = None,
    ):
        """Open the folder of a sweep, or create it.

        Args:
            folder: where chunks go; None for memory.
            identity: from `fingerprint`.
            total: candidates of the sweep.
            columns: costs of one candidate, one for each reference.
            chunk: candidates of one file.
            dtype: of the costs.
            resume: use the chunks that are there.
            parts: from `fingerprints`, to name what differs in a refused sweep.

        Raises:
            InputError: for a folder of another sweep, one that another process works in, or one that cannot be written.
        """
        self.folder = None if folder is None else Path(folder)
        self.identity, self._total, self._columns, self._chunk = identity, total, columns, chunk
        self._dtype = np.dtype(dtype)
        self._parts = dict(parts or {})
        self._pieces = -(-total // chunk)
        self._kept: dict[int, np.ndarray] = {}
        self._lock: FolderLock | None = None
        self._fresh = False  # whether this opening wrote the manifest
        if self.folder is None:
            if resume:
                raise InputError("resume=True needs the folder of the sweep that was stopped: give out=FOLDER.")
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock = FolderLock(self.folder)
        except OSError as error:
            raise InputError(
                f"The sweep cannot be kept in {self.folder} ({error.strerror or error}): give a folder that can be "
                "written."
            ) from error
        try:
            self._open(self.folder, resume)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "SweepStore":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if self.folder is not None and self._fresh and not self._numbers():
                with contextlib.suppress(OSError):  # nothing was computed: the folder is as free as before
                    (self.folder / MANIFEST).unlink()
        finally:
            self.close()

    def close(self) -> None:
        """Release the folder, for another process to use."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def _open(self, folder: Path, resume: bool) -> None:
        there = (folder / MANIFEST).exists()
        known = _read_manifest(folder / MANIFEST)
        if there and not resume:
            raise InputError(f"{folder} holds a sweep already: use resume=True to go on, or another folder.")
        if known is not None and known.get("form") != FORM:
            raise InputError(f"{folder} holds a sweep that another version of fpjax has kept: use another folder.")
        if known is not None and known.get("identity") != self.identity:
            raise InputError(
                f"{folder} holds another sweep (other {self._others(known)}): resume it as it was begun, or use "
                "another folder."
            )
        for entry in list(os.scandir(folder)):  # left by a killed writer: we hold the lock
            if _PARTIAL_NAME.fullmatch(entry.name):
                with contextlib.suppress(OSError):
                    os.unlink(entry.path)
        if known is not None:
            return
        # Chunks without a manifest: their checksums contain the identity, so that one good chunk proves whose they are.
        chunks = self._numbers()
        if there or chunks:
            if chunks and not any(isinstance(self._read(piece), np.ndarray) for piece in sorted(chunks)):
                raise InputError(
                    f"{folder / MANIFEST} is {'damaged' if there else 'missing'}, and no chunk beside it is one of this"
                    " sweep, so the folder may hold another one: use another folder."
                )
            _warn(f"{folder / MANIFEST} was {'damaged' if there else 'missing'}: it is written again.")
        content = {
            "form": FORM,
            "identity": self.identity,
            "parts": self._parts,
            "candidates": self._total,
            "chunk": self._chunk,
            "columns": self._columns,
            "dtype": self._dtype.str,
            "versions": versions(),
        }
        write_whole(folder / MANIFEST, json.dumps(content | {"sha256": _checksum(content)}, indent=1))
        self._fresh = True

    def _others(self, known: JsonObject) -> str:
        """Which parts of the sweep in the folder are not this one's; all that may be, where it does not say."""
        theirs = known.get("parts")
        theirs = theirs if isinstance(theirs, dict) else {}
        differing = [part for part, own in self._parts.items() if theirs.get(part, own) != own]
        if STEPPING in differing and "reference" in differing:
            differing.remove("reference")  # it is kept as tables at the steps, which differ with them
        return ", ".join(differing) or "axes, loop, reference, settings or versions"

    def path(self, piece: int) -> Path:
        """The file of one chunk."""
        assert self.folder is not None
        return chunk_path(self.folder, piece)

    def finished(self) -> set[int]:
        """Numbers of the chunks that are there and undamaged; a damaged one counts as missing, with a warning."""
        if self.folder is None:
            return set(self._kept)
        found, damaged = set(), {}
        # Every file is read and checked: a damaged one must not count as a result.
        for piece in self._numbers():
            read = self._read(piece)
            if isinstance(read, np.ndarray):
                found.add(piece)
            else:
                damaged[piece] = read
        if damaged:
            named = [f"{self.path(piece).name} {damaged[piece]}" for piece in sorted(damaged)[:NAMED]]
            more = f" and {len(damaged) - NAMED} more" if len(damaged) > NAMED else ""
            _warn(
                f"{len(damaged)} of {len(found) + len(damaged)} chunks in {self.folder} cannot be used "
                f"({', '.join(named)}{more}): they are computed again."
            )
        return found

    def missing(self, finished: set[int]) -> Iterator[int]:
        """Numbers of the chunks still to be computed, as a generator: a large sweep has millions of them.

        Args:
            finished: numbers of the chunks that are there.
        """
        return (piece for piece in range(self._pieces) if piece not in finished)

    def keep(self, piece: int, costs: np.ndarray) -> None:
        """Keep one finished chunk, shape (candidates, columns); on return it is on the disk.

        Raises:
            InputError: where it cannot be written.
        """
        if self.folder is None:
            self._kept[piece] = costs
        else:
            write_chunk(self.folder, self.identity, piece, costs)

    def assemble(self) -> np.ndarray:
        """All costs, shape (candidates, columns): an array in memory, or with a folder a memory map of its `cost.npy`.

        Raises:
            InputError: where `cost.npy` cannot be written, or a chunk was damaged since it was written.
        """
        if self.folder is None:
            return np.concatenate([self._kept[piece] for piece in range(self._pieces)])
        # Written as a stream: writing through a memory map to a full disk kills the process (SIGBUS) without an error.
        header = {"descr": self._dtype.str, "fortran_order": False, "shape": (self._total, self._columns)}
        with whole_file(self.folder / "cost.npy") as file:
            np.lib.format.write_array_header_1_0(file, header)
            for piece in range(self._pieces):
                costs = self._read(piece)
                if not isinstance(costs, np.ndarray):
                    raise InputError(
                        f"{self.path(piece)} {costs}, though it was undamaged when this sweep read it first: check the "
                        "disk, then run the sweep again with resume=True."
                    )
                file.write(costs.tobytes())
        return np.load(self.folder / "cost.npy", mmap_mode="r")

    def _numbers(self) -> set[int]:
        assert self.folder is not None
        found = (_CHUNK_NAME.fullmatch(entry.name) for entry in os.scandir(self.folder))
        return {int(match[1]) for match in found if match and int(match[1]) < self._pieces}

    def _read(self, piece: int) -> np.ndarray | str:
        """The costs of a chunk, or what is wrong with its file, as the end of a sentence."""
        shape = (min(self._total, (piece + 1) * self._chunk) - piece * self._chunk, self._columns)
        try:
            # Only a regular file is opened: opening a FIFO would wait for a writer for ever.
            if not stat.S_ISREG(self.path(piece).lstat().st_mode):
                return "is not a file"
            content = self.path(piece).read_bytes()
        except OSError as error:
            return f"cannot be read ({error.strerror or error})"
        body, mark, digest = content[:-_TAIL], content[-_TAIL : len(_MARK) - _TAIL], content[len(_MARK) - _TAIL :]
        if mark != _MARK:
            return "is cut off or has no checksum"
        if digest != _chunk_digest(self.identity, piece, body):
            return "does not match its checksum"
        try:
            costs = np.load(io.BytesIO(body), allow_pickle=False)
        except (ValueError, EOFError, OSError):
            return "is not an array"
        if costs.shape != shape or costs.dtype != self._dtype:
            return f"holds {costs.dtype} of shape {costs.shape}, not {self._dtype} of shape {shape}"
        return costs


def chunk_path(folder: Path, piece: int) -> Path:
    """The file of one chunk in a folder."""
    return folder / f"chunk-{piece:07d}.npy"


def write_chunk(folder: Path, identity: str, piece: int, costs: np.ndarray) -> None:
    """Write a chunk atomically: a reader never finds half a file, however the writer ends.

    Args:
        folder: of the sweep.
        identity: of the sweep.
        piece: which chunk.
        costs: shape (candidates, columns).

    Raises:
        InputError: where it cannot be written.
    """
    body = io.BytesIO()
    np.save(body, costs)
    with whole_file(chunk_path(folder, piece)) as file:
        file.write(body.getvalue())  # np.load reads to the end of the array only: any reader opens it
        file.write(_MARK + _chunk_digest(identity, piece, body.getvalue()))


def is_folder_of(folder: Path, identity: str) -> bool:
    """Whether a folder is that of the sweep: a worker on another machine may have another folder of that name."""
    known = _read_manifest(folder / MANIFEST)
    return known is not None and known.get("identity") == identity


def _chunk_digest(identity: str, piece: int, body: bytes) -> bytes:
    return hashlib.sha256(f"{identity} {piece} ".encode() + body).digest()


def _checksum(content: JsonObject) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _read_manifest(path: Path) -> JsonObject | None:
    """The content of `sweep.json`; None where it is missing or damaged."""
    try:
        # lstat: a link to another sweep would be read as this one.
        if not stat.S_ISREG(path.lstat().st_mode):
            return None
        content = json.loads(path.read_bytes())
        if not isinstance(content, dict):
            return None
        checksum = content.pop("sha256", None)
    except (OSError, ValueError, RecursionError):
        return None
    # A manifest of format 1, without checksums, is read too: its identity differs, and it is refused as another sweep.
    return content if checksum == _checksum(content) or (checksum is None and "form" not in content) else None


def _warn(sentence: str) -> None:
    warnings.warn(sentence, FpjaxWarning, stacklevel=2)


def fingerprint(problem: Problem, axes: Sequence[Axis], chunk: int) -> str:
    """A hash of everything that the costs depend on: arrays, static settings, axes, chunk size and versions.

    Raises:
        InputError: for a lambda or a function defined within another: its code is not hashed, and its name is shared.
    """
    told = dataclasses.replace(problem, references=_to_rounding(problem.references))
    return _checksum({"form": FORM, "problem": _digest(told, repr([*axes, chunk])), "versions": dict(versions())})


def fingerprints(problem: Problem, axes: Sequence[Axis], chunk: int) -> dict[str, str]:
    """A hash of each part of a sweep, by the words that name it where a sweep of another one is refused.

    Raises:
        InputError: as `fingerprint` does.
    """
    cases = (problem.noise, problem.plants, problem.objective)
    return {
        "axes": _digest(problem.space, repr([*axes, problem.parameters])),
        "chunk size": str(chunk),
        "loop": _digest(problem.loop),
        STEPPING: _digest((problem.stepper, problem.time)),
        "reference": _digest(_to_rounding(problem.references)),
        "objective or cases": _digest(cases, repr((problem.seeds, problem.aggregate))),
        "versions": _checksum(dict(versions())),
    }


def _to_rounding(tables: Sequence[jax.Array]) -> tuple[np.ndarray, ...]:
    """Tables of a reference, those in double precision as whole parts of a 2^24th of the largest value, and that value.

    Compiled anew, a sine may be another one in its last digit, and is the same reference.
    """
    found: list[np.ndarray] = []
    for table in map(np.asarray, tables):
        size = float(np.max(np.abs(table), initial=0.0))
        if table.dtype != np.float64 or not 0.0 < size < np.inf:
            found.append(table)
        else:
            found += [np.round(table / size * 2.0**24) + 0.0, np.float32(size)]  # no zero below zero
    return tuple(found)


def _digest(part: PyTree, more: str = "") -> str:
    digest = hashlib.sha256()
    leaves, structure = jax.tree.flatten(part)
    # The tree structure as text holds the static fields: names, functions, numbers of bins.
    text = str(structure)
    if unnamed := re.search(r"<function ([^ >]*<(?:lambda|locals)>[^ ]*)", text):
        raise InputError(
            f"The loop or the objective holds {unnamed[1]}, a function without a name of its own, which a resumed "
            "sweep cannot tell from another one: use a function defined at the top of a module, or leave out=."
        )
    digest.update(f"{_stable(text)} {more}".encode())
    for leaf in leaves:
        array = np.asarray(leaf)
        # Type and shape first: equal bytes of another shape are another array.
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _stable(text: str) -> str:
    """The text without the memory addresses of functions, which change from process to process."""
    return re.sub(r" at 0x[0-9a-f]+", "", text)
