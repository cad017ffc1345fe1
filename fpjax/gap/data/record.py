"""Record: a log made ready for the fit, cut into windows that are fitted or withheld."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from ...errors import InputError
from ...logs import Log
from ...logs.arrays import Values
from ...logs.checks.agreement import in_another_unit
from ...logs.checks.stamp_jitter import stamp_jitter
from ...logs.noise import is_derived
from .channel import Channel, common_noise, make_channel
from .motion import encoder_rate, motion
from .split import every_fourth

SECONDS = (0.5, 1.0)  # bounds of a window's length [s], within which it is the mean time between two reversals
RESOLVED = 0.02  # of the torque's rms: standard deviation with which a window should resolve a constant torque
TURNING = 0.05  # of the top speed: below it a sign of the speed is noise and counts as no direction
SHORTEST, LONGEST = 64, (512, 1024)  # samples of a window; the most with and without a rate sensor
FEWEST = 8  # windows that a log is cut into at least
MOST = 48_000  # samples of all logs that are simulated; of longer ones, stretches in which the machine moves
STRETCHES = 8  # of a longer log: six seconds each at 1 kHz, longer than friction's memory and a period of a loop
LEAD = 512  # samples kept before the first window of a stretch: the past of lags (`TAPS`) and of hidden states
LONG = 4  # times lead and edge, from which stretches pay; in a shorter log pairs of windows are left out instead
KEPT = 4  # windows that each log keeps at least, one of them withheld: of a short one beside a long one it had none
EDGE = 32  # samples kept after the last window, for the sensor's dead time
LEAST = 3 * SHORTEST + EDGE  # samples of the shortest log that can be diagnosed: three windows, one of them withheld


@dataclass(frozen=True)
class Record:
    """One log, its motion and its windows.

    Attributes:
        name: the log's.
        time: of each sample [s], shape (samples,), as every array of the log below.
        torque: commanded [N m].
        velocity: the rate sensor's column, fitted; None without one, or where the position is enough.
        position: the encoder's column, fitted; None without one.
        reading: the velocity column, fitted or not; None without one.
        reference: the commanded motion, or None.
        dt: control period [s].
        linear: whether the log is in metres and newtons (rad and N m stand for them everywhere).
        speed: smoothed rate [rad/s].
        acceleration: its rate of change [rad/s^2].
        angle: smoothed position [rad]: measured, or the integral of the rate.
        speed_noise: standard deviation of `speed` [rad/s].
        followed: smoothed rate that simulations are held to [rad/s]: the encoder's own, which a rate reading may lag;
            the reading's without an encoder.
        followed_noise: standard deviation of `followed` [rad/s].
        smoothing: samples on either side that an encoder's rate is smoothed over; 0 without an encoder.
        starts: first sample of each window, shape (windows,).
        samples: length of every window.
        withheld: whether a window is never fitted, shape (windows,), bool.
        runs: factor on the variance of the readings in a window, for repeated readings [1], shape (windows,).
        since: from the start of the recording to the first sample [s]; above 0 for a stretch after a pause.
        recorded: number of samples of the whole log. Of a long one the arrays hold stretches only, and `time` jumps
            between them.
    """

    name: str
    time: Float[Values, " samples"]
    torque: Float[Values, " samples"]
    velocity: Channel | None
    position: Channel | None
    reading: Channel | None
    reference: Float[Values, " samples"] | None
    dt: float
    linear: bool
    speed: Float[Values, " samples"]
    acceleration: Float[Values, " samples"]
    angle: Float[Values, " samples"]
    speed_noise: float
    followed: Float[Values, " samples"]
    followed_noise: float
    smoothing: int
    starts: Int[Values, " windows"]
    samples: int
    withheld: Bool[Values, " windows"]
    runs: Float[Values, " windows"]
    since: float
    recorded: int

    @property
    def integrated(self) -> bool:
        """Whether `angle` is an integral, whose zero no sensor measures."""
        return self.position is None

    @property
    def elapsed(self) -> Float[Values, " samples"]:
        """Time since the recording began [s], of which a drift is a function, shape (samples,)."""
        return self.time - self.time[0] + self.since

    @property
    def channels(self) -> tuple[bool, bool]:
        """Whether (velocity, position) is fitted."""
        return self.velocity is not None, self.position is not None

    def rows(self, windows: Values | slice = slice(None)) -> Int[Values, "windows samples"]:
        """Indices of the samples of some windows (of all), shape (windows, samples of a window)."""
        return self.starts[windows][:, None] + np.arange(self.samples)

    def motion_squares(self) -> Float[Values, " windows"]:
        """Mean square of the motion in each window, in standard deviations of the sensors, shape (windows,)."""
        rows, found = self.rows(), []
        if self.velocity is not None:
            found.append(np.mean((self.speed[rows] / self.velocity.noise) ** 2, axis=1))
        if self.position is not None:
            found.append(np.var(self.angle[rows], axis=1) / self.position.noise**2)
        return np.mean(found, axis=0)

    def windows_of_samples(self) -> Int[Values, " samples"]:
        """Index of the window of each sample, -1 for none, shape (samples,)."""
        index = np.full(len(self.time), -1)
        for window, start in enumerate(self.starts):
            index[start : start + self.samples] = window
        return index


def make_records(logs: Sequence[Log], holdout: Sequence[Log], inertia: float) -> list[Record]:
    """Logs of one machine as records, with one window length and one noise standard deviation a sensor for all.

    Args:
        logs: fitted; where nothing else is withheld, every fourth block of windows is.
        holdout: never fitted.
        inertia: nominal J [kg m^2], by which a torque becomes an acceleration that the sensors resolve or not.

    Raises:
        InputError: for logs that are too short, or differ in period or columns.
    """
    everything = [*logs, *holdout]
    columns = [_columns(log) for log in everything]
    if _position_is_enough(everything, columns, inertia):
        columns = [(None if position is not None else velocity, position) for velocity, position in columns]
    _check_alike(everything, columns)
    rates = common_noise([velocity for velocity, _ in columns])
    angles = common_noise([position for _, position in columns])
    shortest = min(len(log.time) for log in everything)
    samples = max(
        _window(log, rate, angle, inertia, shortest) for log, rate, angle in zip(everything, rates, angles, strict=True)
    )
    count = sum(len(log.time) for log in everything)
    sides = ["none" if holdout else "blocks"] * len(logs) + ["all"] * len(holdout)
    return [
        _record(log, rate, angle, samples, side, count)
        for log, rate, angle, side in zip(everything, rates, angles, sides, strict=True)
    ]


def _columns(log: Log) -> tuple[Channel | None, Channel | None]:
    """(rate, position) of a log.

    Raises:
        InputError: for a log without either, or with too few samples.
    """
    if log.velocity is None and log.position is None:
        raise InputError(f"{log.name} has neither a velocity nor a position column: the diagnosis needs one of them.")
    if len(log.time) < LEAST:
        raise InputError(
            f"{log.name}: {len(log.time)} samples ({len(log.time) * log.dt:.3g} s) are too few: at least {LEAST} "
            f"({LEAST * log.dt:.3g} s) are needed to fit some stretches and to withhold others; record for longer."
        )
    velocity = None if log.velocity is None else make_channel(log.velocity, rate=True)
    position = None if log.position is None else make_channel(log.position)
    if velocity is not None and position is not None:
        # A reading taken `late` seconds beside its stamp is wrong by the travel in between: noise that grows with the
        # speed, however quiet the encoder is at rest.
        late = stamp_jitter(velocity.values, position.values, float(log.dt)) or 0.0
        moved = late * float(np.sqrt(np.mean(velocity.values**2)))
        position = replace(position, noise=float(np.hypot(position.noise, moved)))
    return velocity, position


def _position_is_enough(
    logs: Sequence[Log], columns: Sequence[tuple[Channel | None, Channel | None]], inertia: float
) -> bool:
    """Whether the rate beside a position is not fitted but left to `fpjax.gap.select.readings`.

    So it is where the encoder alone resolves the torques of every log: most drives differentiate and filter the same
    encoder for the rate, and its lag and scale must not change the estimated torque. That a rate was derived, or is in
    another unit, one log shows for all. It is not enough where positions are read off their stamps, which is no white
    noise: the rate beside them knows better.
    """
    both = [
        (log, rate.values, angle)
        for log, (rate, angle) in zip(logs, columns, strict=True)
        if rate is not None and angle is not None
    ]
    if any(is_derived(rate, angle.values) or in_another_unit(rate, angle.values, log.dt) for log, rate, angle in both):
        return True
    if any(stamp_jitter(rate, angle.values, float(log.dt)) for log, rate, angle in both):
        return False
    return all(
        _resolved(None, angle, inertia, SECONDS[1], log.dt) < RESOLVED * float(np.sqrt(np.mean(np.square(log.torque))))
        for log, _, angle in both
    )


def _check_alike(logs: Sequence[Log], columns: Sequence[tuple[Channel | None, Channel | None]]) -> None:
    first, (velocity, position) = logs[0], columns[0]
    for log, (rate, angle) in zip(logs[1:], columns[1:], strict=True):
        if (rate is None) != (velocity is None) or (angle is None) != (position is None):
            raise InputError(
                f"{log.name} and {first.name} do not have the same columns: give both velocity, or position, or both."
            )
        if abs(log.dt / first.dt - 1.0) > 1e-3:
            raise InputError(
                f"{log.name} has a period of {log.dt:g} s and {first.name} of {first.dt:g} s: logs of one machine need "
                f"one period; diagnose them apart with --each."
            )


def _window(log: Log, velocity: Channel | None, position: Channel | None, inertia: float, shortest: int) -> int:
    """Samples of a window.

    The start values of a window are free, so it shows no torque that is slower than itself. It should reach from one
    reversal to the next, and be long enough for the sensors to resolve a torque of `RESOLVED` of the commanded rms.
    """
    dt, torque = float(log.dt), float(np.sqrt(np.mean(np.square(log.torque))))
    speed = motion(velocity, position, dt)[0]
    fast = speed[np.abs(speed) > TURNING * np.quantile(np.abs(speed), 0.95)]
    turns = int(np.sum(np.diff(np.sign(fast)) != 0))
    seconds = float(np.clip(len(speed) * dt / (turns + 1), *SECONDS))
    longest = min(LONGEST[velocity is None], max(SHORTEST, shortest // FEWEST))
    samples = int(np.clip(round(seconds / dt), SHORTEST, longest))
    while samples < longest and _resolved(velocity, position, inertia, samples * dt, dt) >= RESOLVED * torque:
        samples = min(2 * samples, longest)
    return samples


def _resolved(velocity: Channel | None, position: Channel | None, inertia: float, length: float, dt: float) -> float:
    """Standard deviation [N m] of a constant torque, as the better sensor resolves it in a window of a length [s]."""
    samples, known = length / dt, [np.inf]
    # Least squares of a parabola (angle) or a line (rate) with unknown start values, in white noise:
    if position is not None:
        # Var(a) = 720 sigma^2 / (n T^4) for x0 + v0 t + a t^2 / 2, and Var(a) = 12 sigma^2 / (n T^2) for v0 + a t.
        known.append(inertia * position.noise * np.sqrt(720.0 / samples) / length**2)
    if velocity is not None:
        known.append(inertia * velocity.noise * np.sqrt(12.0 / samples) / length)
    return float(min(known))


def _record(
    log: Log, velocity: Channel | None, position: Channel | None, samples: int, side: str, total: int
) -> Record:
    dt = float(log.dt)
    speed, acceleration, angle, speed_noise = motion(velocity, position, dt)
    followed, followed_noise, smoothing = speed, speed_noise, 0
    if position is not None:
        followed, followed_noise, smoothing = encoder_rate(velocity, position, dt)
    starts = np.arange(0, len(log.time) - samples - EDGE + 1, samples)
    kept: Values | slice = slice(None)
    if total > MOST and len(log.time) > LONG * (LEAD + EDGE) + FEWEST * samples:
        kept, starts = _stretches(speed, samples, MOST / total)
    elif total > MOST:  # whole pairs of windows, spread evenly
        share = min(max(MOST / total, KEPT / max(len(starts), 1)), 1.0)
        pairs = np.arange(len(starts)) // 2
        starts = starts[np.floor((pairs + 1) * share) > np.floor(pairs * share)]
    withheld = every_fourth(len(starts)) if side == "blocks" else np.full(len(starts), side == "all")
    reading = velocity if velocity is not None or log.velocity is None else make_channel(log.velocity, rate=True)
    velocity, position, reading = (_part(channel, kept) for channel in (velocity, position, reading))
    main = velocity if velocity is not None else position
    assert main is not None
    return Record(
        log.name,
        np.asarray(log.time, float)[kept],
        np.asarray(log.torque, float)[kept],
        velocity,
        position,
        reading,
        None if log.reference is None else np.asarray(log.reference, float)[kept],
        dt,
        bool(log.linear),
        speed[kept],
        acceleration[kept],
        angle[kept],
        speed_noise,
        followed[kept],
        followed_noise,
        smoothing,
        starts,
        samples,
        withheld,
        main.runs(starts, samples),
        log.since,
        len(log.time),
    )


def _part(channel: Channel | None, kept: Values | slice) -> Channel | None:
    """Some samples of a channel, with the noise of the whole channel."""
    return None if channel is None else replace(channel, values=channel.values[kept])


def _stretches(
    speed: Float[Values, " samples"], samples: int, share: float
) -> tuple[Int[Values, " kept"], Int[Values, " windows"]]:
    """(samples of a long log that are kept, first sample of each window among them).

    Stretches of whole windows, spread evenly over the parts in which the machine moves most of the time: much of a
    long log may be rest, which shows nothing. They are chosen by nothing else, so that they represent the rest.

    Args:
        speed: smoothed rate [rad/s], shape (samples of the log,).
        samples: of a window.
        share: of the samples that is wanted [1].
    """
    wanted = max(FEWEST, round(share * len(speed) / samples))  # number of windows
    number = min(STRETCHES, max(1, wanted // FEWEST))
    windows = max(1, min(round(wanted / number), (len(speed) - LEAD - EDGE) // samples))
    length = LEAD + windows * samples + EDGE
    blocks = len(speed) // length
    # The log in blocks of a stretch's length: rms speed of each of their windows, shape (blocks, windows).
    size = np.square(speed[: blocks * length]).reshape(blocks, length)[:, LEAD : LEAD + windows * samples]
    size = np.sqrt(np.mean(size.reshape(blocks, windows, samples), axis=2))
    moving = np.mean(size > TURNING * np.max(size), axis=1)
    # Blocks that move at least half as often as the most lively; the liveliest in each of `number` parts of the log.
    alive = np.flatnonzero(moving >= 0.5 * np.max(moving))
    if len(alive) < number:
        alive = np.sort(np.argsort(-moving, kind="stable")[:number])
    parts = [part for part in np.array_split(alive, number) if part.size]
    chosen = np.array([part[np.argmax(moving[part])] for part in parts])
    kept = (chosen[:, None] * length + np.arange(length)).ravel()
    starts = np.arange(len(chosen))[:, None] * length + LEAD + np.arange(windows) * samples
    return kept, starts.ravel()


def joints(record: Record) -> Int[Values, " edges"]:
    """First sample of each stretch of a record, then the record's number of samples: two entries or more."""
    return np.concatenate([[0], np.flatnonzero(np.diff(record.time) > 1.5 * record.dt) + 1, [len(record.time)]])


def in_one_piece(record: Record) -> Record:
    """The first stretch of a record, for simulations of a whole log; the record itself where it has no jumps."""
    edges = joints(record)
    if len(edges) == 2:
        return record
    part, inside = slice(0, int(edges[1])), record.starts < edges[1]
    return replace(
        record,
        time=record.time[part],
        torque=record.torque[part],
        velocity=_part(record.velocity, part),
        position=_part(record.position, part),
        reading=_part(record.reading, part),
        reference=None if record.reference is None else record.reference[part],
        speed=record.speed[part],
        acceleration=record.acceleration[part],
        angle=record.angle[part],
        followed=record.followed[part],
        starts=record.starts[inside],
        withheld=record.withheld[inside],
        runs=record.runs[inside],
    )


def about_stretches(records: Sequence[Record]) -> list[str]:
    """A warning for each log that is too long to be simulated as a whole."""
    said = []
    for record in records:
        edges = joints(record)
        if record.recorded == len(record.time):
            continue
        ends = [(record.time[a], record.time[b - 1]) for a, b in itertools.pairwise(edges)]
        spans = ", ".join(f"{begin:.6g} to {end:.6g}" for begin, end in ends)
        said.append(
            f"{record.name} is long: of its {record.recorded} samples {len(record.time)} are simulated, in stretches "
            f"in which the machine moves ({spans} s); to use another part, give --from and --to."
        )
    return said


def with_noise(records: list[Record], scale: float) -> list[Record]:
    """The records with every sensor's noise multiplied by `scale`, and with it that of the speeds taken from them."""

    def scaled(channel: Channel | None) -> Channel | None:
        return None if channel is None else replace(channel, noise=scale * channel.noise)

    return [
        replace(
            r,
            velocity=scaled(r.velocity),
            position=scaled(r.position),
            speed_noise=scale * r.speed_noise,
            followed_noise=scale * r.followed_noise,
        )
        for r in records
    ]
