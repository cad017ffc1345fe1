"""`export_mujoco` and `export_urdf`: a model's mechanics for another simulator, replayed there and compared.

The replay runs the model's own control law around MuJoCo's body. The report says how far the result is off, and how
much each effect that the format cannot express contributes.
"""

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
from ..logs.arrays import rms
from ..logs.columns.units import is_label
from ..model_file import Model, ModelSource
from ..model_file.as_model import needed_model
from ..model_file.initial_state import initial_state
from ..output.paths import expanded
from ..output.runfile import made_folder, write_whole
from ..simulation.loop import ClosedLoop
from ..simulation.solvers import ExactSticking, get_solver
from .body import Body, Leftover, body_of
from .mjcf import mjcf, urdf
from .mujoco_replay import find_mujoco, replay_mujoco, takes

Target = Literal["mujoco", "urdf"]
# [s] MuJoCo's step is at most this: its dry friction changes sign between steps, so a longer one smears the reversal.
FINEST = 0.25e-3
_MOTION = ("velocity", "position")


@dataclasses.dataclass(frozen=True)
class ExportedBody:
    """The result of `export_mujoco` or `export_urdf`.

    Attributes:
        file: the file that was written.
        body: the parameters in it.
        against: what the replay is compared with: a log's name, or "fpjax" for the model's own simulation.
        errors: by quantity ("torque", "velocity", "position"): the rms error of fpjax, that of the target, and the rms
            of the quantity itself [each in the quantity's unit]; empty where nothing was replayed.
        costs: by effect that the target cannot express: by how much leaving it out increases the rms error of the
            tracked motion [its unit].
        tracked: "velocity" or "position".
        notes: sentences for the user.
    """

    file: pathlib.Path
    body: Body
    against: str
    errors: dict[str, tuple[float, float, float]]
    costs: dict[str, float]
    tracked: str
    notes: tuple[str, ...]


def export_mujoco(model: ModelSource, folder: str | os.PathLike[str], *, log: Log | None = None) -> ExportedBody:
    """Write a model's mechanics as MJCF, replay them in MuJoCo under the model's control law, and compare.

    Args:
        model: a `Model` or a servo.toml, with a known controller to be replayed.
        folder: where NAME.xml is written; created if missing.
        log: a log with a reference to replay; None for the model's own reference.

    Raises:
        InputError: for a plant that MJCF cannot express, or a folder that cannot be written.
    """
    return _export(model, folder, log, "mujoco")


def export_urdf(model: ModelSource, folder: str | os.PathLike[str], *, log: Log | None = None) -> ExportedBody:
    """Write a model's mechanics as URDF, replay them in MuJoCo under the model's control law, and compare.

    Args:
        model: a `Model` or a servo.toml, with a known controller to be replayed.
        folder: where NAME.urdf is written; created if missing.
        log: a log with a reference to replay; None for the model's own reference.

    Raises:
        InputError: for a plant that URDF cannot express, or a folder that cannot be written.
    """
    return _export(model, folder, log, "urdf")


def _export(source: ModelSource, folder: str | os.PathLike[str], log: Log | None, target: Target) -> ExportedBody:
    model = needed_model(source, f"export_{target}")
    # Without MuJoCo installed the file is written for its newest version, which has dcmotor and delays; else what this
    # version takes is tried out.
    mujoco, notes = find_mujoco(), []
    stem = re.sub(r"\W", "_", model.path.stem) if model.path else "servo"
    substeps = max(model.substeps, math.ceil(model.dt / FINEST - 1e-9))
    dcmotor = mujoco is None or takes(mujoco, '<dcmotor joint="j" motorconst="1" resistance="1" lugre="1 0 1 1 1"/>')
    delays = mujoco is None or takes(mujoco, '<general joint="j" delay="0.1" nsample="4"/>')
    dry = isinstance(get_solver(model.solver), ExactSticking)
    body = body_of(model.loop, shaft=target == "mujoco", lugre=target == "mujoco" and dcmotor, dry=dry)
    if target == "mujoco":
        timestep = model.dt / substeps
        text = mjcf(body, name=stem, linear=model.linear, timestep=timestep, dcmotor=dcmotor, delays=delays).replace(
            "DELAY_SAMPLES", str(math.ceil(body.delay / timestep) + 2)
        )
    else:
        text = urdf(body, name=stem, linear=model.linear)
    folder = made_folder(expanded(folder))
    file = folder / f"{stem}.{'xml' if target == 'mujoco' else 'urdf'}"
    write_whole(file, text)
    tracked = "position" if model.units.reference == "position" else "velocity"
    if is_label(model.units.torque):
        notes.append(_not_si(model, file.name, "MuJoCo" if target == "mujoco" else "URDF"))
    if mujoco is None:
        notes.append(
            f'mujoco is not installed, so {file.name} was written but not replayed: pip install "fpjax[mujoco]".'
        )
        return ExportedBody(file, body, "", {}, {}, tracked, tuple(notes))
    if not model.controller_known:
        notes.append(f"[controller] is unknown, so {file.name} was written but not replayed: a replay needs the loop.")
        return ExportedBody(file, body, "", {}, {}, tracked, tuple(notes))
    record, reference, state, against = _record(model, log)
    # Signals by quantity, each of shape (samples,): of the target, and of fpjax.
    theirs = replay_mujoco(
        mujoco, text, model.loop, state, reference, model.dt, substeps, body.limit if target == "urdf" else None
    )
    ours = _simulated(model, model.loop, reference, state)
    errors = {
        name: (rms(ours[name] - values), rms(theirs[name] - values), rms(values)) for name, values in record.items()
    }
    costs = {left.name: _cost(model, left, reference, log, record, ours, tracked) for left in body.leftovers}
    return ExportedBody(file, body, against, errors, costs, tracked, tuple(notes))


def _not_si(model: Model, file: str, target: str) -> str:
    """The sentence on a model whose torque is in units of a label."""
    units = model.units
    force = "N" if model.linear else "N m"
    return (
        f"Inertia, friction and damping in {file} are in units of {units.torque}, as the torque of the model is "
        f"({units.name('kg m^2')} for the inertia), but {target} takes SI: the machine moves as it does here when "
        f"it is driven with {units.torque}, and it is wrong beside bodies and forces in SI. With a torque constant "
        f"[{force}/{units.torque}], multiply all torques, inertias, friction, stiffness and gains of the model by it, "
        f'and write [units] torque = "{force}".'
    )


def _record(model: Model, log: Log | None) -> tuple[dict[str, np.ndarray], np.ndarray, Any, str]:
    """(signals to compare with, the reference, the initial state, where the signals come from)."""
    if log is not None:
        if log.reference is None:
            raise InputError(f"{log.name} has no column reference, so nothing can be replayed: run without --log.")
        if abs(log.dt / model.dt - 1.0) > 1e-3:
            raise InputError(
                f"{log.name} has a period of {log.dt:g} s, but the model has dt = {model.dt:g} s: write the log's into "
                "[simulation]."
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
    """By how much leaving one effect out increases fpjax' own rms error of the tracked motion [its unit]."""
    loop = left.without(model.loop)
    state = loop.init() if log is None else initial_state(dataclasses.replace(model, loop=loop), log)
    name = tracked if tracked in record else "torque"
    model = dataclasses.replace(model, solver=left.solver or model.solver)
    found = _simulated(model, loop, reference, state)[name]
    return rms(found - record[name]) - rms(ours[name] - record[name])
