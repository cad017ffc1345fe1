"""The sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""

from .diagnosis import Comparison as Comparison
from .diagnosis import Diagnosis as Diagnosis
from .diagnosis import Estimate as Estimate
from .diagnosis import Experiment as Experiment
from .diagnosis import Gap as Gap
from .diagnosis import Identifiability as Identifiability
from .diagnosis import Ranked as Ranked
from .diagnosis import Share as Share
from .diagnosis import Step as Step
from .diagnosis import Tracking as Tracking
from .diagnosis import Where as Where
from .effect import Effect as Effect
from .effect import Parameter as Parameter
from .effect import Setting as Setting
from .effect import place as place
from .machine import Machine as Machine
from .vocabulary import EFFECTS as EFFECTS

from .diagnose import diagnose as diagnose  # isort: skip
