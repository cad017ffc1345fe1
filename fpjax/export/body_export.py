"""`export_mujoco` and `export_urdf`: a model's body for another simulator, replayed there, what it costs said."""

import dataclasses
import math
import os
import pathlib
import re
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..logs import Log
from ..model_file import Model
from ..model_file.initial_state import initial_state
from ..output.runfile import write_whole
from ..simulation.loop import ClosedLoop
from .body import Body, Leftover, body_of
from .mjcf import mjcf, urdf
from .mujoco_replay import find_mujoco, replay_mujoco, takes

Target = Literal["mujoco", "urdf"]
FINEST = 0.25e-3  # [s]: MuJoCo's step at most, as friction switches within one
_MOTION = ("velocity", "position")


@dataclasses.dataclass(frozen=True)
class ExportedBody:
    """What `export_mujoco` or `export_urdf` wrote.

    Attributes:
        file: the file.
        body: the numbers in it.
        against: what the errors are against: a log's name, or "fpjax" for the model's own simulation.
        errors: by quantity ("torque", "velocity", "position"): rms error of fpjax and of the target [the quantity's
            unit], and the rms of what they are compared with; empty where nothing was replayed.
        costs: by what the target cannot hold: how much larger it makes the error of the tracked motion [its unit].
        tracked: "velocity" or "position".
        notes: what the user should know.
    """

    file: pathlib.Path
    body: Body
    against: str
    errors: dict[str, tuple[float, float, float]]
    costs: dict[str, float]
    tracked: str
    notes: tuple[str, ...]


def export_mujoco(model: Model, folder: str | os.PathLike[str], *, log: Log | None = None) -> ExportedBody:
    """Write a model's body as MJCF, replay it in MuJoCo under the model's control law, say what it cannot hold.

    Args:
        model: with a known controller, to be replayed.
        folder: where NAME.xml goes; made if missing.
        log: a record with a reference to replay; None for the model's own reference.

    Raises:
        InputError: for a plant without words there, or a folder that cannot be written.
    """
    return _export(model, folder, log, "mujoco")


def export_urdf(model: Model, folder: str | os.PathLike[str], *, log: Log | None = None) -> ExportedBody:
    """Write a model's body as URDF, replay it in MuJoCo under the model's control law, say what it cannot hold.

    Args:
        model: with a known controller, to be replayed.
        folder: where NAME.urdf goes; made if missing.
        log: a record with a reference to replay; None for the model's own reference.

    Raises:
        InputError: for a plant without words there, or a folder that cannot be written.
    """
    return _export(model, folder, log, "urdf")


def _export(model: Model, folder: str | os.PathLike[str], log: Log | None, target: Target) -> ExportedBody:
    mujoco, notes = find_mujoco(), []
    stem = re.sub(r"\W", "_", model.path.stem) if model.path else "servo"
    substeps = max(model.substeps, math.ceil(model.dt / FINEST - 1e-9))
    dcmotor = mujoco is None or takes(mujoco, '<dcmotor joint="j" motorconst="1" resistance="1" lugre="1 0 1 1 1"/>')
    delays = mujoco is None or takes(mujoco, '<general joint="j" delay="0.1" nsample="4"/>')
    body = body_of(model.loop, shaft=target == "mujoco", lugre=target == "mujoco" and dcmotor)
    if target == "mujoco":
        timestep = model.dt / substeps
        text = mjcf(body, name=stem, linear=model.linear, timestep=timestep, dcmotor=dcmotor, delays=delays).replace(
            "DELAY_SAMPLES", str(math.ceil(body.delay / timestep) + 2)
        )
    else:
        text = urdf(body, name=stem, linear=model.linear)
    folder = pathlib.Path(folder).expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror or error}): give another folder.") from error
    file = folder / f"{stem}.{'xml' if target == 'mujoco' else 'urdf'}"
    write_whole(file, text)
    tracked = "position" if model.units.reference == "position" else "velocity"
    if mujoco is None:
        notes.append(
            f'mujoco is not installed, so {file.name} was written but not replayed: pip install "fpjax[mujoco]".'
        )
        return ExportedBody(file, body, "", {}, {}, tracked, tuple(notes))
    if not model.controller_known:
        notes.append(f"[controller] is unknown, so {file.name} was written but not replayed: it is run in closed loop.")
        return ExportedBody(file, body, "", {}, {}, tracked, tuple(notes))
    record, reference, state, against = _record(model, log)
    theirs = replay_mujoco(
        mujoco, text, model.loop, state, reference, model.dt, substeps, body.limit if target == "urdf" else None
    )
    ours = _simulated(model, model.loop, reference, state)
    errors = {
        name: (_rms(ours[name] - values), _rms(theirs[name] - values), _rms(values)) for name, values in record.items()
    }
    costs = {left.name: _cost(model, left, reference, log, record, ours, tracked) for left in body.leftovers}
    return ExportedBody(file, body, against, errors, costs, tracked, tuple(notes))


def _record(model: Model, log: Log | None) -> tuple[dict[str, np.ndarray], np.ndarray, Any, str]:
    """(what is compared with, the reference, the first state, whose it is)."""
    if log is not None:
        if log.reference is None:
            raise InputError(f"{log.name} has no column reference, so nothing can be replayed: leave --log away.")
        if abs(log.dt / model.dt - 1.0) > 1e-3:
            raise InputError(
                f"{log.name} has a period of {log.dt:g} s and the model dt = {model.dt:g} s: write the log's."
            )
        found = {"torque": log.torque} | {
            name: getattr(log, name) for name in _MOTION if getattr(log, name) is not None
        }
        return found, np.asarray(log.reference), initial_state(model, log), log.name
    time = model.dt * np.arange(round(min(model.needed_duration(), 10.0) / model.dt) + 1)
    reference = np.asarray(model.needed_reference().readout(jnp.asarray(time)), dtype=float)
    state = model.loop.init()
    return _simulated(model, model.loop, reference, state), reference, state, "fpjax"


def _simulated(model: Model, loop: ClosedLoop, reference: np.ndarray, state: Any) -> dict[str, np.ndarray]:
    from ..blocks.references import Recorded
    from ..simulation.run import simulate

    names = {"torque": "torque", "velocity": "measured_velocity", "position": "measured_position"}
    run = simulate(
        loop, Recorded(reference, model.dt), dt=model.dt, samples=len(reference), solver=model.solver,
        stepping="sampled", substeps=model.substeps, record=tuple(names.values()), initial=state,
    )  # fmt: skip
    if run.diverged:
        raise InputError("The sampled simulation diverges, so there is nothing to compare with: see fpjax simulate.")
    return {name: np.asarray(run.signals[signal], dtype=float) for name, signal in names.items()}


def _cost(
    model: Model, left: Leftover, reference: np.ndarray, log: Log | None, record: dict[str, np.ndarray],
    ours: dict[str, np.ndarray], tracked: str,
) -> float:  # fmt: skip
    """What leaving one effect out adds to fpjax's own error of the tracked motion."""
    loop = left.without(model.loop)
    state = loop.init() if log is None else initial_state(dataclasses.replace(model, loop=loop), log)
    name = tracked if tracked in record else "torque"
    found = _simulated(model, loop, reference, state)[name]
    return _rms(found - record[name]) - _rms(ours[name] - record[name])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
