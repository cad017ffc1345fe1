"""Compiled programs, the least recently used of which are forgotten: each holds 4 to 8 MB."""

import collections
import functools
import threading
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import equinox as eqx

MOST = 16  # programs of one kind; a compilation takes 0.1 to 8 s, a user comes back to the last few
F = TypeVar("F", bound=Callable[..., Any])
P = TypeVar("P")


class Programs:
    """At most `most` programs by what they were compiled for."""

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._kept: collections.OrderedDict[Hashable, Any] = collections.OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """How many are kept."""
        return len(self._kept)

    def get(self, key: Hashable, make: Callable[[], P]) -> tuple[P, bool]:
        """(the program of a key, whether it was made now)."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key], False
        made = make()  # outside the lock: it may take seconds
        with self._lock:
            self._kept[key] = made
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return made, True


def jit_by(key_of: Callable[..., Hashable], most: int = MOST) -> Callable[[F], F]:
    """`equinox.filter_jit` that forgets all its programs where those of one more key would be too many.

    Jax keeps every shape that it ever compiled: 40 lengths of a run are 300 MB. One program after the other cannot be
    given back: what jax remembers of a function goes only as a whole (measured: a jit of its own for each key, the
    oldest dropped, frees nothing).

    Args:
        key_of: of the call's arguments, what is compiled for: the length of a run, and what else changes often.
        most: keys.
    """

    def decorate(fn: F) -> F:
        program: Any = eqx.filter_jit(fn)
        keys: set[Hashable] = set()
        lock = threading.Lock()

        @functools.wraps(fn)
        def called(*arguments: Any) -> Any:
            key = key_of(*arguments)
            with lock:
                if key not in keys and len(keys) >= most:
                    program._cached.clear_cache()
                    keys.clear()
                keys.add(key)
            return program(*arguments)

        called.keys = keys  # type: ignore[attr-defined]
        return called  # type: ignore[return-value]

    return decorate
