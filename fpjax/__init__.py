"""fpjax: simulate, tune and diagnose servo loops with friction, in JAX.

The public names and their modules are listed in `fpjax/__init__.pyi`. A module is imported when the first name of it is
used, so that `fpjax --help` and `fpjax inspect` need not wait for jax.
"""

import ast
import functools
import importlib
from pathlib import Path
from typing import Any

from . import _moved

_moved.keep_old_names()


@functools.cache
def _modules() -> dict[str, str]:
    """Public name -> the module that defines it, without `fpjax.`, from the stub."""
    listed = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    return {name.name: line.module or "" for line in listed if isinstance(line, ast.ImportFrom) for name in line.names}


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(f"module 'fpjax' has no attribute {name!r}")
    if name in _modules():
        globals()[name] = getattr(importlib.import_module(f"fpjax.{_modules()[name]}"), name)
        return globals()[name]
    if name in _moved.RENAMED:
        _moved.warn_of(f"fpjax.{name}", f"fpjax.{_moved.RENAMED[name]}")
        return __getattr__(_moved.RENAMED[name])
    if name in _moved.MOVED or _moved.is_module(name):
        return importlib.import_module(f"fpjax.{name}")
    raise AttributeError(f"module 'fpjax' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(_modules())
