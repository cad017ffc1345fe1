"""Simulate a velocity loop spoilt by friction, with and without a Friedland-Park observer.

Run: python examples/01_simulate.py --out out
"""

import argparse
import pathlib

import fpjax as fp
from fpjax.output.plotting import COMPENSATED, REFERENCE, UNCOMPENSATED, new_figure, save, style


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
    out = parser.parse_args().out

    # A gimbal of 10 kg m^2 with 20 N m of Coulomb friction, asked for a slow sine of 1 rad/s.
    friction = fp.CoulombViscous(coulomb=20.0, viscous=2.0, steepness=500.0)
    plant = fp.OneMass(inertia=10.0, friction=friction)
    controller = fp.ProportionalIntegral(kp=800.0, ki=8000.0)
    observer = fp.ExtendedFriedlandPark(inertia=10.0, gain_1=100.0, gain_2=500.0, steepness=500.0)
    reference = fp.Sine(amplitude=1.0, frequency=0.5)

    record = ("reference", "velocity", "friction", "compensation")
    figure, axes = new_figure(2, share_x=True, title="A velocity loop at four reversals")
    above, below = axes[:, 0]
    with style():
        for label, colour, loop in (
            ("without observer", UNCOMPENSATED, fp.ClosedLoop(plant, controller)),
            ("with the EFP observer", COMPENSATED, fp.ClosedLoop(plant, controller, observer)),
        ):
            measures = {"error": fp.MeanAbsolute()}
            run = fp.simulate(loop, reference, dt=1e-3, duration=4.2, measures=measures, record=record)
            error = run.signals["reference"] - run.signals["velocity"]
            above.plot(run.time, 1e3 * error, color=colour, label=label)
            print(f"{label}: {run.message}, mean |r - w| = {1e3 * float(run.measures['error']):.2f} mrad/s")
        below.plot(run.time, run.signals["friction"], color=REFERENCE, label="friction")
        below.plot(run.time, run.signals["compensation"], "--", color=COMPENSATED, label="compensation")
        above.set_ylabel("velocity error [mrad/s]")
        below.set_ylabel("torque [N m]")
        below.set_xlabel("time [s]")
        for row in (above, below):  # above the axes, where no line runs
            row.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=2)
    print(f"wrote {save(figure, out / '01_simulate.png')}")


if __name__ == "__main__":
    main()
