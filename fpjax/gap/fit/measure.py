"""Measure: how the missing torque of every model is weighed, by frequency and window, so that all are measured alike.

The missing torque is told at the command, rms, with the share of noise taken out. Two weights, both of the nominal
model, so that no candidate changes what it is measured by:

* Wiener's filter: what a window's sensors tell from noise, and hardly anything where they hold more noise than torque.
  A window of equal readings tells next to nothing, and counts so.
* A model that answers less to a torque lacks more of it, as far as the motion is imposed by a loop that answers with
  the command. Where the torque makes the motion, what is missing is missing at the mass.
"""

import functools
from dataclasses import dataclass

import numpy as np

from ...logs.arrays import Values
from ..thresholds import THRESHOLDS
from .modes import Modes
from .response import Response


@dataclass(frozen=True)
class Measure:
    """The filter of the missing torque.

    Attributes:
        modes: of a window.
        samples: of a window.
        level: of the nominal model's missing torque by octave, its bursts included [N m], shape (bands,).
        imposed: share of the motion that is imposed [1], shape (modes,).
    """

    modes: Modes
    samples: int
    level: Values
    imposed: Values

    @staticmethod
    def of(response: Response, level: Values) -> "Measure":
        """The measure from the nominal model's level (bands,) [N m] and the torques of the logs."""
        modes = response.modes
        return Measure(modes, response.records[0].samples, level, response.imposed(level))

    def filter(self, noise: Values) -> Values:
        """Share of a coefficient that is told as missing torque [1], shape (windows, modes).

        Wiener's share, and hardly any of it where the readings hold more noise than torque: noise is never known to a
        few per cent in every octave (an encoder's steps and its errors within a line are no white noise), and what it
        has above its assumed variance would be a torque there, of the first model that follows it. Such modes keep
        a share of it (`Thresholds.faint`), for a log that has no others.

        Args:
            noise: s^2 of each window [1], shape (windows,).
        """
        share = self.modes.wiener(self.level, noise)
        # From twice as much noise as torque (a share of 1 / 3) to half as much (2 / 3).
        return share * (THRESHOLDS.faint + (1.0 - THRESHOLDS.faint) * np.clip(3.0 * share - 1.0, 0.0, 1.0))

    @property
    def trusted(self) -> Values:
        """`filter` over Wiener's share in a window of usual noise [1], shape (modes,)."""
        share = self.modes.wiener(self.level, np.ones(1))[0]
        return self.filter(np.ones(1))[0] / np.where(share > 0.0, share, 1.0)

    @functools.cached_property
    def drowned(self) -> Values:
        """Whether the readings hold more noise than torque in a tile, shape (tiles,); in all of them means in none.

        A tile is a stretch of time within half an octave, and all of that half octave count alike.
        """
        modes = self.modes
        signal = self.level[modes.band] ** 2 * modes.flat
        torque = modes.by_tile(~modes.sensor) > 0.5
        drowned = torque & (modes.by_tile(signal < 1.0 + modes.unanswered[modes.band] ** 2 * modes.flat) > 0.5)
        return drowned & ~np.all(drowned[torque])

    def root(self, noise: Values, scale: Values) -> Values:
        """Missing torque at the command of a coefficient [N m], shape (windows, modes).

        Args:
            noise: s^2 of each window [1], shape (windows,).
            scale: `Response.torque_scale` of the model [1], shape (modes,).
        """
        gain = np.where(self.modes.sensor | (self.modes.gain <= 0.0), np.inf, self.modes.gain)
        return self.filter(noise) / np.sqrt(gain) * scale**self.imposed

    def weight(self, noise: Values, scale: Values) -> Values:
        """Weight of a squared coefficient in the mean square of the missing torque [N^2 m^2], (windows, modes)."""
        return self.root(noise, scale) ** 2 / self.samples
