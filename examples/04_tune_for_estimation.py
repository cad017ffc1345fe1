"""Tune an observer so that it estimates: gains whose slow mode is seconds, at the thesis' own operating point.

The thesis' cost (the final error) tunes a transient to pass through the truth at t = T; its gains have a slow mode of
minutes and return b_hat = 2 whatever b is. The time-averaged error over several true plants finds gains that follow b,
and shows what they cost: the swing of b_hat on its way, and the noise.

Run: python examples/04_tune_for_estimation.py --out out
"""

import argparse
import math
import pathlib

import jax
import numpy as np
from matplotlib import rc_context

import fpjax as fp
import tuning
from fpjax.output.plotting import BLUE, RED, STYLE, new_figure, save

DEGREE = math.pi / 180.0  # the thesis' loop runs in deg/s: inertia and viscous friction are scaled by this
INERTIA, DT, STEEPNESS = 10.0 * DEGREE, 2e-4, 100.0
TRUE_VISCOUS = (1.0, 2.0, 5.0, 10.0, 20.0)  # N m s/rad
NOISE = 1e-3  # deg/s, standard deviation of the measured velocity
REFERENCE = fp.Sine(amplitude=1.0, frequency=1.0)


def loop_with(gain_2: float, gain_1: float, viscous: float = 2.0, noise: float | None = None) -> fp.ClosedLoop:
    """The thesis' loop with EFP (Table 4.1), smooth laws; gains and b in the thesis' units."""
    friction = fp.CoulombViscous(20.0, viscous * DEGREE, STEEPNESS)
    observer = fp.ExtendedFriedlandPark(INERTIA, gain_1 * DEGREE, gain_2, STEEPNESS)
    sensor = fp.IdealSensor() if noise is None else fp.Gyro(noise=noise)
    plant = fp.OneMass(INERTIA, friction)
    return fp.ClosedLoop(plant, fp.ProportionalIntegral(150.0, 200.0), observer, sensor=sensor)


def find_gains(starts: int = 6, iterations: int = 12) -> tuning.TuningResult:
    """The tuning: the mean squared error between 20 s and 30 s, over five true b."""
    return tuning.tune(
        loop_with(10.0, 100.0),
        REFERENCE,
        parameters=[
            tuning.Parameter("observer.gain_2", low=1.0, high=1e3),
            tuning.Parameter("observer.gain_1", low=DEGREE, high=1e6 * DEGREE),
        ],
        objective=tuning.Estimation(start=20.0),
        plants={"plant.friction.viscous": [viscous * DEGREE for viscous in TRUE_VISCOUS]},
        method=tuning.LBFGS(iterations=iterations),
        starts=starts,
        spread=2.0,
        dt=DT,
        duration=30.0,
        progress=True,
    )


def slow_mode(gain_2: float, gain_1: float) -> str:
    """What the theory says of these gains: the time constant of the slowest estimate error."""
    velocity = np.sin(2.0 * np.pi * DT * np.arange(round(1.0 / DT)))
    truth = {"coulomb": 20.0, "viscous": 2.0 * DEGREE}
    found = fp.assess_excitation(loop_with(gain_2, gain_1).observer, velocity, DT, truth, duration=30.0)
    return f"slow mode {found.slow_mode:.3g} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
    out = parser.parse_args().out
    jax.config.update("jax_enable_x64", True)
    with rc_context(STYLE):
        tune_and_draw(out)


def tune_and_draw(out: pathlib.Path) -> None:
    result = find_gains()
    print(result)
    tuned = (result.gains["observer.gain_2"], result.gains["observer.gain_1"] / DEGREE)
    figure, ((swing, late), (error, noisy)) = new_figure(2, 2, size=(9.0, 6.0))
    for label, gains, colour in (("thesis' gains", (72.6, 298.0), RED), ("tuned gains", tuned, BLUE)):
        print(f"\n{label}: gain_2 = {gains[0]:.4g}, gain_1 = {gains[1]:.5g} (thesis' units), {slow_mode(*gains)}")
        for viscous in TRUE_VISCOUS:
            run = fp.simulate(
                loop_with(*gains, viscous=viscous), REFERENCE, dt=DT, duration=30.0, record=("estimates.viscous",)
            )
            estimate = np.asarray(run.signals["estimates.viscous"]) / DEGREE
            largest = np.abs(estimate).max()
            print(f"  true b = {viscous:4g}: b_hat(30 s) = {estimate[-1]:8.4f}, largest |b_hat| {largest:7.0f}")
            name = label if viscous == 2.0 else None
            swing.semilogy(run.time[::50], np.abs(estimate[::50]), color=colour, linewidth=0.8, label=name)
            late.plot(viscous, estimate[-1], "o", color=colour, label=name)
            error.semilogy(run.time[::50], np.abs(estimate[::50] / viscous - 1.0), color=colour, linewidth=0.8)
        run = fp.simulate(
            loop_with(*gains, noise=NOISE),
            REFERENCE,
            dt=DT,
            duration=30.0,
            stepping="sampled",
            record=("estimates.viscous",),
            key=jax.random.key(0),
        )
        estimate = np.asarray(run.signals["estimates.viscous"])[100_000:] / DEGREE
        print(
            f"  with {NOISE:g} deg/s of noise: b_hat = {estimate.mean():.3g} +- {estimate.std():.3g} over 20 s to 30 s"
        )
        noisy.plot(np.asarray(run.time)[100_000::20], estimate[::20], color=colour, linewidth=0.6)
    swing.set(title="the price: b_hat swings", xlabel="time [s]", ylabel="|b_hat| [N m s/rad]")
    late.plot([0.8, 25.0], [0.8, 25.0], "k:", label="b_hat = b")
    late.set(title="what it buys: b_hat(30 s) follows b", xlabel="true b [N m s/rad]", ylabel="b_hat [N m s/rad]")
    late.set(xscale="log", yscale="log")
    error.set(title="relative error of b_hat, five true b", xlabel="time [s]", ylabel="|b_hat / b - 1|")
    noisy.set(title=f"b_hat with {NOISE:g} deg/s of velocity noise, b = 2", xlabel="time [s]", ylabel="b_hat")
    swing.legend()
    late.legend()
    save(figure, out / "04_tune_for_estimation.png")


if __name__ == "__main__":
    main()
