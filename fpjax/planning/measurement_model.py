"""The measurement model of a planned run, as the diagnosis would make it: windows, modes, noise, missing torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..blocks.sensors import KalmanFusion
from ..gap.data.channel import make_channel
from ..gap.data.record import EDGE, FEWEST, LONGEST, SECONDS, SHORTEST
from ..gap.data.setting import drag_slope
from ..gap.fit.make_modes import make_modes
from ..gap.fit.modes import Modes
from ..gap.fit.search import BAND
from .limits import Limits

if TYPE_CHECKING:
    from ..logs import Log
    from ..model_file import Model

MISSING = 0.02  # share of the friction assumed as missing torque of a real machine, where no diagnosis gives it
RATE = 1e-3  # share of the top speed assumed as the noise of a rate sensor, where neither log nor model gives it
STEP = 2.0 * np.pi / 2**16  # [rad] step of an encoder, where neither log nor model gives it (16 bits)
MOST_WINDOWS = 24  # windows that are simulated at most; of a longer run they are spread over all of it


@dataclass(frozen=True)
class MeasurementModel:
    """Windows, noise and modes with which the diagnosis would look at a run.

    Attributes:
        dt: sample period [s].
        samples: samples of a window.
        starts: first sample of each window, shape (windows,).
        weight: number of windows of the whole run for each one that is simulated [1].
        channels: whether (velocity, position) is in the log.
        rate_noise: noise standard deviation of a rate reading [rad/s].
        angle_noise: noise standard deviation of a position reading [rad].
        missing: level of the missing torque q [N m].
        modes: the modes of a window.
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
        """Variance of each mode's coefficient, from noise (1) and missing torque [1], shape (modes,)."""
        # The coefficients are turned within half an octave, which then has one gain, `flat`, as in the diagnosis.
        torque = np.where(self.modes.sensor, 0.0, self.modes.flat)
        return 1.0 + self.missing**2 * torque


def make_measurement_model(
    model: Model, limits: Limits, log: Log | None, missing: float | None, noise: dict[str, float | None],
    notes: list[str],
) -> MeasurementModel:  # fmt: skip
    """The measurement model of a run of this length.

    Args:
        model: the nominal model.
        limits: of the run.
        log: gives the sensors' noise; None to take the model's.
        missing: level of the missing torque [N m]; None for `MISSING` of the friction.
        noise: standard deviations of "velocity" [rad/s] and "position" [rad]; None for those of the log or the model.
        notes: gets a sentence for every number that was chosen.
    """
    channels = model.sensors != "position", model.sensors != "velocity"
    rate, angle = (_noise(side, model, limits, log, noise.get(side), notes) for side in ("velocity", "position"))
    if missing is None:
        missing = MISSING * max(model.nominal["coulomb"], 0.05 * model.nominal["inertia"] * limits.acceleration)
        notes.append(
            f"a missing torque of {missing:.3g} {model.units.name('N m')} is assumed for every model ({MISSING:.0%} of "
            f"the friction); --missing sets another."
        )
    total = round(limits.duration / model.dt) + 1
    longest = min(LONGEST[not channels[0]], max(SHORTEST, total // FEWEST))
    samples = int(np.clip(round(SECONDS[0] / model.dt), SHORTEST, longest))
    starts = np.arange(0, total - samples - EDGE + 1, samples)
    chosen = starts[np.unique(np.linspace(0, len(starts) - 1, min(MOST_WINDOWS, len(starts))).round().astype(int))]
    rates, angles = (size if there else 0.0 for size, there in zip((rate, angle), channels, strict=True))
    # As many modes as the diagnosis uses: those of torque within its band; the first set only serves to count them.
    slope = model.nominal["viscous"] + drag_slope(model, limits.speed / np.sqrt(2.0))
    damping = slope / model.nominal["inertia"]
    first = make_modes(samples, model.dt, model.nominal["inertia"], rates, angles, damping=damping)
    most = max(16, int(np.sum(~first.sensor & (first.frequency < BAND * 0.5 / model.dt))))
    modes = make_modes(samples, model.dt, model.nominal["inertia"], rates, angles, most, damping=damping)
    return MeasurementModel(
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
    # Rounding to a step has the standard deviation step / sqrt(12).
    parts = [float(getattr(sensor, name, 0.0) or 0.0) / (np.sqrt(12.0) if "step" in name else 1.0) for name in known]
    size = float(np.hypot.reduce(parts)) if parts else 0.0
    if size > 0.0:
        return size
    size = RATE * limits.speed if side == "velocity" else STEP / np.sqrt(12.0)
    if there:
        unit = model.units.name("rad/s" if side == "velocity" else "rad")
        notes.append(
            f"the noise of the {side} column is not known: {size:.3g} {unit} is assumed (--{side}-noise sets another)."
        )
    return float(size)
