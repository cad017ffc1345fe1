"""Improve: from a diagnosis to gains that hold around every machine that it leaves possible."""

from .answer import Change as Change
from .answer import Improvement as Improvement
from .answer import Range as Range
from .answer import Side as Side
from .verb import improve as improve
