"""The seed of random numbers: one range for Python and the command line."""

import operator
from typing import Any

from ..errors import InputError

LARGEST_SEED = 2**63 - 1


def checked_seed(seed: Any, name: str = "seed") -> int:
    """A seed that fits into 63 bits, as every generator takes it.

    Args:
        seed: what was given.
        name: of the argument, for the message.

    Raises:
        InputError: for anything but a whole number of that range.
    """
    try:
        number = operator.index(seed)
    except TypeError:
        number = -1
    if not 0 <= number <= LARGEST_SEED:
        raise InputError(f"{name} must be a whole number from 0 to {LARGEST_SEED}, got {seed!r}.")
    return number
