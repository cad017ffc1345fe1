"""Replay of a log's reference through a model, and the difference of log and simulation."""

import dataclasses

import numpy as np

from ..errors import InputError
from ..logs import Log
from ..logs.arrays import rms
from ..model_file import Model
from ..model_file.initial_state import initial_state


@dataclasses.dataclass(frozen=True)
class Replay:
    """A log and its simulation.

    Attributes:
        log: the log.
        signals: simulated signals by name, each of shape (samples,).
        errors: by quantity: rms of log less simulation, its unit, and this relative to the log's rms [1].
        tracking: rms tracking error of the log and of the simulation.
        unit: of the tracked motion.
    """

    log: Log
    signals: dict[str, np.ndarray]
    errors: dict[str, tuple[float, str, float]]
    tracking: tuple[float, float]
    unit: str


def replay(model: Model, log: Log, record: tuple[str, ...] = (), *, from_rest: bool = False) -> Replay:
    """Simulate the closed loop with the log's reference, from the log's initial state.

    Args:
        model: with a known controller; it is always stepped "sampled", as the log was.
        log: with a reference.
        record: signals to keep besides those that are compared.
        from_rest: start at the log's first position without its velocity.

    Raises:
        InputError: without a reference or a controller, for another period, or for a run that diverged.
    """
    from .. import Recorded, simulate

    model.needed_controller()
    if log.reference is None:
        raise InputError(
            f"{log.name} has no column reference, so nothing can be replayed: map it with --columns reference=NAME, or "
            f"use fpjax estimate, which needs none."
        )
    if abs(log.dt / model.dt - 1.0) > 1e-3:
        raise InputError(
            f"{log.name} has a period of {log.dt:g} s, but the model has [simulation] dt = {model.dt:g} s: write "
            f"dt = {log.dt:g}."
        )
    compared = ("torque", "velocity", "position", "measured_velocity", "measured_position")
    run = simulate(
        model.loop,
        Recorded(log.reference, log.dt),
        dt=log.dt,
        samples=log.samples,
        solver=model.solver,
        stepping="sampled",
        substeps=model.substeps,
        record=tuple(dict.fromkeys((*compared, *record))),
        initial=initial_state(model, log, from_rest=from_rest),
    )
    signals = {name: np.asarray(values) for name, values in run.signals.items()}
    if run.diverged:
        raise InputError(f"The replay of {log.name} {run.message}; check the signs and units of model and log.")
    return _compared(model, log, signals)


def _compared(model: Model, log: Log, signals: dict[str, np.ndarray]) -> Replay:
    units = model.units
    pairs = [("torque", log.torque, signals["torque"], units.name("N m"))]
    if log.velocity is not None:
        pairs.append(("velocity", log.velocity, signals["measured_velocity"], units.name("rad/s")))
    if log.position is not None:
        pairs.append(("position", log.position, signals["measured_position"], units.name("rad")))
    errors = {}
    for name, recorded, simulated, unit in pairs:
        error, size = rms(recorded - simulated), rms(recorded)
        errors[name] = (error, unit, error / size if size > 0.0 else float("nan"))
    position = units.reference == "position"
    motion = log.position if position else log.velocity
    simulated = signals["measured_position" if position else "measured_velocity"]
    assert log.reference is not None
    recorded_error = float("nan") if motion is None else rms(log.reference - motion)
    unit = units.name("rad" if position else "rad/s")
    return Replay(log, signals, errors, (recorded_error, rms(log.reference - simulated)), unit)
