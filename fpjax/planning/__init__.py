"""Which run to record next: a reference within the limits of the machine that shows effects, or separates causes."""

from .answer import Separation as Separation
from .answer import Visible as Visible
from .result import Plan as Plan
from .verb import plan as plan
