"""Start values of torques and frictions that repeat with the position: periods per revolution, and amplitudes there.

A least-squares periodogram over the position (Lomb and Scargle's, with further columns beside the sine): the position
is not evenly sampled, so that a Fourier transform does not serve.
"""

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..data.setting import Setting
from ..effects.parameters import COGGING, COGGING_PERIODS, RIPPLE, RIPPLE_PERIODS, fewest_periods

MOST = 3  # peaks that are returned of each kind
SAMPLES = 3000  # of the log that are used, evenly spread
HIGHEST = 200.0  # periods per revolution that are tried at most, or as many within a shorter travel
GRID = 1600  # values that are tried at most
NEARLY = 0.03  # singular values, of the largest [1], below which amplitudes of waves are left out: nearly parallel ones
BLOCK = 40  # values that are computed together, so that their sines stay in the cache
MOVING = 0.05  # of the top speed: slower samples are left out, since their direction is uncertain


def repeating_waves(course: Values, record: Record, setting: Setting) -> dict[str, tuple[dict[str, float], ...]]:
    """Start values by name of a cogging ("torque") and of a friction by position ("friction"), the strongest first.

    At each number of periods with which the missing torque repeats, the amplitudes that fit it best: from none a large
    one is out of reach, since a machine that cogging traps does not move in a simulation without it.

    Args:
        course: the missing torque [N m], NaN where unknown, shape (samples,).
        record: the log.
        setting: sizes.

    Returns:
        {"torque": starts, "friction": starts}; {} where the machine turns too little.
    """
    periods = _repeating_periods(course, record, setting)
    return {
        kind: tuple(_wave(kind, each, course, record, setting) for each in tried) for kind, tried in periods.items()
    }


def _wave(kind: str, periods: float, course: Values, record: Record, setting: Setting) -> dict[str, float]:
    """Amplitudes [N m] by name that fit the missing torque best at some periods per revolution, and these."""
    parts, number = (RIPPLE, RIPPLE_PERIODS) if kind == "friction" else (COGGING, COGGING_PERIODS)
    keep = _moving(course, record, setting)
    angle, side = record.angle[keep], np.sign(record.speed[keep]) if kind == "friction" else 1.0
    orders = periods * np.arange(1, len(parts) // 2 + 1)
    waves = [side * f(n * angle) for n in orders for f in (np.cos, np.sin)]
    found = _amplitudes(np.stack(waves, 1), course, record, keep, NEARLY)
    amplitudes = {p.name: float(v) for p, v in zip(parts, found, strict=True)}
    return amplitudes | {number.name: float(periods)}


def _repeating_periods(course: Values, record: Record, setting: Setting) -> dict[str, tuple[float, ...]]:
    """{"torque": periods, "friction": periods} [1/rev], the strongest first; {} where the machine turns too little.

    "torque" is a sine of the position, "friction" one times the sign of the speed.
    """
    travel = float(np.ptp(record.angle))
    keep = _moving(course, record, setting)
    if travel <= 0.0 or len(keep) < 50:
        return {}
    angle, speed, left = record.angle[keep], record.speed[keep], course[keep]
    fewest = fewest_periods(setting)
    highest = HIGHEST * max(1.0, fewest)
    # A peak is about 2 pi / travel wide: four values across it.
    step = max(np.pi / (2.0 * travel), highest / GRID)
    periods = np.arange(max(0.5, fewest, step), highest, step)
    if len(periods) < 3:
        return {}
    # Offset, Coulomb, viscous and inertial errors are taken out of the missing torque and of every sine.
    basis, _ = np.linalg.qr(_common(record, keep))
    torque, friction = _energies(left, angle, np.sign(speed), periods, basis)
    found = {
        "torque": _peaks(periods, np.where(periods >= 1.5, torque, 0.0)),  # below, it is an unbalance
        "friction": _peaks(periods, friction),
    }
    if travel < 3.0 * np.pi:
        # Less than one and a half turns: the peak is as wide as its own value, so that starts on both sides are needed.
        around = {name: tuple(f * peaks[0] for f in (0.85, 1.2)) for name, peaks in found.items() if peaks}
        found = {name: (*peaks, *(p for p in around[name] if p > fewest)) for name, peaks in found.items() if peaks}
    return found


def _moving(course: Values, record: Record, setting: Setting) -> np.ndarray:
    """Indices of samples in motion at which the missing torque is known, `SAMPLES` to twice as many at most."""
    keep = np.flatnonzero(np.isfinite(course) & (np.abs(record.speed) > MOVING * setting.speed))
    return keep[:: max(1, len(keep) // SAMPLES)]


def _common(record: Record, keep: np.ndarray) -> Values:
    """What an offset and errors of Coulomb, viscous and inertial torque follow, each of norm 1, (samples, 4)."""
    speed = record.speed[keep]
    columns = np.stack([np.ones_like(speed), np.sign(speed), speed, record.acceleration[keep]], 1)
    return columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-30)


def turning_weight(course: Values, record: Record) -> dict[str, float]:
    """Values of the unbalance that fits a missing torque best, by name [N m]; {} with fewer than 50 samples of it.

    Args:
        course: the missing torque [N m], NaN where unknown, shape (samples,).
        record: the log.
    """
    keep = np.flatnonzero(np.isfinite(course))
    if len(keep) < 50:
        return {}
    angle = record.angle[keep]
    cosine, sine = _amplitudes(np.stack([np.cos(angle), np.sin(angle)], 1), course, record, keep, 1e-6)
    return {"unbalance_cosine": float(cosine), "unbalance_sine": float(sine)}


def _amplitudes(waves: Values, course: Values, record: Record, keep: np.ndarray, least: float) -> Values:
    """Amplitudes [N m] of loads or frictions that fit the missing torque best, beside errors of the nominal values.

    Args:
        waves: of amplitude 1, shape (kept samples, waves).
        course: the missing torque [N m], shape (samples,).
        record: the log.
        keep: indices of samples.
        least: singular values, of the largest [1], below which nothing is fitted.
    """
    columns = np.concatenate([waves, _common(record, keep)], 1)
    sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-30)  # the columns' units differ
    found = np.linalg.lstsq(columns / sizes, course[keep], rcond=least)[0] / sizes
    # A missing torque drives the machine, a load and a friction brake it: the signs are opposite.
    return -found[: waves.shape[1]]


def _energies(left: Values, angle: Values, side: Values, periods: Values, basis: Values) -> tuple[Values, Values]:
    """Energy that a sine of each number of periods explains beside the basis, plain and times `side`.

    Args:
        left: missing torque [N m], (samples,).
        angle: position [rad], (samples,).
        side: sign of the speed, 1 or -1, (samples,).
        periods: per revolution, evenly spaced, (periods,).
        basis: orthonormal columns that are fitted too, (samples, columns).

    Returns:
        (of the torque, of the friction) [N^2 m^2], each of shape (periods,).
    """
    columns = np.concatenate([basis, (left - basis @ (basis.T @ left))[:, None]], 1)
    # sum((side sine) column) = sum(sine (side column)): the sines are formed once for both kinds.
    columns = np.concatenate([columns, side[:, None] * columns], 1)
    # Evenly spaced: exp(i (p0 + k dp) angle) of a block is one exponential times these factors, formed once.
    turned = np.exp(1j * (periods[1] - periods[0]) * angle * np.arange(BLOCK)[:, None])
    found = []
    for first in range(0, len(periods), BLOCK):
        wave = turned[: len(periods) - first] * np.exp(1j * periods[first] * angle)
        cosine, sine = np.ascontiguousarray(wave.real), np.ascontiguousarray(wave.imag)
        squares = [np.einsum("ps,ps->p", a, b) for a, b in ((cosine, cosine), (sine, sine), (cosine, sine))]
        along = np.split(cosine @ columns, 2, axis=1), np.split(sine @ columns, 2, axis=1)
        found.append([_explained(squares, a, b, 1e-6 * len(angle)) for a, b in zip(*along, strict=True)])
    torque, friction = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return torque, friction


def _explained(squares: list[Values], cosine: Values, sine: Values, small: float) -> Values:
    """Fall of the sum of squares by a cosine and a sine beside the basis (a 2 x 2 system after its projection).

    Args:
        squares: sums of cosine^2, sine^2 and cosine x sine, each (periods,).
        cosine: products of the cosine with the basis, then with the missing torque, (periods, columns + 1).
        sine: likewise.
        small: added to the diagonal; a cosine and a sine over little travel are parallel.
    """
    (a, c), (b, s) = (cosine[:, :-1], cosine[:, -1]), (sine[:, :-1], sine[:, -1])
    cc, ss, cs = (
        whole - np.sum(one * other, axis=1) for whole, one, other in zip(squares, (a, b, a), (a, b, b), strict=True)
    )
    cc, ss = cc + small, ss + small
    return (ss * c**2 - 2.0 * cs * c * s + cc * s**2) / (cc * ss - cs**2)


def _peaks(periods: Values, energy: Values) -> tuple[float, ...]:
    """Periods of the highest values that are further apart than 2.5 steps, `MOST` at the most."""
    width = 2.5 * (periods[1] - periods[0])
    found: list[float] = []
    for index in np.argsort(-energy):
        if energy[index] <= 0.0 or len(found) == MOST:
            break
        if all(abs(periods[index] - other) > width for other in found):
            found.append(float(periods[index]))
    return tuple(found)
