"""Replay of the exported body in the `mujoco` package, under the loop's own sensor and control law."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..blocks.plants.masses import OneMassState, SeriesTwoMassState
from ..blocks.signals import PlantOutput
from ..errors import InputError
from ..simulation.loop import ClosedLoop
from ..simulation.scan import after_last


def find_mujoco() -> Any:
    """The mujoco package; None where it is not installed."""
    try:
        import mujoco
    except ImportError:
        return None
    return mujoco


def takes(mujoco: Any, actuator: str) -> bool:
    """Whether this version of MuJoCo accepts an actuator element with these attributes: a small model is compiled."""
    text = (
        '<mujoco><worldbody><body><joint name="j"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
        f"</worldbody><actuator>{actuator}</actuator></mujoco>"
    )
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError:
        return False
    return True


def replay_mujoco(
    mujoco: Any, text: str, loop: ClosedLoop, state: Any, reference: np.ndarray, dt: float, substeps: int,
    limit: float | None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Signals of the closed loop with MuJoCo as the plant.

    Args:
        mujoco: the package.
        text: MJCF or URDF; without an actuator the torque is applied to the first joint.
        loop: gives the sensor and the control law.
        state: of the loop at the first sample.
        reference: shape (samples,).
        dt: control period [s].
        substeps: MuJoCo's steps per control period.
        limit: of the torque [N m] where it is applied to the joint directly, without an actuator.

    Returns:
        The commanded "torque" and the measured "velocity" and "position", each of shape (samples,).

    Raises:
        InputError: where MuJoCo rejects the text or the loop diverges.
    """
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise InputError(f"MuJoCo {mujoco.__version__} rejects the model: {str(error).splitlines()[0]}.") from error
    model.opt.timestep = dt / substeps
    data = mujoco.MjData(model)
    plant: Any = state.plant
    alone = isinstance(plant, OneMassState | SeriesTwoMassState)  # their fields have no prefix motor_ or load_
    sides = ("motor_", "load_") if model.nv > 1 else ("",) if alone else ("load_",)
    for place, side in enumerate(sides):
        data.qpos[place] = float(getattr(plant, f"{side}position"))
        data.qvel[place] = float(getattr(plant, f"{side}velocity"))
    motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, "torque")
    state = loop.sampled(state)
    memory, sensor = (state.controller, state.observer, state.period), state.sensor
    zero, period = jnp.zeros(()), jnp.asarray(dt)
    silent = tuple(zero for _ in range(loop.sensor.noise_channels))

    @jax.jit
    def control(memory: Any, sensor: Any, velocity: Any, position: Any, asked: Any, following: Any) -> Any:
        output = PlantOutput(velocity[-1], position[-1], velocity[0], position[0], zero)
        sensor, measurement = loop.sensor.step(sensor, output, silent, period)
        made = loop.control_law(memory, asked, measurement, period, following)
        return made.memory, sensor, (made.torque, measurement.velocity, measurement.position)

    shown = np.empty((len(reference), 3))
    following = np.append(reference[1:], after_last(loop.controller, reference))
    for sample, asked in enumerate(reference):
        motion = data.qvel.copy(), data.qpos.copy()
        memory, sensor, signals = control(memory, sensor, *motion, asked, following[sample])
        shown[sample] = [float(each) for each in signals]
        torque = shown[sample, 0]
        if motor >= 0:
            data.ctrl[motor] = torque
        else:
            data.qfrc_applied[0] = torque if limit is None else min(max(torque, -limit), limit)
        for _ in range(substeps):
            mujoco.mj_step(model, data)
        if not math.isfinite(torque) or abs(torque) > 1e15:
            raise InputError(f"The loop diverges in MuJoCo at t = {sample * dt:g} s: use more [simulation] substeps.")
    return dict(zip(("torque", "velocity", "position"), shown.T, strict=True))
