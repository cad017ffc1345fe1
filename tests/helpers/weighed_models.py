"""Models of a decision by their evidence and what they leave, without a log."""

import dataclasses
from types import SimpleNamespace

from fpjax.gap.effects.twins import LogFacts
from fpjax.gap.select.statement import Seen
from fpjax.gap.select.verdict import verdict
from fpjax.gap.select.weighed import Weighed

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


def judged(
    chosen,
    rivals,
    *,
    left=0.02,
    before=1.0,
    shares=None,
    lost=None,
    readings=(),
    exact=0.0,
    allowed=(),
    numbers=1.0,
    floor=1e-3,
    share=None,
    whole=1.0,
    **more,
):
    """The verdict on a chosen model beside its rivals, of sizes [N m] and shares [1] as they are given."""
    decision = SimpleNamespace(
        exact=SimpleNamespace(evidence=exact, candidate=SimpleNamespace(values=lambda: NOMINAL)),
        nominal=weighed("cogging", -1e9, left=numbers),
        singles=(),
        chosen=chosen,
        rivals=tuple(rivals),
        shares=shares or dict.fromkeys(chosen.structural, 0.5),
        whole=whole,
        lost=lost or {},
    )
    torque = 5.0
    share = before / torque if share is None else share
    sizes = (before, left * before, floor, share, {})
    return verdict(decision, Seen(*sizes, tuple(readings), frozenset(allowed), **more))
