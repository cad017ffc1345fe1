"""Stability margins of the loop linearised about a steady motion, for many machines at once."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, PyTree

from ..gap.machine import NO_LIMIT
from ..linear.linearise import Disturbed
from ..linear.margins import Margins, margins
from ..linear.state_space import StateSpace
from ..logs.arrays import Values
from ..simulation.loop import ClosedLoop, LoopState
from ..simulation.precision import double_precision
from .judge import Judge, assemble_loop
from .machines import Machines

NAMES = ("modulus", "gain", "phase", "delay")
UNITS = {"modulus": "1", "gain": "1", "phase": "deg", "delay": "ms"}


def margins_of(judge: Judge, values: Values, machines: Machines, speed: float) -> list[dict[str, Values]]:
    """Modulus [1], gain [1], phase [deg] and delay [ms] margin of each candidate, each of shape (machines,).

    NaN where a loop has no steady motion, zero where it is unstable.

    Args:
        judge: runs the loops.
        values: gains, shape (candidates, gains).
        machines: `ready`.
        speed: of the steady motion [rad/s].
    """
    states, reference = judge.settle(values, machines, speed)
    count = machines.count
    # every candidate with every machine, candidate by candidate: one batch of (candidates x machines) loops
    rows = np.repeat(np.asarray(values, float), count, axis=0)
    index = np.tile(np.arange(count), len(values))
    leaves, structure = jax.tree.flatten(machines.machine)
    with double_precision():
        machine = jax.tree.unflatten(structure, [jnp.asarray(np.asarray(leaf)[index]) for leaf in leaves])
        gains = {name: jnp.asarray(rows[:, i]) for i, name in enumerate(judge.names)}
        states = jax.tree.map(jnp.asarray, states)
        now = float(reference[0])
        # A position reference goes on at the steady speed; held, it would look like a stop to a feed-forward.
        following = jnp.asarray(now + speed * judge.dt) if judge.position else None
        shared = (
            judge.law, judge.stepper.dt, jnp.asarray(now), following, jnp.asarray(judge.ground.courses)
        )  # fmt: skip
        tangent = _tangents(judge.ground.substeps, judge.stepper.solver)
        a, b, answer = (np.asarray(each, float) for each in tangent(machine, gains, states, *shared))
    found = []
    for candidate in range(len(values)):
        at = range(candidate * count, (candidate + 1) * count)
        rows_of = [_numbers(a[i], b[i], answer[i], judge.dt) for i in at]
        found.append({name: np.array([row[name] for row in rows_of]) for name in NAMES})
    return found


def _unlimited(loop: ClosedLoop) -> ClosedLoop:
    """The loop without limits of its torque.

    A steady motion reaches none. A loop that is unstable and swings from limit to limit would have, at a limit, no
    feedback, and with it infinite margins.
    """

    def without(path: tuple[Any, ...], leaf: Array) -> Array:
        return jnp.full_like(leaf, NO_LIMIT) if getattr(path[-1], "name", None) == "limit" else leaf

    return jax.tree_util.tree_map_with_path(without, loop)


@functools.lru_cache(maxsize=8)
def _tangents(substeps: int, solver: PyTree) -> PyTree:
    """A compiled function: (machines, gains, states, *shared) -> (A, B, C) of the whole loop, batched over machines."""

    def one(
        machine: PyTree,
        gains: PyTree,
        state: LoopState,
        law: PyTree,
        dt: PyTree,
        reference: PyTree,
        following: PyTree,
        courses: PyTree,
    ) -> tuple[PyTree, PyTree, PyTree]:
        loop = assemble_loop(law, machine, jnp.zeros(courses.shape[0]), courses, dt, gains)
        point, rebuild = ravel_pytree(state)
        zero = jnp.zeros_like(dt)

        def moved(values: PyTree, added: PyTree) -> tuple[PyTree, PyTree]:
            free = _unlimited(loop)
            cut = eqx.tree_at(lambda each: each.actuator, free, Disturbed(free.actuator, added))
            silent = tuple(zero for _ in range(loop.sensor.noise_channels))
            now = rebuild(values)
            after, signals = cut.advance_sampled(now, reference, zero, dt, silent, solver, substeps, following)
            return ravel_pytree(after)[0], signals.torque

        (a, b), (c, _) = jax.jacfwd(moved, (0, 1))(point, zero)
        return a, b, c

    return jax.jit(jax.vmap(one, (0, 0, 0, None, None, None, None, None)))


def _numbers(a: Values, b: Values, answer: Values, dt: float) -> dict[str, float]:
    """The margins by name of one loop, from its A, B (of a torque added to the command) and C (of the command)."""
    if not (np.isfinite(a).all() and np.isfinite(b).all() and np.isfinite(answer).all()):
        return dict.fromkeys(NAMES, float("nan"))
    # The actuator gets v = y + d. With the loop opened there v is the input: d = v - y (as in fpjax.linear.linearise).
    b, answer = b[:, None], answer[None, :]
    ratio = StateSpace(a - b @ answer, b, -answer, np.zeros((1, 1)), dt, ("torque",), ("return",))
    try:
        found: Margins = margins(ratio, points=400)
    # eigenvalues of a loop at the edge of overflow may not converge: it counts as one without a steady motion
    except (ValueError, FloatingPointError, np.linalg.LinAlgError):
        return dict.fromkeys(NAMES, float("nan"))
    if not found.stable:
        return dict.fromkeys(NAMES, 0.0)
    return {
        "modulus": found.modulus_margin,
        "gain": found.gain_margin,
        "phase": found.phase_margin,
        "delay": 1e3 * found.delay_margin,
    }
