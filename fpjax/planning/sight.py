"""Sight: what the diagnosis would see of a run: windows, modes, noise and the level of the missing torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..blocks.sensors import KalmanFusion
from ..gap.data.channel import make_channel
from ..gap.data.record import EDGE, LONGEST, SECONDS, SHORTEST
from ..gap.fit.modes import Modes, make_modes
from ..gap.fit.search import BAND
from .limits import Limits

if TYPE_CHECKING:
    from ..logs import Log
    from ..model_file import Model

MISSING = 0.02  # of the friction: the missing torque that every real machine is taken to have, where no log tells
RATE = 1e-3  # of the top speed: noise of a rate sensor that nobody described
STEP = 2.0 * np.pi / 2**16  # rad: of an encoder that nobody described
MOST_WINDOWS = 24  # that are simulated; of a longer run, spread over all of it


@dataclass(frozen=True)
class Sight:
    """What the diagnosis would see.

    Attributes:
        dt: [s].
        samples: of a window.
        starts: first sample of each window, shape (windows,).
        weight: windows of the whole run for each one that is simulated [1].
        channels: whether (velocity, position) is in the log.
        rate_noise: standard deviation of a rate reading [rad/s].
        angle_noise: of a position reading [rad].
        missing: level of the missing torque q [N m].
        modes: of a window.
    """

    dt: float
    samples: int
    starts: np.ndarray
    weight: float
    channels: tuple[bool, bool]
    rate_noise: float
    angle_noise: float
    missing: float
    modes: Modes

    @property
    def variance(self) -> np.ndarray:
        """Of a coefficient: noise and missing torque [1], shape (modes,)."""
        torque = np.where(self.modes.sensor, 0.0, self.modes.gain)
        return 1.0 + self.missing**2 * torque


def make_sight(
    model: Model, limits: Limits, log: Log | None, missing: float | None, noise: dict[str, float | None],
    notes: list[str],
) -> Sight:  # fmt: skip
    """How the diagnosis would look at a run of this length.

    Args:
        model: the nominal one.
        limits: of the run.
        log: whose sensors' noise is taken; None for the model's.
        missing: level of the missing torque [N m]; None for `MISSING` of the friction.
        noise: "velocity" [rad/s] and "position" [rad], None where the log or the model tells.
        notes: a sentence is appended for every number that was chosen.
    """
    channels = model.sensors != "position", model.sensors != "velocity"
    rate, angle = (_noise(side, model, limits, log, noise.get(side), notes) for side in ("velocity", "position"))
    if missing is None:
        missing = MISSING * max(model.nominal["coulomb"], 0.05 * model.nominal["inertia"] * limits.acceleration)
        notes.append(
            f"a missing torque of {missing:.3g} {model.units.name('N m')} is assumed beside every model "
            f"({MISSING:.0%} of the friction); --missing says another."
        )
    total = round(limits.duration / model.dt) + 1
    samples = int(np.clip(round(SECONDS[0] / model.dt), SHORTEST, LONGEST[channels[0]]))
    samples = min(samples, max(SHORTEST, (total - EDGE) // 4))
    starts = np.arange(0, total - samples - EDGE + 1, samples)
    chosen = starts[np.unique(np.linspace(0, len(starts) - 1, min(MOST_WINDOWS, len(starts))).round().astype(int))]
    rates, angles = (size if there else 0.0 for size, there in zip((rate, angle), channels, strict=True))
    first = make_modes(samples, model.dt, model.nominal["inertia"], rates, angles)
    most = max(16, int(np.sum(~first.sensor & (first.frequency < BAND * 0.5 / model.dt))))
    modes = make_modes(samples, model.dt, model.nominal["inertia"], rates, angles, most)
    return Sight(
        model.dt, samples, chosen, len(starts) / len(chosen), channels, rate, angle, float(missing), modes
    )  # fmt: skip


def _noise(side: str, model: Model, limits: Limits, log: Log | None, given: float | None, notes: list[str]) -> float:
    there = model.sensors in (side, "both")
    column = None if log is None else getattr(log, side)
    if given is not None:
        return given
    if there and column is not None:
        return make_channel(column).noise
    sensor = model.loop.sensor
    known = {
        "velocity": (("noise", "step_size") if not isinstance(sensor, KalmanFusion) else ()),
        "position": ("position_noise", "position_step", "angle_noise"),
    }[side]
    parts = [float(getattr(sensor, name, 0.0) or 0.0) / (np.sqrt(12.0) if "step" in name else 1.0) for name in known]
    size = float(np.hypot.reduce(parts)) if parts else 0.0
    if size > 0.0:
        return size
    size = RATE * limits.speed if side == "velocity" else STEP / np.sqrt(12.0)
    if there:
        unit = model.units.name("rad/s" if side == "velocity" else "rad")
        notes.append(
            f"the noise of the {side} column is not known: {size:.3g} {unit} is assumed (--{side}-noise says another)."
        )
    return float(size)
