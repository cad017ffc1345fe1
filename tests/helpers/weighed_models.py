"""Models of a decision by their evidence and what they leave, without a log."""

import dataclasses
from types import SimpleNamespace

from fpjax.gap.effects.twins import LogFacts
from fpjax.gap.select.decision import Weighed

NOMINAL = {"inertia": 2.0, "coulomb": 0.5, "viscous": 0.1}
RATE_ONLY = LogFacts(position=False, known_torque=False, known_turning=False, nominal=NOMINAL)
BOTH = dataclasses.replace(RATE_ONLY, position=True)


def weighed(names, evidence, wide=(), left=0.2, wrong=None):
    """A model by its evidence over the nominal model, and what it leaves of that one's missing torque."""
    values = NOMINAL | {name: 1.2 * NOMINAL[name] for name in wide} | (wrong or {})
    candidate = SimpleNamespace(
        structural=tuple(names.split("+")) if names else (), wide=frozenset(wide), values=lambda: values
    )
    return Weighed(SimpleNamespace(candidate=candidate), evidence, evidence, left)
