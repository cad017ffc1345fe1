"""An effect of the user's own, in about twenty lines, goes through the same fit."""

import jax.numpy as jnp
import numpy as np

from fpjax import CoulombViscous, OneMass
from fpjax.gap import Effect, EffectParameter, Setting, place
from fpjax.gap.simulate.family import Nominal, make_family
from fpjax.gap.simulate.replay import assembled


def spring() -> Effect:
    """A torque that grows with the first harmonic of half a turn, as a weak return spring would."""
    size = EffectParameter(
        name="spring_torque",
        unit="N m",
        neutral=lambda s: 0.0,
        low=lambda s: -s.friction,
        high=lambda s: s.friction,
        scale=lambda s: 0.1 * s.friction,
    )

    def apply(machine, values):
        return place(machine, {"plant.load.parts.1.sine.0": values["spring_torque"]})

    return Effect("return_spring", (size,), apply=apply, features=("torque",))


def test_a_users_effect_changes_the_machine_and_is_neutral_at_zero():
    setting = Setting(0.5, 2.0, 0.3, 2.0, 3.0, 9.0, 4.0, 10.0, 1e-3)
    effect = spring()
    family = make_family(("rigid", ("torque",)), Nominal(OneMass(0.5, CoulombViscous(2.0, 0.3))), (effect,), setting)
    vector = family.neutral(setting)
    neutral = assembled(family.machine, family.effects, family.parameters, jnp.asarray(vector)[:, None])
    assert float(neutral.plant.load.parts[1].sine[0][0]) == 0.0
    vector[family.index("spring_torque")] = 0.7
    changed = assembled(family.machine, family.effects, family.parameters, jnp.asarray(vector)[:, None])
    assert float(changed.plant.load.parts[1].sine[0][0]) == 0.7
    assert np.isclose(float(changed.plant.inertia[0]), 0.5)
