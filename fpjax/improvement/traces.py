"""Traces: the tracking error over time around a few machines, for the pictures."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..gap.precision import double_precision
from ..scan import Inputs, roll
from .judge import Judge, assemble_loop, start_state
from .machines import Machines

SHOWN = 12  # machines

Values = np.ndarray


def traces(judge: Judge, values: Values, machines: Machines) -> dict[str, Values]:
    """The tracking error's lowest, middle and highest of a few machines, `before` and `after` of shape (3, samples).

    Beside them `time` [s] and `reference`, of shape (samples,).

    Args:
        judge: runs the loops.
        values: the gains before and after, shape (2, gains).
        machines: `ready`.
    """
    some = machines.first(SHOWN)
    leaves, structure = jax.tree.flatten(some.machine)
    index = np.tile(np.arange(some.count), 2)
    rows = np.repeat(np.asarray(values, float), some.count, axis=0)
    record = judge.ground.record
    with double_precision():
        machine = jax.tree.unflatten(structure, [jnp.asarray(np.asarray(leaf)[index]) for leaf in leaves])
        lanes = (
            machine,
            jnp.asarray(some.shares[index]),
            {n: jnp.asarray(rows[:, i]) for i, n in enumerate(judge.names)},
        )
        inputs = Inputs(judge.time, (jnp.asarray(judge.reference),), (judge.noise[0], judge.noise[1]))
        courses = jnp.asarray(judge.ground.courses)
        names = ("motor_position", "position") if judge.position else ("motor_velocity", "velocity")

        def one(lane: Any) -> Any:
            machine, shares, gains = lane
            loop = assemble_loop(judge.law, machine, shares, courses, judge.stepper.dt, gains)
            state = start_state(loop, machine, jnp.asarray(float(record.speed[0])), jnp.asarray(float(record.angle[0])))
            _, recorded, _ = roll(loop, inputs, judge.stepper, {}, record=names, initial=state)
            motor, load = recorded[names[0]], recorded[names[1]]
            return inputs.references[0] - motor - machine.sensor.load_side * (load - motor)

        error = np.asarray(jax.jit(jax.vmap(one))(lanes)).reshape(2, some.count, -1)
    largest = 10.0 * judge.size
    error = np.clip(np.nan_to_num(error, nan=largest, posinf=largest, neginf=-largest), -largest, largest)
    before, after = (np.stack([part.min(axis=0), np.median(part, axis=0), part.max(axis=0)]) for part in error)
    return {"time": np.asarray(judge.time), "reference": judge.reference, "before": before, "after": after}
