"""The finished chunks of a sweep: one file each, written whole, so that a sweep can go on where it was stopped."""

import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from fpjax.errors import InputError
from fpjax.output.runfile import write_whole

from .result import versions

MANIFEST = "sweep.json"
_CHUNK_NAME = re.compile(r"chunk-(\d{7,})\.npy")


class SweepStore:
    """Where finished chunks go: a folder, or memory where there is none.

    Attributes:
        folder: holds `sweep.json` and `chunk-NNNNNNN.npy`; None for memory.
        identity: what the sweep is; chunks of another one are refused.
    """

    def __init__(
        self,
        folder: str | Path | None,
        identity: str,
        pieces: int,
        total: int,
        columns: int,
        chunk: int,
        *,
        resume: bool,
    ):
        self.folder = None if folder is None else Path(folder)
        self.identity, self._pieces, self._total, self._columns, self._chunk = identity, pieces, total, columns, chunk
        self._kept: dict[int, np.ndarray] = {}
        if self.folder is None:
            if resume:
                raise InputError("resume=True needs the folder of the sweep that was stopped: give out=FOLDER.")
            return
        self._open(resume)

    def _open(self, resume: bool) -> None:
        assert self.folder is not None
        manifest = self.folder / MANIFEST
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            known = json.loads(manifest.read_text()).get("identity") if manifest.exists() else None
            if known is not None and not resume:
                raise InputError(f"{self.folder} holds a sweep already: use resume=True to go on, or another folder.")
            if known is not None and known != self.identity:
                raise InputError(
                    f"{self.folder} holds another sweep (other axes, loop, reference, settings or versions): resume it "
                    "as it was begun, or use another folder."
                )
            if known is None:
                text = {"identity": self.identity, "candidates": self._total, "chunk": self._chunk}
                write_whole(manifest, json.dumps(text | {"versions": versions()}, indent=1))
        except (OSError, ValueError) as error:
            raise InputError(
                f"The sweep cannot be kept in {self.folder} ({error}): give a folder that can be written."
            ) from error

    def path(self, piece: int) -> Path:
        """The file of one chunk."""
        assert self.folder is not None
        return chunk_path(self.folder, piece)

    def finished(self) -> set[int]:
        """Chunks that are there."""
        if self.folder is None:
            return set(self._kept)
        found = (_CHUNK_NAME.fullmatch(entry.name) for entry in os.scandir(self.folder))
        return {int(match[1]) for match in found if match and int(match[1]) < self._pieces}

    def missing(self) -> Iterator[int]:
        """Chunks still to be computed, one by one: a large sweep has millions of them."""
        there = self.finished()
        return (piece for piece in range(self._pieces) if piece not in there)

    def keep(self, piece: int, costs: np.ndarray) -> None:
        """Keep one finished chunk, shape (candidates, columns)."""
        if self.folder is None:
            self._kept[piece] = costs
        else:
            write_chunk(self.folder, piece, costs)

    def assemble(self) -> np.ndarray:
        """All costs, shape (candidates, columns); with a folder a memory map of `cost.npy` there."""
        if self.folder is None:
            return np.concatenate([self._kept[piece] for piece in range(self._pieces)])
        first = np.load(self.path(0))
        partial = self.folder / ".cost.partial.npy"
        whole = np.lib.format.open_memmap(partial, mode="w+", dtype=first.dtype, shape=(self._total, self._columns))
        for piece in range(self._pieces):
            costs = np.load(self.path(piece))
            whole[piece * self._chunk : piece * self._chunk + costs.shape[0]] = costs
        whole.flush()
        del whole
        os.replace(partial, self.folder / "cost.npy")
        return np.load(self.folder / "cost.npy", mmap_mode="r")


def chunk_path(folder: Path, piece: int) -> Path:
    """The file of one chunk in a folder."""
    return folder / f"chunk-{piece:07d}.npy"


def write_chunk(folder: Path, piece: int, costs: np.ndarray) -> None:
    """Write a chunk whole or not at all: a reader never meets half a file, however the writer ends."""
    handle, name = tempfile.mkstemp(dir=folder, prefix=".chunk-", suffix=".partial")
    with os.fdopen(handle, "wb") as file:
        np.save(file, costs)
        file.flush()
        os.fsync(file.fileno())
    os.replace(name, chunk_path(folder, piece))


def fingerprint(problem: Any, axes: Sequence[Any], chunk: int) -> str:
    """What a sweep is, as a hash of every array, every static setting, the axes, the chunk and the versions.

    Raises:
        InputError: for a function without a name of its own, which cannot be told from another one.
    """
    digest = hashlib.sha256()
    leaves, structure = jax.tree.flatten(problem)
    text = str(structure)
    if unnamed := re.search(r"<function ([^ >]*<(?:lambda|locals)>[^ ]*)", text):
        raise InputError(
            f"The loop or the objective holds {unnamed[1]}, a function without a name of its own, which a resumed "
            "sweep cannot tell from another one: use a function defined at the top of a module, or leave out=."
        )
    digest.update(_stable(text).encode())
    digest.update(json.dumps(versions(), sort_keys=True).encode())
    for leaf in leaves:
        array = np.asarray(leaf)
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(array.tobytes())
    digest.update(repr([*axes, chunk]).encode())
    return digest.hexdigest()


def _stable(text: str) -> str:
    """Without addresses of functions, which change from process to process."""
    return re.sub(r" at 0x[0-9a-f]+", "", text)
