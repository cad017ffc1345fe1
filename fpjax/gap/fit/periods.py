"""Periods: at how many periods a revolution the missing torque repeats with the position; starts of fits."""

import numpy as np

from ..data.record import Record
from ..data.setting import Setting
from ..effects.parameters import fewest_periods

MOST = 3  # starts of each kind
SAMPLES = 3000  # that are looked at
HIGHEST = 200.0  # periods a revolution that are looked at, or as many within a shorter travel
GRID = 1600  # periods that are tried at the most
BLOCK = 40  # periods that are computed together: they stay in the cache
MOVING = 0.05  # of the top speed: below it the direction is not known

Values = np.ndarray


def repeating_periods(course: Values, record: Record, setting: Setting) -> dict[str, tuple[float, ...]]:
    """{"torque": periods, "friction": periods} [1/rev], the strongest first; nothing where too little turns.

    Args:
        course: the missing torque [N m], NaN where unknown, shape (samples,).
        record: its motion.
        setting: sizes.
    """
    travel = float(np.ptp(record.angle))
    keep = np.flatnonzero(np.isfinite(course) & (np.abs(record.speed) > MOVING * setting.speed))
    if travel <= 0.0 or len(keep) < 50:
        return {}
    keep = keep[:: max(1, len(keep) // SAMPLES)]
    angle, speed, left = record.angle[keep], record.speed[keep], course[keep]
    fewest = fewest_periods(setting)
    highest = HIGHEST * max(1.0, fewest)
    step = max(np.pi / (2.0 * travel), highest / GRID)
    periods = np.arange(max(0.5, fewest, step), highest, step)
    if len(periods) < 3:
        return {}
    common = np.stack([np.ones_like(speed), np.sign(speed), speed, record.acceleration[keep]], 1)
    basis, _ = np.linalg.qr(common / np.maximum(np.linalg.norm(common, axis=0), 1e-30))
    torque, friction = _energies(left, angle, np.sign(speed), periods, basis)
    found = {
        "torque": _peaks(periods, np.where(periods >= 1.5, torque, 0.0)),
        "friction": _peaks(periods, friction),
    }
    if travel < 3.0 * np.pi:
        # Little more than a period was seen: the peak is as wide as its place, and the fit wants starts around it.
        around = {name: tuple(f * peaks[0] for f in (0.85, 1.2)) for name, peaks in found.items() if peaks}
        found = {name: (*peaks, *(p for p in around[name] if p > fewest)) for name, peaks in found.items() if peaks}
    return found


def repeating_share(course: Values, record: Record, periods: tuple[float, ...]) -> tuple[float, float]:
    """(periods a revolution [1/rev], share [1] of the missing torque) of the sine of the position that holds most.

    Args:
        course: the missing torque [N m], NaN where unknown, shape (samples,).
        record: its motion.
        periods: to choose from [1/rev].

    Returns:
        (0, 0) where there is none.
    """
    keep, best = np.flatnonzero(np.isfinite(course)), (0.0, 0.0)
    left = course[keep] - np.mean(course[keep])
    for period in periods:
        waves = np.stack([np.cos(period * record.angle[keep]), np.sin(period * record.angle[keep])], 1)
        rest = left - waves @ np.linalg.lstsq(waves, left, rcond=1e-6)[0]
        share = 1.0 - float(np.sum(rest**2)) / max(float(np.sum(left**2)), 1e-300)
        best = max(best, (period, share), key=lambda one: one[1])
    return best


def turning_weight(course: Values, record: Record) -> dict[str, float]:
    """Values of an unbalance that a missing torque is most like, by name [N m]; nothing where too little is known.

    Args:
        course: the missing torque [N m], NaN where unknown, shape (samples,).
        record: its motion.
    """
    keep = np.flatnonzero(np.isfinite(course))
    if len(keep) < 50:
        return {}
    angle, speed = record.angle[keep], record.speed[keep]
    beside = np.stack([np.ones_like(speed), np.sign(speed), speed, record.acceleration[keep]], 1)
    columns = np.concatenate([np.stack([np.cos(angle), np.sin(angle)], 1), beside], 1)
    sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-30)
    found = np.linalg.lstsq(columns / sizes, course[keep], rcond=1e-6)[0] / sizes
    # What the machine has and the model lacks drives; a load holds back.
    return {"unbalance_cosine": -float(found[0]), "unbalance_sine": -float(found[1])}


def _energies(left: Values, angle: Values, side: Values, periods: Values, basis: Values) -> tuple[Values, Values]:
    """What a sine of each of the periods explains, as it is and times `side` (1 or -1), beside the basis.

    Both of shape (periods,).
    """
    columns = np.concatenate([basis, (left - basis @ (basis.T @ left))[:, None]], 1)
    columns = np.concatenate([columns, side[:, None] * columns], 1)
    # The periods are evenly spaced: a block of them is one of them turned on, without further sines.
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
    """Fall of the sum of squares by a sine and a cosine; given their products, and those with the columns."""
    (a, c), (b, s) = (cosine[:, :-1], cosine[:, -1]), (sine[:, :-1], sine[:, -1])
    cc, ss, cs = (
        whole - np.sum(one * other, axis=1) for whole, one, other in zip(squares, (a, b, a), (a, b, b), strict=True)
    )
    cc, ss = cc + small, ss + small
    return (ss * c**2 - 2.0 * cs * c * s + cc * s**2) / (cc * ss - cs**2)


def _peaks(periods: Values, energy: Values) -> tuple[float, ...]:
    """The highest ones that are further apart than the resolution."""
    width = 2.5 * (periods[1] - periods[0])
    found: list[float] = []
    for index in np.argsort(-energy):
        if energy[index] <= 0.0 or len(found) == MOST:
            break
        if all(abs(periods[index] - other) > width for other in found):
            found.append(float(periods[index]))
    return tuple(found)
