"""Statement: what a verdict is of, and what it says."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ..fit.candidate import NOMINAL
from .dominant import Curve

Word = Literal["no_gap", "explained", "partly_explained", "unexplained"]


@dataclass(frozen=True)
class Seen:
    """Sizes that a verdict hangs on.

    Attributes:
        before: missing torque of the nominal model as given, rms over all windows [N m].
        after: likewise of the chosen model.
        floor: what noise alone would show of it [N m].
        share: `before` over the commanded torque [1], in the log where that is the largest: of a run in which a cause
            shows and one in which it does not, both together would show half of it.
        sizes: of the nominal numbers (`fpjax.gap.fit.candidate.nominal_sizes`).
        readings: what is wrong with the velocity column beside any model of the machine, in any order:
            its rounding (`velocity_quantisation`), and what the encoder tells (`fpjax.gap.select.readings`).
        allowed: effects that may be asserted; empty for all.
        doubts: of a reading's error, what it may be instead, and the probability that it is not [1].
        twins: by effect, what makes the same log in its place: no rival, since it is named beside it.
        unshown: effects of the chosen model whose size the log does not tell from nothing: they are not asserted.
        meaning: by effect of a rival that holds a cause of the chosen model as a special case and is not told from it,
            that cause.
        curves: by recorded variable, where they were looked at.
        named: what the chosen model, or one of its effects alone, holds of the missing torque in the measure of the
            curves [1].
        follows: by effect, the variables that its torque is a function of.
        misread: by error of the velocity column, how large it is beside the gap (`beside_gap`) [1].
        slight: readings that are late for sure, and no causes where anything else is amiss.
        rounded: error of a velocity that is rounded, of the speed's rms [1].
        of_rounding: what the rounding of the readings makes of `after`, which no torque made [N m].
        moved: `after` over `before` [1], each frequency weighted by how far it moves the machine: vibration that hardly
            does, and that no cause of the vocabulary holds, is most of what many real machines leave.
        moved_by_numbers: likewise, of the model of the nominal numbers alone [1].
        contradicted: whether a unit, a sign or a column of the logs cannot be what it says: no cause is asserted then.
    """

    before: float
    after: float
    floor: float
    share: float
    sizes: dict[str, float]
    readings: tuple[str, ...] = ()
    allowed: frozenset[str] = frozenset()
    doubts: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    twins: Mapping[str, frozenset[str]] = field(default_factory=dict)
    unshown: frozenset[str] = frozenset()
    meaning: Mapping[str, str] = field(default_factory=dict)
    curves: Mapping[str, Curve] = field(default_factory=dict)
    named: float = 0.0
    follows: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    misread: Mapping[str, float] = field(default_factory=dict)
    slight: frozenset[str] = frozenset()
    rounded: float = 0.0
    of_rounding: float = 0.0
    moved: float = 1.0
    moved_by_numbers: float = 1.0
    contradicted: bool = False


@dataclass(frozen=True)
class Verdict:
    """What is asserted.

    Attributes:
        word: of the contract.
        causes: effects, the most important first.
        probability: that the verdict is right [1].
        main: probability by effect that it is the main cause [1]; sums to at most 1.
        among: probability by effect that it is among the causes [1].
        margin: worth of the chosen model over that of the best one without its leading cause [nats].
        ahead: how far the leading cause is beyond the others' reach [1]; 0 where nothing leads.
        undecided: causes of the chosen model that take a part of the gap too, and are not asserted, since others do
            nearly as well in their place.
    """

    word: Word
    causes: tuple[str, ...]
    probability: float
    main: Mapping[str, float]
    among: Mapping[str, float]
    margin: float
    ahead: float
    undecided: tuple[str, ...] = ()


def is_number(name: str) -> bool:
    """Whether a cause is a wrong nominal number.

    Args:
        name: of the cause.
    """
    return name.endswith("_error") and name.removesuffix("_error") in NOMINAL
