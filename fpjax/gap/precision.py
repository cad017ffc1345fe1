"""Double precision, in which every diagnosis is computed."""

from ..precision import double_precision as double_precision
