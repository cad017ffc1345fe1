# pyright: reportArgumentType=false
"""Corners: what a perfect model leaves of the torque where the motion is imposed.

A position is smoothed before it is differentiated, and that rounds off the corners which friction puts into the motion
at a reversal. No effect of the vocabulary is needed to explain what they leave, yet a compliance can. So a log is made
in which the nominal model, one rigid mass, is right, along the measured motion and with the encoder's noise, and goes
through the same code.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ..blocks.plants import OneMass
from .attribute import Search
from .family import Nominal
from .imposed import noise_torque
from .machine import known_load, nominal_machine
from .null import made_logs
from .record import make_record
from .residual import torque_residual
from .rigid import rigid_body


def corner_torque(search: Search) -> float:
    """Root mean square of what is left of the made log's torque by the model that made it [N m], found once.

    Args:
        search: on logs without a rate sensor; its `corners` keep the answer.
    """
    if search.corners is None:
        search.corners = _left(search)
    return search.corners


def _left(search: Search) -> float:
    machine = search.family(()).machine
    plant: Any = OneMass(machine.plant.inertia, machine.law, known_load(machine))
    body, record = rigid_body(nominal_machine(plant)), search.records[0]
    made = made_logs(record, body, torque_residual(record, body), draws=1)[0]
    again = make_record(made, withhold="all", window=record.samples * record.dt, half=record.half)
    assert again.position is not None
    assert record.position is not None
    again = replace(again, position=replace(again.position, noise=record.position.noise))
    alone = Search([again], Nominal(plant), search.effects, search.setting)
    candidate = alone.candidate((), {}, "fixed")
    (left,) = alone.fitters[candidate.family.key].score([candidate], alone.withheld)
    return float(np.sqrt(np.sum(left) / alone.count)) * noise_torque(again, search.setting.inertia)
