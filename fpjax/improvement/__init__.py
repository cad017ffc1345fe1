"""From a diagnosis to gains that follow better in nearly every machine that the log leaves possible."""

from .answer import Change as Change
from .answer import Range as Range
from .answer import Side as Side
from .result import Improvement as Improvement
from .verb import improve as improve
