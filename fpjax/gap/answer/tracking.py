"""Tracking: the closed loop's tracking error, predicted around the nominal and the corrected machine, and measured.

Only where the controller is known to have made the torque: run over the recorded reference and readings, it must give
the torque column. A friction compensation that the model does not know would act in the log and not in the prediction.
"""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from ...blocks.references import Recorded
from ...blocks.signals import Measurement
from ...model_file import Model
from ...simulation.loop import ClosedLoop, Period
from ...simulation.run import simulate
from ...simulation.scan import astype
from ..data.channel import Channel
from ..data.record import Record
from ..machine import Machine, structure_of
from ..precision import double_precision
from ..simulate.replay import SUBSTEPS
from .diagnosis import TrackingError
from .shrink import SEED

REPRODUCED = 0.03  # of the torque's rms that a known controller may leave unexplained
HISTORY = 4  # periods kept beyond a dead time


@dataclasses.dataclass(frozen=True)
class Side:
    """A machine and the step that its rate reading is rounded to.

    Attributes:
        machine: nominal or corrected.
        step: [rad/s]; 0 for none but the machine's own.
    """

    machine: Machine
    step: float = 0.0


def tracking_error(
    model: Model, records: list[Record], before: Side, after: Side, warnings: list[str]
) -> TrackingError | None:
    """The tracking error on withheld samples; None where there is nothing to predict it with.

    Args:
        model: gives controller and observer, and what the reference is.
        records: the logs; those without a reference are left out.
        before: the nominal machine.
        after: the corrected one.
        warnings: grows by a sentence where the controller of the model did not make the torque.
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
        rows: dict[str, list[np.ndarray]] = {"measured": [], "before": [], "after": []}
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
    """What a torque column says that the model's controller would not have made; the error is of its rms [1]."""
    told = "The model's controller and observer, run over the recorded reference and readings, do not give the torque"
    if error > 1.0:
        return f"{told} at all: another controller made it, or one without the model's observer"
    return f"{told}: they differ by {error:.1%} of its rms (something adds to the command, or the gains are others)"


def made_torque(model: Model, record: Record) -> tuple[float, Any]:
    """(rms of what the model's controller does not make of the torque column, relative to the torque's rms [1]; state
    of controller and observer at the log's start).

    The state at the start is not recorded: it is the one with which controller and observer make the torque best.
    """
    controller, observer = astype((model.loop.controller, model.loop.observer), float)
    start, unravel = ravel_pytree((controller.init(), observer.init()))
    rate = _readings(record.reading)
    angle = _readings(record.position)
    if rate is None:
        assert angle is not None
        rate = np.concatenate([[0.0], np.diff(angle)]) / record.dt
    angle = np.zeros_like(rate) if angle is None else angle
    asked = np.asarray(record.reference)
    columns = tuple(jnp.asarray(column, float) for column in (asked, rate, angle, np.append(asked[1:], asked[-1])))

    dt = jnp.asarray(record.dt)
    loop = ClosedLoop(model.loop.plant, controller, observer)
    zero = jnp.zeros(())
    first = Period(zero, zero, zero) if observer.estimated else ()

    def torque(flat: Any) -> Any:
        def period(memory: Any, sample: Any) -> tuple[Any, Any]:
            reference, velocity, place, following = sample
            command = loop.control_law(memory, reference, Measurement(velocity, place), dt, following)
            return command.memory, command.torque

        return jax.lax.scan(period, (*unravel(flat), first), columns)[1]

    measured = np.asarray(record.torque)
    if start.size:
        # Linear controllers are there after one step; a second serves those with a limit.
        slope = jax.jit(jax.jacfwd(torque))
        for _ in range(2):
            step, *_ = np.linalg.lstsq(np.asarray(slope(start)), measured - np.asarray(torque(start)), rcond=1e-10)
            start = start + jnp.asarray(step)
    left = measured - np.asarray(torque(start))
    return rms_or_infinite(left) / max(rms(measured), 1e-300), unravel(start)


def followed(model: Model, record: Record, side: Side, start: Any, position: bool) -> np.ndarray:
    """What the sensor of a machine reads in the closed loop under the recorded reference, shape (samples,).

    Args:
        model: gives controller and observer.
        record: the log: reference, first motion, noise of the sensors.
        side: the machine.
        start: state of controller and observer at the log's start.
        position: the reading of the position, not of the rate.
    """
    machine = side.machine
    loop = ClosedLoop(machine.plant, model.loop.controller, model.loop.observer, *_late(machine, record, side.step))
    loop = astype(loop, float)
    state = loop.init()
    speed, angle = float(record.speed[0]), float(record.angle[0]) + float(machine.origin)
    for name in type(state.plant).__dataclass_fields__:
        if name.endswith(("velocity", "position")):
            value = jnp.asarray(speed if name.endswith("velocity") else angle, float)
            state = eqx.tree_at(lambda at, name=name: getattr(at.plant, name), state, value)
    state = eqx.tree_at(lambda at: (at.controller, at.observer), state, start, is_leaf=lambda leaf: leaf is None)
    name = "measured_position" if position else "measured_velocity"
    run = simulate(
        loop,
        Recorded(np.asarray(record.reference), record.dt),
        dt=record.dt,
        samples=len(record.time),
        solver="exact",
        stepping="sampled",
        substeps=SUBSTEPS[structure_of(machine)],
        record=(name,),
        initial=state,
        key=jax.random.key(SEED),
    )
    values = np.asarray(run.signals[name])
    return values - float(machine.origin) if position else values


def _late(machine: Machine, record: Record, step: float) -> tuple[Any, Any]:
    """Actuator and sensor with history enough for their dead times, the sensor with the log's noise."""
    actuator, sensor = machine.actuator, machine.sensor
    kept = [
        1 if delay is None else math.ceil(float(delay) / record.dt) + HISTORY
        for delay in (actuator.delay, sensor.delay)
    ]
    step = step or float(sensor.step_size)
    changes: dict[str, Any] = {"longest_delay": kept[1], "step_size": jnp.asarray(step)}
    for name, channel, rounded in (
        ("noise", record.reading, step),
        ("position_noise", record.position, float(sensor.position_step)),
    ):
        if channel is not None and float(getattr(sensor, name)) == 0.0:
            changes[name] = jnp.asarray(math.sqrt(max(channel.noise**2 - rounded**2 / 12.0, 0.0)))
    return dataclasses.replace(actuator, longest_delay=kept[0]), dataclasses.replace(sensor, **changes)


def withheld_samples(record: Record) -> np.ndarray:
    """True for samples of withheld windows, shape (samples,)."""
    keep = np.zeros(len(record.time), bool)
    for start in record.starts[record.withheld]:
        keep[start : start + record.samples] = True
    return keep


def rms_or_infinite(values: np.ndarray) -> float:
    """Root mean square; infinite where any value is not finite."""
    return rms(values) if np.all(np.isfinite(values)) else math.inf


def _channel(record: Record, signal: str) -> Channel | None:
    return record.position if signal == "position" else record.reading


def _readings(channel: Any) -> np.ndarray | None:
    return None if channel is None else channel.values


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
