# pyright: reportArgumentType=false
"""Sizes: what bounds and starts are made from, read from the logs and the nominal model."""

import dataclasses
from typing import Any

import numpy as np

from ..blocks.signals import Motion
from .effect import Setting
from .hints import known_torque, position_hints
from .record import Record


def make_setting(records: list[Record], model: Any) -> Setting:
    """Sizes for bounds and starts, from the logs and the nominal model."""
    values = model.nominal
    longest = max(records, key=lambda record: len(record.time))
    torque = max(float(np.max(np.abs(record.torque))) for record in records)
    speed = max(float(np.quantile(np.abs(record.speed), 0.95)) for record in records)
    coulomb, viscous = values.get("coulomb", 0.0), values.get("viscous", 0.0)
    friction = max(coulomb, 0.02 * torque)
    setting = Setting(
        inertia=values["inertia"],
        coulomb=coulomb,
        viscous=viscous,
        friction=friction,
        speed=max(speed, 1e-12),
        torque=torque,
        travel=float(np.ptp(longest.angle)),
        duration=float(longest.time[-1] - longest.time[0]),
        dt=longest.dt,
        nominal={"inertia": values["inertia"], "coulomb": coulomb, "viscous": viscous},
        unknown_origin=longest.position is None and turns_with_position(model.loop.plant.load),
    )
    return dataclasses.replace(
        setting, hints=position_hints(longest, setting, known_torque(longest, model.loop.plant.load))
    )


def turns_with_position(load: Any) -> bool:
    """Whether a known load depends on the position."""
    at = [Motion(np.zeros(1), np.full(1, angle), np.zeros(1)) for angle in (0.0, 0.7, 1.9)]
    values = [float(np.asarray(load.readout(motion))[0]) for motion in at]
    return max(values) - min(values) > 0.0
