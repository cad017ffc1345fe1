"""Double precision for the diagnosis, whatever the process has chosen for itself."""

from typing import Any

import jax


def double_precision() -> Any:
    """A context in which arrays are float64; the process' own setting is left alone."""
    switch = getattr(jax, "enable_x64", None)
    if switch is None:
        from jax.experimental import enable_x64 as switch  # pyright: ignore[reportAttributeAccessIssue]
    return switch(True)
