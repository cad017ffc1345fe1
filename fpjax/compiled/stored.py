"""Stored programs: compiled ones on disk that a later process calls without tracing them again.

jax's own cache (`fpjax.compiled.native.enable_compilation_cache`) spares the compiling alone: to find a program in it,
the program must be traced and lowered first, which took a diagnosis with twenty loops a third of its time. A stored
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
import shutil
import sys
import tempfile
import threading
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
# compiled anew (`tests/compiled/test_stored.py` looks at what is called while the diagnosis' loops are traced).
SOURCES = ("blocks", "compiled", "gap/data", "gap/effects", "gap/machine.py", "gap/simulate", "simulation")
MOST_FOLDERS = 3  # of programs from different sources that are kept: some 20 MB each

_folder: pathlib.Path | None = None


def store_in(folder: pathlib.Path | None) -> None:
    """Keep the programs of `Stored` functions in a folder from now on; None: nowhere, as at the start."""
    global _folder
    _folder = folder


class _UnknownError(Exception):
    """Something that no description tells from others: a user's own block, a function."""


def description(*of: object) -> str | None:
    """What a function was made of, as text that is the same in every process; None where there is none.

    Args:
        of: numbers, texts, None, tuples of these, blocks of the package, and structures (`jax.tree.structure`) of
            pytrees of them. Arrays count by their place alone: their shapes are those of a call's arguments.
    """
    try:
        return _told(of)
    except _UnknownError:
        return None


def _told(value: Any) -> str:
    if isinstance(value, jax.tree_util.PyTreeDef):
        return _told(jax.tree.unflatten(value, [_Leaf] * value.num_leaves))
    if value is _Leaf:
        return "*"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    if isinstance(value, tuple | list):
        return f"({','.join(_told(one) for one in value)})"
    kind = type(value)
    if dataclasses.is_dataclass(value) and kind.__module__.partition(".")[0] == PACKAGE.name:
        fields = (f"{field.name}={_told(getattr(value, field.name))}" for field in dataclasses.fields(value))
        return f"{kind.__module__}.{kind.__qualname__}({','.join(fields)})"
    raise _UnknownError(f"{kind.__module__}.{kind.__qualname__}")


class _Leaf:
    """Stands for an array of a structure."""


class Stored:
    """A jitted function whose programs are stored where `store_in` named a folder and it runs on the CPU.

    Args:
        function: jitted, of arrays and pytrees of arrays alone.
        made_of: `description` of all that its trace depends on beside the arguments; None: never stored.
    """

    def __init__(self, function: Callable[..., PyTree], made_of: str | None):
        self.function, self.made_of = function, made_of
        self._programs: dict[Hashable, Callable[..., PyTree]] = {}
        self._lock = threading.Lock()

    def __call__(self, *arguments: PyTree) -> PyTree:
        """The function's result."""
        if self.made_of is None or _folder is None:
            return self.function(*arguments)
        # 9 us for forty arrays, where a call takes 500.
        key = settings(), tuple([(leaf.shape, leaf.dtype) for leaf in jax.tree.leaves(arguments)])
        program = self._programs.get(key)
        if program is None:
            with self._lock:  # several threads come here at once: one of them loads or compiles
                program = self._programs.get(key)
                if program is None:
                    program = self._programs[key] = self._find(_folder, repr(key), arguments)
        return program(*arguments)

    def _find(self, folder: pathlib.Path, key: str, arguments: PyTree) -> Callable[..., PyTree]:
        """The program for arguments like these: from its file, or compiled and written to it; else the function."""
        device = jax.config.jax_default_device or jax.devices()[0]  # pyright: ignore[reportAttributeAccessIssue]
        if getattr(device, "platform", "") != "cpu" or jax.config.jax_disable_jit:  # pyright: ignore[reportAttributeAccessIssue]
            return self.function
        structure = str(jax.tree.structure(arguments))
        name = hashlib.sha256("\n".join((str(self.made_of), key, structure, str(device))).encode()).hexdigest()[:32]
        path = folder / _surroundings() / name
        # A file that is damaged, or one that this jax cannot read, is as good as none.
        with contextlib.suppress(Exception):
            return _load(path, device)
        with _without_cache():
            compiled = self.function.lower(*arguments).compile()  # type: ignore[attr-defined]
        with contextlib.suppress(Exception):  # a full disk, or a jax that cannot: compiled for this process alone
            _save(path, compiled)
        return compiled


@contextlib.contextmanager
def _without_cache() -> Iterator[None]:
    """jax's own cache is not asked: a program that comes from there cannot be stored (it lacks its functions)."""
    used = jax.config.jax_enable_compilation_cache  # pyright: ignore[reportAttributeAccessIssue]
    with _switching:
        jax.config.update("jax_enable_compilation_cache", False)
        compilation_cache.reset_cache()  # jax reads the setting once, and again after this
        try:
            yield
        finally:
            jax.config.update("jax_enable_compilation_cache", used)
            compilation_cache.reset_cache()


_switching = threading.Lock()


def _load(path: pathlib.Path, device: Any) -> Callable[..., PyTree]:
    made, structure_in, structure_out = pickle.loads(zlib.decompress(path.read_bytes()))
    one = {} if "execution_devices" not in _parameters_of_loading else {"execution_devices": [device]}
    return serialize_executable.deserialize_and_load(made, structure_in, structure_out, backend=device.client, **one)


_parameters_of_loading = inspect.signature(serialize_executable.deserialize_and_load).parameters


def _save(path: pathlib.Path, compiled: Any) -> None:
    packed = zlib.compress(pickle.dumps(serialize_executable.serialize(compiled)), 1)
    if not path.parent.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        _forget(path.parent.parent)
    # Written beside it and renamed: another process sees the whole file or none.
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(packed)
    os.replace(file.name, path)


def _forget(folder: pathlib.Path) -> None:
    """Remove the programs of older sources and versions."""
    inside = sorted((one for one in folder.iterdir() if one.is_dir()), key=lambda one: one.stat().st_mtime)
    for old in inside[:-MOST_FOLDERS]:
        shutil.rmtree(old, ignore_errors=True)


@functools.lru_cache(maxsize=1)
def _surroundings() -> str:
    """Name of the folder for programs of these sources, versions, settings of XLA and this kind of processor."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in ("jax", "jaxlib", "equinox")]
    words = [*versions, sys.version, os.environ.get("XLA_FLAGS", ""), _processor(), *_sources(SOURCES)]
    return hashlib.sha256("\n".join(words).encode()).hexdigest()[:16]


def _sources(within: Sequence[str]) -> Iterator[str]:
    """Names and digests of the package's source files within some folders."""
    for part in within:
        place = PACKAGE / part
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            yield f"{path.relative_to(PACKAGE)} {hashlib.sha256(path.read_bytes()).hexdigest()}"


def _processor() -> str:
    """What a compiled program may use of this processor: its features, or the machine's name where they are unknown."""
    with contextlib.suppress(OSError):
        for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
            if line.partition(":")[0].strip() in ("flags", "Features"):
                return " ".join(sorted(line.partition(":")[2].split()))
    return f"{platform.machine()} {platform.processor()} {platform.node()}"
