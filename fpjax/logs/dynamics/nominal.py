"""A nominal model from a log: J a = u - C sgn v - B v - A sin q - A' cos q - offset - known load, robust to noise.

A regression of torque on a differentiated velocity is biased by the noise of the acceleration: it finds J = 0.008 on a
pendulum of 0.21 kg m^2 whose encoder has steps of 2.9 mrad. Here no derivative is taken. Over short windows the
equation of motion is integrated up to the quantity that the sensor reads,

    q(t) = q0 + v0 t + (1/J) int int (u - C sgn v - B v - A sin q - A' cos q - offset),

which is linear in 1/J, C/J, .... The sensor's noise stands on the left side only, where least squares allows it, and
the torque, which is held over each period, is integrated exactly. Start angle and speed of every window are free.
Windows in which something else happened (an impact, a push) get little weight (Cauchy weights on their rms residual).

The windows are made longer until the residual is a few times the noise: in shorter ones the noise hides the motion, in
longer ones the unmodelled torques add up. The standard deviations come from the scatter between windows (sandwich
estimator) and from the change between one window length and the next, so they include model errors. Why `estimate`
regresses pairs of samples instead: `fpjax.logs.dynamics.regression`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Values
from ..log import Log
from ..noise import noise_level
from .derivative import local_polynomial, quiet_half, smooth_motion
from .regression import mean_direction, mean_held, solved

Load = Callable[[Values], Values]

WINDOWS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0)  # lengths that are tried [s]
# Residual of a window over the noise up to which a longer window is tried. On simulated logs any value from 1 to 10
# does. On the three measured pendulum logs J is within 3 % of an independent multiple-shooting fit at 4, 14 % high at 3
# (noise) and 9 % low at 8 (unmodelled torques).
BEYOND_NOISE = 4.0
FEWEST_SAMPLES, FEWEST_WINDOWS = 16, 8
POINTS = 64  # readings in a window: more are averaged in groups, which keeps the arrays small
MOST_ROWS = 240_000  # [samples]: of a longer log, evenly spaced pieces are used
ROUNDS = 40  # of reweighting
SIGNIFICANT = 3.0  # [standard deviations]
MATTERS = 0.02  # of the torque's rms: a smaller unbalance is not worth its two parameters
PARAMETERS = ("inertia", "coulomb", "viscous", "offset", "sine", "cosine")


@dataclass(frozen=True)
class Nominal:
    """A rigid machine fitted to a log, in the log's units.

    Attributes:
        inertia: J.
        coulomb: C.
        viscous: B.
        offset: constant torque, of the same sign as friction in positive motion.
        deviations: standard deviation of inertia, coulomb, viscous, offset, sine, cosine.
        residual: rms torque that the model does not explain, as a torque that is constant over a window [N m].
        share: share of the motion's variance within the windows that the model explains [1].
        rows: number of windows used.
        sine: holding torque at the angle where sin(position) = 1; 0 where no unbalance is seen.
        cosine: holding torque at the angle where cos(position) = 1; 0 where no unbalance is seen.
        window: length of the windows [s].
        least_inertia: J of the reverse regression, of the torque on the motion. Where it is much smaller than inertia,
            either the torque column is noisy, or a torque acts that follows the command and is not in the model (a
            limit, a wrong gain): the true J lies between the two.
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
        """Whether inertia and friction have possible signs, and the model explains the motion."""
        firm = self.inertia > SIGNIFICANT * self.deviations[0] and self.share > 0.3
        return firm and self.coulomb > -SIGNIFICANT * self.deviations[1]

    @property
    def amplitude(self) -> float:
        """Amplitude of the unbalance torque, amplitude sin(position + phase), in the log's torque unit."""
        return float(np.hypot(self.sine, self.cosine))

    @property
    def phase(self) -> float:
        """Phase of the unbalance torque [rad]."""
        return float(np.arctan2(self.cosine, self.sine))

    def torque(self, acceleration: Values, speed: Values, angle: Values | None = None) -> Values:
        """Torque that the model needs for a motion, without the known load.

        Args:
            acceleration: [rad/s^2], any shape.
            speed: [rad/s], of the same shape.
            angle: [rad], of the same shape; None leaves the unbalance out.
        """
        found = self.inertia * acceleration + self.coulomb * np.sign(speed) + self.viscous * speed + self.offset
        if angle is not None and self.amplitude > 0.0:
            found = found + self.sine * np.sin(angle) + self.cosine * np.cos(angle)
        return found


def speed_of(log: Log) -> Values:
    """Velocity with little noise [rad/s]: smoothed where it was measured, else the derivative of the position."""
    return smooth_motion(log.velocity, log.position, log.dt)[0]


def angle_of(log: Log) -> Values:
    """Position [rad] as it was read, or the integral of the velocity where the log has no position."""
    return smooth_motion(log.velocity, log.position, log.dt)[1]


def acceleration_of(log: Log) -> Values:
    """Acceleration [rad/s^2]: slope of a local parabola of the velocity, or curvature of a local cubic of the position.

    The windows are as wide as the noise requires (`quiet_half`).
    """
    if log.velocity is not None:
        half = quiet_half(log.velocity, noise_level(log.velocity), derivative=1)
        return local_polynomial(log.velocity, half, dt=log.dt, derivative=1)
    assert log.position is not None
    half = quiet_half(log.position, noise_level(log.position), degree=3, derivative=2)
    return local_polynomial(log.position, half, dt=log.dt, degree=3, derivative=2)


def fit_nominal(log: Log, *, load: Load | None = None) -> Nominal | None:
    """The rigid machine that fits a log best; None where the motion does not determine it.

    Args:
        log: with a torque and a motion.
        load: known load torque [N m] as a function of the position [rad]; it is subtracted and not fitted.
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
    """The rigid machine that fits these arrays best; None where the motion does not determine it.

    The position is fitted where there is one, else the velocity.

    Args:
        torque: held over each period [N m], shape (samples,).
        velocity: at the start of each period [rad/s], or None.
        position: at the start of each period [rad], or None.
        dt: control period [s].
        gravity: also fit a sine and a cosine of the position (or of the integrated velocity); they are kept where they
            are significant and not negligible.
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
    """Consecutive samples: what the sensor read, and every term of the equation of motion over each period."""

    reading: Values  # position [rad] or velocity [rad/s], shape (samples,)
    terms: Values  # shape (samples, 6): u, -sgn v, -v, -1, -sin q, -cos q, means over each period
    noise: float  # standard deviation of one reading
    order: int  # integrals from acceleration to the reading: 2 for a position, 1 for a velocity
    dt: float  # [s]


def _pieces(torque: Values, velocity: Values | None, position: Values | None, dt: float) -> Iterator[_Piece]:
    size = torque.size
    starts = [0] if size <= MOST_ROWS else np.linspace(0, size - MOST_ROWS // 12, 12).astype(int)
    length = size if size <= MOST_ROWS else MOST_ROWS // 12
    noise: float | None = None
    for start in starts:
        part = slice(int(start), int(start) + length)
        rate = None if velocity is None else velocity[part]
        place = None if position is None else position[part]
        # A drive's own velocity is delayed by its filter: the position shows better when the motion reverses.
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
    """The fit of the longest windows in which the residual stays within a few times the noise."""
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
    # Another window length should give the same parameters: a change is a model error that the scatter between windows
    # of one length does not show, so it widens the standard deviations.
    changes = [getattr(found, name) - getattr(before, name) for name in PARAMETERS]
    widened = tuple(float(np.hypot(*both)) for both in zip(found.deviations, changes, strict=True))
    return replace(found, deviations=widened)


def _windows(pieces: list[_Piece], seconds: float, count: int) -> tuple[Nominal, float] | None:
    """(fit with windows of this length, their residual over the noise); None for too few windows."""
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
    # Start angle and speed of each window are eliminated by projecting readings and regressors onto what is
    # orthogonal to a constant (velocity) or to a constant and a line (position): y of shape (windows, points), x
    # (windows, points, terms).
    time = np.linspace(0.0, 1.0, y.shape[1])
    free, _ = np.linalg.qr(np.stack([time**power for power in range(order)], axis=1))
    y = y - (y @ free) @ free.T
    x = x - np.einsum("nj,wjk->wnk", free, np.einsum("wnk,nj->wjk", x, free))
    return _robust(y, x, noise, seconds, order)


def _integrated(terms: Values, dt: float, order: int) -> Values:
    """Speed (order 1) or position (order 2) at the start of each period, of an acceleration held over each period.

    The integration of a held value is exact. Shapes in and out: (windows, samples, terms).
    """
    zero = np.zeros((terms.shape[0], 1, terms.shape[2]))
    speed = np.concatenate([zero, np.cumsum(terms, axis=1)[:, :-1]], axis=1) * dt
    if order == 1:
        return speed
    return np.concatenate([zero, np.cumsum(speed * dt + 0.5 * dt * dt * terms, axis=1)[:, :-1]], axis=1)


def _means(values: Values, group: int) -> Values:
    shape = (values.shape[0], values.shape[1] // group, group, *values.shape[2:])
    return values.reshape(shape).mean(axis=2)


def _robust(y: Values, x: Values, noise: float, seconds: float, order: int) -> tuple[Nominal, float] | None:
    """Least squares over all windows, each weighted by its rms residual; and the median residual over the noise.

    Iteratively reweighted with Cauchy's weights (Holland, Welsch, 1977), one weight per window.
    """
    count = x.shape[2]
    gram = np.einsum("wnk,wnl->wkl", x, x)
    with_reading = np.einsum("wnk,wn->wk", x, y)
    scale = np.sqrt(np.einsum("wkk->k", gram))
    if not (scale[0] > 0.0 and np.all(np.isfinite(scale))):
        return None
    # columns to length one, as in `regression.solved`: torque and angle differ by orders of magnitude
    scale[scale == 0.0] = 1.0
    gram, with_reading = gram / np.outer(scale, scale), with_reading / scale
    weight = np.ones(len(y))
    solution, middle = np.zeros(count), 0.0
    for _ in range(ROUNDS):
        total = np.einsum("w,wkl->kl", weight, gram)
        solution, _, rank, _ = np.linalg.lstsq(total, weight @ with_reading, rcond=1e-12)
        if rank < count:  # one direction or one speed only: the parameters are not identifiable
            return None
        left = np.sqrt(np.mean((y - x @ (solution / scale)) ** 2, axis=1))
        middle = float(np.median(left))
        if middle == 0.0:
            break
        weight = 1.0 / (1.0 + (left / middle) ** 2)
    if not abs(solution[0]) > 0.0:
        return None
    # Sandwich estimator with a window as a cluster (Liang, Zeger, 1986): readings within a window share its model
    # error, so they are not independent, but windows are. The last factor corrects for the number of fitted
    # parameters.
    slopes = weight[:, None] * (with_reading - np.einsum("wkl,l->wk", gram, solution))
    inverse = np.linalg.pinv(np.einsum("w,wkl->kl", weight, gram), rcond=1e-12)
    spread = inverse @ (slopes.T @ slopes) @ inverse * len(y) / max(len(y) - count, 1)
    # from (1/J, C/J, B/J, ...) to (J, C, B, ...)
    solution, spread = solution / scale, spread / np.outer(scale, scale)
    # the Jacobian of that change of parameters, for the covariance
    turn = np.diag(np.full(count, 1.0 / solution[0]))
    turn[:, 0] = -solution / solution[0] ** 2
    turn[0, 0] = -1.0 / solution[0] ** 2
    values = solution / solution[0]
    values[0] = 1.0 / solution[0]
    deviations = np.sqrt(np.maximum(np.diag(turn @ spread @ turn.T), 0.0))
    power = float(np.sum(weight * np.mean(y**2, axis=1)))
    share = 1.0 - float(np.sum(weight * left**2)) / power if power > 0.0 else 0.0
    # A constant torque of 1 N m moves the position by t^2 / (2 J) over a window of length T. Without its best line this
    # has an rms of T^2 / (sqrt(720) J); a velocity t / J without its mean has T / (sqrt(12) J). So the residual of the
    # reading is given as the constant torque that would leave as much.
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
    """J of the reverse regression, of the torque on the motion, with the same windows and weights.

    Noise in the motion biases it towards zero, noise in the torque biases the forward regression upwards.
    """
    root = np.sqrt(weight)[:, None]
    torque = (x[:, :, 0] * root).ravel()
    others = np.concatenate([y[:, :, None], -x[:, :, 1:]], axis=2) * root[:, :, None]
    table = others.reshape(-1, others.shape[2])
    found = solved(table, torque)
    return 0.0 if found is None else float(found[0])
