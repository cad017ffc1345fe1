"""Diagnose a sim-to-real gap: a machine whose friction rises towards rest, and a model that does not know it.

Run: python examples/05_diagnose.py --out out
"""

import argparse
import pathlib

import jax
import numpy as np

import fpjax as fp
from fpjax.gap import EFFECTS, diagnose

NOMINAL = """
[units]
sensors = "both"
[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.4
viscous = 0.03
[controller]
type = "pi"
kp = 3.0
ki = 30.0
[reference]
type = "multisine"
amplitudes = [1.0, 0.5]
frequencies = [1.1, 2.7]
[sensor]
noise = 2e-3
position_noise = 2e-5
[simulation]
dt = 0.001
duration = 4.0
stepping = "sampled"
solver = "exact"
"""
# What the machine has and the model does not: 0.2 N m of extra friction near rest, gone well above 0.15 rad/s.
STRIBECK = "stribeck_torque = 0.2\nstribeck_velocity = 0.15\n[controller]"

# Fewer candidates compile faster; leave `effects` out to ask for all of them.
CANDIDATES = ("coulomb_error", "viscous_error", "inertia_error", "stribeck", "asymmetric_friction", "torque_gain_error")


def record() -> dict[str, np.ndarray]:
    """What the drive would log: the commanded torque and both sensors' readings."""
    machine = fp.load_model(NOMINAL.replace("[controller]", STRIBECK))
    columns = {"torque": "torque", "velocity": "measured_velocity", "position": "measured_position"}
    run = fp.simulate(
        machine.loop,
        machine.needed_reference(),
        dt=machine.dt,
        duration=machine.duration,
        stepping=machine.stepping,
        solver=machine.solver,
        record=(*columns.values(), "reference"),
        key=jax.random.key(0),
    )
    log = {name: np.asarray(run.signals[signal]) for name, signal in columns.items()}
    return log | {"time": np.asarray(run.time), "reference": np.asarray(run.signals["reference"])}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
    out = parser.parse_args().out
    jax.config.update("jax_enable_x64", True)  # an encoder's noise of 2e-5 rad drowns in single precision

    found = diagnose(record(), NOMINAL, effects=tuple(effect for effect in EFFECTS if effect.name in CANDIDATES))
    print(found)
    print(f"wrote {found.report(out)}")
    found.plot(out / "05_diagnose.png")


if __name__ == "__main__":
    main()
