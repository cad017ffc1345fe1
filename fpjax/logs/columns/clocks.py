"""Whether the columns of a log are of one clock: a file of several recorders holds a time for each."""

from collections.abc import Mapping

import numpy as np

from .axes import owner_of
from .mapping import Source
from .names import guess

SAME = 1e-3  # of the mean step: what the digits of a text file leave of a stamp


def other_clocks(
    columns: Mapping[str, np.ndarray], sources: Mapping[str, Source], units: Mapping[str, str], name: str
) -> list[str]:
    """A sentence for each column that has a time of its own whose stamps are not those of the time that was taken.

    Args:
        columns: of the file, by name.
        sources: where the canonical columns come from.
        units: from a row of units, by name.
        name: of the file, for messages.
    """
    taken = sources["time"].column if "time" in sources else ""
    if taken not in columns:  # rows at a given rate, or a column of words
        return []
    stamps = columns[taken]
    times = {each.owner: each.column for each in reversed(guess(columns, units).get("time", [])) if each.owner}
    notes = []
    for canonical, source in sources.items():
        own = times.get(owner_of(source.column), taken)
        if own == taken or canonical == "time" or own not in columns or columns[own].size != stamps.size:
            continue
        if stamps.size < 2:
            continue
        apart = float(np.nanmax(np.abs(columns[own] - stamps)))
        if apart > SAME * abs(float(np.nanmean(np.diff(stamps)))):
            notes.append(
                f"{name}: {source.column!r} was recorded at the times {own!r}, which are up to {apart:.3g} off "
                f"{taken!r}, but is read at those: put the recordings on one clock first."
            )
    return notes
