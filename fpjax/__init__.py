"""fpjax: simulate, tune and diagnose servo loops with friction, in JAX.

The public surface is `fpjax/public.py`; it is imported when its first name is asked for, so that `fpjax --help` and
`fpjax inspect` need not wait for jax.
"""

import importlib
import importlib.util
import sys
import types
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .public import *  # noqa: F403

# Public functions that share the name of the module they live in.
_SHADOWED = frozenset({"estimate", "identify", "simulate"})


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(f"module 'fpjax' has no attribute {name!r}")
    # A module first: one of ours may ask for another while the public surface is still being imported.
    if name not in _SHADOWED and importlib.util.find_spec(f"fpjax.{name}") is not None:
        return importlib.import_module(f"fpjax.{name}")
    try:
        value = getattr(importlib.import_module("fpjax.public"), name)
    except AttributeError:
        raise AttributeError(f"module 'fpjax' has no attribute {name!r}") from None
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    public = importlib.import_module("fpjax.public")
    return sorted(name for name in vars(public) if not name.startswith("_"))


class _Package(types.ModuleType):
    """Importing the module `fpjax.simulate` must not put it over the function of that name."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _SHADOWED and isinstance(value, types.ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
