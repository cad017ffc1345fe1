"""Shaft: stiffness, resonance and hardening of a transmission, from the parameters that are fitted.

Named values may be numbers, numpy or jax arrays; so are the results.
"""

from math import pi
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...blocks.plants.transmission import Transmission
from ..machine import Machine
from .effect import Values
from .parameters import DAMPING_RATIO, FREQUENCY, HARDENING, LOAD_SIDE, SHAFT_INERTIA


def mean_slope(hardening: float, torque: np.ndarray) -> float:
    """Slope of the least-squares line through a hardening shaft's torque over that of small twists [1]."""
    # The real root of x + h x^3 = torque for x = stiffness x twist (Cardano).
    root = (3.0 * hardening) ** 0.5
    twist = 2.0 / root * np.sinh(np.arcsinh(1.5 * root * torque) / 3.0)
    return float(np.sum(torque * twist) / np.sum(twist**2)) if np.any(twist) else 1.0


def stiffness_of(values: Values) -> Any:
    """Stiffness of the transmission [N m/rad], from its free-free resonance, thesis (3.15), and the two inertias.

    omega^2 = k (1/J_motor + 1/J_load), so that k = J s (1 - s) omega^2 with the load's share s of the total inertia J.
    """
    return reduced_inertia(values) * (2.0 * pi * values["frequency"]) ** 2


def resonance_of(values: Values) -> Any:
    """Free-free resonance of the transmission [Hz] beside the inertia that a model has."""
    return values["frequency"] * (_shaft_inertia(values) / values["inertia"]) ** 0.5


def reduced_inertia(values: Values) -> Any:
    """That of the relative motion of the two masses, J s (1 - s) [kg m^2]."""
    share = values["load_share"]
    return _shaft_inertia(values) * share * (1.0 - share)


def _shaft_inertia(values: Values) -> Any:
    """Inertia [kg m^2] with which resonance and damping ratio are meant."""
    known = values.get(SHAFT_INERTIA.name, 0.0)
    where = jnp.where if isinstance(known, Array) else np.where
    return where(known > 0.0, known, values["inertia"])


def hardening_of(values: Values) -> Any:
    """Hardening of the transmission [N m/rad^3]; a product, which Python and jax round alike, as they do no power."""
    stiffness = stiffness_of(values)
    return values[HARDENING.name] * (stiffness * stiffness * stiffness)


def shaft_values(machine: Machine) -> dict[str, float]:
    """What no leaf of a transmission holds, or no effect frees, by parameter name."""
    plant = machine.plant
    assert isinstance(plant, Transmission)
    reduced = float(plant.motor_inertia * plant.load_inertia / plant.inertia)
    ratio = float(plant.damping) / (2.0 * (float(plant.stiffness) * reduced) ** 0.5)
    return {
        FREQUENCY.name: float(plant.resonance()),
        DAMPING_RATIO.name: ratio,
        LOAD_SIDE.name: float(machine.sensor.load_side),
        SHAFT_INERTIA.name: float(plant.inertia),
        HARDENING.name: float(plant.hardening) / float(plant.stiffness) ** 3,
    }
