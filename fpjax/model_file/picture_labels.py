"""What the picture of a model's run says beside the signals."""

from ..output.run_picture import KINDS, About
from .model import Model


def about_model(model: Model) -> About:
    """True values, units and title for the picture of a run of this model."""
    units = ("rad", "rad/s", "N m", *KINDS.values())
    return About(
        tuple((name, value) for name, value in model.nominal.items() if name in KINDS),
        tuple((unit, model.units.name(unit)) for unit in units),
        model.units.reference == "position",
        model.linear,
        model.path.name if model.path else "",
    )
