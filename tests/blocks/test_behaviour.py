"""What the blocks must survive: stiff bristles, a run that blows up beside healthy ones, and other numbers in the
same program."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fpjax as fp


def test_lugre_is_stable_at_the_textbook_stiffness():
    """At sigma_0 = 20000, sigma_1 = 1000, dt = 1e-4 the run follows scipy's implicit solver, written out by hand."""
    coulomb, static, stribeck, stiffness, damping, viscous, inertia = 20.0, 25.0, 0.05, 20000.0, 1000.0, 2.0, 10.0
    law = fp.LuGre(coulomb, static, stribeck, stiffness, damping, viscous)
    loop = fp.ClosedLoop(fp.OneMass(inertia, law), fp.ProportionalIntegral(150.0, 200.0))
    run = fp.simulate(loop, fp.Sine(1.0, 1.0), dt=1e-4, duration=1.0, record=("velocity", "friction"))
    assert run.status == fp.Status.COMPLETED

    def rates(time, state):
        velocity, bristle, integral = state
        error = np.sin(2.0 * np.pi * time) - velocity
        level = coulomb + (static - coulomb) * np.exp(-((velocity / stribeck) ** 2))
        rate = velocity - stiffness * abs(velocity) * bristle / level
        friction = stiffness * bristle + damping * rate + viscous * velocity
        return [(150.0 * error + integral - friction) / inertia, rate, 200.0 * error]

    truth = solve_ivp(rates, (0.0, 1.0), np.zeros(3), method="Radau", t_eval=run.time[::100], rtol=1e-10, atol=1e-12)
    # RK4 is of first order only where w crosses zero (|w| has a kink there): dt |dw/dt| = 1e-4 x 6 rad/s^2.
    np.testing.assert_allclose(run.signals["velocity"][::100], truth.y[0], rtol=0, atol=1e-6)


def test_lugre_at_rest_is_the_bristles_spring():
    """Below break-away the mass rests on sigma_0: a constant torque T deflects it by T / sigma_0."""
    law = fp.LuGre(20.0, 25.0, 0.05, bristle_stiffness=20000.0, bristle_damping=1000.0)
    loop = fp.ClosedLoop(fp.OneMass(10.0, law), fp.Proportional(5.0))
    run = fp.simulate(loop, fp.Constant(1.0), dt=1e-4, duration=1.0, record=("position", "velocity"))
    # u = 5 (r - w) = 5 N m at rest, a quarter of F_c, so z creeps by z |w| / g: some tens of per cent at most.
    assert 5.0 / 20000.0 < float(run.signals["position"][-1]) < 1.4 * 5.0 / 20000.0
    assert abs(float(run.signals["velocity"][-1])) < 1e-6


def blowing_up(gain):
    return fp.ClosedLoop(fp.OneMass(1.0, fp.CoulombViscous(1.0, 0.1, 100.0)), fp.Proportional(gain))


def test_a_diverged_run_says_so_and_throws_on_demand():
    run = fp.simulate(blowing_up(1e5), fp.Sine(1.0, 1.0), dt=1e-3, duration=1.0, measures={"mae": fp.MeanAbsolute()})
    assert run.status == fp.Status.DIVERGED
    assert run.diverged
    assert "smaller" in run.message
    with pytest.raises(fp.DivergedError, match="diverged"):
        fp.simulate(blowing_up(1e5), fp.Sine(1.0, 1.0), dt=1e-3, duration=1.0, throw=True)


def test_a_diverged_run_does_not_spoil_its_neighbours():
    gains = jnp.asarray([10.0, 1e5, 20.0, 1e6, 30.0])

    def run(gain):
        loop = fp.set_parameters(blowing_up(1.0), {"controller.kp": gain})
        return fp.simulate(loop, fp.Sine(1.0, 1.0), dt=1e-3, duration=1.0, measures={"mae": fp.MeanAbsolute()})

    batch = jax.vmap(run)(gains)
    assert batch.status.tolist() == [0, 1, 0, 1, 0]
    for index in (0, 2, 4):
        alone = run(gains[index])
        np.testing.assert_allclose(batch.measures["mae"][index], alone.measures["mae"], rtol=1e-12)
        np.testing.assert_allclose(batch.final_state.plant.velocity[index], alone.final_state.plant.velocity, rtol=1e-9)
    healthy = jnp.where(batch.status == 0, batch.measures["mae"], 0.0)
    assert bool(jnp.all(jnp.isfinite(healthy)))


def test_a_diverged_neighbour_does_not_spoil_a_gradient():
    def cost(gain):
        loop = fp.set_parameters(blowing_up(1.0), {"controller.kp": gain})
        return fp.simulate(loop, fp.Sine(1.0, 1.0), dt=1e-3, samples=200, measures={"mse": fp.MeanSquare()}).measures[
            "mse"
        ]

    gradients = jax.vmap(jax.grad(cost))(jnp.asarray([10.0, 1e6]))
    np.testing.assert_allclose(gradients[0], jax.grad(cost)(10.0), rtol=1e-9)


class CountingController(fp.AbstractController):
    """Counts how often it is traced."""

    kp: jax.Array = eqx.field(converter=jnp.asarray)
    traces: ClassVar[list[int]] = []

    def init(self):
        return ()

    def derivative(self, state, reference, measurement):
        return ()

    def readout(self, state, reference, measurement):
        self.traces.append(1)
        return self.kp * (reference - measurement.velocity)


@pytest.mark.parametrize("stepping", ["continuous", "sampled"])
def test_simulate_compiles_once_for_other_numbers(stepping):
    def run(kp, coulomb, gain, amplitude, dt):
        plant = fp.OneMass(10.0, fp.CoulombViscous(coulomb, 2.0, 40.0))
        observer = fp.ExtendedFriedlandPark(10.0, gain, 70.0, 40.0)
        loop = fp.ClosedLoop(plant, CountingController(kp), observer)
        measures = {"mae": fp.MeanAbsolute(), "k": fp.EstimateError("coulomb", coulomb)}
        return fp.simulate(loop, fp.Sine(amplitude, 2.0), dt=dt, samples=50, stepping=stepping, measures=measures)

    CountingController.traces.clear()
    first = run(150.0, 20.0, 300.0, 1.0, 1e-3)
    traced = len(CountingController.traces)
    assert traced > 0
    for numbers in ((160.0, 20.0, 300.0, 1.0, 1e-3), (150.0, 9.0, 30.0, 2.0, 1e-3), (150.0, 20.0, 300.0, 1.0, 2e-4)):
        other = run(*numbers)
        assert float(other.measures["mae"]) != float(first.measures["mae"])
    assert len(CountingController.traces) == traced, "other numbers compiled again"


def test_status_counts_what_is_measured_too():
    """A measure that is NaN marks the run, even where the final state is finite."""

    class Broken(fp.MeanAbsolute):
        def final(self, total, samples):
            return total * jnp.nan

    run = fp.simulate(blowing_up(10.0), fp.Sine(1.0, 1.0), dt=1e-3, samples=10, measures={"broken": Broken()})
    assert run.diverged


def test_a_transfer_function_for_another_period_is_refused():
    """Its matrices were made for one period; at another the run would be silently wrong."""
    inner = fp.TransferFunction([150.0, 2e3], [1.0, 60.0], period=2e-3)
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(2.0)), fp.PositionLoop(20.0, inner))
    with pytest.raises(fp.InputError, match=r"period=0\.001"):
        fp.simulate(loop, fp.Sine(1.0, 1.0), dt=1e-3, samples=5, stepping="sampled")
    fp.simulate(loop, fp.Sine(1.0, 1.0), dt=2e-3, samples=5, stepping="sampled")
    fp.simulate(loop, fp.Sine(1.0, 1.0), dt=1e-3, samples=5)  # continuous: no discretisation is used
