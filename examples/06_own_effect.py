"""An effect of your own: a cable that pulls the axis back, in twenty lines, fitted and named by the diagnosis.

Run: python examples/06_own_effect.py --out out
"""

import argparse
import pathlib
from collections.abc import Mapping

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

import fpjax as fp
from fpjax.blocks.block import as_parameter
from fpjax.blocks.position_torque import Loads
from fpjax.blocks.signals import Motion
from fpjax.gap import EFFECTS, Effect, EffectParameter, Machine, diagnose

NOMINAL = """
[units]
sensors = "both"
[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.1
viscous = 0.03
[controller]
type = "pi"
kp = 3.0
ki = 30.0
[reference]
type = "multisine"
amplitudes = [4.0, 1.5]
frequencies = [0.53, 1.31]
[sensor]
noise = 2e-3
position_noise = 2e-5
[simulation]
dt = 0.001
duration = 4.0
stepping = "sampled"
solver = "exact"
"""
CANDIDATES = ("coulomb_error", "viscous_error", "inertia_error", "constant_torque", "quadratic_drag")


# 1. The physics: a block like any other.
class Cable(fp.AbstractLoad):
    """A cable that pulls back to position zero: stiffness x position [N m], stiffness in [N m/rad]."""

    stiffness: Array = eqx.field(converter=as_parameter)

    def readout(self, motion: Motion) -> Array:
        """Torque that the motor must hold [N m]."""
        return self.stiffness * motion.position


# 2. How it changes the machine; at stiffness 0 the machine is exactly as it was.
def add_cable(machine: Machine, values: Mapping[str, Array]) -> Machine:
    loads = Loads((*machine.plant.load.parts, Cable(values["cable_stiffness"])))
    return eqx.tree_at(lambda at: at.plant.load, machine, loads)


# 3. What is fitted, between which bounds; sizes come from the log and the nominal model.
STIFFNESS = EffectParameter(
    name="cable_stiffness",
    unit="N m/rad",
    neutral=lambda setting: 0.0,
    low=lambda setting: 0.0,
    high=lambda setting: 10.0 * setting.torque / setting.travel,
    scale=lambda setting: 0.1 * setting.torque / setting.travel,
)
CABLE = Effect("cable_spring", (STIFFNESS,), apply=add_cable, features=())


def record() -> dict[str, np.ndarray]:
    """A machine with a cable of 0.15 N m/rad, as its drive would log it."""
    machine = fp.load_model(NOMINAL)
    columns = {"torque": "torque", "velocity": "measured_velocity", "position": "measured_position"}
    run = fp.simulate(
        eqx.tree_at(lambda at: at.plant.load, machine.loop, Cable(0.15)),
        machine.needed_reference(),
        dt=machine.dt,
        duration=machine.duration,
        stepping=machine.stepping,
        solver=machine.solver,
        record=tuple(columns.values()),
        key=jax.random.key(0),
    )
    return {"time": np.asarray(run.time)} | {name: np.asarray(run.signals[at]) for name, at in columns.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
    out = parser.parse_args().out
    jax.config.update("jax_enable_x64", True)  # an encoder's noise of 2e-5 rad drowns in single precision

    # Leave `if ...` out to weigh it against the whole vocabulary: a minute instead of seconds.
    candidates = tuple(effect for effect in EFFECTS if effect.name in CANDIDATES)
    found = diagnose(record(), NOMINAL, effects=(*candidates, CABLE))
    print(found)
    print(f"wrote {found.report(out)}")
    found.plot(out / "06_own_effect.png")


if __name__ == "__main__":
    main()
