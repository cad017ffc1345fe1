"""The sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""

from typing import Any

from .._moved import warn_of
from .answer.findings import Comparison as Comparison
from .answer.findings import FittedParameter as FittedParameter
from .answer.findings import Learned as Learned
from .answer.findings import Ranked as Ranked
from .answer.findings import Share as Share
from .answer.findings import TrackingError as TrackingError
from .answer.findings import Where as Where
from .answer.free_replay import FreeReplay as FreeReplay
from .answer.gap import Gap as Gap
from .answer.gap import Step as Step
from .data.setting import Setting as Setting
from .diagnosis import Diagnosis as Diagnosis
from .effects.effect import Effect as Effect
from .effects.effect import EffectParameter as EffectParameter
from .effects.effect import place as place
from .effects.estimate import Estimate as Estimate
from .effects.experiments import Experiment as Experiment
from .effects.vocabulary import EFFECTS as EFFECTS
from .machine import Machine as Machine
from .select.dominant import DominantVariable as DominantVariable
from .verb import diagnose as diagnose

RENAMED = {"Parameter": "EffectParameter", "Identifiability": "FittedParameter", "Tracking": "TrackingError"}
"""Old name -> new name, both served: `tuning` uses the old names for other classes."""


def __getattr__(name: str) -> Any:
    if name in RENAMED:
        warn_of(f"fpjax.gap.{name}", f"fpjax.gap.{RENAMED[name]}")
        return globals()[RENAMED[name]]
    raise AttributeError(f"module 'fpjax.gap' has no attribute {name!r}")
