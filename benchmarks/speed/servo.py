"""The one servo loop that every implementation computes, and the library's own way to it.

Velocity w, PI integral q [N m] and the two states z1, z2 of the EFP observer (thesis (4.7)-(4.10)), explicit Euler,
tanh friction, the mean square tracking error in the carry:

    u  = kp (r - w) + q
    c  = z1 - gain_2 |w|,   b = z2 - gain_1 w^2 / 2
    du = u + c sign(w) + b w - coulomb tanh(steepness w) - viscous w
    w += dt du / inertia,  q += dt ki (r - w),  z1 += dt gain_2 sign(w) u / model,  z2 += dt gain_1 w u / model
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import PyTree

import fpjax
from fpjax.simulation.scan import make_inputs, make_stepper, roll

DT = 1e-4
STEPS = 5000

# The ten parameters in the order in which they join the gradient, in SI units (gains as in the EFP). `inertia` is the
# plant's, `model` the observer's.
NOMINAL = {
    "gain_1": 2.0,
    "gain_2": 30.0,
    "kp": 150.0,
    "ki": 200.0,
    "coulomb": 20.0,
    "viscous": 2.0,
    "steepness": 200.0,
    "inertia": 10.0,
    "model": 10.0,
    "velocity": 0.0,
}
NAMES = tuple(NOMINAL)


def candidates(size: int, gains: int, dtype: DTypeLike) -> dict[str, np.ndarray]:
    """`size` candidates that differ in the first `gains` gains, by up to 10 % (the start velocity by 0.1)."""
    spread = np.random.default_rng(0).uniform(-0.1, 0.1, (gains, size))
    return {
        name: (NOMINAL[name] * (1.0 + spread[i]) if NOMINAL[name] else spread[i]).astype(dtype)
        for i, name in enumerate(NAMES[:gains])
    }


def complete(candidate: dict[str, PyTree], dtype: DTypeLike) -> dict[str, PyTree]:
    """All ten values: the candidate's, and the nominal ones for the rest."""
    return {name: candidate.get(name, np.asarray(value, dtype)) for name, value in NOMINAL.items()}


def table(steps: int, dtype: DTypeLike) -> np.ndarray:
    """The reference at each step [rad/s]: a sine of 1 rad/s and 2 Hz."""
    return np.sin(2.0 * np.pi * 2.0 * DT * np.arange(steps)).astype(dtype)


def by_hand(candidate: dict[str, PyTree], reference: PyTree) -> PyTree:
    """The loop as a JAX user writes it: `lax.scan` and nothing else."""
    c = complete(candidate, reference.dtype)
    dt = reference.dtype.type(DT)

    def step(carry: PyTree, r: PyTree) -> PyTree:
        w, q, z1, z2, total = carry
        return euler(c, w, q, z1, z2, total, r, dt), None

    zero = jnp.zeros_like(c["gain_1"])
    carry, _ = jax.lax.scan(step, (zero + c["velocity"], zero, zero, zero, zero), reference)
    return carry[4] / reference.shape[0]


def euler(
    c: dict[str, PyTree], w: PyTree, q: PyTree, z1: PyTree, z2: PyTree, total: PyTree, r: PyTree, dt: PyTree
) -> tuple[PyTree, ...]:
    """One step of the loop; the JAX peers share it."""
    error = r - w
    control = c["kp"] * error + q
    side = jnp.sign(w)
    compensation = (z1 - c["gain_2"] * jnp.abs(w)) * side + (z2 - 0.5 * c["gain_1"] * w * w) * w
    friction = c["coulomb"] * jnp.tanh(c["steepness"] * w) + c["viscous"] * w
    drive = dt * control / c["model"]
    return (
        w + dt * (control + compensation - friction) / c["inertia"],
        q + dt * c["ki"] * error,
        z1 + drive * c["gain_2"] * side,
        z2 + drive * c["gain_1"] * w,
        total + error * error,
    )


def library(steps: int, dtype: DTypeLike) -> tuple[Callable[..., PyTree], tuple[PyTree, ...]]:
    """The same loop built of fpjax's blocks: (cost of one candidate given the shared inputs, the shared inputs)."""
    stepper = make_stepper(dt=jnp.asarray(DT, dtype), samples=steps, solver="euler")
    measures: dict[str, fpjax.AbstractMeasure] = {"cost": fpjax.MeanSquare()}

    def cost(candidate: dict[str, PyTree], inputs: PyTree) -> PyTree:
        c = {name: jnp.asarray(value) for name, value in complete(candidate, dtype).items()}
        loop = closed_loop(c)
        start = loop.init()
        start = fpjax.LoopState(
            type(start.plant)(c["velocity"], start.plant.position, start.plant.friction),
            start.controller,
            start.observer,
            start.actuator,
            start.sensor,
        )
        return roll(loop, inputs, stepper, measures, initial=start)[0]["cost"]

    nominal = closed_loop({name: jnp.asarray(value, dtype) for name, value in NOMINAL.items()})
    sine = fpjax.Sine(amplitude=jnp.asarray(1.0, dtype), frequency=jnp.asarray(2.0, dtype))
    sine = fpjax.astype(sine, dtype)
    return cost, (make_inputs(nominal, sine, stepper),)


def closed_loop(c: dict[str, PyTree]) -> fpjax.ClosedLoop:
    """The blocks with these ten values."""
    friction = fpjax.CoulombViscous(coulomb=c["coulomb"], viscous=c["viscous"], steepness=c["steepness"])
    loop = fpjax.ClosedLoop(
        plant=fpjax.OneMass(inertia=c["inertia"], friction=friction),
        controller=fpjax.ProportionalIntegral(kp=c["kp"], ki=c["ki"]),
        observer=fpjax.ExtendedFriedlandPark(inertia=c["model"], gain_1=c["gain_1"], gain_2=c["gain_2"]),
    )
    return fpjax.astype(loop, c["kp"].dtype)
