"""The gains that are best in the nominal model alone, as a tuning without a log finds them, for comparison."""

import math
from collections.abc import Sequence

import numpy as np

from ..logs import Log
from ..logs.arrays import Values
from ..model_file import Model
from ..simulation.precision import double_precision
from .answer import NominalGains
from .decision import range_of, too_much
from .gains import freed, guesses
from .judge import Judge, Score
from .machines import COURSES, Ground, nominal_machines, one_piece, ready, records_of
from .reference import followed
from .search import CANDIDATES, ROUGHEST, AllowedScore, allowed_roughness, limits_of, search


def nominal_gains(
    log: Log, model: Model, free: Sequence[str] = (), seed: int = 0, table: Values | None = None
) -> dict[str, float]:
    """The gains that follow best in the nominal model, by their names in the file: the same search with one machine.

    Args:
        log: gives the reference, the initial motion, the largest torque so far and the sensors' noise; nothing else of
            it is used.
        model: the nominal model.
        free: as for `improve`.
        seed: of the search.
        table: the reference, shape (samples,); None for the log's.
    """
    with double_precision():
        records = records_of(log, model)
        record, table = one_piece(records[0], log, followed(log, model, "log") if table is None else table)
        machine = {name: model.nominal[name] for name in ("inertia", "coulomb", "viscous")}
        gains = freed(model, machine, table, free)
        noise = tuple(0.0 if channel is None else float(channel.noise) for channel in (record.reading, record.position))
        machines = nominal_machines(model)
        silent = np.zeros((COURSES, len(record.time)))
        ground = Ground(record, records, silent, (noise[0], noise[1]), machines.substeps, ())
        machines = ready(machines, ground, machines.periods(record.dt))
        judge = Judge(gains.model, gains.names, ground, table, seed + 3, CANDIDATES)
        limits = limits_of(judge(gains.now[None], machines).of(0), record, model)
        found = search(judge, gains, machines, guesses(gains, machine), limits, seed + 4)
        return {gain.word: float(value) for gain, value in zip(gains.gains, found.values, strict=True)}


def compare_nominal(
    gains: dict[str, float], scores: Score, chosen: int, limits: AllowedScore, objection: str, unit: str
) -> NominalGains:
    """The nominal model's gains beside those that the answer leaves, on the machines of the diagnosis.

    Args:
        gains: of `nominal_gains`.
        scores: of all candidates, each of shape (candidates, machines): the current gains first, these last.
        chosen: place of the gains that the answer leaves.
        limits: of the search.
        objection: to these gains, as `decision.objection` tells it.
        unit: of the torque.
    """
    stable = np.isfinite(scores.error[chosen])
    rough = scores.rough[-1] / max(float(np.median(allowed_roughness(scores.of(0)))), 1e-300)
    return NominalGains(
        gains,
        range_of(scores.error[-1][stable] / scores.error[chosen][stable], "1"),
        range_of(scores.peak[-1], unit),
        limits.peak if math.isfinite(limits.peak) else None,
        range_of(rough, "1"),
        ROUGHEST,
        objection or too_much(scores.of(-1), limits, unit),
        chosen == len(scores.error) - 1,
    )
