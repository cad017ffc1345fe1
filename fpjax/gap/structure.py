"""Is anything but noise left? Null tests on the residual of a simulation, for `no_gap` and `unexplained`.

Three questions, each answered against draws of what chance alone would do:
is the residual larger than the noise; is it coloured where noise is white (against permuted samples, or against a
rounded copy
of the prediction where the sensor rounds); does it follow the motion (against phase-randomised copies of itself:
Theiler et al.,
"Testing for nonlinearity in time series: the method of surrogate data", 1992,
which keep its spectrum and lose its timing).
"""

import itertools
from dataclasses import dataclass

import numpy as np

from .measure import block_length

Values = np.ndarray

DRAWS = 400
BANDS = 8


@dataclass(frozen=True)
class LeftOver:
    """Chances that noise alone would look like this, each between 1 / (draws + 1) and 1.

    Attributes:
        larger: that it would be so large.
        coloured: that it would be so coloured.
        follows: that it would follow the motion so well.
        excess: mean square over the noise's, 1 for noise.
        white_excess: largest band's power over the white level, 1 for noise.
        explained: share of the residual's energy that plain functions of the motion explain [1].
    """

    larger: float
    coloured: float
    follows: float
    excess: float
    white_excess: float
    explained: float

    def noise_alone(self, chance: float = 0.01) -> bool:
        """Whether none of the three is too unlikely; `chance` is shared between them (Bonferroni)."""
        return min(self.larger, self.coloured, self.follows) >= chance / 3.0


def left_over(
    residual: Values,
    noise: float,
    motion: Values,
    window: Values,
    *,
    predicted: Values | None = None,
    step: float = 0.0,
    draws: int = DRAWS,
    seed: int = 0,
) -> LeftOver:
    """Test a simulation's residual against chance.

    Args:
        residual: measured less simulated, shape (samples,); NaN where nothing was simulated.
        noise: standard deviation of one sensor sample.
        motion: signals that a missing effect would follow (speed, its sign, acceleration, position, ...), shape
        (signals, samples).
        window: index of the window of each sample; windows are not joined.
        predicted: what was simulated, needed where the sensor rounds.
        step: of the rounding; 0 for none.
        draws: of chance.
        seed: of the draws.
    """
    known = np.isfinite(residual) & np.all(np.isfinite(motion), axis=0)
    random = np.random.default_rng(seed)
    excess = float(np.mean(residual[known] ** 2)) / noise**2
    # the noise level itself is known from the sensor to a few per cent; the chance counts both
    independent = np.sum(known) / max(block_length(residual[known]) / 4.0, 1.0)
    spread = np.sqrt(2.0 / independent + 0.05**2)
    larger = _upper_tail((excess - 1.0) / spread)
    groups = _groups(known, window)
    white, drawn = _whiteness(residual, groups, noise, predicted, step, draws, random)
    coloured = (1.0 + np.sum(drawn >= white)) / (draws + 1.0)
    explained, by_chance = _followed(residual, motion, known, draws, random)
    follows = (1.0 + np.sum(by_chance >= explained)) / (draws + 1.0)
    return LeftOver(larger, float(coloured), float(follows), excess, white, explained)


def repeats(residual: Values, lap: int, *, draws: int = DRAWS, seed: int = 0) -> tuple[float, float]:
    """(correlation of the residual with itself one lap later, chance of so much by luck), against phase-randomised
    laps.

    Args:
        residual: shape (samples,), NaN where unknown.
        lap: samples, from `fpjax.gap.measure.lap_length`.
        draws: of chance.
        seed: of the draws.
    """
    known = np.isfinite(residual)
    values = np.where(known, residual - np.mean(residual[known]), 0.0)
    both = known[lap:] & known[:-lap]
    if np.sum(both) < 64:
        return 0.0, 1.0
    random = np.random.default_rng(seed)

    def alike(first: Values, second: Values) -> float:
        return float(np.sum((first * second)[both]) / np.sqrt(np.sum(first[both] ** 2) * np.sum(second[both] ** 2)))

    found = alike(values[lap:], values[:-lap])
    drawn = [alike(values[lap:], randomised(values[:-lap], random)) for _ in range(draws)]
    return found, float((1.0 + np.sum(np.asarray(drawn) >= found)) / (draws + 1.0))


def randomised(values: Values, random: np.random.Generator) -> Values:
    """A copy with the same spectrum and random phases, shape (samples,)."""
    spectrum = np.fft.rfft(values)
    phase = np.exp(2j * np.pi * random.random(len(spectrum)))
    phase[0] = 1.0
    if len(values) % 2 == 0:
        phase[-1] = 1.0
    return np.fft.irfft(spectrum * phase, len(values))


def _whiteness(
    residual: Values, groups: list[Values], noise: float, predicted: Values | None, step: float, draws: int, random
) -> tuple[float, Values]:
    """(largest octave band's power over the mean of all, the same of draws of noise)."""
    if not groups:
        return 1.0, np.ones(draws)
    rows = np.stack([residual[group] for group in groups])
    found = float(_largest_band(rows[None])[0])
    if step > 0.0 and predicted is not None:
        beyond = np.sqrt(max(noise**2 - step**2 / 12.0, 0.0))
        made = np.stack([predicted[group] for group in groups])

        def draw() -> Values:
            shift = step * random.random((len(made), 1))  # where the steps lie is not known
            moved = made + shift
            return step * np.round((moved + beyond * random.standard_normal(made.shape)) / step) - moved
    else:

        def draw() -> Values:
            return random.permuted(rows, axis=1)

    return found, np.array([_largest_band(draw()[None])[0] for _ in range(draws)])


def _largest_band(rows: Values) -> Values:
    """Largest octave band's power over the mean of all, (draws,), of rows (draws, windows, samples)."""
    centred = rows - np.mean(rows, axis=-1, keepdims=True)
    power = np.mean(np.abs(np.fft.rfft(centred, axis=-1)[..., 1:]) ** 2, axis=-2)
    lines = power.shape[-1]
    edges = np.unique(np.concatenate([[0], np.round(lines / 2.0 ** np.arange(BANDS)[::-1]).astype(int)]))
    means = np.stack([np.mean(power[..., a:b], axis=-1) for a, b in itertools.pairwise(edges)], axis=-1)
    return np.max(means, axis=-1) / np.maximum(np.mean(power, axis=-1), 1e-300)


def _followed(
    residual: Values, motion: Values, known: Values, draws: int, random: np.random.Generator
) -> tuple[float, Values]:
    """(share of the energy that a regression on the motion explains, the same of phase-randomised residuals)."""
    values = np.where(known, residual, 0.0)
    columns = motion[:, known]
    columns = columns[np.std(columns, axis=1) > 0.0]
    basis = np.concatenate([np.ones((1, columns.shape[1])), columns / np.std(columns, axis=1, keepdims=True)])
    basis, _ = np.linalg.qr(basis.T)

    def share(candidate: Values) -> float:
        total = float(candidate @ candidate)
        return float(np.sum((basis.T @ candidate) ** 2)) / total if total > 0.0 else 0.0

    found = share(values[known])
    return found, np.array([share(randomised(values, random)[known]) for _ in range(draws)])


def _groups(known: Values, window: Values) -> list[Values]:
    """The samples of each full window."""
    found = [np.flatnonzero((window == index) & known) for index in np.unique(window[window >= 0])]
    longest = max((len(group) for group in found), default=0)
    return [group for group in found if len(group) == longest >= 16]


def _upper_tail(deviations: float) -> float:
    from math import erfc, sqrt

    return float(max(0.5 * erfc(deviations / sqrt(2.0)), 1e-300))
