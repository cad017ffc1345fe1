"""A fit as blocks of the simulator: every leaf a number."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...simulation.precision import double_precision
from ..fit.candidate import Candidate
from ..machine import Machine
from ..simulate.family import Family
from ..simulate.replay import assembled


def machine_of(candidate: Candidate) -> Machine:
    """The machine of a candidate, at its fitted parameters."""
    return machine_at(candidate.family, candidate.vector)


def machine_at(family: Family, vector: np.ndarray) -> Machine:
    """The machine of a family at parameters of shape (parameters,), in SI units."""
    with double_precision():
        # Assembled for one lane, as in the fits; the axis of lanes is then dropped from every leaf.
        machine = assembled(family.machine, family.effects, family.parameters, jnp.asarray(vector[:, None]))
        return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[0]) if eqx.is_array(leaf) else leaf, machine)


def with_reading(machine: Machine, values: Mapping[str, tuple[float, float, str]]) -> Machine:
    """The machine with the errors of its rate sensor that the encoder shows: time_constant, delay, scale, bias.

    Args:
        machine: as fitted.
        values: (value, standard deviation, unit) by those names.
    """
    names = {"time_constant": "lag", "delay": "delay", "scale": "scale", "bias": "bias"}
    sensor = machine.sensor
    for name, (value, _, _) in values.items():
        sensor = eqx.tree_at(lambda at, name=name: getattr(at, names[name]), sensor, jnp.asarray(value, float))
    return eqx.tree_at(lambda at: at.sensor, machine, sensor)
