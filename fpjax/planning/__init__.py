"""Which run to record next: a reference within the limits of the machine that shows effects, or separates causes."""

from .result import Plan as Plan
from .result import Separation as Separation
from .result import Visible as Visible
from .verb import plan as plan
