"""The tracking error of the closed loop: measured, and predicted with the nominal and with the corrected machine.

It is predicted only if the model's controller made the recorded torque: run over the recorded reference and readings,
it must give the torque column. Otherwise a part of the command, for example a friction compensation that the model does
not have, would act in the log but not in the prediction.
"""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from ...blocks.references import Recorded
from ...blocks.signals import Measurement
from ...logs.arrays import Values, rms
from ...model_file import Model
from ...simulation.loop import ClosedLoop, Period
from ...simulation.precision import double_precision
from ...simulation.run import simulate
from ...simulation.scan import after_last, astype
from ..data.channel import Channel
from ..data.record import Record
from ..machine import Machine, structure_of
from ..simulate.hidden_states import BLOCK
from ..simulate.replay import SUBSTEPS
from .findings import TrackingError
from .gap_size import SEED

REPRODUCED = 0.03  # rms of the torque column that the controller may leave unexplained, over that column's rms
HISTORY = 4  # control periods of history that a delay line keeps beyond the dead time


@dataclasses.dataclass(frozen=True)
class Side:
    """A machine, and the rounding step of its rate reading.

    Attributes:
        machine: nominal or corrected.
        step: [rad/s]; 0 for the machine's own.
    """

    machine: Machine
    step: float = 0.0


def tracking_error(
    model: Model, records: list[Record], before: Side, after: Side, warnings: list[str]
) -> TrackingError | None:
    """The tracking error on withheld samples; None without a known controller, a reference or its reading.

    Args:
        model: gives controller and observer, and what the reference is.
        records: the logs; those without a reference are left out.
        before: the nominal machine.
        after: the corrected one.
        warnings: sentences are appended where the model's controller did not make the torque, or a loop is unstable.
    """
    position = model.units.reference == "position"
    signal = "position" if position else "velocity"
    logs = [record for record in records if record.reference is not None and _channel(record, signal) is not None]
    if not model.controller_known or model.units.reference == "none" or not logs:
        return None
    with double_precision():
        found = [made_torque(model, record) for record in logs]
        worst = max(error for error, _ in found)
        if worst > REPRODUCED:
            warnings.append(f"{_other_torque(worst)}, so the closed loop's tracking error was not predicted.")
            return None
        rows: dict[str, list[Values]] = {"measured": [], "before": [], "after": []}
        for record, (_, start) in zip(logs, found, strict=True):
            keep = withheld_samples(record)
            reference = np.asarray(record.reference)
            rows["measured"].append((reference - _readings(_channel(record, signal)))[keep])
            for name, side in (("before", before), ("after", after)):
                rows[name].append((reference - followed(model, record, side, start, position))[keep])
    values = {name: rms_or_infinite(np.concatenate(parts)) for name, parts in rows.items()}
    for name in ("before", "after"):
        if not math.isfinite(values[name]):
            machine = "nominal" if name == "before" else "corrected"
            warnings.append(f"The closed loop around the {machine} machine is not stable in simulation.")
    unit = model.units.name("rad" if position else "rad/s")
    return TrackingError(unit, signal=signal, controller_error=worst, **values)


def _other_torque(error: float) -> str:
    """The warning on a torque column that the model's controller did not make; the error is relative to its rms [1]."""
    start = "The model's controller and observer, run over the recorded reference and readings, do not give the torque"
    if error > 1.0:
        return f"{start} at all: another controller made it, or one without the model's observer"
    return f"{start}: they differ by {error:.1%} of its rms (something is added to the command, or the gains differ)"


def made_torque(model: Model, record: Record) -> tuple[float, Any]:
    """(error of the model's controller in reproducing the torque column, rms over rms [1]; initial state).

    The initial state of controller and observer is not recorded: it is estimated, as the one that reproduces the torque
    column best.

    Args:
        model: gives controller and observer.
        record: gives reference, readings and torque.
    """
    controller, observer = astype((model.loop.controller, model.loop.observer), float)
    # As one vector, in which the torque column is linear for a linear controller.
    start, unravel = ravel_pytree((controller.init(), observer.init()))
    rate = _readings(record.reading)
    angle = _readings(record.position)
    if rate is None:
        assert angle is not None
        # A loop on an encoder alone takes the velocity from differences, as most drives do.
        rate = np.concatenate([[0.0], np.diff(angle)]) / record.dt
    angle = np.zeros_like(rate) if angle is None else angle
    asked = np.asarray(record.reference)
    # The last column is the next reference, which a feed-forward of a position looks at.
    following = np.append(asked[1:], after_last(controller, asked))
    columns = tuple(padded(column) for column in (asked, rate, angle, following))
    loop, dt = ClosedLoop(model.loop.plant, controller, observer), jnp.asarray(record.dt)
    measured = np.asarray(record.torque)
    if start.size:
        # Gauss-Newton in the initial state: a linear controller needs one step, one with a limit a second.
        for _ in range(2):
            made, slope = (np.asarray(part)[: len(measured)] for part in _torque_and_slope(start, loop, columns, dt))
            step, *_ = np.linalg.lstsq(slope, measured - made, rcond=1e-10)
            start = start + jnp.asarray(step)
    left = measured - np.asarray(_torque(start, loop, columns, dt))[: len(measured)]  # what no initial state explains
    return rms_or_infinite(left) / max(rms(measured), 1e-300), unravel(start)


@eqx.filter_jit
def _torque(start: Array, loop: ClosedLoop, columns: tuple[Array, ...], dt: Array) -> Array:
    """The torque [N m] that controller and observer give over a log's columns from a flat initial state, (samples,)."""
    _, unravel = ravel_pytree((loop.controller.init(), loop.observer.init()))
    zero = jnp.zeros(())
    first = Period(zero, zero, zero) if loop.observer.estimated else ()

    def period(memory: Any, sample: Any) -> tuple[Any, Any]:
        reference, velocity, place, following = sample
        command = loop.control_law(memory, reference, Measurement(velocity, place), dt, following)
        return command.memory, command.torque

    return jax.lax.scan(period, (*unravel(start), first), columns)[1]


# Loop and columns are arguments: as constants of the program they would have it compiled again for every log.
@eqx.filter_jit
def _torque_and_slope(start: Array, loop: ClosedLoop, columns: tuple[Array, ...], dt: Array) -> tuple[Array, Array]:
    """(`_torque`, its Jacobian by the initial state, shape (samples, states))."""
    return _torque(start, loop, columns, dt), jax.jacfwd(_torque)(start, loop, columns, dt)


def padded(values: Values) -> Array:
    """Values continued by the last of them to whole blocks of samples: a log of another length compiles nothing."""
    return jnp.asarray(np.pad(values, (0, -len(values) % BLOCK), "edge"), float)


def followed(model: Model, record: Record, side: Side, start: Any, position: bool) -> Values:
    """The sensor reading of a machine in the closed loop under the recorded reference, shape (samples,).

    Args:
        model: gives controller and observer.
        record: the log: reference, initial motion, noise of the sensors.
        side: the machine and its rounding step.
        start: initial state of controller and observer, as `made_torque` estimates it.
        position: whether the position is read, else the rate.
    """
    machine = side.machine
    loop = ClosedLoop(machine.plant, model.loop.controller, model.loop.observer, *_late(machine, record, side.step))
    loop = astype(loop, float)
    state = loop.init()
    speed, angle = float(record.speed[0]), float(record.angle[0]) + float(machine.origin)
    # Motor and load, where there are two, start together at the measured motion.
    for name in type(state.plant).__dataclass_fields__:
        if name.endswith(("velocity", "position")):
            value = jnp.asarray(speed if name.endswith("velocity") else angle, float)
            state = eqx.tree_at(lambda at, name=name: getattr(at.plant, name), state, value)
    state = eqx.tree_at(lambda at: (at.controller, at.observer), state, start, is_leaf=lambda leaf: leaf is None)
    name = "measured_position" if position else "measured_velocity"
    reference = padded(np.asarray(record.reference))
    run = simulate(
        loop,
        Recorded(reference, record.dt),
        dt=record.dt,
        samples=len(reference),
        solver="exact",
        stepping="sampled",
        substeps=SUBSTEPS[structure_of(machine)],
        record=(name,),
        initial=state,
        key=jax.random.key(SEED),
    )
    values = np.asarray(run.signals[name])[: len(record.time)]
    return values - float(machine.origin) if position else values


def _late(machine: Machine, record: Record, step: float) -> tuple[Any, Any]:
    """(actuator, sensor) with delay lines long enough for their dead times, the sensor with the noise of the log."""
    actuator, sensor = machine.actuator, machine.sensor
    # Whole blocks of periods: a loop is compiled for the length of its delay lines, and a dead time is a fitted number.
    kept = [
        1 if delay is None else HISTORY * (2 + math.ceil(float(delay) / record.dt) // HISTORY)
        for delay in (actuator.delay, sensor.delay)
    ]
    step = step or float(sensor.step_size)
    changes: dict[str, Any] = {"longest_delay": kept[1], "step_size": jnp.asarray(step)}
    for name, channel, rounded in (
        ("noise", record.reading, step),
        ("position_noise", record.position, float(sensor.position_step)),
    ):
        if channel is not None and float(getattr(sensor, name)) == 0.0:
            # Rounding to a step adds a variance of step^2 / 12, which the measured noise of the channel contains.
            changes[name] = jnp.asarray(math.sqrt(max(channel.noise**2 - rounded**2 / 12.0, 0.0)))
    return dataclasses.replace(actuator, longest_delay=kept[0]), dataclasses.replace(sensor, **changes)


def withheld_samples(record: Record) -> Values:
    """True for samples of withheld windows, shape (samples,)."""
    keep = np.zeros(len(record.time), bool)
    for start in record.starts[record.withheld]:
        keep[start : start + record.samples] = True
    return keep


def rms_or_infinite(values: Values) -> float:
    """Root mean square; infinite where any value is not finite."""
    return rms(values) if np.all(np.isfinite(values)) else math.inf


def _channel(record: Record, signal: str) -> Channel | None:
    return record.position if signal == "position" else record.reading


def _readings(channel: Channel | None) -> Values | None:
    return None if channel is None else channel.values
