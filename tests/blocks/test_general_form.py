"""A law's general form is the law: the same torque, term by term, and for bristles the same steady torque."""

import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp
from fpjax.blocks.friction.bristles import Bristles
from fpjax.blocks.friction.general import GeneralFriction

STATIC = [
    fp.NoFriction(),
    fp.Coulomb(20.0),
    fp.SmoothCoulomb(20.0, 40.0),
    fp.Viscous(2.0),
    fp.CoulombViscous(20.0, 2.0),
    fp.CoulombViscous(20.0, 2.0, 40.0),
    fp.Stribeck(20.0, 25.0, 0.05, 2.0, 1.0),
    fp.Stribeck(20.0, 25.0, 0.05, 2.0, 2.0, 40.0),
    fp.AsymmetricCoulombViscous(20.0, 15.0, 2.0, 3.0),
]
ZERO = jnp.asarray(0.0)


@pytest.mark.parametrize("law", STATIC, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("velocity", [-1.0, -0.03, 0.0, 0.02, 0.5])
def test_a_static_law_and_its_general_form_give_one_torque(law, velocity):
    motion = fp.Motion(jnp.asarray(velocity), jnp.asarray(0.7), jnp.asarray(0.2), ZERO)
    general = law.general()
    assert isinstance(general, GeneralFriction)
    expected = law.readout(law.init(), motion, ZERO)
    np.testing.assert_allclose(general.readout((), motion, ZERO), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "law", [fp.Dahl(20.0, 2000.0, 1.0, 2.0), fp.LuGre(20.0, 25.0, 0.05, 20000.0, 100.0, 2.0)], ids=["dahl", "lugre"]
)
@pytest.mark.parametrize("velocity", [-0.4, 0.03])
def test_bristles_slide_with_the_same_torque_and_start_with_the_same_stiffness(law, velocity):
    """Dahl, "A solid friction model", 1968; LuGre (1.7)-(1.8): F = F_c or g(w) in steady sliding, sigma x near rest."""
    motion = fp.Motion(jnp.asarray(velocity), ZERO, ZERO, ZERO)
    general = law.general()
    assert isinstance(general, Bristles)
    side = jnp.sign(motion.velocity)
    if isinstance(law, fp.Dahl):
        sliding, stiffness = law.coulomb * side, law.stiffness
    else:
        curve = 20.0 + 5.0 * jnp.exp(-((motion.velocity / 0.05) ** 2))
        sliding, stiffness = curve / law.bristle_stiffness * side, law.bristle_stiffness
    expected = law.readout(sliding, motion, ZERO)
    np.testing.assert_allclose(general.readout(side, motion, ZERO), expected, rtol=1e-9)
    np.testing.assert_allclose(law.coulomb / general.deflection, stiffness, rtol=1e-12)


def test_bristles_over_a_law_take_its_general_form():
    general = Bristles(fp.CoulombViscous(20.0, 2.0), 1e-3, 50.0, 1.5).general()
    assert isinstance(general.law, GeneralFriction)
    assert (float(general.deflection), float(general.damping), float(general.exponent)) == (1e-3, 50.0, 1.5)


def test_a_law_without_a_general_form_says_what_to_do():
    with pytest.raises(fp.InputError, match="CoulombViscousStiction has no general form: use coulomb_viscous"):
        fp.CoulombViscousStiction(20.0, 25.0).general()
