"""A lead controller, and its design from a crossover frequency and the phase lead there."""

import math
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...errors import InputError
from ..block import as_parameter, require_positive
from ..signals import Measurement
from .base import AbstractController


class Lead(AbstractController):
    """G_c(s) = gain (s + zero) / (s + pole) on the velocity error (3.16).

    Attributes:
        gain: K_c [N m s/rad].
        zero: z [rad/s].
        pole: p [rad/s].
    """

    gain: Array = eqx.field(converter=as_parameter)
    zero: Array = eqx.field(converter=as_parameter)
    pole: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_positive(self, "pole", "rad/s")

    def init(self) -> Array:
        """The one state of the lead."""
        return jnp.zeros_like(self.gain)

    def derivative(self, state: Array, reference: Array, measurement: Measurement) -> Array:
        """x' = e - p x."""
        return reference - measurement.velocity - self.pole * state

    def readout(self, state: Array, reference: Array, measurement: Measurement) -> Array:
        """gain (e + (z - p) x) [N m]."""
        return self.gain * (reference - measurement.velocity + (self.zero - self.pole) * state)

    def step(self, state: Array, reference: Array, measurement: Measurement, dt: Array) -> Array:
        """Exact for an error held over dt [s] (zero-order hold)."""
        kept = jnp.exp(-self.pole * dt)
        return kept * state + (1.0 - kept) / self.pole * (reference - measurement.velocity)


def design_lead(plant: Callable[[complex], complex], crossover: float, phase_lead: float) -> Lead:
    """A lead controller from its crossover and the phase it is to add (3.20)-(3.26).

    Args:
        plant: transfer function G(s) from control to measured velocity.
        crossover: gain crossover frequency [Hz].
        phase_lead: phase added at the crossover [rad], between 0 and pi/2.

    Raises:
        InputError: where no lead can add that phase.
    """
    if not 0.0 < phase_lead < math.pi / 2.0:
        raise InputError(
            f"phase_lead must lie between 0 and pi/2 rad, which is what one lead adds, got {phase_lead:g} rad: "
            f"ask for less, or put two leads in series."
        )
    if not crossover > 0.0:
        raise InputError(f"crossover must be positive, got {crossover:g} Hz.")
    # (3.20)-(3.26) put the largest phase lead, at sqrt(zero * pole), onto the crossover.
    ratio = (1.0 + math.sin(phase_lead)) / (1.0 - math.sin(phase_lead))  # (3.20)
    omega = 2.0 * math.pi * crossover
    zero = omega / math.sqrt(ratio)  # (3.22), (3.24)
    pole = ratio * zero
    s = 1j * omega
    gain = 1.0 / abs((s + zero) / (s + pole) * plant(s))  # (3.26)
    return Lead(gain, zero, pole)


def phase_lead_for_margin(plant: Callable[[complex], complex], crossover: float, margin: float) -> float:
    """Phase [rad] that a lead must add (3.17)-(3.19).

    Args:
        plant: transfer function G(s) from control to measured velocity.
        crossover: gain crossover frequency [Hz].
        margin: wanted phase margin [rad].
    """
    phase = float(np.angle(plant(2j * math.pi * crossover)))
    if phase > 0.0:  # a plant lags: an angle above zero is one beyond -180 degrees, wrapped
        phase -= 2.0 * math.pi
    return margin - (math.pi + phase)
