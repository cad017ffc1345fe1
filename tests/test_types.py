"""Types and shapes of blocks, simulation, analysis, logs and model files, checked at run time.

In a process of its own: the check must stand before the package is imported, and the diagnosis lets numpy arrays stand
for jax arrays.
"""

import pathlib
import subprocess
import sys

MODEL = pathlib.Path(__file__).parents[1] / "examples" / "gimbal.toml"

CODE = """
import jax, sys, warnings
from jaxtyping import TypeCheckError, install_import_hook
jax.config.update("jax_enable_x64", True)
warnings.simplefilter("ignore")
checked = ("blocks", "simulation", "analysis", "logs", "model_file")
hook = install_import_hook([f"fpjax.{name}" for name in checked], "beartype.beartype")
import jax.numpy as jnp, numpy as np, fpjax as fp
from fpjax.logs.dynamics.regression import fit_pairs
from fpjax.simulation.scan import make_inputs, make_stepper, roll

observer = fp.ExtendedFriedlandPark(1.0, 9.0, 9.0, 40.0)
loop = fp.ClosedLoop(fp.OneMass(1.0, fp.CoulombViscous(2.0, 0.2, 40.0)), fp.Proportional(9.0), observer)
measures = {"mean": fp.MeanAbsolute(), "largest": fp.Largest(fp.velocity_error)}
for stepping in ("continuous", "sampled"):
    stepper = make_stepper(dt=1e-3, samples=20, stepping=stepping)
    inputs = make_inputs(loop, fp.Sine(1.0, 1.0), stepper)
    shapes = jax.eval_shape(lambda *all: roll(*all, measures, ("velocity", "torque")), loop, inputs, stepper)
    print(shapes[1]["velocity"].shape)
velocity = np.sin(np.linspace(0.0, 12.0, 400))
log = fp.read_log({"time": 1e-3 * np.arange(400), "torque": np.cos(velocity), "velocity": velocity})
print(log.velocity.shape, fp.load_model(fp.dump_model(fp.load_model(sys.argv[1]))).dt)
print(fp.assess_excitation(loop.observer, velocity, 1e-3, {"coulomb": 2.0, "viscous": 0.2}).names)
for wrong in (
    lambda: fit_pairs(np.zeros(5), np.linspace(0.0, 1.0, 5), 1e-3, 1.0),
    lambda: make_inputs(loop, 1.0, make_stepper(dt=1e-3, samples=4)),
):
    try:
        wrong()
    except TypeCheckError:
        print("found")
"""


def test_what_runs_keeps_its_types_and_what_is_of_the_wrong_length_or_kind_is_found():
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(MODEL)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["(20,)", "(20,)", "(400,) 0.001", "('coulomb', 'viscous')", "found", "found"]
