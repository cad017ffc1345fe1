"""Measure: how the missing torque of every model is weighed, by frequency and window, so that all are measured alike.

The missing torque is told at the command, rms, with the share of noise taken out. Two weights, both of the nominal
model, so that no candidate changes what it is measured by:

* Wiener's filter: what a window's sensors tell from noise, and nothing where they hold more noise than torque. A window
  of equal readings tells next to nothing, and counts so.
* A model that answers less to a torque lacks more of it, as far as the motion is imposed by a loop that answers with
  the command. Where the torque makes the motion, what is missing is missing at the mass.
"""

import functools
from dataclasses import dataclass

import numpy as np

from ...logs.arrays import Values
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

    @functools.cached_property
    def told(self) -> Values:
        """Whether a mode tells a torque, shape (modes,).

        One in which the readings hold more noise than torque tells none: noise is never known to a few per cent in
        every octave (an encoder's steps and its errors within a line are no white noise), and what it has above its
        assumed variance would be a torque there, of the first model that follows it. Where that is every mode, all do.
        """
        told = self.modes.wiener(self.level, np.ones(1))[0] >= 0.5
        return told if np.any(told) else np.ones_like(told)

    def filter(self, noise: Values) -> Values:
        """Share of a coefficient that is told as missing torque [1], shape (windows, modes).

        Args:
            noise: s^2 of each window [1], shape (windows,).
        """
        return np.where(self.told, self.modes.wiener(self.level, noise), 0.0)

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
