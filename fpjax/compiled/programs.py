"""A bounded store of compiled programs (4 to 8 MB each); the least recently used are dropped."""

import collections
import functools
import threading
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import equinox as eqx

MOST = 16  # programs kept of one kind: a compilation takes 0.1 to 8 s, and a user comes back to the last few
F = TypeVar("F", bound=Callable[..., Any])
P = TypeVar("P")


class Programs:
    """At most `most` programs, found by the key of what they were compiled for; safe to share between threads."""

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._kept: collections.OrderedDict[Hashable, Any] = collections.OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """How many are kept."""
        return len(self._kept)

    def get(self, key: Hashable, make: Callable[[], P]) -> tuple[P, bool]:
        """(the program of a key, whether it was made by this call)."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key], False
        # Compiled outside the lock, because it may take seconds: two threads that ask for the same new key at once both
        # compile it, and the later one is kept.
        made = make()
        with self._lock:
            self._kept[key] = made
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return made, True


def jit_by(key_of: Callable[..., Hashable], most: int = MOST) -> Callable[[F], F]:
    """`equinox.filter_jit` with bounded memory: a key beyond `most` drops all compiled programs and starts anew.

    jax keeps every shape that it ever compiled: 40 lengths of a run are 300 MB. Programs cannot be dropped one by one,
    because jax clears the cache of a function only as a whole (measured: a jit of its own for each key, of which the
    oldest is dropped, frees nothing).

    Args:
        key_of: takes the call's arguments, gives what a program is compiled for: the length of a run, and whatever else
            changes often.
        most: the number of keys whose programs are kept.
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
                    # equinox keeps its jitted function here; it has no public way to clear it.
                    program._cached.clear_cache()
                    keys.clear()
                keys.add(key)
            return program(*arguments)

        called.keys = keys  # type: ignore[attr-defined]
        return called  # type: ignore[return-value]

    return decorate
