"""Rich references: multisine, plateaus at several speeds, slow and fast reversals, a rest."""

import numpy as np

from .systems import Kind


def reference(kind: Kind, rng: np.random.Generator, periods: int, preroll: int, dt: float) -> np.ndarray:
    """Velocity reference of `preroll + periods` samples [rad/s], segments in a drawn order."""
    total = preroll + periods
    pieces = ["multisine", "plateaus", "slow", "multisine", "plateaus", "fast"]
    rng.shuffle(pieces)
    lengths = rng.uniform(0.8, 1.2, len(pieces)) * np.array([1.3 if piece != "slow" else 0.8 for piece in pieces])
    ends = np.round(np.cumsum(lengths) / lengths.sum() * total).astype(int)
    starts = np.concatenate([[0], ends[:-1]])
    value = np.zeros(total)
    # Pieces overlap by 0.12 s.
    blend = int(0.12 / dt)
    for piece, start, end in zip(pieces, starts, ends, strict=True):
        # Every piece overlaps the next one and is faded into it.
        stop = min(end + blend, total)
        time = np.arange(stop - start) * dt
        part = PIECES[piece](kind, rng, time)
        window = np.ones(len(time))
        if start > 0 or preroll == 0:
            rise = min(blend, len(time))
            window[:rise] = _ramp(rise)
        if stop > end:
            window[end - start :] *= 1 - _ramp(blend)[: stop - end]
        value[start:stop] += part * window
    return value * rng.uniform(0.85, 1.05)


def _ramp(count: int) -> np.ndarray:
    x = (np.arange(count) + 0.5) / count
    return x * x * (3 - 2 * x)


def _multisine(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    frequencies = np.geomspace(0.35, kind.highest, 7) * rng.uniform(0.9, 1.1, 7)
    phases = rng.uniform(0, 2 * np.pi, 7)
    # Amplitudes fall with frequency, so that accelerations stay of one size.
    waves = np.sin(2 * np.pi * frequencies * time[:, None] + phases) * frequencies**-0.7
    wave = waves.sum(axis=1)
    return kind.speed * rng.uniform(0.7, 1.0) * wave / np.max(np.abs(wave))


def _plateaus(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    duration = time[-1] if len(time) > 1 else 1.0
    levels = rng.permutation([1.0, 0.55, 0.25, -0.8, -0.35, 0.12][: 4 + int(rng.integers(3))])
    levels = levels * rng.choice([1.0, 1.0, -1.0]) * rng.uniform(0.9, 1.0, len(levels))
    edges = np.linspace(0, duration, len(levels) + 1)
    ramp = min(0.18, 0.5 * duration / len(levels))
    knots, values = [0.0], [levels[0]]
    for edge, before, after in zip(edges[1:-1], levels[:-1], levels[1:], strict=True):
        knots += [edge - ramp / 2, edge + ramp / 2]
        values += [before, after]
    return kind.speed * np.interp(time, knots, values)


def _triangle(kind: Kind, rng: np.random.Generator, time: np.ndarray, size: float, period: float) -> np.ndarray:
    phase = (time / period + rng.uniform()) % 1.0
    return kind.speed * size * (4 * np.abs(phase - 0.5) - 1)


def _slow(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    return _triangle(kind, rng, time, rng.uniform(0.06, 0.2), rng.uniform(0.5, 0.9))


def _fast(kind: Kind, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    # A chirp up to beyond the highest reference frequency, where lags and resonances show.
    low, high = 1.0, 2.2 * kind.highest
    duration = max(time[-1], 0.1)
    phase = 2 * np.pi * (low * time + (high - low) * time**2 / (2 * duration))
    size = 1 / (1 + 2 * time / duration)
    return kind.speed * 0.5 * size * np.sin(phase + rng.uniform(0, 6.28))


PIECES = {"multisine": _multisine, "plateaus": _plateaus, "slow": _slow, "fast": _fast}
