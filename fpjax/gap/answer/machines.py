"""Machines: a fit as blocks of the simulator, every leaf a number."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..fit.candidate import Candidate
from ..machine import Machine
from ..precision import double_precision
from ..simulate.family import Family
from ..simulate.replay import assembled


def machine_of(candidate: Candidate) -> Machine:
    """The fitted machine."""
    return machine_at(candidate.family, candidate.vector)


def machine_at(family: Family, vector: np.ndarray) -> Machine:
    """The machine of a family at a vector of shape (parameters,)."""
    with double_precision():
        machine = assembled(family.machine, family.effects, family.parameters, jnp.asarray(vector[:, None]))
        return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[0]) if eqx.is_array(leaf) else leaf, machine)


def with_reading(machine: Machine, values: Mapping[str, tuple[float, float, str]]) -> Machine:
    """The machine with what the encoder tells of the rate sensor (`time_constant`, `delay`, `scale`, `bias`)."""
    names = {"time_constant": "lag", "delay": "delay", "scale": "scale", "bias": "bias"}
    sensor = machine.sensor
    for name, (value, _, _) in values.items():
        sensor = eqx.tree_at(lambda at, name=name: getattr(at, names[name]), sensor, jnp.asarray(value, float))
    return eqx.tree_at(lambda at: at.sensor, machine, sensor)
