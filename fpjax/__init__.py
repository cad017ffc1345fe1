"""fpjax: simulate, tune and diagnose servo loops with friction, in JAX.

The public names are those of `fpjax/public.py`. It is imported when the first of them is used, so that `fpjax --help`
and `fpjax inspect` do not have to wait for jax.
"""

import importlib
from typing import TYPE_CHECKING, Any

from . import _moved

if TYPE_CHECKING:
    from .public import *  # noqa: F403

_moved.keep_old_names()


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(f"module 'fpjax' has no attribute {name!r}")
    # Modules first: while the public names are still being imported, one module may ask for another.
    if _moved.is_module(name):
        return importlib.import_module(f"fpjax.{name}")
    public = importlib.import_module("fpjax.public")
    if hasattr(public, name):
        globals()[name] = getattr(public, name)
        return globals()[name]
    if name in _moved.RENAMED:
        _moved.warn_of(f"fpjax.{name}", f"fpjax.{_moved.RENAMED[name]}")
        return getattr(public, _moved.RENAMED[name])
    if name in _moved.MOVED:
        return importlib.import_module(f"fpjax.{name}")
    raise AttributeError(f"module 'fpjax' has no attribute {name!r}")


def __dir__() -> list[str]:
    public = importlib.import_module("fpjax.public")
    return sorted(name for name in vars(public) if not name.startswith("_"))
