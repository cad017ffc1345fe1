"""Modes: in which a torque that nobody modelled reaches the sensors, and how large it is.

The residual of a window, in standard deviations of the sensors, is r = n + B d: n is white, d an unknown torque held
over each period [N m], B its way through the rigid *nominal* mass. B holds the nominal mass and the residual the
measured motion, so no candidate can shrink what it is judged by. With B = U diag(sqrt(lambda)) V' the coefficients
c = U' r are independent, of variance s^2 + q^2 lambda: one number a mode, so that the unknown torque is integrated out
exactly. For the rigid mass this is the likelihood of a Kalman filter's innovations (Kennedy, O'Hagan, "Bayesian
calibration of computer models", 2001, have the same idea for static models).

q is estimated for every model: at zero it is output error, at infinity the torque residual. It may depend on frequency,
in octaves: a real machine's unknown torque is not white, and a white one would count its slow part as many
independent observations.
"""

import functools
from dataclasses import dataclass

import numpy as np

FIRST_BAND = 4  # modes of the lowest octave: two of them are taken by a window's start states
LEVELS = 80  # values of a level that are tried
NOISES = np.geomspace(0.5, 32.0, 49)  # factors on the sensors' noise that are tried
BURSTS = 4.0 ** np.arange(-3, 7)  # factors on a window's q^2 that are tried
BURST_SCALE = 1.0  # of the Laplace law of a burst's logarithm [1]
FINEST, COARSEST = 0.03, 1e7  # of the smallest level that a mode can show at all

Values = np.ndarray


@dataclass(frozen=True)
class Modes:
    """The ways of an unknown torque to the sensors in one window, and what two sensors may disagree by.

    With a rate sensor and an encoder, half of the modes hold no torque: they show whether the two agree. What is left
    there has a level of its own, or a sensor that is not as it should be would pass for a torque.

    Attributes:
        basis: U, shape (rows, modes); rows are the samples of the rate, then of the position.
        gain: lambda [1 / (N m)^2], descending, then 1 for modes that hold no torque [1], shape (modes,).
        torque: V, the course of a mode's torque, orthonormal, shape (samples, modes); zero where it holds none.
        band: octave of each mode, shape (modes,); the last one is that of the modes without torque, if there are any.
        frequency: of each mode's torque [Hz], shape (modes,).
        levels: values of q to try [N m], and of the disagreement [standard deviations], shape (levels, bands).
        sensor: whether a mode holds no torque, shape (modes,).
    """

    basis: Values
    gain: Values
    torque: Values
    band: Values
    frequency: Values
    levels: Values
    sensor: Values

    @property
    def bands(self) -> int:
        """Number of levels."""
        return self.levels.shape[1]

    def coefficients(self, residuals: Values) -> Values:
        """c = U' r.

        Args:
            residuals: (channels, samples, lanes), in standard deviations.

        Returns:
            Shape (modes, lanes).
        """
        return self.basis.T @ residuals.reshape(self.basis.shape[0], -1)

    def variance(self, level: Values, noise: Values, burst: Values) -> Values:
        """s^2 + q^2 lambda, shape (windows, modes).

        Args:
            level: q by octave [N m], shape (bands,).
            noise: s^2 of each window [1], shape (windows,).
            burst: factor on q^2 of each window [1], shape (windows,).
        """
        return noise[:, None] + burst[:, None] * (level[self.band] ** 2 * self.gain)

    def wiener(self, level: Values, noise: Values) -> Values:
        """Share of a coefficient that is torque and not noise, shape (windows, modes); 0 for modes without torque."""
        signal = np.where(self.sensor, 0.0, level[self.band] ** 2 * self.gain)
        return signal / (noise[:, None] + signal)

    def bursts(self, level: Values, noise: Values, coefficients: Values) -> Values:
        """The most likely factor on q^2 of each window [1], shape (windows,).

        A push that nobody recorded, a stretch in which something rattles: most of an unknown torque may lie in a few
        windows, which then must not decide over the others (a scale mixture of normal laws, heavy-tailed as Student's).

        Args:
            level: q by octave [N m], shape (bands,).
            noise: s^2 of each window [1], shape (windows,).
            coefficients: shape (windows, modes).
        """
        costs = np.stack([
            self.cost(level, noise, np.full(len(noise), factor), coefficients) for factor in BURSTS
        ])  # fmt: skip
        return BURSTS[np.argmin(costs, axis=0)]

    def cost(self, level: Values, noise: Values, burst: Values, coefficients: Values) -> Values:
        """Twice the negative log likelihood of each window, with the prior of its burst, shape (windows,)."""
        variance = self.variance(level, noise, burst)
        rare = 2.0 / BURST_SCALE * np.abs(np.log(burst))
        return np.sum(coefficients**2 / variance + np.log(variance), axis=1) + rare

    def best_level(self, squares: Values, counts: Values, noise: Values, *, white: bool) -> Values:
        """The levels that make coefficients most likely, shape (bands,).

        Args:
            squares: sum of c^2 over the windows of one class of noise, shape (classes, modes).
            counts: windows of each class, shape (classes,).
            noise: s^2 of each class [1], shape (classes,).
            white: one level of the torque for all octaves.
        """
        by_band = self._costs(squares, counts, noise)
        best = np.argmin(by_band, axis=0)
        if white:
            torque = np.unique(self.band[~self.sensor])
            best[torque] = np.argmin(np.sum(by_band[:, torque], axis=1))
        return self.levels[best, np.arange(self.bands)]

    def best_noise(self, squares: Values, counts: Values, noise: Values) -> float:
        """The factor on the sensors' standard deviation [1] that makes coefficients most likely beside a white torque.

        White sensor noise falls with frequency in a mode's torque and a white torque does not: the two are told apart
        by their spectra, however large the torque is.
        """
        torque = np.unique(self.band[~self.sensor])
        costs = [np.min(np.sum(self._costs(squares, counts, noise * s**2)[:, torque], axis=1)) for s in NOISES]
        return float(NOISES[int(np.argmin(costs))])

    def _costs(self, squares: Values, counts: Values, noise: Values) -> Values:
        """Twice the negative log likelihood of each level, shape (levels, bands)."""
        signal = self.levels[:, self.band] ** 2 * self.gain  # (levels, modes)
        cost = np.zeros_like(signal)
        for square, count, floor in zip(squares, counts, noise, strict=True):
            total = floor + signal
            cost += square / total + count * np.log(total)
        return np.stack([np.sum(cost[:, self.band == b], axis=1) for b in range(self.bands)], axis=1)

    def mean_level(self, level: Values, weight: Values) -> float:
        """q of all octaves together [N m], rms over the modes by a weight of shape (modes,)."""
        weight = np.where(self.sensor, 0.0, weight)
        return float(np.sqrt(np.sum(weight * level[self.band] ** 2) / np.sum(weight)))


@functools.lru_cache(maxsize=16)
def make_modes(samples: int, dt: float, inertia: float, rate_noise: float, angle_noise: float, most: int = 0) -> Modes:
    """The modes of a window.

    Args:
        samples: of the window.
        dt: control period [s].
        inertia: nominal J [kg m^2].
        rate_noise: standard deviation of a rate reading [rad/s]; 0 for no rate sensor.
        angle_noise: of a position reading [rad]; 0 for none.
        most: modes with torque that are kept; 0 for all.
    """
    index = np.arange(samples)
    lag = index[:, None] - index[None, :]  # of sample k behind the period j in which a torque acts
    held = lag > 0
    parts = []
    if rate_noise > 0.0:
        parts.append(np.where(held, dt / inertia, 0.0) / rate_noise)
    if angle_noise > 0.0:
        parts.append(np.where(held, (lag - 0.5) * dt**2 / inertia, 0.0) / angle_noise)
    basis, size, course = np.linalg.svd(np.concatenate(parts), full_matrices=len(parts) == 2)
    count = basis.shape[1]
    gain, torque = np.ones(count), np.zeros((samples, count))
    alive = np.zeros(count, bool)
    alive[: len(size)] = size > 1e-13 * size[0]
    gain[alive] = size[alive[: len(size)]] ** 2
    torque[:, alive] = course.T[:, alive[: len(size)]]
    place = np.arange(count)
    band = np.floor(np.log2(np.maximum(place / FIRST_BAND, 0.5))).astype(int) + 1
    last = int(np.max(band[alive]))
    if np.sum(alive & (band == last)) < FIRST_BAND * 2 ** (last - 1) / 2:  # a rest joins the octave below
        band[band >= last] = last - 1
    last = int(np.max(band[alive]))
    both = len(parts) == 2
    keep = ~alive if both else np.zeros(count, bool)
    keep = keep | (alive & (place < (most or count)))
    # With one sensor, a mode that shows no torque is noise: it has the last octave's level and no gain.
    gain = np.where(alive, gain, 1.0 if both else 0.0)
    grid = np.concatenate([[0.0], np.geomspace(FINEST, COARSEST, LEVELS)])
    torques = int(np.max(band[keep & alive])) + 1
    band = np.where(alive, band, torques if both else last)
    levels = np.repeat(grid[:, None] / np.sqrt(gain[0]), torques, axis=1)
    if both:
        levels = np.concatenate([levels, np.minimum(grid, 1e5)[:, None]], axis=1)
    frequency = (place + 0.5) / (2.0 * samples * dt)
    return Modes(
        np.ascontiguousarray(basis[:, keep]), gain[keep], torque[:, keep], band[keep], frequency[keep], levels,
        (~alive)[keep],
    )  # fmt: skip
