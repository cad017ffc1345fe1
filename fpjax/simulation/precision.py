"""Double precision for computations that need it, whatever the setting of the process."""

from contextlib import AbstractContextManager
from typing import Any

import jax


def double_precision() -> AbstractContextManager[Any]:
    """A context in which arrays are float64; the setting of the process is not changed."""
    switch = getattr(jax, "enable_x64", None)
    if switch is None:  # before jax 0.8 it was in jax.experimental
        from jax.experimental import enable_x64 as switch  # pyright: ignore[reportAttributeAccessIssue]
    return switch(True)
