"""Modes: how an unmodelled (missing) torque reaches the sensors, and the likelihood with it integrated out.

The residual of a window, in standard deviations of the sensors, is r = n + B d: n is white noise, d the missing torque,
held over each period [N m], B its effect on the readings through the rigid *nominal* mass with its viscous friction
(without which a motor under a voltage, whose speed follows it within a fraction of a window, would seem to miss next to
nothing). B is the same for every candidate, so that none can make its own missing torque small by its inertia. With the
singular value decomposition B = U diag(sqrt(lambda)) V' the coefficients c = U' r are independent, of variance
s^2 + q^2 lambda, where s is the noise and q the standard deviation of the missing torque: so it is integrated out
exactly. For the rigid mass this is the likelihood of a Kalman filter's innovations (Kennedy and O'Hagan, "Bayesian
calibration of computer models", 2001, have the same idea for static models).

q is estimated for every model: with q = 0 the fit minimises the output error, with large q the torque residual. It may
depend on frequency, in octaves: a real machine's missing torque is not white, and with one q its slow part would count
as many independent observations. Nor is it stationary: there are unrecorded pushes, stretches of rattling, reversals
with details that no law has. So the coefficients of half an octave are rotated into ones that are local in time, and
every few neighbours (a tile of time and frequency) share a factor on q, their burst, which is integrated out too: a
scale mixture of normal laws, heavy-tailed as Student's t. A few events then do not outweigh the rest of a log.

How heavy the tails are depends on the question (as in MM-estimation: Yohai, "High breakdown-point and high efficiency
robust estimates for regression", 1987). Models are *compared* with heavy ones (`COMPARED`): what happens at a few
reversals must not decide for a name. Parameters are *fitted* with light ones (`FITTED`): with heavy tails the quiet
stretches of a log decide, in which a law's own errors are largest beside what is to be seen. (The weight of a pendulum
came out 12 % too small on two records, and intervals held the truth in 59 instead of 80 % under laws of another form.)
"""

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from ...logs.arrays import Values
from ..thresholds import THRESHOLDS
from .bursts import BELOW, BURSTS, bursts, law_along, mixed_likelihood

PER_OCTAVE = 3  # levels q that are tried within a factor of two
NOISES = np.geomspace(0.5, 32.0, 49)  # factors on the sensors' noise standard deviation that are tried
FITTED, COMPARED = THRESHOLDS.fitted_tails, THRESHOLDS.compared_tails


@dataclass(frozen=True)
class _Atoms:
    """Groups of modes that enter the likelihood by their sum of squares alone (`Modes._atoms`).

    A side is the modes that hold torque, or those that hold none.

    Attributes:
        first: first mode of each atom, shape (atoms,).
        count: modes in each, (atoms,).
        band: octave of each, (atoms,).
        flat: lambda of each, (atoms,).
        excess: variance of each beside noise and torque [1], (atoms,).
        tile: number of the tile of each, from 0, (atoms,).
        first_of_tile: first atom of each tile, (tiles,).
        by_order: (tiles, atoms): the first atom of every tile, the second one of those with two, and so on; sums over
            the atoms of a tile take these in turn (`numpy.add.reduceat` takes three times as long).
        of_side: atoms of each side.
        place: atom of each mode, shape (modes,).
    """

    first: Values
    count: Values
    band: Values
    flat: Values
    excess: Values
    tile: Values
    first_of_tile: Values
    by_order: tuple[tuple[Values, Values], ...]
    of_side: tuple[slice, ...]
    place: Values


@dataclass(frozen=True)
class Modes:
    """The modes of one window's residuals: those that a missing torque reaches, and those that it does not.

    With a rate sensor and an encoder, half of the modes hold no torque: they are the differences between the sensors.
    These have a level of their own, else a fault of a sensor would count as a torque.

    Attributes:
        basis: U, rotated half an octave at a time into vectors that are local in time, shape (rows, modes); rows are
            the samples of the rate, then of the position.
        turn: that rotation, orthonormal, shape (modes, modes): U is basis @ turn.T.
        flat: lambda of the rotated coefficients [1 / (N m)^2], its mean in each half octave, shape (modes,).
        tile: number of the tile of each rotated coefficient, ascending, shape (modes,).
        gain: lambda [1 / (N m)^2], descending, then 1 for modes that hold no torque [1], shape (modes,).
        torque: V, the course of each mode's torque, orthonormal, shape (samples, modes); zero for modes without torque.
        band: octave of each mode, ascending, shape (modes,); the last one is that of the modes without torque, if there
            are any.
        frequency: of each mode's torque [Hz], shape (modes,).
        levels: values of q to try [N m], and of the sensors' difference [standard deviations], shape (levels, bands).
        sensor: whether a mode holds no torque, shape (modes,).
        inertia: nominal J [kg m^2].
        tails: scale of the prior of a burst's logarithm [1].
        unanswered: standard deviation by octave of what the readings hold beside the sensors' noise and is no torque,
            as the torque that it would be [N m], shape (bands,) (`fpjax.gap.fit.band.unanswered`).
    """

    basis: Values
    turn: Values
    flat: Values
    tile: Values
    gain: Values
    torque: Values
    band: Values
    frequency: Values
    levels: Values
    sensor: Values
    inertia: float
    unanswered: Values
    tails: float = FITTED

    @property
    def bands(self) -> int:
        """Number of octaves, each with a level."""
        return self.levels.shape[1]

    def coefficients(self, residuals: Values) -> Values:
        """The rotated coefficients of residuals.

        Args:
            residuals: (channels, samples, lanes), in standard deviations.

        Returns:
            Shape (modes, lanes).
        """
        return self.basis.T @ residuals.reshape(self.basis.shape[0], -1)

    def wiener(self, level: Values, noise: Values) -> Values:
        """Share of torque in a coefficient (Wiener filter) [1], shape (windows, modes); 0 in modes without torque.

        Args:
            level: q by octave [N m], shape (bands,).
            noise: s^2 of each window [1], shape (windows,).
        """
        signal = np.where(self.sensor, 0.0, level[self.band] ** 2 * self.gain)
        return signal / (self.variance(noise) + signal)

    def variance(self, noise: Values) -> Values:
        """Variance of plain coefficients without a missing torque [1], shape (windows, modes).

        Args:
            noise: s^2 of each window [1], shape (windows,).
        """
        return noise[:, None] + np.where(self.sensor, 0.0, self.unanswered[self.band] ** 2 * self.gain)

    def response(
        self, inertia: Values, viscous: Values, gain: Values, guide: tuple[float, float] = (0.0, 0.0)
    ) -> Values:
        """Frequency responses of the motion to a missing torque, over that of the nominal rigid mass [1], (machines,
        modes).

        Its magnitude by mode: g J_nominal / J |s^2 + K| / |s^2 + s B / J + K|. The gain makes it a torque in units of
        the command. An actuator's lag has no part in it: friction and load act on the mass, behind the actuator. (With
        it, what a lag leaves was read as several times the torque that it is, and a delay was told in its place.)

        Args:
            inertia: J [kg m^2], shape (machines,), as the other two.
            viscous: B [N m s/rad].
            gain: of the torque g [1].
            guide: its stiffness k [1/s^2] and damping d [1/s], with K = k + d s.
        """
        square = (2.0 * np.pi * self.frequency) ** 2
        # |s^2 + K|^2 and |s^2 + s B / J + K|^2 at s = j w, in real numbers, three times as fast as complex ones.
        apart, damping = (guide[0] - square) ** 2, guide[1]
        held, own = apart + square * damping**2, (damping + viscous / inertia)[:, None] ** 2
        return (gain * self.inertia / inertia)[:, None] * np.sqrt(held / (apart + square * own))

    def plain(self, coefficients: Values) -> Values:
        """c = U' r from rotated coefficients; both of shape (windows, modes)."""
        return coefficients @ self.turn.T

    def cost(self, level: Values, noise: Values, coefficients: Values, *, white: bool) -> Values:
        """Twice the negative log likelihood of each window, its bursts integrated out, shape (windows,).

        Args:
            level: q by octave [N m], shape (bands,).
            noise: s^2 of each window [1], shape (windows,).
            coefficients: rotated, shape (windows, modes).
            white: one burst for all tiles of a side of a window.
        """
        return np.sum(self._costs(level, noise, coefficients, white), axis=1)

    def cost_in(self, tiles: Values, level: Values, noise: Values, coefficients: Values) -> Values:
        """`cost` of some tiles alone, given as a mask of shape (tiles,); not white."""
        return np.sum(self._costs(level, noise, coefficients, False)[:, tiles], axis=1)

    def by_tile(self, some: Values) -> Values:
        """Mean of a number of each rotated coefficient, (modes,), in every tile, shape (tiles,)."""
        first = self._first_modes
        return np.add.reduceat(np.asarray(some, float), first) / np.diff(np.append(first, len(self.tile)))

    def _costs(self, level: Values, noise: Values, coefficients: Values, white: bool) -> Values:
        """`cost` by tile, or by side if white."""
        order = np.argsort(noise, kind="stable")
        by_burst = self._by_burst(level, noise[order], coefficients[order], white)
        mixed = mixed_likelihood(by_burst, bursts(self.tails)[1])
        found = np.empty_like(mixed)
        found[order] = mixed
        return found

    def precision(self, level: Values, noise: Values, coefficients: Values, *, white: bool) -> Values:
        """Posterior mean of 1 / (s^2 + q^2 lambda) over the bursts, shape (windows, modes).

        The weights of a least-squares step that lowers `cost`: the E step of expectation-maximisation. Arguments as of
        `cost`.
        """
        return self.cost_and_precision(level, noise, coefficients, white=white)[1]

    def cost_and_precision(
        self, level: Values, noise: Values, coefficients: Values, *, white: bool
    ) -> tuple[Values, Values]:
        """`cost` and `precision`, whose most work is the same."""
        order = np.argsort(noise, kind="stable")
        factors, law = bursts(self.tails)
        by_burst = self._by_burst(level, noise[order], coefficients[order], white)
        mixed = mixed_likelihood(by_burst, law)
        share = law[:, None, None] * np.exp(-0.5 * (by_burst - mixed))
        cost = np.empty(len(noise))
        cost[order] = np.sum(mixed, axis=1)
        atoms = self._atoms
        signal = (level[atoms.band] ** 2 * atoms.flat) * 4.0 ** factors[:, None]
        out = np.empty((len(noise), len(atoms.first)))
        for rows, kind in _kinds(noise[order]):
            sharper = 1.0 / (kind + atoms.excess + signal)
            if white:
                for side, own in enumerate(atoms.of_side):
                    out[order[rows], own] = share[:, rows, side].T @ sharper[:, own]
            else:
                out[order[rows]] = np.einsum("bwa,ba->wa", share[:, rows, atoms.tile], sharper)
        return cost, out[:, atoms.place]

    def best_level(self, noise: Values, coefficients: Values, *, white: bool) -> Values:
        """The most likely level of each octave, bursts integrated out, shape (bands,).

        First on a grid of factors of two, then in `PER_OCTAVE` steps around the best. Arguments as of `cost`; white:
        also one level for all octaves.
        """
        # A burst is a power of two, as a step of the grid is: the costs of all levels with all bursts are those of one
        # longer grid, of which `law_along` takes weighted sums. Shape (values, bands).
        coarse = np.concatenate([np.zeros((1 + BELOW, self.bands)), self.levels[1::PER_OCTAVE]])
        coarse = np.concatenate([coarse, coarse[-1] * 2.0 ** np.arange(1, BURSTS[-1] + 1)[:, None]])
        order = np.argsort(noise, kind="stable")
        noise, coefficients = noise[order], coefficients[order]
        costs = self._at(coarse, noise, coefficients, white)
        least = np.min(costs, axis=0)
        costs -= least
        costs *= -0.5
        likely = np.exp(costs, out=costs).reshape(len(coarse), -1)
        mixed = (law_along(len(coarse), self.tails) @ likely).reshape(-1, *least.shape)
        # The floor: a level under which one tile underflows costs 690 nats for that tile instead of infinity.
        best = self._best(-2.0 * np.log(np.maximum(mixed, 1e-300)) + least, white)
        middle = np.where(best > 0, (best - 1) * PER_OCTAVE + 1, 0)
        around = np.clip(middle[None] + np.arange(1 - PER_OCTAVE, PER_OCTAVE)[:, None], 0, len(self.levels) - 1)
        tries = self.levels[around, np.arange(self.bands)]
        factors, law = bursts(self.tails)
        every = (tries[:, None] * 2.0 ** factors[:, None]).reshape(-1, self.bands)
        costs = self._at(every, noise, coefficients, white)
        mixed = mixed_likelihood(costs.reshape(len(tries), len(factors), *costs.shape[1:]), law)
        best = self._best(mixed, white)
        return tries[best, np.arange(self.bands)]

    def _best(self, costs: Values, white: bool) -> Values:
        """Place of the best level of each octave, from costs of shape (levels, windows, tiles or sides)."""
        total = np.sum(costs, axis=1)
        if white:
            return np.argmin(total, axis=0)[self._side]
        return np.argmin(np.add.reduceat(total, self._first_tiles, axis=1), axis=0)

    def best_noise(self, noise: Values, coefficients: Values) -> float:
        """The factor on the sensors' standard deviation [1] that makes coefficients most likely beside a white torque.

        The noise has the same variance in all modes and a torque falls with lambda: they are distinguished by their
        spectra, however large the torque is. Bursts are left out: they could stand for the noise of a few windows.

        Args:
            noise: s^2 of each window [1], shape (windows,).
            coefficients: rotated, shape (windows, modes).
        """
        torque, squares = ~self.sensor, coefficients**2
        signal = self.levels[:, self.band[torque]] ** 2 * self.flat[torque]  # (levels, modes)
        costs = []
        for factor in NOISES:
            cost = np.zeros(len(signal))
            for kind in np.unique(noise):
                rows = noise == kind
                total = kind * factor**2 + signal
                cost += np.sum(np.sum(squares[np.ix_(rows, torque)], axis=0) / total, axis=1)
                cost += np.sum(rows) * np.sum(np.log(total), axis=1)
            costs.append(np.min(cost))
        return float(NOISES[int(np.argmin(costs))])

    def _by_burst(self, level: Values, noise: Values, coefficients: Values, white: bool) -> Values:
        """Twice the negative log likelihood for each burst, shape (bursts, windows, tiles); sides if white."""
        return self._at(level * 2.0 ** bursts(self.tails)[0][:, None], noise, coefficients, white)

    def _at(self, levels: Values, noise: Values, coefficients: Values, white: bool) -> Values:
        """Twice the negative log likelihood for each of the levels, shape (values, windows, tiles); sides if white.

        The values come first: sums and minima over them then run along the memory, several times as fast.

        Args:
            levels: q, shape (values, bands).
            noise: s^2 of each window [1], ascending, shape (windows,).
            coefficients: rotated, shape (windows, modes).
            white: sums over a side instead of a tile.
        """
        atoms = self._atoms
        squares = np.add.reduceat(coefficients**2, atoms.first, axis=1)
        signal = levels[:, atoms.band] ** 2 * atoms.flat
        sides = atoms.of_side
        found = np.empty((len(levels), len(noise), len(sides) if white else len(atoms.first_of_tile)))
        for rows, kind in _kinds(noise):
            total = kind + atoms.excess + signal
            logs, sharper = atoms.count * np.log(total), 1.0 / total
            if white:
                for side, own in enumerate(sides):
                    found[:, rows, side] = (
                        sharper[:, own] @ squares[rows, own].T + np.sum(logs[:, own], axis=1)[:, None]
                    )
                continue
            here, part = squares[rows], found[:, rows]
            (_, own), *more = atoms.by_order  # the first atom of every tile
            np.multiply(here[:, own], sharper[:, None, own], out=part)
            part += logs[:, None, own]
            for tiles, own in more:
                part[:, :, tiles] += here[:, own] * sharper[:, None, own] + logs[:, None, own]
        return found

    @functools.cached_property
    def _atoms(self) -> "_Atoms":
        """Runs of modes with one lambda, tile and octave: the likelihood depends on their sum of squares alone.

        Most tiles are one run, so that the likelihood costs a `TILE`-th of the modes.
        """
        same = (np.diff(self.tile) == 0) & (np.diff(self.band) == 0) & (np.diff(self.flat) == 0.0)
        first = np.flatnonzero(np.concatenate([[True], ~same]))
        count = np.diff(np.append(first, len(self.tile)))
        tile, ends = self.tile[first], np.append(self._first_modes_of_sides, len(self.tile))
        sides = [slice(*np.searchsorted(first, [a, b])) for a, b in itertools.pairwise(ends)]
        tile = np.cumsum(np.diff(tile, prepend=tile[0]) != 0)
        starts = np.flatnonzero(np.diff(tile, prepend=-1))
        order = np.arange(len(first)) - starts[tile]
        by_order = tuple(
            (tile[order == place], np.flatnonzero(order == place)) for place in range(int(np.max(order)) + 1)
        )
        excess = np.where(self.sensor, 0.0, self.unanswered[self.band] ** 2 * self.flat)[first]
        return _Atoms(
            first, count.astype(float), self.band[first], self.flat[first], excess, tile, starts, by_order,
            tuple(sides), np.repeat(np.arange(len(first)), count),
        )  # fmt: skip

    @functools.cached_property
    def _first_modes(self) -> Values:
        """First mode of each tile, shape (tiles,)."""
        return np.flatnonzero(np.diff(self.tile, prepend=-1))

    @functools.cached_property
    def _first_tiles(self) -> Values:
        """First tile of each octave, shape (bands,)."""
        return np.flatnonzero(np.diff(self.band[self._first_modes], prepend=-1))

    @functools.cached_property
    def _sides(self) -> Values:
        """Side of each mode: 0 where it holds torque, 1 where it holds none, shape (modes,)."""
        return np.cumsum(np.diff(self.sensor.astype(int), prepend=int(self.sensor[0])))

    @functools.cached_property
    def _side(self) -> Values:
        """Side of each octave, shape (bands,)."""
        return self._sides[self._first_modes[self._first_tiles]]

    @functools.cached_property
    def _first_modes_of_sides(self) -> Values:
        return np.flatnonzero(np.diff(self._sides, prepend=-1))

    def mean_level(self, level: Values, weight: Values) -> float:
        """q of all octaves together [N m], rms over the modes by a weight of shape (modes,)."""
        weight = np.where(self.sensor, 0.0, weight)
        whole = np.sum(weight)
        return float(np.sqrt(np.sum(weight * level[self.band] ** 2) / whole)) if whole > 0.0 else 0.0


def _kinds(noise: Values) -> list[tuple[slice, float]]:
    """(windows, noise s^2) of each value of an ascending noise of shape (windows,).

    Noises are powers of two (`fpjax.gap.fit.least_squares.Fitter.noise`), so that there are few.
    """
    ends = [0, *(np.flatnonzero(np.diff(noise)) + 1), len(noise)]
    return [(slice(a, b), float(noise[a])) for a, b in itertools.pairwise(ends) if b > a]
