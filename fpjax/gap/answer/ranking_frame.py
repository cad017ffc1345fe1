"""The ranking of a diagnosis as a data frame (needs pandas)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ...output.data_frames import to_frame

if TYPE_CHECKING:
    from .answer import Answer


def ranking_frame(diagnosis: Answer) -> Any:
    """A row for each parameter of each effect tried, most probable effect first, as `Diagnosis.to_dataframe` says.

    Args:
        diagnosis: whose ranking is tabulated.
    """
    rows = []
    for entry in diagnosis.ranking:
        head = (entry.effect in diagnosis.causes, entry.probability, entry.cause_probability, entry.gap_after)
        # An effect without parameters keeps one row, so that its probability is in the frame.
        parameters = [(name, p.value, p.low, p.high, p.unit) for name, p in entry.parameters.items()]
        rows += [(*head, *each) for each in parameters or [("", math.nan, math.nan, math.nan, "")]]
    names = ("cause", "probability", "cause_probability", "gap_after", "parameter", "value", "low", "high", "unit")
    columns = {name: [row[i] for row in rows] for i, name in enumerate(names)}
    effects = [entry.effect for entry in diagnosis.ranking for _ in range(max(len(entry.parameters), 1))]
    return to_frame(columns, effects, "effect")
