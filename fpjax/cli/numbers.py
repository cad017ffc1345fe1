"""Numbers on the command line, more strictly than Python, which takes 1_0 for 10, digits of other scripts and inf."""

import argparse
import math
import re

from ..simulation.seeds import LARGEST_SEED, checked_seed

_REAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WHOLE = re.compile(r"[+-]?\d+", re.ASCII)


def real(text: str) -> float:
    """A finite decimal number.

    Raises:
        ValueError: for anything else.
    """
    if not _REAL.fullmatch(text.strip()) or not math.isfinite(float(text)):
        raise ValueError(f"{text!r} is not a number")
    return float(text)


def whole(text: str) -> int:
    """A whole number.

    Raises:
        ValueError: for anything else.
    """
    if not _WHOLE.fullmatch(text.strip()):
        raise ValueError(f"{text!r} is not a whole number")
    return int(text)


def seed(text: str) -> int:
    """The seed of random numbers, as `checked_seed` takes it.

    Raises:
        ArgumentTypeError: for anything else.
    """
    try:
        return checked_seed(whole(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"a seed is a whole number from 0 to {LARGEST_SEED}, got {text!r}") from None


# argparse uses these names in its message "invalid number value: '1_0'".
real.__name__, whole.__name__ = "number", "whole number"
