"""Tune a friction observer by gradients and by the thesis' Algorithm 1, and look at what each found.

Run: python examples/02_tune.py --out out
"""

import argparse
import pathlib

import fpjax as fp
import tuning
from fpjax.output.plotting import SERIES, TRUTH, new_figure, save, style


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
    out = parser.parse_args().out

    loop = fp.ClosedLoop(
        fp.OneMass(inertia=10.0, friction=fp.CoulombViscous(coulomb=20.0, viscous=2.0, steepness=500.0)),
        fp.ProportionalIntegral(kp=800.0, ki=8000.0),
        fp.ExtendedFriedlandPark(inertia=10.0, gain_1=10.0, gain_2=10.0, steepness=500.0),
    )
    reference = fp.Sine(amplitude=1.0, frequency=0.5)
    gains = ["observer.gain_1", "observer.gain_2"]

    candidates = {"as it was": loop}
    for method in ("grid", "levenberg_marquardt"):
        # One start from the same gains for both: Levenberg-Marquardt by default looks for better starts first.
        result = tuning.tune(loop, reference, parameters=gains, method=method, starts=1, dt=1e-3, duration=4.0)
        print(f"{result}\n")
        candidates[method] = result.apply(loop)

    figure, axes = new_figure(2, share_x=True, title="The observer's estimates over four seconds")
    with style():
        for (label, tuned), colour in zip(candidates.items(), SERIES, strict=False):
            run = fp.simulate(
                tuned, reference, dt=1e-3, duration=4.0, record=("estimates.coulomb", "estimates.viscous")
            )
            for row, name in zip(axes[:, 0], ("coulomb", "viscous"), strict=True):
                row.plot(run.time, run.signals[f"estimates.{name}"], color=colour, label=label)
        for row, true, unit in zip(axes[:, 0], (20.0, 2.0), ("Coulomb [N m]", "viscous [N m s/rad]"), strict=True):
            row.axhline(true, color=TRUTH, linestyle=":", label="true")
            row.set_ylabel(unit)
        axes[1, 0].set_xlabel("time [s]")
        axes[0, 0].legend(loc="lower right", ncols=4)
    print(f"wrote {save(figure, out / '02_tune.png')}")


if __name__ == "__main__":
    main()
