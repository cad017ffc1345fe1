"""Parameters, their bounds and the space without bounds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tuning_loops import GAINS, efp

from fpjax import InputError
from tuning import Parameter, population
from tuning.parameters import make_space


def space_of(*parameters):
    return make_space(efp(), parameters, jnp.float64)


def test_values_and_coordinates_are_inverse():
    _, start, space = space_of(
        Parameter("observer.gain_2", 10.0, 1.0, 1e3), Parameter("controller.kp", 150.0, 0.0, 400.0, "linear")
    )
    np.testing.assert_allclose(start, [10.0, 150.0])
    for values in ([10.0, 150.0], [1.5, 395.0], [990.0, 1.0]):
        np.testing.assert_allclose(space.values(jnp.asarray(space.coordinates(values))), values, rtol=1e-9)


def test_coordinates_linear_below_the_start_are_the_inverse_too_and_halve_with_it():
    _, start, space = space_of(Parameter("observer.gain_2", 10.0, 1e-3, 1e5))
    linear = space.linear_below(np.asarray(start))
    for value in (1e-2, 0.0999, 0.3, 10.0, 500.0):
        np.testing.assert_allclose(linear.values(jnp.asarray(linear.coordinates([value]))), [value], rtol=1e-9)
    # 1e-3: the bend towards the bounds, four decades away.
    np.testing.assert_allclose(linear.values(jnp.array([-0.5])), [5.0], rtol=1e-3)
    np.testing.assert_allclose(linear.values(jnp.array([1.0])), [10.0 * np.e], rtol=1e-3)
    # The joints of the map: the knee, and TAIL - 1 = -0.7.
    for turn in (0.0, -0.7):
        left, right = (jax.jvp(linear.values, (jnp.array([turn + side]),), (jnp.ones(1),))[1] for side in (-1e-9, 1e-9))
        np.testing.assert_allclose(left, right, rtol=1e-5)


@pytest.mark.parametrize("far", [-1e6, -50.0, 50.0, 1e6])
@pytest.mark.parametrize("linear", [False, True])
def test_no_coordinate_leaves_the_bounds_or_has_a_slope_that_is_not_finite(far, linear):
    _, start, space = space_of(Parameter("observer.gain_2", 10.0, 1.0, 1e3))
    space = space.linear_below(np.asarray(start)) if linear else space
    value, slope = jax.jvp(space.values, (jnp.array([far]),), (jnp.ones(1),))
    assert 1.0 - 1e-9 <= float(value[0]) <= 1e3 * (1.0 + 1e-9)
    assert np.isfinite(float(slope[0]))


def test_inside_the_bounds_a_unit_is_an_e_fold():
    _, _, space = space_of(Parameter("observer.gain_2", 10.0, 1e-3, 1e5))
    at = space.coordinates([10.0])
    np.testing.assert_allclose(space.values(jnp.asarray(at + 1.0)), [10.0 * np.e], rtol=1e-3)


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        (Parameter("observer.gain_3"), "observer.gain"),
        (Parameter("observer.gain_1", start=-1.0), "above zero"),
        (Parameter("observer.gain_1", start=1.0, low=2.0, high=3.0), "outside"),
        (Parameter("observer.gain_1", start=1.0, low=3.0, high=2.0), "empty"),
        (Parameter("observer.gain_1", start=1.0, low=0.0), "above zero"),
        (Parameter("observer.gain_1", scale="linear"), "both low and high"),
        (Parameter("observer.gain_1", scale="decibel"), "not known"),
    ],
)
def test_what_cannot_be_is_said_in_one_sentence(parameter, words):
    with pytest.raises(InputError, match=words):
        space_of(parameter)


def test_nothing_or_the_same_twice_cannot_be_tuned():
    with pytest.raises(InputError, match="nothing to tune"):
        space_of()
    with pytest.raises(InputError, match="twice"):
        space_of(*GAINS, "observer.gain_1")


def test_population_holds_the_nominal_plant_and_the_corners():
    loop = efp()
    plants = population(loop, {"plant.inertia": 0.2, "plant.friction.coulomb": 0.1})
    assert plants["plant.inertia"].shape == (5,)
    np.testing.assert_allclose(plants["plant.inertia"][0], loop.plant.inertia)
    corners = {
        (round(a / 20.0, 6), bool(b > loop.plant.inertia)) for a, b in zip(*reversed(plants.values()), strict=True)
    }
    assert {(0.9, False), (0.9, True), (1.1, False), (1.1, True)} <= corners
    drawn = population(loop, {"plant.inertia": 0.2}, count=20)
    ratio = drawn["plant.inertia"] / float(loop.plant.inertia)
    assert np.all((ratio >= 0.8) & (ratio <= 1.2))
    with pytest.raises(InputError, match="between 0 and 1"):
        population(loop, {"plant.inertia": 20.0})
