"""Leading: which candidates of each set of causes go on, and what they are compared with."""

from collections.abc import Collection

import numpy as np

from .candidate import Candidate, Start

FIRST = 4  # starts of a transmission that go on from a few windows to all
THEN = 2  # starts that go on after some steps, of all causes
MET = 0.2  # of a parameter's typical change (a resonance's and a gap's own value): nearer two fits have met [1]


def new_shaft(c: Candidate, start: Start) -> bool:
    """Whether the causes of a candidate bring a transmission that no fit has found yet."""
    brought = any(effect.structure == "transmission" for effect in c.effects)
    return brought and (start.like is None or start.like.family.key[0] != "transmission")


def leading(candidates: Collection[Candidate], most: int) -> list[Candidate]:
    """The best candidates of each set of causes that have not met: `THEN` at most, `most` of those with a transmission,
    which has several local minima.
    """
    best: dict[tuple[str, ...], list[Candidate]] = {}
    for c in sorted(candidates, key=lambda c: c.cost):
        group = best.setdefault(c.names, [])
        room = len(group) < (most if c.family.key[0] == "transmission" else min(most, THEN))
        if room and not any(_met(c, other) for other in group):
            group.append(c)
    return [c for group in best.values() for c in group]


def _met(c: Candidate, other: Candidate) -> bool:
    """Whether two candidates of the same causes are within `MET` of each other in every parameter."""
    # A resonance and a clearance are told by their ratios: they span decades.
    spans = np.array([c.family.parameters[i].name in ("frequency", "gap") for i in c.free], bool)
    near = MET * np.where(spans, np.abs(c.vector[c.free]), c.scale)
    fixed = np.delete(np.arange(len(c.vector)), c.free)  # the side of the sensors
    met = np.all(np.abs(c.vector[c.free] - other.vector[c.free]) <= near)
    return bool(met and np.array_equal(c.vector[fixed], other.vector[fixed]))


def compared(candidates: Collection[Candidate]) -> None:
    """The likeliest of these candidates becomes the one that all are compared with."""
    best = min((c.cost for c in candidates), default=np.inf)
    for c in candidates:
        c.beside = best
