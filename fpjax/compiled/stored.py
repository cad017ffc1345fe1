"""Stored programs: compiled ones on disk that a later process calls without tracing them again.

jax's own cache (`fpjax.compiled.native.enable_compilation_cache`) spares the compiling alone: to find a program in it,
the program must be traced and lowered first, which took a diagnosis with twenty loops a sixth of its time. A stored
program is found by what it was made from: the package's sources, a description of the function, shapes and settings.
"""

import contextlib
import dataclasses
import functools
import hashlib
import importlib.metadata
import inspect
import os
import pathlib
import pickle
import platform
import re
import shutil
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any

import jax
from jax.experimental import serialize_executable
from jax.experimental.compilation_cache import compilation_cache
from jaxtyping import PyTree

from .threads import settings

PACKAGE = pathlib.Path(__file__).parents[1]
# What a stored program may be traced through, relative to the package: if one of these files changes, all programs are
# compiled anew (`tests/gap/test_stored_loops.py` looks at what is called while the diagnosis' loops are traced).
SOURCES = ("blocks", "compiled", "gap/data", "gap/effects", "gap/machine.py", "gap/simulate", "simulation")
FOLDER = "fpjax-programs"  # within the cache's folder; in it one folder for each state of the sources and the machine
MOST_FOLDERS = 4  # that are kept: some 20 MB each
MOST_PROGRAMS = 300  # in each
NAME = re.compile("[0-9a-f]{32}")

# Of this process: when it began to read the sources, and what XLA read.
_STARTED, _XLA_FLAGS = time.time(), os.environ.get("XLA_FLAGS", "")
_folder: pathlib.Path | None = None
_switching = threading.Lock()


def store_in(cache: pathlib.Path | None) -> None:
    """Keep the programs of `Stored` functions within a cache's folder from now on; None: nowhere, as at the start."""
    global _folder
    _folder = None if cache is None else cache / FOLDER


class _UnknownError(Exception):
    """Something that no description tells from others: a user's own block, a function."""


def description(*of: object) -> str | None:
    """What a function was made of, as text that is the same in every process; None where there is none.

    Args:
        of: numbers, texts, None, tuples, lists and dictionaries of these, blocks of the package, and structures
            (`jax.tree.structure`) of pytrees of them. Arrays count by their place alone: their shapes are those of a
            call's arguments.
    """
    try:
        return _described(of)
    except _UnknownError:
        return None


def _described(value: Any) -> str:
    if isinstance(value, jax.tree_util.PyTreeDef):
        return _described(jax.tree.unflatten(value, [_Leaf] * value.num_leaves))
    if value is _Leaf:
        return "*"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    kind = type(value)
    if kind in (tuple, list):
        return f"{kind.__name__}({','.join(_described(one) for one in value)})"
    if kind is dict:
        return f"dict({','.join(f'{name!r}:{_described(one)}' for name, one in value.items())})"
    if dataclasses.is_dataclass(value) and kind.__module__.partition(".")[0] == PACKAGE.name:
        fields = (f"{field.name}={_described(getattr(value, field.name))}" for field in dataclasses.fields(value))
        return f"{kind.__module__}.{kind.__qualname__}({','.join(fields)})"
    raise _UnknownError(f"{kind.__module__}.{kind.__qualname__}")


class _Leaf:
    """Stands for an array of a structure."""


class Stored:
    """A jitted function whose programs are stored where `store_in` named a folder and it runs on the CPU.

    Args:
        function: jitted, of arrays and of lists, tuples and dictionaries of arrays alone. One that calls a library
            (linear algebra, FFT) is compiled in every process.
        made_of: `description` of all that its trace depends on beside the arguments; None: never stored.
    """

    def __init__(self, function: Callable[..., PyTree], made_of: str | None):
        self.function, self.made_of = function, made_of
        self._programs: dict[Hashable, Callable[..., PyTree]] = {}
        self._lock = threading.Lock()

    def __call__(self, *arguments: PyTree) -> PyTree:
        """The function's result."""
        folder, config = _folder, jax.config
        if self.made_of is None or folder is None or config.jax_disable_jit:  # pyright: ignore[reportAttributeAccessIssue]
            return self.function(*arguments)
        leaves, structure = jax.tree.flatten(arguments)
        # 10 us for forty arrays, where a call takes 500.
        shapes = tuple([(leaf.shape, leaf.dtype) for leaf in leaves])
        key = shapes, structure, settings(), config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
        program = self._programs.get(key)
        if program is None:
            with self._lock:  # several threads come here at once: one of them loads or compiles
                program = self._programs.get(key)
                if program is None:
                    program = self._programs[key] = self._find(folder, f"{shapes}{structure}", arguments)
        return program(*arguments)

    def _find(self, folder: pathlib.Path, call: str, arguments: PyTree) -> Callable[..., PyTree]:
        """The program for arguments like these: from its file, or compiled and written to it; else the function."""
        device = jax.config.jax_default_device or jax.local_devices()[0]  # pyright: ignore[reportAttributeAccessIssue]
        surroundings = _surroundings()
        if getattr(device, "platform", "") != "cpu" or surroundings is None or _changed():
            return self.function
        words = (str(self.made_of), call, str(device), *_options())
        path = folder / surroundings / hashlib.sha256("\n".join(words).encode()).hexdigest()[:32]
        # Whatever is wrong with a file (damaged, of another jax), the program is then compiled as if there were none.
        with contextlib.suppress(Exception):
            program = _loaded(path.read_bytes(), device)
            with contextlib.suppress(OSError):  # a folder that can be read alone
                os.utime(path)
                os.utime(path.parent)
            return program
        with _without_cache():
            compiled = self.function.lower(*arguments).compile()  # type: ignore[attr-defined]
        with contextlib.suppress(Exception):  # a full disk, a jax that cannot: compiled for this process alone
            # A library's functions are made known while a program is lowered: without that a call ends the process.
            if "custom-call" not in compiled.as_text():
                packed = zlib.compress(pickle.dumps(serialize_executable.serialize(compiled)), 1)
                # Called once: where the function ran before from jax's own cache, this is that program, which lacks
                # its functions. It is loaded without a word, and would fail in every process to come.
                jax.block_until_ready(_loaded(packed, device)(*arguments))
                _write(path, packed)
        return compiled


@contextlib.contextmanager
def _without_cache() -> Iterator[None]:
    """jax's own cache is not asked: a program that comes from there cannot be stored (it lacks its functions)."""
    with _switching:
        used = jax.config.jax_enable_compilation_cache  # pyright: ignore[reportAttributeAccessIssue]
        jax.config.update("jax_enable_compilation_cache", False)
        compilation_cache.reset_cache()  # jax reads the setting once, and again after this
        try:
            yield
        finally:
            jax.config.update("jax_enable_compilation_cache", used)
            compilation_cache.reset_cache()


def _loaded(packed: bytes, device: Any) -> Callable[..., PyTree]:
    made, structure_in, structure_out = pickle.loads(zlib.decompress(packed))
    one = {} if "execution_devices" not in _parameters_of_loading else {"execution_devices": [device]}
    return serialize_executable.deserialize_and_load(made, structure_in, structure_out, backend=device.client, **one)


_parameters_of_loading = inspect.signature(serialize_executable.deserialize_and_load).parameters


def _write(path: pathlib.Path, packed: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    # Written beside it and renamed: another process sees the whole file or none.
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(packed)
    try:
        os.replace(file.name, path)
    except OSError:
        os.unlink(file.name)
        raise
    os.utime(path.parent)
    with contextlib.suppress(OSError):  # another process may remove the same
        _forget(path.parent, MOST_PROGRAMS, os.unlink)
        _forget(path.parent.parent, MOST_FOLDERS, shutil.rmtree)


def _forget(folder: pathlib.Path, most: int, remove: Callable[[pathlib.Path], object]) -> None:
    """Of what this module has written into a folder, remove what was used the longest ago."""
    own = [path for path in folder.iterdir() if NAME.fullmatch(path.name)]
    for old in sorted(own, key=lambda path: path.stat().st_mtime)[:-most]:
        remove(old)


@functools.lru_cache(maxsize=1)
def _surroundings() -> str | None:
    """Name of the folder for programs of these sources, versions and this kind of processor; None: not known."""
    try:
        versions = [f"{name} {importlib.metadata.version(name)}" for name in ("jax", "jaxlib", "equinox")]
        words = [*versions, sys.version, _XLA_FLAGS, _processor(), *_digests(SOURCES)]
    except (OSError, importlib.metadata.PackageNotFoundError):  # an installation without sources, or without records
        return None
    return hashlib.sha256("\n".join(words).encode()).hexdigest()[:32]


def _files(within: Sequence[str]) -> list[pathlib.Path]:
    """The package's source files within some folders."""
    places = [PACKAGE / part for part in within]
    return [path for place in places for path in (sorted(place.rglob("*.py")) if place.is_dir() else [place])]


def _digests(within: Sequence[str]) -> list[str]:
    digests = ((path, hashlib.sha256(path.read_bytes()).hexdigest()) for path in _files(within))
    return [f"{path.relative_to(PACKAGE)} {digest}" for path, digest in digests]


def _changed() -> bool:
    """Whether a source file is younger than this process, which then may run what is not in it any more."""
    return any(path.stat().st_mtime > _STARTED for path in _files(SOURCES))


def _options() -> list[str]:
    """jax's options as they are in this thread, but for its cache's and those that only say something."""
    silent = ("cache", "logging", "_log_", "dump")
    values = {n: v for n, v in getattr(jax.config, "values", {}).items() if not any(word in n for word in silent)}
    # Of most a thread may have a value of its own, which is an attribute; of the others there is one for all.
    return [f"{name}={getattr(jax.config, name, values[name])!r}" for name in sorted(values)]


def _processor() -> str:
    """What a compiled program may use of this processor: its features, or the machine's name where they are unknown."""
    with contextlib.suppress(OSError):
        for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
            if line.partition(":")[0].strip() in ("flags", "Features"):
                return " ".join(sorted(line.partition(":")[2].split()))
    return f"{platform.machine()} {platform.processor()} {platform.node()}"


def _forked() -> None:
    """A forked child inherits none of the threads, but would inherit the lock as held."""
    global _switching
    _switching = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)
