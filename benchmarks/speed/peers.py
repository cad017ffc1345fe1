"""The same loop in numpy, numba and diffrax, each as its users would write it."""

from collections.abc import Callable

import numpy as np
from jaxtyping import PyTree

from . import servo


def with_numpy(candidates: dict[str, PyTree], reference: PyTree) -> Callable[[], PyTree]:
    """A Python loop over the steps, arrays over the candidates."""
    dtype = reference.dtype
    c = servo.complete(candidates, dtype)
    size = len(next(iter(candidates.values())))
    dt, half = dtype.type(servo.DT), dtype.type(0.5)

    def run() -> PyTree:
        w = np.broadcast_to(c["velocity"], (size,)).astype(dtype)
        q, z1, z2, total = (np.zeros(size, dtype) for _ in range(4))
        for r in reference:
            error = r - w
            control = c["kp"] * error + q
            side = np.sign(w)
            compensation = (z1 - c["gain_2"] * np.abs(w)) * side + (z2 - half * c["gain_1"] * w * w) * w
            friction = c["coulomb"] * np.tanh(c["steepness"] * w) + c["viscous"] * w
            drive = dt * control / c["model"]
            z1 += drive * c["gain_2"] * side
            z2 += drive * c["gain_1"] * w
            q += dt * c["ki"] * error
            w = w + dt * (control + compensation - friction) / c["inertia"]
            total += error * error
        return total / dtype.type(len(reference))

    return run


def with_numba(candidates: dict[str, PyTree], reference: PyTree) -> Callable[[], PyTree]:
    """One candidate after the other, compiled scalar code."""
    import numba  # pyright: ignore[reportMissingImports]

    dtype = reference.dtype
    size = len(next(iter(candidates.values())))
    values = np.stack([np.broadcast_to(v, (size,)) for v in servo.complete(candidates, dtype).values()]).astype(dtype)
    dt, zero, half = dtype.type(servo.DT), dtype.type(0.0), dtype.type(0.5)

    def loop(values: PyTree, reference: PyTree) -> PyTree:
        cost = np.empty(values.shape[1], values.dtype)
        for i in range(values.shape[1]):
            gain_1, gain_2, kp, ki = values[0, i], values[1, i], values[2, i], values[3, i]
            coulomb, viscous, steepness = values[4, i], values[5, i], values[6, i]
            inertia, model, w = values[7, i], values[8, i], values[9, i]
            q, z1, z2, total = zero, zero, zero, zero
            for t in range(reference.shape[0]):
                error = reference[t] - w
                control = kp * error + q
                side = np.sign(w)
                compensation = (z1 - gain_2 * abs(w)) * side + (z2 - half * gain_1 * w * w) * w
                friction = coulomb * np.tanh(steepness * w) + viscous * w
                drive = dt * control / model
                z1 += drive * gain_2 * side
                z2 += drive * gain_1 * w
                q += dt * ki * error
                w += dt * (control + compensation - friction) / inertia
                total += error * error
            cost[i] = total / values.dtype.type(reference.shape[0])
        return cost

    compiled = numba.njit(loop)
    return lambda: compiled(values, reference)


def with_diffrax(candidates: dict[str, PyTree], reference: PyTree) -> Callable[[], PyTree]:
    """`diffeqsolve` with `Euler` at a constant step, vmapped over the candidates."""
    import diffrax
    import jax
    import jax.numpy as jnp

    steps, dtype = len(reference), reference.dtype
    dt = dtype.type(servo.DT)

    def derivative(t: PyTree, y: PyTree, args: PyTree) -> PyTree:
        c, reference = args
        now = reference[jnp.round(t / dt).astype(jnp.int32)]
        unit = dtype.type(1.0)  # the increment of an Euler step of length 1 is the derivative
        w, q, z1, z2, total = y
        after = servo.euler(c, w, q, z1, z2, total, now, unit)
        return (*(new - old for new, old in zip(after[:4], y[:4], strict=True)), jnp.square(now - w))

    def cost(candidate: PyTree, reference: PyTree) -> PyTree:
        c = servo.complete(candidate, dtype)
        zero = jnp.zeros_like(jnp.asarray(c["gain_1"]))
        start = (zero + c["velocity"], zero, zero, zero, zero)
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(derivative),
            diffrax.Euler(),
            t0=dtype.type(0.0),
            t1=dtype.type(steps * servo.DT),
            dt0=dt,
            y0=start,
            args=(c, reference),
            saveat=diffrax.SaveAt(t1=True),
            max_steps=steps + 2,
            adjoint=diffrax.ForwardMode() if hasattr(diffrax, "ForwardMode") else diffrax.RecursiveCheckpointAdjoint(),
        )
        assert solution.ys is not None
        return solution.ys[4][0] / (steps * dt)

    run = jax.jit(jax.vmap(cost, in_axes=(0, None)))
    arrays = {name: jnp.asarray(value) for name, value in candidates.items()}
    table = jnp.asarray(reference)
    return lambda: run(arrays, table)
