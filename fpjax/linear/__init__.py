"""A loop linearised at a point: state space, margins, step response."""

from .linear_loop import LinearLoop as LinearLoop
from .linearise import linearise as linearise
from .margins import Margins as Margins
from .margins import margins as margins
from .state_space import StateSpace as StateSpace
