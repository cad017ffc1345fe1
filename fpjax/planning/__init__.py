"""Which run to record next: a reference under the machine's limits that shows, or separates, what a log left open."""

from .result import Plan as Plan
from .result import Separation as Separation
from .result import Visible as Visible
from .verb import plan as plan
