"""A known load that turns with the position may be wrong a little, in a plan as in the diagnosis that follows it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from plan_case import LIMITS, servo_text

from fpjax import load_model
from fpjax.gap.effects.vocabulary import EFFECTS
from fpjax.planning.machines import Variant, make_shop
from fpjax.planning.measurement_model import make_measurement_model
from fpjax.planning.trajectory import make_course
from fpjax.planning.trial import effects_trial
from fpjax.simulation.precision import double_precision
from fpjax.simulation.scan import astype

NOISE = {"velocity": 1e-3, "position": 1e-5}
LOAD = "[load]\namplitude = 1.0\n"  # N m
COGGING = next(effect for effect in EFFECTS if effect.name == "cogging")
UNBALANCED = next(effect for effect in EFFECTS if effect.name == "unbalance")


def shop_of(sensors, load):
    model = load_model(servo_text(sensors).replace("[controller]", f"{load}[controller]"))
    with double_precision():
        return make_shop(dataclasses.replace(model, loop=astype(model.loop, jnp.float64)), LIMITS, 3.0, 0.25)


def evidence(sensors, load, amplitudes):
    """The evidence [nats] of torques amplitude cos(position) [N m], within the limits of `plan_case`."""
    shop = shop_of(sensors, load)
    once = [Variant("cogging", COGGING, "rigid", {"cogging_periods": 1.0, "cogging_cosine_1": a}) for a in amplitudes]
    with double_precision():
        measurement = make_measurement_model(shop.model, LIMITS, None, 0.01, NOISE, [])
        course = make_course(LIMITS, shop.model.dt, 0.02)
        trial = effects_trial(shop, measurement, course, once)
        return np.asarray(jax.jit(trial.seen)(trial.reference(course.starts(0, 1)[0])).nats)


def test_a_small_error_of_a_known_load_is_weak_evidence_for_a_torque_that_repeats():
    small, large = evidence("both", LOAD, (0.02, 0.1))  # one and five prior deviations of the load's error
    alone = evidence("both", "", (0.02, 0.1))
    assert alone[0] > 100.0
    assert small < 0.6 * alone[0]
    assert large > 0.8 * alone[1]


def test_a_known_load_whose_zero_no_sensor_measures_hides_a_shift_of_its_angle():
    # sin(position + e) = sin(position) + e cos(position): the torque is a shift of the load's angle.
    nothing, small = evidence("velocity", LOAD, (0.0, 0.002))
    assert small < 0.01 * evidence("velocity", "", (0.002,))[0]
    # The angle that the speed integrates to is that of the load: the machine explains its own log.
    assert nothing < 1e-6


@pytest.mark.parametrize(
    ("sensors", "free"), [("both", ("unbalance_cosine", "unbalance_sine")), ("velocity", ("origin",))]
)
def test_the_error_of_a_known_load_is_free_beside_every_effect_but_its_own(sensors, free):
    shop, plain = shop_of(sensors, LOAD), shop_of(sensors, "")
    assert set(shop.nuisances(COGGING)) - set(plain.nuisances(COGGING)) == set(free)
    assert not {"unbalance_cosine", "unbalance_sine"} & set(shop.nuisances(UNBALANCED))


def test_an_unbalance_of_its_own_is_as_free_as_any_effect():
    shop = shop_of("both", LOAD)
    names = ("unbalance_cosine", "unbalance_sine")
    beside = shop.spreads(Variant("cogging", COGGING, "rigid", {}), names)
    own = shop.spreads(Variant("unbalance", UNBALANCED, "rigid", {}), names)
    np.testing.assert_allclose(beside, 0.02)  # N m: 2 % of the known load's amplitude
    assert np.all(own > 10.0 * beside)
