"""The one-kernel form: equal to the scan within float32 rounding, and it lowers for CUDA without a GPU here."""

import contextlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp
from fpjax.lanes import Problem, roll_lanes, roll_many


def _problem(dtype, samples=60):
    friction = fp.CoulombViscous(20.0, 2.0, steepness=100.0)
    loop = fp.ClosedLoop(
        fp.OneMass(10.0, friction),
        fp.ProportionalIntegral(150.0, 200.0),
        fp.ExtendedFriedlandPark(10.0, 50.0, 50.0, steepness=100.0),
    )
    measures = {"mae": fp.MeanAbsolute(), "square": fp.MeanSquare(), "error": fp.EstimateError("coulomb", 20.0)}
    loop, measures = fp.astype(loop, dtype), fp.astype(measures, dtype)
    stepper = fp.make_stepper(dt=1e-3, samples=samples, solver="rk4")
    inputs = fp.make_inputs(loop, fp.astype(fp.Sine(1.0, 5.0), dtype), stepper)
    return Problem(loop, inputs, fp.astype(stepper, dtype), measures)


def _values(count, dtype):
    first, second = np.geomspace(10.0, 500.0, count), np.geomspace(20.0, 300.0, count)
    return {"observer.gain_1": first.astype(dtype), "observer.gain_2": second.astype(dtype)}


@pytest.mark.parametrize("count", [1, 5, 33])
def test_kernel_equals_scan(count):
    problem, values = _problem(jnp.float32), _values(count, np.float32)
    scan = roll_many(problem, values, kernel=False)
    kernel = roll_lanes(problem, values, interpret=True, lanes=32)
    for name in scan:
        np.testing.assert_allclose(kernel[name], scan[name], rtol=2e-5)


def test_tangents_equal_forward_mode_of_the_scan():
    problem, values = _problem(jnp.float64), _values(3, np.float64)
    finals, derivatives = roll_lanes(problem, values, tangents=True, interpret=True, lanes=4)
    for index in range(3):
        at = {name: jnp.asarray(column[index]) for name, column in values.items()}

        def measures(candidate):
            loop = fp.set_parameters(problem.loop, candidate)
            return fp.roll(loop, problem.inputs, problem.stepper, problem.measures)[0]

        expected, slopes = measures(at), jax.jacfwd(measures)(at)
        for name in expected:
            np.testing.assert_allclose(finals[name][index], expected[name], rtol=1e-10)
            for parameter in values:
                np.testing.assert_allclose(derivatives[name][parameter][index], slopes[name][parameter], rtol=1e-8)


def test_a_loop_with_matrices_is_refused_in_one_sentence():
    problem = _problem(jnp.float32)
    loop = fp.ClosedLoop(problem.loop.plant, fp.astype(fp.TransferFunction([1.0], [1.0, 2.0]), jnp.float32))
    other = Problem(loop, problem.inputs, problem.stepper, {"mae": fp.MeanAbsolute()})
    with pytest.raises(fp.InputError, match="kernel=False"):
        roll_lanes(other, {"plant.inertia": np.ones(3, np.float32)}, interpret=True)


@pytest.mark.filterwarnings("ignore:The Pallas Triton backend is deprecated:DeprecationWarning")
@pytest.mark.parametrize("tangents", [False, True])
def test_lowers_for_cuda(tangents):
    problem, values = _problem(jnp.float32), _values(300, np.float32)

    def run(columns):
        return roll_lanes(problem, columns, tangents=tangents)

    with _pretend_gpu():
        lowered = jax.jit(run).trace(values).lower(lowering_platforms=("cuda",))
    assert "triton" in lowered.as_text()
    shapes = {leaf.shape for leaf in jax.tree.leaves(lowered.out_info)}
    assert shapes == {(300,)}


def _pretend_gpu():
    """From jax 0.12 on, lowering for a GPU that is not here needs a description of one."""
    try:
        from jax.sharding import AbstractDevice, AbstractMesh, use_abstract_mesh

        device = AbstractDevice("NVIDIA H100", 132, "gpu")
        return use_abstract_mesh(AbstractMesh((), (), abstract_device=device))
    except (ImportError, TypeError):
        return contextlib.nullcontext()
