"""A nominal model from a log: J a = u - C sgn v - B v - A sin q - A' cos q - offset - known load, honest about noise.

A regression of torque on a differentiated velocity divides by the acceleration's noise: it finds J = 0.008 on a
pendulum of 0.21 kg m^2 whose encoder has steps of 2.9 mrad. Here no derivative is taken. Over short windows the
equation is integrated until it speaks of what the sensor reads,

    q(t) = q0 + v0 t + (1/J) int int (u - C sgn v - B v - A sin q - A' cos q - offset),

which is linear in 1/J, C/J, ..., has the sensor's noise on the left only, where least squares allows it, and knows the
held torque exactly. Start angle and speed of every window are free. Windows in which something else happened (an
impact, a push) are weighed down by Cauchy's law of their rms. The windows are as long as lets what the model leaves
grow to a few times the noise: shorter ones give their information away to noise, in longer ones unmodelled torques pile
up. Deviations are those of the windows among themselves (the sandwich estimator) and of one length of window against
the next, so they hold model errors too. Why `estimate` regresses pairs of samples instead: `fpjax.logs.regression`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..log import Log
from ..noise import noise_level
from .derivative import local_polynomial, quiet_half, smooth_motion
from .regression import mean_direction, mean_held, solved

Values = np.ndarray
Load = Callable[[Values], Values]

WINDOWS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0)  # s
# Times the noise that a window may leave, for a longer one to be tried. Simulated logs do not care (1 to 10); the three
# pendulum records end within 3 % of an independent multiple-shooting fit at 4, 14 % high at 3 (noise), 9 % low at 8.
BEYOND_NOISE = 4.0
FEWEST_SAMPLES, FEWEST_WINDOWS = 16, 8
POINTS = 64  # readings a window, each the mean of some
MOST_ROWS = 240_000  # of a longer log, evenly spaced pieces are looked at
ROUNDS = 40  # of the weights
SIGNIFICANT = 3.0  # standard deviations
MATTERS = 0.02  # of the torque's rms: a load below it is not worth a line
PARAMETERS = ("inertia", "coulomb", "viscous", "offset", "sine", "cosine")


@dataclass(frozen=True)
class Nominal:
    """A rigid machine fitted to a log, in the log's units.

    Attributes:
        inertia: J.
        coulomb: C.
        viscous: B.
        offset: same sign as positive friction.
        deviations: standard deviation of inertia, coulomb, viscous, offset, sine, cosine.
        residual: rms torque that the model leaves over its windows [N m].
        share: of the motion within the windows that the model explains [1].
        rows: windows used.
        sine: torque that sin(position) needs to be held; 0 where none is seen.
        cosine: torque that cos(position) needs to be held.
        window: length of the windows [s].
        least_inertia: J of the regression the other way round, of the torque on the motion. Where it is much smaller, a
            torque acts that follows the command and is not in the model (a limit, a gain), or the command holds noise:
            J lies between the two.
    """

    inertia: float
    coulomb: float
    viscous: float
    offset: float
    deviations: tuple[float, ...]
    residual: float
    share: float
    rows: int
    sine: float = 0.0
    cosine: float = 0.0
    window: float = 0.0
    least_inertia: float = 0.0

    @property
    def plausible(self) -> bool:
        """Whether signs and fit are those of a machine."""
        firm = self.inertia > SIGNIFICANT * self.deviations[0] and self.share > 0.3
        return firm and self.coulomb > -SIGNIFICANT * self.deviations[1]

    @property
    def amplitude(self) -> float:
        """Of the unbalance: torque = amplitude sin(position + phase)."""
        return float(np.hypot(self.sine, self.cosine))

    @property
    def phase(self) -> float:
        """Of the unbalance [rad]."""
        return float(np.arctan2(self.cosine, self.sine))

    def torque(self, acceleration: Values, speed: Values, angle: Values | None = None) -> Values:
        """What the model needs for a motion, without the known load."""
        found = self.inertia * acceleration + self.coulomb * np.sign(speed) + self.viscous * speed + self.offset
        if angle is not None and self.amplitude > 0.0:
            found = found + self.sine * np.sin(angle) + self.cosine * np.cos(angle)
        return found


def speed_of(log: Log) -> Values:
    """Velocity with little noise: smoothed where it was measured, else the derivative of the position."""
    return smooth_motion(log.velocity, log.position, log.dt)[0]


def angle_of(log: Log) -> Values:
    """Position with little noise, or the integral of the velocity."""
    return smooth_motion(log.velocity, log.position, log.dt)[1]


def acceleration_of(log: Log) -> Values:
    """Acceleration by a local cubic of the speed or of the position, as wide as its noise asks for."""
    if log.velocity is not None:
        half = quiet_half(log.velocity, noise_level(log.velocity), derivative=1)
        return local_polynomial(log.velocity, half, dt=log.dt, derivative=1)
    assert log.position is not None
    half = quiet_half(log.position, noise_level(log.position), degree=3, derivative=2)
    return local_polynomial(log.position, half, dt=log.dt, degree=3, derivative=2)


def fit_nominal(log: Log, *, load: Load | None = None) -> Nominal | None:
    """The rigid machine of a log; None where the motion tells too little.

    Args:
        log: with a torque and a motion.
        load: known torque [N m] as a function of the position [rad], which the fit takes as given.
    """
    torque = log.torque if load is None else log.torque - load(angle_of(log))
    return fit_rigid(torque, log.velocity, log.position, log.dt, gravity=not log.linear)


def fit_rigid(
    torque: Values,
    velocity: Values | None,
    position: Values | None,
    dt: float,
    *,
    gravity: bool = False,
) -> Nominal | None:
    """A rigid machine, from arrays; the position is fitted where there is one, else the velocity.

    Args:
        torque: held over each period [N m], shape (samples,).
        velocity: at the start of each period [rad/s], or None.
        position: at the start of each period [rad], or None.
        dt: [s].
        gravity: look for a sine and a cosine of the position (of the integral of the velocity where there is none),
            kept where they are significant and matter.
    """
    torque = np.asarray(torque, dtype=np.float64)
    pieces = list(_pieces(torque, velocity, position, dt))
    found = _best(pieces, gravity)
    if found is None or not gravity:
        return found
    size = float(np.sqrt(np.mean(torque**2)))
    sure = any(
        abs(value) > SIGNIFICANT * deviation
        for value, deviation in ((found.sine, found.deviations[4]), (found.cosine, found.deviations[5]))
    )
    return found if sure and found.amplitude > MATTERS * size else _best(pieces, gravity=False)


@dataclass(frozen=True)
class _Piece:
    """Consecutive samples: what the sensor read, and the course of every term over each period."""

    reading: Values
    terms: Values  # shape (samples, 6): torque and what it has to overcome, signs as in J a
    noise: float
    order: int  # integrals from acceleration to the reading: 2 for a position
    dt: float


def _pieces(torque: Values, velocity: Values | None, position: Values | None, dt: float) -> Iterator[_Piece]:
    size = torque.size
    starts = [0] if size <= MOST_ROWS else np.linspace(0, size - MOST_ROWS // 12, 12).astype(int)
    length = size if size <= MOST_ROWS else MOST_ROWS // 12
    noise: float | None = None
    for start in starts:
        part = slice(int(start), int(start) + length)
        rate = None if velocity is None else velocity[part]
        place = None if position is None else position[part]
        # A drive's own velocity is late by its filter: the position knows better when the motion turns.
        speed, angle = smooth_motion(None if place is not None else rate, place, dt)
        reading = place if place is not None else rate
        assert reading is not None
        noise = noise_level(reading) if noise is None else noise
        columns = [
            torque[part], -mean_direction(speed), -mean_held(speed), -np.ones(speed.size), -mean_held(np.sin(angle)),
            -mean_held(np.cos(angle)),
        ]  # fmt: skip
        yield _Piece(reading, np.stack(columns, axis=1), noise, 2 if place is not None else 1, dt)


def _best(pieces: list[_Piece], gravity: bool) -> Nominal | None:
    """The fit of the longest windows in which the model's error stays a few times the noise."""
    found, before = None, None
    for seconds in WINDOWS:
        cut = _windows(pieces, seconds, 6 if gravity else 4)
        if cut is None:
            continue
        fitted, beyond = cut
        if found is not None and beyond > BEYOND_NOISE:
            break
        found, before = fitted, found
        if beyond > BEYOND_NOISE:
            break
    if found is None or before is None:
        return found
    # Another length of window should give the same numbers: what it does not is an error that no window shows.
    changes = [getattr(found, name) - getattr(before, name) for name in PARAMETERS]
    widened = tuple(float(np.hypot(*both)) for both in zip(found.deviations, changes, strict=True))
    return replace(found, deviations=widened)


def _windows(pieces: list[_Piece], seconds: float, count: int) -> tuple[Nominal, float] | None:
    """(fit with windows of this length, what they leave over the noise); None for too few windows."""
    dt = pieces[0].dt
    size = round(seconds / dt)
    group = max(1, size // POINTS)
    size = size // group * group
    if size < FEWEST_SAMPLES:
        return None
    readings, terms = [], []
    for piece in pieces:
        many = (piece.reading.size - 1) // size
        if many:
            readings.append(piece.reading[: many * size].reshape(many, size))
            terms.append(piece.terms[: many * size, :count].reshape(many, size, count))
    if not readings or sum(len(each) for each in readings) < FEWEST_WINDOWS:
        return None
    order, noise = pieces[0].order, pieces[0].noise / np.sqrt(group)
    y, x = np.concatenate(readings), _integrated(np.concatenate(terms), dt, order)
    y, x = _means(y, group), _means(x, group)
    time = np.linspace(0.0, 1.0, y.shape[1])
    free, _ = np.linalg.qr(np.stack([time**power for power in range(order)], axis=1))
    y = y - (y @ free) @ free.T
    x = x - np.einsum("nj,wjk->wnk", free, np.einsum("wnk,nj->wjk", x, free))
    return _robust(y, x, noise, seconds, order)


def _integrated(terms: Values, dt: float, order: int) -> Values:
    """Speed or position at the start of each period, of an acceleration that is held over each."""
    zero = np.zeros((terms.shape[0], 1, terms.shape[2]))
    speed = np.concatenate([zero, np.cumsum(terms, axis=1)[:, :-1]], axis=1) * dt
    if order == 1:
        return speed
    return np.concatenate([zero, np.cumsum(speed * dt + 0.5 * dt * dt * terms, axis=1)[:, :-1]], axis=1)


def _means(values: Values, group: int) -> Values:
    shape = (values.shape[0], values.shape[1] // group, group, *values.shape[2:])
    return values.reshape(shape).mean(axis=2)


def _robust(y: Values, x: Values, noise: float, seconds: float, order: int) -> tuple[Nominal, float] | None:
    """Least squares over windows that are weighed by Cauchy's law of their rms."""
    count = x.shape[2]
    gram = np.einsum("wnk,wnl->wkl", x, x)
    with_reading = np.einsum("wnk,wn->wk", x, y)
    scale = np.sqrt(np.einsum("wkk->k", gram))
    if not (scale[0] > 0.0 and np.all(np.isfinite(scale))):
        return None
    scale[scale == 0.0] = 1.0
    gram, with_reading = gram / np.outer(scale, scale), with_reading / scale
    weight = np.ones(len(y))
    solution, middle = np.zeros(count), 0.0
    for _ in range(ROUNDS):
        total = np.einsum("w,wkl->kl", weight, gram)
        solution, _, rank, _ = np.linalg.lstsq(total, weight @ with_reading, rcond=1e-12)
        if rank < count:  # one direction only, or one speed: what cannot be told apart is not told
            return None
        left = np.sqrt(np.mean((y - x @ (solution / scale)) ** 2, axis=1))
        middle = float(np.median(left))
        if middle == 0.0:
            break
        weight = 1.0 / (1.0 + (left / middle) ** 2)
    if not abs(solution[0]) > 0.0:
        return None
    slopes = weight[:, None] * (with_reading - np.einsum("wkl,l->wk", gram, solution))
    inverse = np.linalg.pinv(np.einsum("w,wkl->kl", weight, gram), rcond=1e-12)
    spread = inverse @ (slopes.T @ slopes) @ inverse * len(y) / max(len(y) - count, 1)
    # from (1/J, C/J, B/J, ...) to (J, C, B, ...)
    solution, spread = solution / scale, spread / np.outer(scale, scale)
    turn = np.diag(np.full(count, 1.0 / solution[0]))
    turn[:, 0] = -solution / solution[0] ** 2
    turn[0, 0] = -1.0 / solution[0] ** 2
    values = solution / solution[0]
    values[0] = 1.0 / solution[0]
    deviations = np.sqrt(np.maximum(np.diag(turn @ spread @ turn.T), 0.0))
    power = float(np.sum(weight * np.mean(y**2, axis=1)))
    share = 1.0 - float(np.sum(weight * left**2)) / power if power > 0.0 else 0.0
    # a torque held over a window moves the reading by its own integral: 1 / J t^2 / sqrt(720) or t / sqrt(12), rms
    moved = seconds**2 / np.sqrt(720.0) if order == 2 else seconds / np.sqrt(12.0)
    if not np.all(np.isfinite([*values, *deviations, share])):
        return None
    padded = [*(float(each) for each in deviations), 0.0, 0.0][:6]
    nominal = Nominal(
        *(float(value) for value in values[:4]),
        deviations=tuple(padded),
        residual=abs(float(values[0])) * middle / moved,
        share=share,
        rows=len(y),
        sine=float(values[4]) if count > 4 else 0.0,
        cosine=float(values[5]) if count > 4 else 0.0,
        window=seconds,
        least_inertia=_least_inertia(y, x, weight),
    )
    return nominal, middle / noise if noise > 0.0 else 0.0


def _least_inertia(y: Values, x: Values, weight: Values) -> float:
    """J of the torque regressed on the motion, with the same windows and weights."""
    root = np.sqrt(weight)[:, None]
    torque = (x[:, :, 0] * root).ravel()
    others = np.concatenate([y[:, :, None], -x[:, :, 1:]], axis=2) * root[:, :, None]
    table = others.reshape(-1, others.shape[2])
    found = solved(table, torque)
    return 0.0 if found is None else float(found[0])
