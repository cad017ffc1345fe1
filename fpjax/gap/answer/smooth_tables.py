"""Tables of a missing torque over one recorded variable.

The tables are B-splines of degree one, whose coefficients are the torques at the points, penalised by second
differences (Eilers, Marx, "Flexible smoothing with B-splines and penalties", 1996): what is fitted is what a
`LearnedTorque` simulates.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record

Variable = Literal["velocity", "position", "torque", "time"]

SPEEDS = 14  # points for each direction, closer towards rest, where friction has its curvature
ANGLES = 72  # points a revolution, one every 5 deg
CLOSE = 16  # points of a period that repeats within a revolution: up to its fifth harmonic or so
STRAIGHT = 40  # points over the travel
TORQUES = 17  # points over the range of the commanded torque
TIMES = 17  # points over the duration
RESTING = 2.0  # standard deviations of the speed below which its sign is noise
SMOOTHED = 3.0  # factor by which smoothing lowers the noise of a rate sensor
ONE_SIDED = 0.01  # share of the samples below which a direction is not learned
TURNS = 1.5  # revolutions of travel from which a position is taken within one revolution too


@dataclass(frozen=True)
class Table:
    """The points of one table, and the weights of its points at every sample.

    Attributes:
        of: the variable.
        at: points, in the variable's unit, shape (points,); a velocity has 0 twice.
        period: of the variable; None where nothing repeats.
        columns: weight of each point at each sample [1], one array of shape (samples, points) for each record.
        bend: departure of a point from the straight line between its neighbours, shape (rows, points).
    """

    of: Variable | Literal["acceleration"]
    at: Values
    period: float | None
    columns: tuple[Values, ...]
    bend: Values

    @property
    def variable(self) -> Variable:
        """Of a law; an error of the inertia is none."""
        assert self.of != "acceleration"
        return self.of

    @functools.cached_property
    def mean(self) -> Values:
        """Of the columns over all samples [1], shape (points,)."""
        return np.sum([np.sum(each, axis=0) for each in self.columns], axis=0) / sum(len(c) for c in self.columns)

    def departures(self, torque: Values) -> Values:
        """Distance of each point from its neighbours' line [N m], shape (points,); an end has that of its neighbour."""
        inner = np.argmax(np.abs(self.bend), axis=1) if len(self.bend) else np.zeros(0, int)
        found = np.zeros(len(self.at))
        found[inner] = np.abs(self.bend @ torque)
        ends = np.setdiff1d(np.arange(len(self.at)), inner)
        for end in ends:
            if len(inner):
                found[end] = found[inner[np.argmin(np.abs(inner - end))]]
        return found


def make_tables(records: Sequence[Record], periods: Sequence[float] = ()) -> dict[Variable, list[Table]]:
    """The tables that the logs can determine, by variable; several of one variable are alternatives.

    Args:
        records: the logs.
        periods: numbers of periods a revolution with which the missing torque seems to repeat [1/rev].
    """
    speeds = [_mid(r.speed) for r in records]
    rests = [resting(r) for r in records]
    found: dict[Variable, list[Table]] = {}
    if (velocity := _velocity_table(speeds, rests)) is not None:
        found["velocity"] = [velocity]
    angles = [_mid(r.angle) for r in records]
    # Integrated positions of several logs have no common zero.
    if len(records) == 1 or not any(r.integrated for r in records):
        found["position"] = _position_tables(records, angles, periods)
    torques = [r.torque for r in records]
    if (spread := _range(torques)) is not None:
        found["torque"] = [_table("torque", np.linspace(*spread, TORQUES), torques)]
    times = [r.elapsed for r in records]
    found["time"] = [_table("time", np.linspace(0.0, max(t[-1] for t in times), TIMES), times)]
    return found


def inertia_table(records: Sequence[Record]) -> Table:
    """An error of the inertia as a table of one point: the torque [N m] at the acceleration's rms."""
    accelerations = [_mid(r.acceleration) for r in records]
    size = max(float(np.sqrt(np.mean(np.concatenate(accelerations) ** 2))), 1e-300)
    return Table(
        "acceleration",
        np.array([size]),
        None,
        tuple(a[:, None] / size for a in accelerations),
        _bend(np.zeros(1), None),
    )


def _mid(values: Values) -> Values:
    """Mean over the period that begins at each sample: the torque is held over it."""
    return 0.5 * (values + np.concatenate([values[1:], values[-1:]]))


def _range(values: Sequence[Values]) -> tuple[float, float] | None:
    low, high = min(float(np.min(v)) for v in values), max(float(np.max(v)) for v in values)
    return (low, high) if high > low else None


def _velocity_table(speeds: Sequence[Values], rests: Sequence[float]) -> Table | None:
    everything = np.concatenate(speeds)
    rest = max(rests)
    columns: list[list[Values]] = [[] for _ in speeds]
    at, bends = [], []
    for side in (-1.0, 1.0):
        own = side * everything
        if np.mean(own > rest) < ONE_SIDED or not np.max(own) > 4.0 * rest:
            continue
        # Quadratic spacing, the first points within the noise of rest left out.
        points = np.max(own) * (np.arange(SPEEDS + 1) / SPEEDS) ** 2
        points = np.concatenate([[0.0], points[points > rest]])
        for column, speed, still in zip(columns, speeds, rests, strict=True):
            part = np.where((side * speed > still)[:, None], _hats(side * speed, points, None), 0.0)
            column.append(part if side > 0 else part[:, ::-1])
        at.append(points if side > 0 else -points[::-1])
        bends.append(_bend(at[-1], None))
    if not at:
        return None
    # Block diagonal: no smoothness across zero, where Coulomb friction jumps.
    bend = np.zeros((sum(len(b) for b in bends), sum(len(a) for a in at)))
    row = place = 0
    for b in bends:
        bend[row : row + b.shape[0], place : place + b.shape[1]] = b
        row, place = row + b.shape[0], place + b.shape[1]
    return Table("velocity", np.concatenate(at), None, tuple(np.concatenate(c, 1) for c in columns), bend)


def _position_tables(records: Sequence[Record], angles: Sequence[Values], periods: Sequence[float]) -> list[Table]:
    spread = _range(angles)
    if spread is None:
        return []
    turn = 2.0 * np.pi
    whole = _table("position", np.linspace(*spread, STRAIGHT), angles)
    if any(r.linear for r in records) or spread[1] - spread[0] < TURNS * turn:
        return [whole]
    # Over several revolutions a torque may repeat with each, or follow the whole travel, as that of a spring does, or
    # of a weight behind a gear.
    found = [_table("position", np.arange(ANGLES) * turn / ANGLES, angles, turn)]
    if not any(r.integrated for r in records):  # else the travel's zero is another one in every log
        found.append(whole)
    # A torque that repeats often within a revolution needs closer points than one every 5 deg.
    for count in periods:
        if count > ANGLES / CLOSE:
            short = turn / count
            found.append(_table("position", np.arange(CLOSE) * short / CLOSE, angles, short))
    return found


def _table(of: Variable, at: Values, values: Sequence[Values], period: float | None = None) -> Table:
    return Table(of, at, period, tuple(_hats(v, at, period) for v in values), _bend(at, period))


def _hats(x: Values, at: Values, period: float | None) -> Values:
    """B-splines of degree one: the weights of the points at x, shape (samples, points)."""
    count = len(at)
    edges = at if period is None else np.append(at, at[0] + period)
    x = x if period is None else at[0] + np.mod(x - at[0], period)
    x = np.clip(x, edges[0], edges[-1])
    left = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    share = (x - edges[left]) / (edges[left + 1] - edges[left])
    found, row = np.zeros((len(x), count)), np.arange(len(x))
    found[row, left] = 1.0 - share
    found[row, (left + 1) % count] += share
    return found


def _bend(at: Values, period: float | None) -> Values:
    """Of each inner point, its departure from the line between its neighbours, shape (rows, points)."""
    count = len(at)
    if period is not None:
        return np.eye(count) - 0.5 * np.roll(np.eye(count), 1, 0) - 0.5 * np.roll(np.eye(count), -1, 0)
    rows = np.zeros((max(count - 2, 0), count))
    for i in range(count - 2):
        width = at[i + 2] - at[i]
        rows[i, i : i + 3] = -(at[i + 2] - at[i + 1]) / width, 1.0, -(at[i + 1] - at[i]) / width
    return rows


def resting(record: Record) -> float:
    """Speed [rad/s] below which noise alone would give a direction."""
    return RESTING * record.speed_noise / (SMOOTHED if record.velocity is not None else 1.0)
