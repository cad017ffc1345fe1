"""`fpjax demo`: the main steps on an embedded example, by the commands that a user would type."""

import argparse
import pathlib
import shlex

from ..output.runfile import open_folder, write_whole
from .common import add_out

SERVO = """\
# A gimbal axis: 10 kg m^2 with 20 N m of Coulomb friction under a sampled PI velocity loop with a noisy gyro, and an
# EFP observer whose gains are too small. fpjax tune finds better ones.
[plant]
type = "one_mass"
inertia = 10.0               # kg m^2

[friction]
type = "coulomb_viscous"
coulomb = 20.0               # N m
viscous = 2.0                # N m s/rad
steepness = 1000.0           # s/rad, of the observer; the exact solver needs none

[controller]
type = "pi"
kp = 800.0                   # N m s/rad
ki = 8000.0                  # N m/rad
@OBSERVER@
[sensor]
noise = 1e-3                 # rad/s, each sample

[reference]
type = "sine"
amplitude = 1.0              # rad/s
frequency = 0.5              # Hz

[simulation]
dt = 1e-3                    # s, the control period
duration = 4.2               # s
stepping = "sampled"
solver = "exact"             # sticking resolved within the step
"""
OBSERVER = """
[observer]
type = "efp"
gain_1 = 5.0
gain_2 = 5.0
"""
EMPS = """\
# EMPS, a ball-screw axis: A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", 2019 Workshop on
# Nonlinear System Identification Benchmarks. Parameters and controller as published; the log has the reference.
[units]
motion = "linear"
reference = "position"
sensors = "position"

[plant]
type = "one_mass"
inertia = 95.1089            # kg

[friction]
type = "coulomb_viscous"
coulomb = 20.3935            # N
viscous = 203.5034           # N s/m
offset = -3.1648             # N

[controller]
type = "position_cascade"
kp = 160.18                  # 1/s
kv = 8557.2675               # N s/m: 243.45 V s/m x 35.15 N/V

[sensor]
side = "load"
delay = 1e-3                 # s: the drive takes the mean of two position differences, which is one period late

[simulation]
dt = 1e-3                    # s
stepping = "sampled"
substeps = 4
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("--emps", metavar="PATH", help="DATA_EMPS.mat: replay it and estimate its friction too")
    add_out(parser, required=True)


def run(arguments: argparse.Namespace) -> int:
    """Run the demo. Each step is a command, printed before it runs."""
    from .command_line import main

    folder = open_folder(arguments.out)
    assert folder is not None
    servo = folder / "servo.toml"
    bare = folder / "bare.toml"
    write_whole(bare, SERVO.replace("@OBSERVER@", ""))
    write_whole(servo, SERVO.replace("@OBSERVER@", OBSERVER))
    steps = [
        ("without an observer: friction spoils every reversal",
         ["simulate", str(bare), "--out", str(folder / "1-bare")]),
        ("with an observer, not tuned", ["simulate", str(servo), "--out", str(folder / "2-observer")]),
        ("tuned under noise by the gradient and by Algorithm 1, at the same objective and start",
         ["tune", str(servo), "--noise-seeds", "2", "--method", "levenberg_marquardt", "--method", "grid",
          "--method", "grid_repaired", "--out", str(folder / "3-tune")]),
        ("the whole landscape, to see where they ended",
         ["sweep", str(servo), "--noise-seeds", "2", "--axis", "observer.gain_1=1:1e5:32",
          "--axis", "observer.gain_2=1:1e5:32", "--tuned", str(folder / "3-tune"), "--out", str(folder / "4-sweep")]),
        ("with the tuned gains", ["simulate", str(folder / "3-tune" / "tuned.toml"), "--out", str(folder / "5-tuned")]),
    ]  # fmt: skip
    if arguments.emps:
        emps, log = folder / "emps.toml", str(pathlib.Path(arguments.emps))
        write_whole(emps, EMPS)
        steps += [
            ("a real axis: its log replayed",
             ["simulate", str(emps), "--log", log, "--columns", "emps", "--out", str(folder / "6-emps-replay")]),
            ("its friction by an observer, beside least squares",
             ["estimate", log, "--columns", "emps", "--model", str(emps), "--average", "6.24", "--out",
              str(folder / "7-emps-estimate")]),
        ]  # fmt: skip
    for number, (title, words) in enumerate(steps, 1):
        if arguments.no_cache:
            words = [*words, "--no-cache"]
        print(f"\n{number}. {title}\n$ fpjax {shlex.join(words)}", flush=True)
        code = main(words)
        if code:
            return code
    print(f"\nlook at {folder}/3-tune/tune.png and {folder}/4-sweep/sweep.html, then put your own servo.toml in place")
    return 0
