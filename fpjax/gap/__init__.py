"""The sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""

from typing import Any

from .._moved import warn_of
from .answer.diagnosis import Comparison as Comparison
from .answer.diagnosis import Diagnosis as Diagnosis
from .answer.diagnosis import Estimate as Estimate
from .answer.diagnosis import Experiment as Experiment
from .answer.diagnosis import FittedParameter as FittedParameter
from .answer.diagnosis import Gap as Gap
from .answer.diagnosis import Learned as Learned
from .answer.diagnosis import Ranked as Ranked
from .answer.diagnosis import Share as Share
from .answer.diagnosis import Step as Step
from .answer.diagnosis import TrackingError as TrackingError
from .answer.diagnosis import Where as Where
from .data.setting import Setting as Setting
from .effects.effect import Effect as Effect
from .effects.effect import EffectParameter as EffectParameter
from .effects.effect import place as place
from .effects.vocabulary import EFFECTS as EFFECTS
from .machine import Machine as Machine
from .select.dominant import DominantVariable as DominantVariable

from .diagnose import diagnose as diagnose  # isort: skip

RENAMED = {"Parameter": "EffectParameter", "Identifiability": "FittedParameter", "Tracking": "TrackingError"}
"""Old name -> name now: `tuning` means other things by the old ones."""


def __getattr__(name: str) -> Any:
    if name in RENAMED:
        warn_of(f"fpjax.gap.{name}", f"fpjax.gap.{RENAMED[name]}")
        return globals()[RENAMED[name]]
    raise AttributeError(f"module 'fpjax.gap' has no attribute {name!r}")
