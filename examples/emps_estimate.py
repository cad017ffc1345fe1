"""Friction of a real axis (EMPS) from its log: an EFP observer tuned in simulation only, then run over the record.

    python examples/emps_estimate.py --log DATA_EMPS.mat --out out

Without --log (the data are not ours to give) the record is a simulated axis whose friction the tuning does not know.

The tuning sees simulated axes with the drive, the mass and the program of this one and with friction that nobody
knows: Coulomb anywhere from 3 to 100 N, viscous from 30 to 1000 N s/m, each with its own asymmetry, a mass 2 % off,
an unknown but subtracted offset, a quantised encoder. It never sees the record's torque.
"""

import argparse
import dataclasses
import pathlib

import jax
import jax.numpy as jnp
import numpy as np

import fpjax as fp
from fpjax.analysis.estimate import observe
from fpjax.logs.dynamics.derivative import measured_velocity

MODEL = pathlib.Path(__file__).parent / "emps.toml"
LAP = 6.24  # s, the program's period
COUNT = 5e-8  # m, the encoder's
MEMBERS = 24
PASSES = 4  # over the log: slow gains average over what depends on direction and place
GAIN_1, GAIN_2 = np.geomspace(1e3, 1e5, 13), np.geomspace(10.0, 1e3, 13)


@dataclasses.dataclass(frozen=True)
class Axes:
    """Simulated axes: true friction [N], [N s/m], and what a log would hold, one row an axis."""

    coulomb: np.ndarray
    viscous: np.ndarray
    torque: np.ndarray
    velocity: np.ndarray


def simulate_axes(model: fp.Model, log: fp.Log, seed: int) -> Axes:
    """Run the program on axes whose friction varies over one and a half decades."""
    random = np.random.default_rng(seed)
    coulomb = np.exp(random.uniform(np.log(3.0), np.log(100.0), MEMBERS))
    viscous = np.exp(random.uniform(np.log(30.0), np.log(1000.0), MEMBERS))
    skew_coulomb, skew_viscous = random.uniform(-0.1, 0.1, MEMBERS), random.uniform(-0.25, 0.25, MEMBERS)
    inertia = float(model.loop.plant.inertia) * (1.0 + random.uniform(-0.02, 0.02, MEMBERS))
    offset = random.uniform(-5.0, 5.0, MEMBERS)

    def run(k, b, skew_k, skew_b, mass, held):
        law = fp.AsymmetricCoulombViscous(
            k * (1 - skew_k), k * (1 + skew_k), b * (1 - skew_b), b * (1 + skew_b), steepness=2500.0
        )
        loop = fp.ClosedLoop(fp.OneMass(mass, law, fp.Unbalance(0.0, 0.0, held)), model.loop.controller)
        simulated = fp.simulate(
            loop,
            fp.Recorded(log.reference, log.dt),
            dt=log.dt,
            samples=log.samples,
            stepping="sampled",
            substeps=4,
            record=("torque", "position"),
        )
        return simulated.signals["torque"], simulated.signals["position"]

    varied = (coulomb, viscous, skew_coulomb, skew_viscous, inertia, offset)
    torque, position = (np.asarray(each) for each in jax.jit(jax.vmap(run))(*map(jnp.asarray, varied)))
    counted = np.round(position / COUNT) * COUNT
    velocity = [measured_velocity(dataclasses.replace(log, velocity=None, position=row))[0] for row in counted]
    return Axes(coulomb, viscous, torque[:, :-1] - offset[:, None], np.stack(velocity))


def tune(model: fp.Model, log: fp.Log, axes: Axes) -> tuple[float, float, float]:
    """(gain_1, gain_2, cost): the median over the axes of the last lap's mean squared relative error.

    The median, because on an axis where one of the two frictions carries next to no torque no gains can estimate it,
    and a mean is made of those axes alone.
    """
    last, dt = round(LAP / log.dt), jnp.asarray(log.dt)
    inertia = model.loop.plant.inertia

    def error(gain_1, gain_2, torque, velocity, coulomb, viscous):
        estimates = observe(fp.ExtendedFriedlandPark(inertia, gain_1, gain_2), torque, velocity, dt, PASSES)
        first = estimates["coulomb"][-last:] / coulomb - 1.0
        second = estimates["viscous"][-last:] / viscous - 1.0
        return jnp.mean(first**2 + second**2)

    over_axes = jax.vmap(error, in_axes=(None, None, 0, 0, 0, 0))
    data = tuple(map(jnp.asarray, (axes.torque, axes.velocity, axes.coulomb, axes.viscous)))
    row = jax.jit(jax.vmap(lambda first, second: jnp.median(over_axes(first, second, *data)), in_axes=(0, None)))
    costs = np.stack([np.asarray(row(jnp.asarray(GAIN_1), jnp.asarray(gain))) for gain in GAIN_2])
    best = np.unravel_index(np.nanargmin(costs), costs.shape)
    return float(GAIN_1[best[1]]), float(GAIN_2[best[0]]), float(costs[best])


def stand_in(model: fp.Model) -> fp.Log:
    """A record of a simulated axis on a smooth program of the same length and stroke, offset and all."""
    time = np.arange(round(4.0 * LAP / 1e-3)) * 1e-3
    program = 0.08 * (1.0 - np.cos(2.0 * np.pi * time / LAP)) + 0.02 * (1.0 - np.cos(6.0 * np.pi * time / LAP))
    law = fp.AsymmetricCoulombViscous(31.0, 33.0, 140.0, 180.0, steepness=2500.0)
    loop = fp.ClosedLoop(fp.OneMass(model.loop.plant.inertia, law, model.loop.plant.load), model.loop.controller)
    run = fp.simulate(
        loop,
        fp.Recorded(program, 1e-3),
        dt=1e-3,
        samples=len(time),
        stepping="sampled",
        substeps=4,
        record=("torque", "position"),
    )
    position = np.round(np.asarray(run.signals["position"]) / COUNT) * COUNT
    torque = np.asarray(run.signals["torque"])
    return fp.Log(time, torque, None, position, program, 1e-3, "simulated axis", True, "N")


def main(path: str | None = None, out: pathlib.Path = pathlib.Path("out"), seed: int = 0) -> fp.Estimated:
    """Tune in simulation, estimate on the record."""
    model = fp.load_model(MODEL)
    log = stand_in(model) if path is None else fp.read_log(path, columns="emps")
    truth = {"coulomb": 32.0, "viscous": 160.0} if path is None else {"coulomb": 20.3935, "viscous": 203.5034}
    gain_1, gain_2, cost = tune(model, log, simulate_axes(model, log, seed))
    print(f"tuned on {MEMBERS} simulated axes (seed {seed}): gain_1 = {gain_1:.4g}, gain_2 = {gain_2:.4g}, ", end="")
    print(f"median rms relative error {np.sqrt(cost):.3f}")
    observer = fp.ExtendedFriedlandPark(model.loop.plant.inertia, gain_1, gain_2)
    found = fp.estimate(log, observer, load=model.loop.plant.load, average=LAP, passes=PASSES)
    print(found)
    for name, value in truth.items():
        print(f"{name}: {found.final[name]:.4g} {found.unit(name)}, ", end="")
        print(f"{'true' if path is None else 'published'} {value}, {100.0 * (found.final[name] / value - 1.0):+.1f} %")
    found.plot(out / "emps_estimate.png")
    print(f"picture: {out / 'emps_estimate.png'}")
    return found


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--log", help="DATA_EMPS.mat or DATA_EMPS_PULSES.mat")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
    arguments = parser.parse_args()
    main(arguments.log, arguments.out)
