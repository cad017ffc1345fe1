"""A log, and the friction in it: an observer over the record beside least squares.

Run: python examples/03_estimate.py --out out
"""

import argparse
import pathlib

import numpy as np

import fpjax as fp

BELT = pathlib.Path(__file__).parent / "gallery" / "belt_axis.toml"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
    out = parser.parse_args().out
    # The log comes from the simulator here; yours comes from a drive: log = fp.read_log("run.csv").
    run = fp.simulate(BELT)
    held = {name: np.asarray(run.signals[name]) for name in ("torque", "velocity", "position", "reference")}
    log = fp.Log(np.asarray(run.time), **held, dt=1e-3, name="belt axis", linear=True, torque_unit="N")
    log.plot(out / "03_log.png")
    found = fp.estimate(log, BELT)
    print(found)
    found.plot(out / "03_estimate.png")


if __name__ == "__main__":
    main()
