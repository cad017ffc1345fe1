"""Blocks print their numbers, whatever stands in for them."""

import jax
import numpy as np

import fpjax as fp

LAW = fp.Stribeck(20.0, 25.0, 0.1, 2.0)


def test_a_block_prints_its_numbers():
    assert repr(LAW) == str(LAW)
    assert str(LAW) == "Stribeck(coulomb=20, static=25, stribeck_velocity=0.1, viscous=2, exponent=2, steepness=None)"
    assert str(fp.Multisine([1.0, 0.5], [0.5, 1.3], [0.0, 1.0])).startswith("Multisine(amplitudes=[1. , 0.5], ")
    recorded = str(fp.Recorded(np.arange(1000.0), 1e-3))
    assert recorded.startswith("Recorded(values=<1000 numbers from 0 to 999>, interval=0.001")


def test_a_loop_prints_those_of_its_blocks():
    loop = fp.ClosedLoop(fp.OneMass(10.0, LAW), fp.ProportionalIntegral(800.0, 8000.0))
    text = str(loop)
    assert "inertia=10," in text
    assert "friction=Stribeck(coulomb=20" in text
    assert "kp=800, ki=8000" in text
    assert "[]" not in text
    assert max(map(len, text.splitlines())) <= 120


def test_what_stands_in_for_a_number_is_printed_too():
    printed = []
    jax.jit(lambda law: printed.append(str(law)) or law.coulomb)(LAW)
    printed.append(str(jax.eval_shape(lambda: LAW)))
    printed.append(str(jax.tree.map(lambda leaf: None, LAW)))
    printed.append(str(jax.tree.map(lambda leaf: np.zeros(0), LAW)))
    printed.append(str(jax.tree.map(lambda leaf: leaf > 0, LAW)))
    printed.append(str(jax.tree.map(lambda leaf: jax.random.key(0), LAW)))
    assert all(text.startswith("Stribeck(") and "coulomb=" in text for text in printed)
    assert "coulomb=<0 numbers>" in printed[3]
