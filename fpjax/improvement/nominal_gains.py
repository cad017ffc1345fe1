"""The gains that are best in the nominal model alone, as a tuning without a log finds them, for comparison."""

from collections.abc import Sequence

import numpy as np

from ..logs import Log
from ..model_file import Model
from .gains import freed, guesses
from .judge import Judge
from .machines import COURSES, Ground, nominal_machines, one_piece, ready, record_of
from .search import limits_of, search
from .verb import followed, largest_torque


def nominal_gains(log: Log, model: Model, free: Sequence[str] = (), seed: int = 0) -> dict[str, float]:
    """The gains that follow best in the nominal model, by their names in the file: the same search with one machine.

    Args:
        log: gives the reference, the initial motion and the sensors' noise; nothing else of it is used.
        model: the nominal model.
        free: as for `improve`.
        seed: of the search.
    """
    table = followed(log, model, "log")
    whole = record_of(log, model)
    record, table = one_piece(whole, log, table)
    machine = {name: model.nominal[name] for name in ("inertia", "coulomb", "viscous")}
    gains = freed(model, machine, table, free)
    noise = tuple(0.0 if channel is None else float(channel.noise) for channel in (record.reading, record.position))
    machines = nominal_machines(model)
    silent = np.zeros((COURSES, len(record.time)))
    ground = Ground(record, whole, silent, (noise[0], noise[1]), machines.substeps, ())
    machines = ready(machines, ground, machines.periods(record.dt))
    judge = Judge(gains.model, gains.names, ground, table, seed + 3)
    limits = limits_of(judge(gains.now[None], machines).of(0), largest_torque(record), model.limits.get("torque"))
    found = search(judge, gains, machines, guesses(gains, machine), limits, seed + 4)
    return {gain.word: float(value) for gain, value in zip(gains.gains, found.values, strict=True)}
