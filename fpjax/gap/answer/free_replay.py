"""Free replay: how far a model leaves the measured motion where nothing but the recorded torque drives it.

Fits may hold their simulations near the motion (`fpjax.gap.fit.guide`); what a user simulates is free. The number
beside the missing torque therefore says what that torque does to the motion of a window.
"""

from dataclasses import asdict, dataclass

import numpy as np

from ...output.json_object import JsonObject
from ...simulation.precision import double_precision
from ..data.replay_tables import tables_of
from ..fit.candidate import Fit
from ..fit.search import Search
from ..simulate.family import Runner, window_fields


@dataclass(frozen=True)
class FreeReplay:
    """Departure of free simulations from the log, rms over all windows, each from start values of its own.

    Attributes:
        before: with the nominal model, of the rms motion [1].
        after: with the causes in, likewise.
        window: length of a window [s].
        guide: bandwidth [Hz] with which the fits held their simulations near the motion; 0 where they were free too.
    """

    before: float
    after: float
    window: float
    guide: float

    def to_dict(self) -> JsonObject:
        """All of it, by name."""
        return asdict(self)


def free_replay(search: Search, before: Fit, after: Fit) -> FreeReplay:
    """The departures of two models.

    Args:
        search: of the logs.
        before: the nominal model.
        after: the chosen one.
    """
    record = search.records[0]
    departures = _departure(search, before), _departure(search, after)
    return FreeReplay(*departures, window=record.samples * record.dt, guide=search.guide)


def _departure(search: Search, fit: Fit) -> float:
    c = fit.candidate
    with double_precision():
        # The same compiled loop with other tables among its arguments.
        free = [tables_of(record, free=True) for record in search.records]
        runner = Runner(search.fitters[c.family.key].runner.family, search.records, free)
    squares, motion = [], []
    for which, record in enumerate(search.records):
        windows = np.arange(len(record.starts))
        vector = np.repeat(c.vector[:, None], len(windows), 1)
        fields = window_fields(record, windows, c.hidden[which])
        residual = runner.run(which, vector, c.states[which], fields)[0]
        squares.append(np.mean(residual**2, axis=(0, 1)))
        motion.append(record.motion_squares())
    return float(np.sqrt(np.mean(np.concatenate(squares)) / np.mean(np.concatenate(motion))))
