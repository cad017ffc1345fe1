"""References as people record them: sines, chirps, trapezoids, reversals, random steps, with rests between."""

import numpy as np

from .machines import Kind, between


def reference(kind: Kind, rng: np.random.Generator, count: int, dt: float) -> np.ndarray:
    """Velocity reference of `count` samples from rest; its integral stays within the machine's travel."""
    # Always one wide-band piece, reversals and trapezoids: every effect is excited somewhere.
    wide = ["chirp", "steps"][int(rng.integers(2))]
    others = rng.permutation(["sines", "trapezoids", "reversals", "chirp", "steps"])
    pieces = [wide, "reversals", "trapezoids", str(others[0])]
    pieces = [pieces[i] for i in rng.permutation(len(pieces))]
    lengths = rng.uniform(0.7, 1.3, len(pieces))
    ends = np.round(np.cumsum(lengths) / lengths.sum() * count).astype(int)
    value, begin = np.zeros(count), 0
    for piece, end in zip(pieces, ends, strict=True):
        rest = int(rng.uniform(0.05, 0.25) / dt) if rng.random() < 0.5 else 0
        stop = max(end - rest, begin + 100)
        part = PIECES[piece](kind, rng, np.arange(stop - begin) * dt)[: end - begin]
        # Without its mean, so that the piece comes back; smoothed over 20 ms, as by a generator that limits the jerk.
        part = smooth(part - part.mean(), int(0.02 / dt))
        # Scaled down to the travel, as one would set the amplitude so that nothing hits a stop.
        reach = np.ptp(np.cumsum(part) * dt)
        value[begin : begin + len(part)] = part * min(1.0, 0.8 * kind.travel / max(reach, 1e-12))
        begin = end
    return smooth(value, int(0.006 / dt))


def smooth(value: np.ndarray, width: int) -> np.ndarray:
    """A raised-cosine average over `width` samples, which ends at zero on both sides."""
    if width < 2:
        return value
    window = np.hanning(width + 2)[1:-1]
    edge = np.clip(np.minimum(np.arange(len(value)), np.arange(len(value))[::-1]) / (2 * width), 0, 1)
    return np.convolve(value, window / window.sum(), mode="same") * edge * edge * (3 - 2 * edge)


def _sines(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    slow, fast = between(rng, 0.4, 1.0), between(rng, 0.4, 1.0) * kind.highest
    share = rng.uniform(0.15, 0.4)
    wave = (1 - share) * np.sin(2 * np.pi * slow * time) + share * np.sin(2 * np.pi * fast * time + rng.uniform(0, 6))
    return kind.speed * wave * rng.uniform(0.7, 1.0)


def _chirp(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    low, high = 0.5, kind.highest * rng.uniform(1.5, 3.0)
    rate = np.log(high / low) / max(time[-1], 0.2)
    phase = 2 * np.pi * low * (np.exp(rate * time) - 1) / rate
    return kind.speed * rng.uniform(0.5, 0.8) * np.sin(phase) / (1 + (np.exp(rate * time) * low / kind.highest) ** 2)


def _trapezoids(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    knots, values, now = [0.0], [0.0], 0.0
    side = 1.0
    while now < time[-1]:
        ramp, hold, rest = rng.uniform(0.06, 0.18), rng.uniform(0.12, 0.4), rng.uniform(0.0, 0.1)
        speed = side * kind.speed * float(rng.choice([1.0, 0.7, 0.45, 0.2]))
        for length, target in ((ramp, speed), (hold, speed), (ramp, 0.0), (rest, 0.0)):
            now += length
            knots.append(now)
            values.append(target)
        side = -side
    return np.interp(time, knots, values)


def _reversals(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    period = rng.uniform(0.5, 1.1)
    size = np.where(time < rng.uniform(0.4, 0.6) * time[-1], rng.uniform(0.06, 0.15), rng.uniform(0.25, 0.5))
    return kind.speed * size * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * time / period)) * 1.2


def _steps(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    edges = np.cumsum(rng.uniform(0.08, 0.35, int(time[-1] / 0.08) + 2))
    levels = rng.uniform(-1, 1, len(edges) + 1) * rng.choice([1.0, 0.5, 0.2], len(edges) + 1)
    return kind.speed * levels[np.searchsorted(edges, time)]


PIECES = {"sines": _sines, "chirp": _chirp, "trapezoids": _trapezoids, "reversals": _reversals, "steps": _steps}
