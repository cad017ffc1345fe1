"""Parameters by dotted name."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from catalogue import CASES

import fpjax as fp


@pytest.fixture
def loop():
    return fp.ClosedLoop(
        fp.OneMass(10.0, fp.CoulombViscous(20.0, 2.0, 100.0)),
        fp.ProportionalIntegral(150.0, 200.0),
        fp.ExtendedFriedlandPark(10.0, 298.0, 72.6),
    )


def test_names_are_the_paths_of_the_leaves(loop):
    names = fp.parameter_names(loop)
    assert "plant.friction.coulomb" in names
    assert "observer.gain_1" in names
    assert "observer.steepness" not in names  # None: not there
    assert len(names) == len(jax.tree.leaves(eqx.filter(loop, eqx.is_inexact_array)))


def test_get_and_set_round_trip_and_keep_the_structure(loop):
    changed = fp.set_parameters(loop, {"observer.gain_1": 5.0, "plant.friction.viscous": jnp.asarray(3.0)})
    assert float(fp.get_parameter(changed, "observer.gain_1")) == 5.0
    assert fp.get_parameters(changed, ["plant.friction.viscous"])["plant.friction.viscous"] == 3.0
    assert float(fp.get_parameter(loop, "observer.gain_1")) == 298.0
    assert jax.tree.structure(changed) == jax.tree.structure(loop)
    assert fp.set_parameters(loop, {}) is loop


def test_dtype_is_the_leafs_own(loop):
    single = fp.astype(loop, jnp.float32)
    changed = fp.set_parameters(single, {"observer.gain_1": jnp.asarray(5.0, jnp.float64)})
    assert fp.get_parameter(changed, "observer.gain_1").dtype == jnp.float32


def test_under_jit_vmap_and_grad(loop):
    def gain(value):
        return fp.get_parameter(fp.set_parameters(loop, {"observer.gain_1": value}), "observer.gain_1") ** 2

    assert jnp.allclose(jax.jit(jax.vmap(gain))(jnp.arange(3.0)), jnp.arange(3.0) ** 2)
    assert float(jax.grad(gain)(3.0)) == 6.0


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("observer.gain1", "observer.gain_1"),
        ("gain_2", "observer.gain_2"),
        ("friction.coulomb", "did you mean 'plant.friction.coulomb'"),
        ("feedforward.coulomb", "is not known: Known: "),
        ("observer.steepness", "absent"),
        ("plant", "whole block"),
        ("nonsense", "is not known: .*Known: "),
    ],
)
def test_unknown_names_are_told_the_nearest(loop, name, said):
    with pytest.raises(fp.InputError, match=said):
        fp.get_parameter(loop, name)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"plant.inertia": -1.0}, "above zero"),
        ({"plant.inertia": "ten"}, "not a number"),
        ({"plant.inertia": True}, "not a number"),
        ({"plant.inertias": 1.0}, "plant.inertia"),
    ],
)
def test_values_that_cannot_be(loop, values, said):
    with pytest.raises(fp.InputError, match=said):
        fp.set_parameters(loop, values)


def test_wrong_shape_is_refused_and_batch_axes_are_not():
    reference = fp.Multisine([1.0, 2.0], [1.0, 2.0], [0.0, 0.0])
    with pytest.raises(fp.InputError, match="shape"):
        fp.set_parameters(reference, {"amplitudes": [1.0, 2.0, 3.0]})
    loop = fp.OneMass(10.0, fp.NoFriction())
    assert fp.set_parameters(loop, {"inertia": jnp.ones(7)}).inertia.shape == (7,)


def test_entries_of_tuples_and_dictionaries_have_names(loop):
    tree = (loop.plant, {"sine": fp.Sine(1.0, 2.0)})
    assert "1.sine.frequency" in fp.parameter_names(tree)
    assert float(fp.get_parameter(fp.set_parameters(tree, {"1.sine.frequency": 4.0}), "1.sine.frequency")) == 4.0


@pytest.mark.parametrize(
    "make", [fp.IdealSensor, lambda side: fp.Gyro(0.0, side=side), lambda side: fp.Encoder(1e-3, side=side)]
)
def test_a_side_of_the_transmission_that_there_is_not_is_refused(make):
    assert make("motor").side == "motor"
    with pytest.raises(fp.InputError, match="must be 'load' or 'motor', got 'Motor'"):
        make("Motor")


@pytest.mark.parametrize("case", CASES, ids=str)
@pytest.mark.parametrize("value", [jnp.nan, jnp.inf])
def test_no_parameter_of_a_block_may_be_other_than_finite(case, value):
    block = case.build()
    names = [name for name in fp.parameter_names(block) if fp.get_parameter(block, name).size]
    for name in names:
        with pytest.raises(fp.InputError):
            fp.set_parameters(block, {name: jnp.full_like(fp.get_parameter(block, name), value)})


def test_a_block_is_checked_where_it_is_made():
    with pytest.raises(fp.InputError, match="Actuator: offset must be finite, got nan"):
        fp.Actuator(offset=float("nan"))
    with pytest.raises(fp.InputError, match="TransferFunction: output must be finite, 1 of 1 numbers"):
        fp.TransferFunction([float("nan")], [1.0, 2.0])
    assert jax.vmap(lambda offset: fp.Actuator(offset=offset).offset)(jnp.array([jnp.nan])).shape == (1,)  # traced
