"""Saved fits: those of a diagnosis in one file, from which an interrupted diagnosis resumes.

The search asks for fits in an order that depends on its input alone. Each answer is appended to the file with a
checksum. A rerun with the same input reads them in that order and ends with the same bits. Anything else in the file is
ignored: an answer that was half written, answers to another input or of another version of the code.

The answers are pickles. A pickle from an untrusted file can run code when it is read, so the reader accepts the classes
of `_KNOWN` only, and numbers as bytes with a checked type.
"""

import contextlib
import functools
import hashlib
import io
import os
import pickle
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

from ...errors import InputError
from ...logs import Log
from ...model_file import Model
from ...output.runfile import sync_folder, versions
from ..effects.always import LATE_TORQUE
from ..effects.effect import Effect
from ..simulate.family import Family
from .candidate import Candidate, Fit
from .search import Search, Start

T = TypeVar("T")
NAME = "diagnosis.kept"
_MAGIC = b"fpjax kept fits 1\n"
_HEAD = struct.Struct("<Q32s")  # before each answer: its length [bytes], its SHA-256
# The only classes that the reader makes of a file's content. None of numpy: with dtype object, an ndarray takes the
# file's bytes for addresses of objects.
_KNOWN = {(Candidate.__module__, "Candidate"), (Fit.__module__, "Fit")}
_NUMBERS = "fiub"  # kinds of numpy dtypes that are numbers: float, int, unsigned, bool


class SavedFits:
    """The file of one diagnosis; it exists from `begin` to `discard`.

    Attributes:
        path: of the file.
        taken: number of answers that were read from an earlier run.
        lost: why answers are no longer written, for instance "No space left on device"; "" while they are.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        self.taken, self.lost = 0, ""
        self._answers: list[tuple[str, bytes, int]] = []  # question, answer, where it begins in the file
        self._place = self._depth = 0
        self._handle: int | None = None
        self._own = False  # whether this process holds the lock, and may remove the file

    def begin(self, key: str) -> None:
        """Open and lock the file, and read the answers of an earlier run with the same input.

        Args:
            key: of the input, as `key_of` gives it.

        Raises:
            InputError: where another process has locked it.
        """
        self.close()
        self.taken, self._place, self._answers = 0, 0, []
        begin = _MAGIC + key.encode() + b"\n"
        try:
            self._handle = os.open(self.path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
            _lock(self._handle, self.path)
            self._own = True
            # After the lock, so that no other process is writing.
            content = self.path.read_bytes()
            end = len(begin)
            if content.startswith(begin):
                self._answers, end = _answers(content, end)
            else:
                os.ftruncate(self._handle, 0)
                _write(self._handle, begin, 0)
            os.ftruncate(self._handle, end)  # a half written answer behind the last whole one
            sync_folder(self.path.parent)
        except InputError:
            self.close()
            raise
        except OSError as error:
            self._give_up(error)

    def answer(self, question: str, work: Callable[[], T], search: Search) -> T:
        """The result of `work`, read from the file where the earlier run has got so far, else computed and appended.

        Args:
            question: name of the computation, the same in a rerun.
            work: computes the answer. Questions that it asks itself are not kept: its answer contains theirs.
            search: whose effects and families the answer refers to.
        """
        if self._depth:
            return work()
        place, self._place = self._place, self._place + 1
        if place < len(self._answers):
            asked, content, begin = self._answers[place]
            with contextlib.suppress(Exception):  # an answer that cannot be read is computed again
                if asked == question:
                    found = _Reader(io.BytesIO(content), search).load()
                    self.taken += 1
                    return found
            # The rerun asks for something else: this answer and all behind it are of no use.
            del self._answers[place:]
            self._cut(begin)
        self._depth += 1
        try:
            found = work()
        finally:
            self._depth -= 1
        self._add(question, found, search)
        return found

    def _add(self, question: str, found: Any, search: Search) -> None:
        if self._handle is None:
            return
        stream = io.BytesIO()
        try:
            _Writer(stream, search).dump(found)
            content = pickle.dumps((question, stream.getvalue()), protocol=4)
            place = os.lseek(self._handle, 0, os.SEEK_END)
            _write(self._handle, _HEAD.pack(len(content), hashlib.sha256(content).digest()) + content, place)
        except (OSError, pickle.PicklingError) as error:
            self._give_up(error)

    def _cut(self, end: int) -> None:
        if self._handle is not None:
            try:
                os.ftruncate(self._handle, end)
            except OSError as error:
                self._give_up(error)

    def _give_up(self, error: Exception) -> None:
        """Stop writing and remove the file; the diagnosis goes on, for instance with a full disk."""
        self.lost = getattr(error, "strerror", None) or str(error)
        self.discard()

    def close(self) -> None:
        """Close and unlock the file, and leave it for a rerun."""
        if self._handle is not None:
            os.close(self._handle)
        self._handle = None

    def discard(self) -> None:
        """Close and remove the file, unless another process holds it; for a diagnosis that is done."""
        self.close()
        with contextlib.suppress(OSError):
            if self._own:
                self.path.unlink(missing_ok=True)
        self._own = False


Kept = SavedFits
"""The old name of `SavedFits`, for one more version."""


class ResumingSearch(Search):
    """A search that reads its fits from the file of an earlier run and appends what it computes.

    Args:
        kept: the file, on which `begin` was called.
        arguments: of `Search`, in its order.
    """

    def __init__(self, kept: SavedFits, *arguments: Any):
        self._kept = kept
        super().__init__(*arguments)

    def _base(self, wide: tuple[str, ...] | None) -> Candidate:
        return self._kept.answer(f"base {wide}", lambda: super(ResumingSearch, self)._base(wide), self)

    def explore(self, starts: Sequence[Start], keep: Sequence[int] = (), *, white: bool = True) -> list[Fit]:
        """As `Search.explore`."""
        question = f"explore {_of_starts(starts)} {tuple(keep)} {white}"
        return self._kept.answer(question, lambda: super(ResumingSearch, self).explore(starts, keep, white=white), self)

    def fitted(self, starts: Sequence[Start], *, alone: bool = False) -> list[Fit]:
        """As `Search.fitted`."""
        question = f"fitted {_of_starts(starts)} {alone}"
        return self._kept.answer(question, lambda: super(ResumingSearch, self).fitted(starts, alone=alone), self)

    def refit(self, fit: Fit, wide: Sequence[str]) -> Fit:
        """As `Search.refit`."""
        question = f"refit {_of_candidate(fit.candidate)} {sorted(wide)}"
        return self._kept.answer(question, lambda: super(ResumingSearch, self).refit(fit, wide), self)

    def finish(self, candidates: Sequence[Candidate], *arguments: Any) -> list[Fit]:
        """As `Search.finish`."""
        question = f"finish {[_of_candidate(c) for c in candidates]} {arguments}"
        return self._kept.answer(question, lambda: super(ResumingSearch, self).finish(candidates, *arguments), self)


def key_of(logs: Sequence[Log], withheld: Sequence[Log], model: Model, effects: Sequence[Effect]) -> str:
    """Hash of all that the fits depend on: logs, model, effects by name, versions, and the package's code.

    Args:
        logs: fitted.
        withheld: scored only.
        model: the nominal model.
        effects: the vocabulary.
    """
    digest = hashlib.sha256(_code().encode())
    for part in ([str(sorted(versions().items())), model.text], [f"{len(logs)} {len(withheld)}"]):
        digest.update("\0".join(part).encode())
    digest.update(repr([(e.name, [p.name for p in e.parameters]) for e in effects]).encode())
    for leaf in jax.tree.leaves(model.loop):  # the blocks may have been changed since the text was read
        digest.update(np.asarray(leaf).tobytes())
    for log in (*logs, *withheld):
        digest.update(f"{log.name} {log.dt!r} {log.linear} {log.torque_measured} {log.torque_step!r}".encode())
        for name, values in {**log.columns(), **log.extra}.items():
            digest.update(name.encode())
            digest.update(values.astype("<f8").tobytes())
    return digest.hexdigest()


@functools.cache
def _code() -> str:
    """Hash of the package's files: fits of another state of the code are not reused."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _answers(content: bytes, begin: int) -> tuple[list[tuple[str, bytes, int]], int]:
    """(complete answers from the byte `begin` on, byte at which the last of them ends)."""
    found = []
    while begin + _HEAD.size <= len(content):
        length, checksum = _HEAD.unpack_from(content, begin)
        end = begin + _HEAD.size + length
        part = content[begin + _HEAD.size : end]
        if end > len(content) or hashlib.sha256(part).digest() != checksum:
            break
        try:
            question, answer = _Plain(io.BytesIO(part)).load()
        except Exception:  # the checksum has no key: a forged file can have a right one
            break
        found.append((question, answer, begin))
        begin = end
    return found, begin


def _write(handle: int, content: bytes, place: int) -> None:
    os.lseek(handle, place, os.SEEK_SET)
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(handle, rest) :]
    os.fsync(handle)


def _lock(handle: int, path: Path) -> None:
    try:
        import fcntl
    except ImportError:  # no fcntl on Windows: two diagnoses in one folder are not noticed there
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(
            f"{path.parent} belongs to a diagnosis that is still running: wait for it, end it, or use another --out."
        ) from None


class _Writer(pickle.Pickler):
    """Writes effects and families as their names, arrays as their bytes."""

    def __init__(self, stream: io.BytesIO, search: Search):
        super().__init__(stream, protocol=4)
        self._effects = {id(effect): effect.name for effect in (*search.effects, LATE_TORQUE)}
        self._arrays: dict[int, int] = {}

    def persistent_id(self, obj: Any) -> Any:
        """(kind, name or bytes) of an object that is not pickled itself; None for one that is."""
        if isinstance(obj, Effect):
            if id(obj) not in self._effects:
                raise pickle.PicklingError(f"{obj.name} is not of the vocabulary")
            return "effect", obj.name
        if isinstance(obj, np.ndarray | np.generic) and obj.dtype.kind in _NUMBERS:
            return self._numbers(obj)
        return ("family", obj.key) if isinstance(obj, Family) else None

    def _numbers(self, obj: np.ndarray | np.generic) -> tuple[Any, ...]:
        if isinstance(obj, np.generic):
            return "scalar", (obj.dtype.str, obj.tobytes())
        known = id(obj) in self._arrays
        place = self._arrays.setdefault(id(obj), len(self._arrays))
        if known:  # an array that occurs twice is one object again after reading
            return "array", (place,)
        order = "F" if obj.flags.fnc else "C"
        return "array", (place, obj.dtype.str, obj.shape, order, obj.tobytes(order))


class _Plain(pickle.Unpickler):
    """Reads builtins and the classes of `_KNOWN`, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """Refuse every other class and function: by them a pickle runs code."""
        if (module, name) not in _KNOWN:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of a fit")
        return super().find_class(module, name)


class _Reader(_Plain):
    """The counterpart of `_Writer`."""

    def __init__(self, stream: io.BytesIO, search: Search):
        super().__init__(stream)
        self._search = search
        self._effects = {effect.name: effect for effect in (*search.effects, LATE_TORQUE)}
        self._arrays: dict[int, np.ndarray] = {}

    def persistent_load(self, pid: Any) -> Any:
        """The effect or family with a name, or the numbers in some bytes."""
        kind, name = pid
        if kind == "scalar":
            return _of_bytes(*name)[0]
        if kind == "array":
            place, *parts = name
            if parts:
                word, shape, order, content = parts
                self._arrays[place] = _of_bytes(word, content).reshape(shape, order=order).copy(order="K")
            return self._arrays[place]
        return self._effects[name] if kind == "effect" else self._search.fitter(name).family


def _of_bytes(word: str, content: bytes) -> np.ndarray:
    dtype = np.dtype(word)
    if dtype.kind not in _NUMBERS:
        raise pickle.UnpicklingError(f"{word} is no number")
    return np.frombuffer(content, dtype)


def _of_candidate(c: Candidate) -> str:
    """Text that identifies a candidate in a question: its causes and a hash of its values."""
    numbers = b"".join(part.tobytes() for part in (c.vector, *c.states, *c.hidden))
    return f"{c.names} {hashlib.sha256(numbers).hexdigest()[:16]}"


def _of_starts(starts: Sequence[Start]) -> str:
    """Text that identifies starts in a question: their number and a hash of all they hold."""
    digest = hashlib.sha256()
    for start in starts:
        like = "" if start.like is None else _of_candidate(start.like)
        values = repr(sorted(start.values.items()))
        words = (*(e.name for e in start.effects), "|", *sorted(start.wide), values, like, repr(start.or_given))
        digest.update("\0".join(words).encode())
    return f"{len(starts)} {digest.hexdigest()[:16]}"
