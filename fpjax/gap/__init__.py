"""The sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""

from .answer.diagnosis import Comparison as Comparison
from .answer.diagnosis import Diagnosis as Diagnosis
from .answer.diagnosis import Estimate as Estimate
from .answer.diagnosis import Experiment as Experiment
from .answer.diagnosis import Gap as Gap
from .answer.diagnosis import Identifiability as Identifiability
from .answer.diagnosis import Learned as Learned
from .answer.diagnosis import Ranked as Ranked
from .answer.diagnosis import Share as Share
from .answer.diagnosis import Step as Step
from .answer.diagnosis import Tracking as Tracking
from .answer.diagnosis import Where as Where
from .data.setting import Setting as Setting
from .effects.effect import Effect as Effect
from .effects.effect import Parameter as Parameter
from .effects.effect import place as place
from .effects.vocabulary import EFFECTS as EFFECTS
from .machine import Machine as Machine

from .diagnose import diagnose as diagnose  # isort: skip
