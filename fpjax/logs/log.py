"""Log: the recorded run of a machine, in SI units, on one uniform clock."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from ..errors import InputError
from ..output.drawable import Drawable
from .arrays import Values, rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OTHER_PERIOD = 0.01  # relative deviation of the times' steps from dt, above which they are of another clock
ROUNDING = 1e-9  # of its size: a reference that changes by no more was constant before it was resampled


def _numbers(values: Any, name: str, log: str) -> Values:
    """A list as an array of float64."""
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise InputError(f"{log}: {name} must be numbers, one for each time.") from None


@dataclass(frozen=True)
class Log(Drawable):
    """A recorded run of one machine: float64, SI units, one row per control period.

    `plot` draws every column against time.

    Attributes:
        time: start of each control period [s], uniform, shape (samples,).
        torque: commanded at that time (or measured, see torque_measured) and held over the period [N m] (linear
            axis: [N]), shape (samples,).
        velocity: read at the start of the period [rad/s] (linear: [m/s]); None where the log has none.
        position: read at the start of the period [rad] (linear: [m]); None where the log has none.
        reference: reference of the controller [rad/s], or [rad] for a position loop; None where the log has none.
        dt: control period [s].
        name: of the file or the data, for messages and pictures.
        linear: whether motion is in metres and torque in newtons.
        torque_unit: "N m", "N", or a label ("V", "PWM", ...) that also replaces N m in inertia and friction.
        extra: the other columns, as they were recorded; "torque_measured" in torque_unit and "temperature" [deg C]
            where the log has them.
        jitter: largest deviation of a recorded time stamp from the uniform clock [s].
        sha256: of the file; "" where the log came from arrays.
        warnings: what the reader found and changed, a sentence each.
        torque_step: the torque is rounded to multiples of it, in torque_unit; 0 where no rounding is seen.
        torque_measured: the torque was measured by the drive, not commanded.
        torque_lag: delay of the measured torque (in `extra`) behind the commanded one [s]; None without both.
        resampled: values were interpolated or filled to get a uniform clock.
        since: from the start of the recording's first stretch to this one's [s]; 0 where time starts anew.
        further: other stretches of the same recording, each a log of its own, where time starts anew or was
            interrupted; this one is the longest. A changed log (`dataclasses.replace`) has none.

    Raises:
        InputError: for columns of other shapes, and for a dt that is not the step of the times.
    """

    time: Values
    torque: Values
    velocity: Values | None
    position: Values | None
    reference: Values | None
    dt: float
    name: str = "log"
    linear: bool = False
    torque_unit: str = "N m"
    extra: dict[str, Values] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    jitter: float = 0.0
    sha256: str = ""
    torque_step: float = 0.0
    torque_measured: bool = False
    torque_lag: float | None = None
    resampled: bool = False
    since: float = 0.0
    further: tuple["Log", ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        for name in ("time", "torque", "velocity", "position", "reference"):
            values = getattr(self, name)
            if values is None:
                continue
            if isinstance(values, (list, tuple)):
                object.__setattr__(self, name, values := _numbers(values, name, self.name))
            if values.shape != np.shape(self.time)[:1]:
                raise InputError(
                    f"{self.name}: {name} has the shape {values.shape} and time {np.shape(self.time)}: every column of "
                    f"a Log needs one number for each time."
                )
        if not isinstance(self.dt, (int, float, np.number)) or not 0.0 < self.dt < np.inf:
            raise InputError(f"{self.name}: dt must be a positive time in s, got {self.dt!r}.")
        if len(self.time) < 2:
            return
        # Either may be right: of a time in single precision the mean, of one with a break the median.
        steps = np.diff(np.asarray(self.time, float))
        step = float(np.median(steps))
        usual = float(np.mean(steps[steps <= 2.0 * step])) if step > 0.0 else step
        if not min(abs(each / self.dt - 1.0) for each in (step, usual)) <= OTHER_PERIOD:
            raise InputError(
                f"{self.name}: its times are {step:.6g} s apart, but its dt is {self.dt:.6g} s: give the control "
                f"period that the times have, or let fpjax.read_log take the columns."
            )

    def __len__(self) -> int:
        return len(self.time)

    @property
    def samples(self) -> int:
        """Number of rows."""
        return len(self.time)

    @property
    def duration(self) -> float:
        """From the first period's start to the last one's end [s]."""
        return self.samples * self.dt

    @property
    def rate(self) -> float:
        """Control rate [Hz]."""
        return 1.0 / self.dt

    @property
    def motion_unit(self) -> str:
        """Unit of position: "m" or "rad"."""
        return "m" if self.linear else "rad"

    def columns(self) -> dict[str, Values]:
        """The canonical columns that are there, by name, in the contract's order."""
        names = ("time", "torque", "velocity", "position", "reference")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def with_further(self, further: Iterable["Log"]) -> "Log":
        """The same log with other stretches of its recording beside it."""
        log = replace(self)
        # not a field that `replace` takes along: stretches of changed columns would be other data
        object.__setattr__(log, "further", tuple(further))
        return log

    def to_dataframe(self) -> Any:
        """The columns and what else was recorded as a `pandas.DataFrame`, the time [s] as its index.

        Raises:
            InputError: where pandas is not installed.
        """
        from ..output.data_frames import to_frame

        columns = {name: values for name, values in self.columns().items() if name != "time"}
        return to_frame(columns | {name: each for name, each in self.extra.items() if name not in columns}, self.time)

    def _figure(self) -> "Figure":
        from ..output.run_picture import columns_figure

        rate = f"{self.motion_unit}/s"
        units = {"position": self.motion_unit, "velocity": rate, "torque": self.torque_unit}
        units["reference"] = self.motion_unit if asks_for_a_position(self) else rate
        columns = {name: values for name, values in self.columns().items() if name != "time"}
        return columns_figure(self.time, columns, units, self.name)

    def __str__(self) -> str:
        return (
            f"{self.name}: {self.samples} samples at {self.rate:.6g} Hz ({self.duration:.4g} s), "
            f"{', '.join(self.columns())}"
        )

    __repr__ = __str__


@runtime_checkable
class NamedArrays(Protocol):
    """Columns by name: a mapping of arrays, a pandas or polars DataFrame, a pyarrow table."""

    def __getitem__(self, name: Any, /) -> Any:
        """One column, anything that numpy makes an array of numbers of, shape (samples,)."""
        ...


LogSource = Log | str | os.PathLike[str] | NamedArrays
"""What a verb takes for a log: one that is read, the path of its file, or its columns."""


def asks_for_a_position(log: Log) -> bool:
    """Whether the reference is a position: it is nearer to the logged position than to the velocity.

    A reference that never changes is held against their levels, any other against their changes alone. In a log with
    only one of them, the reference is taken to be of that kind.
    """
    if log.reference is None or log.position is None or log.velocity is None:
        return log.velocity is None
    reference = np.asarray(log.reference)
    # distances relative to the spread of each motion: a position in rad and a velocity in rad/s do not compare as
    # numbers
    changes = np.ptp(reference) > ROUNDING * np.max(np.abs(reference))
    far = np.std if changes else rms
    off = [far(reference - motion) / (np.std(motion) or 1.0) for motion in (log.position, log.velocity)]
    return bool(off[0] < off[1])
