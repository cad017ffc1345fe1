"""Closed loops of a few machines over time, for the pictures and for comparing the prediction with the log."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..gap.data.record import Record
from ..logs.arrays import Values, rms
from ..logs.dynamics.derivative import travel
from ..simulation.precision import double_precision
from ..simulation.scan import Inputs, roll, sampled_tables
from .judge import Judge, assemble_loop, start_state
from .machines import Ground, Machines

SHOWN = 12  # machines in the pictures
OVER = 0.02  # [s] over which mean speeds are compared without a rate sensor
# Largest difference between the log's motion and the simulated one, relative to the tracking error. A larger difference
# means that other gains made the log.
REPEATED = 0.3


@dataclasses.dataclass(frozen=True)
class Traces:
    """Closed loops over time, before and after.

    Attributes:
        time: [s], shape (samples,).
        reference: shape (samples,).
        error: reference less true motion, with the gains (before, after), shape (2, machines, samples).
        measured: sensor reading of the first machine with the current gains, shape (samples,).
    """

    time: Values
    reference: Values
    error: Values
    measured: Values

    def summary(self, largest: float) -> dict[str, Values]:
        """For the pictures: `time`, `reference`, and the error's lowest, middle and highest, `before` and `after`.

        Args:
            largest: errors are cut off here [the unit of the error].
        """
        error = np.clip(np.nan_to_num(self.error, nan=largest, posinf=largest, neginf=-largest), -largest, largest)
        before, after = (np.stack([part.min(axis=0), np.median(part, axis=0), part.max(axis=0)]) for part in error)
        return {"time": self.time, "reference": self.reference, "before": before, "after": after}


def run_traces(judge: Judge, values: Values, machines: Machines) -> Traces:
    """Run a few machines of the chosen explanation with the gains before and after.

    Args:
        judge: runs the loops.
        values: the gains before and after, shape (2, gains).
        machines: `ready`.
    """
    some = machines.first(SHOWN)
    leaves, structure = jax.tree.flatten(some.machine)
    # both sets of gains in one batch: the machines twice, first with the gains before, then with those after
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
        tables = sampled_tables(judge.law[0], jnp.asarray(judge.reference))
        inputs = Inputs(judge.time, tables, (judge.noise[0], judge.noise[1]))
        courses = jnp.asarray(judge.ground.courses)
        kind = "position" if judge.position else "velocity"
        names = (f"motor_{kind}", kind, f"measured_{kind}")

        def one(lane: PyTree) -> PyTree:
            machine, shares, gains = lane
            loop = assemble_loop(judge.law, machine, shares, courses, judge.stepper.dt, gains)
            state = start_state(loop, machine, jnp.asarray(float(record.speed[0])), jnp.asarray(float(record.angle[0])))
            _, recorded, _ = roll(loop, inputs, judge.stepper, {}, record=names, initial=state)
            motor, load, measured = (recorded[name] for name in names)
            return inputs.references[0] - motor - machine.sensor.load_side * (load - motor), measured

        error, measured = (np.asarray(each) for each in jax.jit(jax.vmap(one))(lanes))
    error = error.reshape(2, some.count, -1)
    return Traces(np.asarray(judge.time), judge.reference, error, measured[0])


def unlike(traces: Traces, judge: Judge, record: Record, ground: Ground) -> tuple[float, bool] | None:
    """Compare the log's motion with the simulated motion with the gains that ran.

    The courses are compared, not the rms errors: these may agree where the courses do not, and new gains change the
    course. The noise of both readings is taken off. Without a rate sensor mean speeds over 20 ms are compared, from the
    encoder's readings at both ends.

    Returns:
        (rms difference [the error's unit], whether it is larger than the sensors' noise); None where the two motions
        are so different that other gains must have made the log.
    """
    first, last = math.ceil(judge.start / judge.dt), len(judge.reference)
    rate, angle = ground.noise
    # noise of a difference: the simulated reading has the sensor's noise as the log has
    channel = record.position if judge.position else record.reading
    if channel is not None:
        noise = math.sqrt(2.0) * (angle if judge.position else rate)
        left = (traces.measured - channel.values[:last])[first:]
    elif record.position is not None:
        span = max(round(OVER / judge.dt), 1)
        # a mean speed is the difference of two readings over the span, each with the encoder's noise
        noise = math.sqrt(2.0) * angle / (span * judge.dt)
        speed = traces.reference - traces.error[0, 0]
        left = (travel(speed, judge.dt) - record.position.values[:last])[first:]
        left = (left[span:] - left[:-span]) / (span * judge.dt)
    else:
        return None
    found = math.sqrt(max(rms(left) ** 2 - noise**2, 0.0))
    return (found, found > noise) if found < REPEATED * rms(traces.error[0, 0, first:]) else None


def passed_on(traces: Traces, judge: Judge) -> float:
    """How strongly unforeseen torques show in the error with the new gains, relative to the current gains [1].

    It is the ratio of the spreads of the error over the machines, and at most 1.
    """
    first = math.ceil(judge.start / judge.dt)
    apart = [rms((part[1:] - part[:1])[:, first:].ravel()) for part in traces.error]
    return min(apart[1] / apart[0], 1.0) if np.isfinite(apart).all() and apart[0] > 0.0 else 1.0
