"""Simulate a velocity loop spoilt by friction, with and without a Friedland-Park observer.

Run: python examples/01_simulate.py --out out
"""

import argparse
import pathlib

import matplotlib.pyplot as plt

import fpjax as fp


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)

    # A gimbal of 10 kg m^2 with 20 N m of Coulomb friction, asked for a slow sine of 1 rad/s.
    friction = fp.CoulombViscous(coulomb=20.0, viscous=2.0, steepness=500.0)
    plant = fp.OneMass(inertia=10.0, friction=friction)
    controller = fp.ProportionalIntegral(kp=800.0, ki=8000.0)
    observer = fp.ExtendedFriedlandPark(inertia=10.0, gain_1=500.0, gain_2=500.0, steepness=500.0)
    reference = fp.Sine(amplitude=1.0, frequency=0.5)

    measures = {"velocity MAE [rad/s]": fp.MeanAbsolute()}
    record = ("time", "reference", "velocity", "compensation", "friction")
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 5), layout="constrained")
    for label, loop in (
        ("without observer", fp.ClosedLoop(plant, controller)),
        ("with EFP observer", fp.ClosedLoop(plant, controller, observer)),
    ):
        run = fp.simulate(loop, reference, dt=1e-3, duration=4.0, solver="rk4", measures=measures, record=record)
        error = run.signals["reference"] - run.signals["velocity"]
        above.plot(run.time, 1e3 * error, label=label)
        print(f"{label}: {run.message}, velocity MAE {float(run.measures['velocity MAE [rad/s]']):.5f} rad/s")
    below.plot(run.time, run.signals["friction"], label="friction")
    below.plot(run.time, run.signals["compensation"], "--", label="compensation")
    above.set_ylabel("velocity error [mrad/s]")
    below.set_ylabel("torque [N m]")
    below.set_xlabel("time [s]")
    above.legend(loc="upper right")
    below.legend(loc="upper right")
    figure.savefig(out / "01_simulate.png", dpi=150)


if __name__ == "__main__":
    main()
