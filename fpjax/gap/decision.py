"""Decision: what the search for causes found."""

from dataclasses import dataclass, field

from .attribute import Fitted


@dataclass
class Decision:
    """What the search found.

    Attributes:
        exact: the nominal model as given.
        null: the nominal model with its three numbers free under the prior.
        singles: every effect alone, best first.
        path: the model after each cause, the nominal one first.
        chosen: the last of the path.
        rivals: sets of effects that compete with the chosen one, itself included, best first.
        floor: residual energy per sample that is noise [1, in the estimated noise's variance].
        structure: residual energy of the chosen model over the floor [1].
        explained: the causes close the gap.
        gap: the nominal model is rejected.
        weak: how many causes at the path's end withheld data want although they leave most of the gap.
    """

    exact: Fitted
    null: Fitted
    singles: list[Fitted]
    path: list[Fitted]
    rivals: list[Fitted] = field(default_factory=list)
    floor: float = 1.0
    structure: float = 1.0
    explained: bool = False
    gap: bool = False
    weak: int = 0

    @property
    def chosen(self) -> Fitted:
        """The model with all causes in."""
        return self.path[-1]

    @property
    def leading(self) -> Fitted:
        """The model with the causes that each remove a good part of what is left."""
        return self.path[-1 - self.weak]
