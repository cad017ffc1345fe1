"""A nominal model from a log: J a = u - C sgn v - B v - A sin q - A' cos q - offset - known load, robust to noise.

A regression of torque on a differentiated velocity is biased by the noise of the acceleration: it finds J = 0.008 on a
pendulum of 0.21 kg m^2 whose encoder has steps of 2.9 mrad. Here no derivative is taken. Over short windows the
equation of motion is integrated up to the quantity that the sensor reads,

    q(t) = q0 + v0 t + (1/J) int int (u - C sgn v - B v - A sin q - A' cos q - offset),

which is linear in 1/J, C/J, .... The sensor's noise stands on the left side only, where least squares allows it, and
the torque, which is held over each period, is integrated exactly. Start angle and speed of every window are free.
Windows in which something else happened (an impact, a push) get little weight (Cauchy weights on their rms residual).

That takes the torque for exact. Where it was measured with noise, or a tight loop holds the motion against whatever
acts on the machine, the torque holds what the motion does not show, and J comes out too large (7 and 200 times on
joints of a UR10e, whose currents are noisy and whose motion is slow). Then the motion is what is exact, and the
equation is solved for the torque: J (q - q0 - v0 t) + int int (C sgn v + ...) = int int u, less the sensor's noise,
whose size is known (errors in variables: Fuller, "Measurement error models", 1987). No log tells such a torque from one
that somebody else brought and the machine followed: pushes on a machine without a loop set the two inertias apart too,
and then the first is right. So the second is taken only where they are so far apart that the pushes would have to be
larger than the torque itself.

The windows are made longer until the residual is a few times the noise: in shorter ones the noise hides the motion, in
longer ones the unmodelled torques add up. The standard deviations come from the scatter between windows (sandwich
estimator) and from the change between one window length and the next, so they include model errors. Why `estimate`
regresses pairs of samples instead: `fpjax.logs.dynamics.regression`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Values
from ..log import Log
from ..noise import noise_level
from .derivative import local_polynomial, quiet_half, smooth_motion
from .regression import solved as least_squares
from .windows import ROUNDS, Cut, Piece, Solved, pieces_of, robust, windows_of

Load = Callable[[Values], Values]

WINDOWS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0)  # lengths that are tried [s]
# Residual of a window over the noise up to which a longer window is tried. On simulated logs any value from 1 to 10
# does. On the three measured pendulum logs J is within 3 % of an independent multiple-shooting fit at 4, 14 % high at 3
# (noise) and 9 % low at 8 (unmodelled torques).
BEYOND_NOISE = 4.0
SIGNIFICANT = 3.0  # [standard deviations]
# Ratio of the two inertias from which on the motion is taken for exact. It is 1 / R^2 of the torque: 3 where two thirds
# of its energy are not in the motion.
LOOSE = 3.0
EXPLAINED = 0.3  # share of the motion's (or the torque's) variance: with less explained, the numbers mean nothing
NOISY = 1e-3  # share of noise in the motion's energy within a window, up to which windows serve to solve for the torque
MATTERS = 0.02  # of the torque's rms: a smaller unbalance is not worth its two parameters
# Of an unbalance's rms torque: where it and the offset leave less than this of each other, and the model's residual is
# more than this of what the unbalance varies by, they are two large torques that follow something else over a short
# travel (a cogging, a friction by position). Set on simulated machines (development logs, and reported ones that had
# been opened): of 28 fits that cancel so 27 had no unbalance, of which 24 hardly stand out and one is more than any
# torque of its log; the one that had one stands out, as does a weight with a balancer.
CANCELLED = 0.5
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
        share: share of the motion's variance within the windows that the model explains [1]; of the torque's where
            `reverse`.
        rows: number of windows used.
        sine: holding torque at the angle where sin(position) = 1; 0 where no unbalance is seen.
        cosine: holding torque at the angle where cos(position) = 1; 0 where no unbalance is seen.
        window: length of the windows [s].
        least_inertia: J of the reverse regression, of the torque on the motion.
        most_inertia: J of the forward regression, of the motion on the torque; infinite where it has the wrong sign.
            Where they are apart, either the torque column is noisy, or a torque acts that follows the command and is
            not in the model (a limit, a wrong gain): the true J lies between the two.
        reverse: whether the parameters are those of the reverse regression.
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
    most_inertia: float = np.inf
    reverse: bool = False

    @property
    def plausible(self) -> bool:
        """Whether inertia and friction have possible signs, and the model explains the motion."""
        return not self.doubt

    @property
    def doubt(self) -> str:
        """Why these numbers are no machine, as the end of a sentence; "" where they are `plausible`."""
        if self.inertia < -SIGNIFICANT * self.deviations[0]:
            return (
                f"the fitted inertia is negative ({self.inertia:.3g} +- {self.deviations[0]:.2g}): torque and motion "
                f"have opposite signs, or something else than this torque moves the machine"
            )
        if not self.inertia > SIGNIFICANT * self.deviations[0]:
            return (
                f"the fitted inertia, {self.inertia:.3g} +- {self.deviations[0]:.2g}, is not told from zero (the "
                f"machine hardly accelerates, or other torques than its friction and weight move it)"
            )
        if not self.share > EXPLAINED:
            return f"inertia and friction explain only {self.share:.0%} of what they were fitted to"
        if not self.coulomb > -SIGNIFICANT * self.deviations[1]:
            return f"the fitted Coulomb friction is negative ({self.coulomb:.3g} +- {self.deviations[1]:.2g})"
        return ""

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
            are significant and not negligible, unless the offset cancels most of them and they hardly stand out.
    """
    torque = np.asarray(torque, dtype=np.float64)
    pieces = list(pieces_of(torque, velocity, position, dt))
    found = _best(pieces, gravity)
    if found is None or not gravity:
        return found
    size = float(np.sqrt(np.mean(torque**2)))
    sure = any(
        abs(value) > SIGNIFICANT * deviation
        for value, deviation in ((found.sine, found.deviations[4]), (found.cosine, found.deviations[5]))
    )
    if not (sure and found.amplitude > MATTERS * size):
        return _best(pieces, gravity=False)
    angle = np.cumsum(velocity) * dt if position is None else np.asarray(position, dtype=np.float64)
    without = _best(pieces, gravity=False) if _cancelled(found, angle, torque) else None
    return found if without is None else _not_told(found, without)


def _not_told(found: Nominal, without: Nominal) -> Nominal:
    """Without its unbalance, and with the offset that there is then.

    Inertia and friction stay as they are beside a torque of the position, whatever it is: without one they take it.
    """
    deviations = (*found.deviations[:3], without.deviations[3], 0.0, 0.0)
    said = {"residual": without.residual, "share": without.share}
    return replace(found, offset=without.offset, sine=0.0, cosine=0.0, deviations=deviations, **said)


def _cancelled(found: Nominal, angle: Values, torque: Values) -> bool:
    """Whether the offset takes most of an unbalance back that hardly stands out, or is more than any torque."""
    load = found.sine * np.sin(angle) + found.cosine * np.cos(angle)
    faint = found.residual > CANCELLED * float(np.std(load)) or found.amplitude > np.max(np.abs(torque))
    return bool(faint and np.mean((load + found.offset) ** 2) < CANCELLED**2 * np.mean(load**2))


def _best(pieces: list[Piece], gravity: bool) -> Nominal | None:
    """The fit of the longest windows in which the residual stays within a few times the noise."""
    count, found, before = 6 if gravity else 4, None, None
    for seconds in WINDOWS:
        cut = windows_of(pieces, seconds, count)
        forward = None if cut is None else _forward(cut)
        if cut is None or forward is None:
            continue
        fitted, beyond = forward
        if found is not None and beyond > BEYOND_NOISE:
            break
        found, before = (fitted, cut), found
        if beyond > BEYOND_NOISE:
            break
    if found is None:
        return None
    fitted, cut = found
    opposite = _reverse(cut)
    if not 0.0 < fitted.inertia < LOOSE * (0.0 if opposite is None else opposite.inertia):
        reverse = _best_reverse(pieces, count)
        if reverse is not None:
            return replace(reverse, most_inertia=fitted.most_inertia)
    return fitted if before is None else _widened(fitted, before[0])


def _best_reverse(pieces: list[Piece], count: int) -> Nominal | None:
    """The reverse fit of the shortest windows whose motion holds hardly any noise; None without a positive inertia."""
    found = None
    for seconds in WINDOWS:
        cut = windows_of(pieces, seconds, count)
        if cut is None or not cut.noise_share < NOISY:
            continue
        fitted = _reverse(cut)
        if fitted is not None and found is not None:
            return _widened(found, fitted)
        found = fitted if found is None else found
    return found


def _widened(found: Nominal, other: Nominal) -> Nominal:
    """With standard deviations that hold the parameters of another window length too.

    It should give the same parameters: a change is a model error that the scatter between windows of one length does
    not show.
    """
    changes = [getattr(found, name) - getattr(other, name) for name in PARAMETERS]
    widened = tuple(float(np.hypot(*both)) for both in zip(found.deviations, changes, strict=True))
    return replace(found, deviations=widened)


def _forward(cut: Cut) -> tuple[Nominal, float] | None:
    """The fit of the motion on the torque, and its median residual over the noise."""
    y, x = cut.y, cut.x
    solved = robust(y, x)
    if solved is None or not abs(solved.solution[0]) > 0.0:
        return None
    # from (1/J, C/J, B/J, ...) to (J, C, B, ...)
    inverse = solved.solution[0]
    values = solved.solution / inverse
    values[0] = 1.0 / inverse
    # the Jacobian of that change of parameters, for the covariance
    turn = np.diag(np.full(values.size, 1.0 / inverse))
    turn[:, 0] = -solved.solution / inverse**2
    turn[0, 0] = -1.0 / inverse**2
    found = _nominal_of(cut, values, turn @ solved.spread @ turn.T, solved, y, abs(float(values[0])))
    if found is None:
        return None
    table = np.concatenate([y[:, :, None], -x[:, :, 1:]], axis=2) * np.sqrt(solved.weight)[:, None, None]
    torque = x[:, :, 0] * np.sqrt(solved.weight)[:, None]
    # Noise in the motion biases it towards zero, noise in the torque biases the forward regression upwards.
    least = least_squares(table.reshape(-1, table.shape[2]), torque.ravel())
    found = replace(
        found, least_inertia=0.0 if least is None else float(least[0]),
        most_inertia=found.inertia if found.inertia > 0.0 else np.inf,
    )  # fmt: skip
    return found, solved.middle / cut.noise


def _reverse(cut: Cut) -> Nominal | None:
    """The fit of the torque on the motion, corrected for the sensor's noise; None without a positive inertia."""
    table = np.concatenate([cut.y[:, :, None], -cut.x[:, :, 1:]], axis=2)
    # Where most of the torque comes from elsewhere (another joint), weights by the residual choose among the windows
    # until none accelerates: then all count alike.
    for rounds in (ROUNDS, 1):
        solved = robust(cut.x[:, :, 0], table, cut.noise_energy, rounds)
        if solved is not None and solved.solution[0] > 0.0:
            found = _nominal_of(cut, solved.solution, solved.spread, solved, cut.x[:, :, 0], 1.0)
            return None if found is None else replace(found, least_inertia=found.inertia, reverse=True)
    return None


def _nominal_of(
    cut: Cut, values: Values, covariance: Values, solved: Solved, target: Values, per_unit: float
) -> Nominal | None:
    """The parameters as a `Nominal`; `per_unit` makes a residual of the target, as an acceleration, a torque."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    power = float(np.sum(solved.weight * np.mean(target**2, axis=1)))
    share = 1.0 - float(np.sum(solved.weight * solved.left**2)) / power if power > 0.0 else 0.0
    if not np.all(np.isfinite([*values, *deviations, share])):
        return None
    padded = [*(float(each) for each in values), 0.0, 0.0][:6]
    return Nominal(
        *padded[:4],
        deviations=tuple([*(float(each) for each in deviations), 0.0, 0.0][:6]),
        # the constant torque over a window that would leave as much
        residual=per_unit * solved.middle / cut.moved,
        share=share,
        rows=len(cut.y),
        sine=padded[4],
        cosine=padded[5],
        window=cut.seconds,
    )
