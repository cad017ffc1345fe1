"""Double precision for what needs it, whatever the process has chosen for itself."""

from contextlib import AbstractContextManager
from typing import Any

import jax


def double_precision() -> AbstractContextManager[Any]:
    """A context in which arrays are float64; the process' own setting is left alone."""
    switch = getattr(jax, "enable_x64", None)
    if switch is None:  # before jax 0.8 it stands with the experimental ones
        from jax.experimental import enable_x64 as switch  # pyright: ignore[reportAttributeAccessIssue]
    return switch(True)
