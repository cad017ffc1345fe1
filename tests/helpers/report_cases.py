"""Diagnoses as a report gets them, made from small simulated machines: one per verdict, and what is awkward to show.

What a fit would have found is set by hand near the truth; gaps, maps and shares are computed from simulated signals, so
pictures and numbers belong together.
"""

import dataclasses
import math

from numpy_machine import Machine
from report_machine import compare, gap_of, record, where_of

from fpjax import Diagnosis
from fpjax.gap import (
    Estimate,
    Experiment,
    FittedParameter,
    FreeReplay,
    Gap,
    Learned,
    Ranked,
    Share,
    Step,
    TrackingError,
    Where,
)

NOMINAL = """[units]
sensors = "both"

[plant]
type = "one_mass"
inertia = 0.05

[friction]
type = "coulomb_viscous"
coulomb = 0.4
viscous = 0.03

[simulation]
dt = 0.001
duration = 8.0
"""

PROVENANCE = {
    "command": "fpjax diagnose axis.csv --model servo.toml --out result",
    "inputs": [
        {"name": "axis.csv", "role": "fitted and withheld blocks", "sha256": "9f2c" * 16, "samples": 8000},
        {"name": "servo.toml", "role": "model", "sha256": "41ab" * 16},
    ],
    "versions": {"fpjax": "0.1.0", "jax": "0.12.0", "python": "3.12.4"},
    "started": "2026-11-21T12:30:05Z",
    "seeds": [0],
}
SECONDS = {"read": 0.11, "locate": 0.42, "screen": 4.8, "fit": 7.9, "withheld": 1.3}


def explained():
    """Stribeck friction, alone and clear; a position channel is there."""
    truth = Machine(stribeck=0.22)
    comparison = compare("axis.csv", truth, Machine(), Machine(stribeck=0.2187, stribeck_velocity=0.1509))
    _, torque, velocity, position = record(truth, 8.0)
    gap = gap_of(comparison, 2.02e-3)
    where = where_of(comparison, velocity, position, torque, Machine())
    ranking = (
        Ranked(
            "stribeck",
            0.962,
            gap.after,
            {
                "stribeck_torque": Estimate(0.2187, 0.2131, 0.2243, "N m"),
                "stribeck_velocity": Estimate(0.1509, 0.1466, 0.1552, "rad/s"),
            },
            evidence=4120.0,
        ),
        Ranked(
            "presliding",
            0.027,
            gap.before * 0.42,
            {
                "bristle_deflection": Estimate(3.11e-4, 2.2e-4, 4.1e-4, "rad"),
                "bristle_stiffness": Estimate(1286.0, 950.0, 1610.0, "N m/rad"),
            },
        ),
        Ranked("coulomb_error", 0.006, gap.before * 0.71, {"coulomb": Estimate(0.4386, 0.4301, 0.4471, "N m")}),
        Ranked("torque_dead_zone", 0.001, gap.before * 0.83, {"width": Estimate(0.041, 0.033, 0.049, "N m")}),
        Ranked(
            "compliance",
            0.0,
            gap.before * 0.98,
            {
                "frequency": Estimate(88.0, math.nan, math.nan, "Hz"),
                "stiffness": Estimate(3820.0, math.nan, math.nan, "N m/rad"),
            },
        ),
    )
    model = NOMINAL.replace(
        "coulomb = 0.4\n", "coulomb = 0.4012\nstribeck_torque = 0.2187\nstribeck_velocity = 0.1509\n"
    )
    return Diagnosis(
        "explained",
        ("stribeck",),
        ranking,
        gap,
        (Step("stribeck", gap.after, gap.after_interval),),
        where,
        (),
        model,
        (),
        (comparison,),
        (
            FittedParameter("inertia", 0.05002, 4.1e-5, "kg m^2", "pinned"),
            FittedParameter("coulomb", 0.4012, 7.2e-4, "N m", "pinned"),
            FittedParameter("viscous", 0.0297, 9.0e-4, "N m s/rad", "pinned"),
            FittedParameter("stribeck_torque", 0.2187, 3.4e-3, "N m", "pinned"),
            FittedParameter("stribeck_velocity", 0.1509, 2.6e-3, "rad/s", "traded off with stribeck_torque"),
        ),
        None,
        0.962,
        SECONDS,
        "rotary",
        NOMINAL,
        TrackingError("rad/s", 0.0712, 0.0489, 0.0708),
        PROVENANCE,
        free_replay=FreeReplay(0.34, 0.0121, 0.5, 1.6),
    )


def pair_with_twins():
    """Two causes, each with a twin that a velocity-only log cannot tell from it."""
    truth = Machine(constant=0.11, delay=4)
    comparison = compare("run_1.csv", truth, Machine(), Machine(constant=0.1097, delay=4), noise=3e-3)
    middle = compare("run_1.csv", truth, Machine(), Machine(constant=0.1097), noise=3e-3)
    _, torque, velocity, position = record(truth, 8.0)
    gap, one = gap_of(comparison, 3.0e-3), gap_of(middle, 3.0e-3)
    where = where_of(comparison, velocity, position, torque, Machine(), with_position=False)
    ranking = (
        Ranked(
            "constant_torque",
            0.24,
            one.after,
            {"torque": Estimate(0.1097, 0.1079, 0.1115, "N m")},
            ("asymmetric_friction",),
        ),
        Ranked(
            "asymmetric_friction",
            0.23,
            one.after,
            {
                "coulomb_positive": Estimate(0.2903, 0.2885, 0.2921, "N m"),
                "coulomb_negative": Estimate(0.5097, 0.5079, 0.5115, "N m"),
            },
            ("constant_torque",),
        ),
        Ranked(
            "actuator_delay", 0.22, gap.after, {"delay": Estimate(4.02e-3, 3.93e-3, 4.11e-3, "s")}, ("velocity_delay",)
        ),
        Ranked(
            "velocity_delay", 0.21, gap.after, {"delay": Estimate(4.02e-3, 3.93e-3, 4.11e-3, "s")}, ("actuator_delay",)
        ),
        Ranked("actuator_lag", 0.05, 1.6 * gap.after, {"time_constant": Estimate(4.4e-3, 4.1e-3, 4.7e-3, "s")}),
        Ranked(
            "compliance",
            0.02,
            1.9 * gap.after,
            {
                "frequency": Estimate(41.7, 36.0, 47.4, "Hz"),
                "stiffness": Estimate(858.0, 640.0, 1076.0, "N m/rad"),
            },
        ),
        Ranked("inertia_error", 0.004, 0.93 * gap.before, {"inertia": Estimate(0.0541, 0.0533, 0.0549, "kg m^2")}),
    )
    model = NOMINAL.replace('sensors = "both"', 'sensors = "velocity"')
    corrected = (
        model.replace("viscous = 0.03\n", "viscous = 0.0304\noffset = -0.1097\n") + "\n[actuator]\ndelay = 0.00402\n"
    )
    return Diagnosis(
        "explained",
        ("constant_torque", "actuator_delay"),
        ranking,
        gap,
        (Step("constant_torque", one.after, one.after_interval), Step("actuator_delay", gap.after, gap.after_interval)),
        where,
        (
            Experiment(
                ("constant_torque", "asymmetric_friction"),
                "Coast down both ways with the drive off: a constant torque acts at rest, friction does not.",
            ),
            Experiment(
                ("actuator_delay", "velocity_delay"),
                "Record the encoder too: a late rate sensor disagrees with it, a late actuator does not.",
            ),
        ),
        corrected,
        (
            "No position column: delays and scale errors of actuator and sensor cannot be told apart in this log.",
            "12 samples were repeated (0.15 % of the log); they were left out of the fit.",
        ),
        (comparison,),
        (
            FittedParameter("inertia", 0.0499, 1.1e-4, "kg m^2", "pinned"),
            FittedParameter("coulomb", 0.4, 9.8e-4, "N m", "traded off with torque"),
            FittedParameter("viscous", 0.0304, 1.5e-3, "N m s/rad", "pinned"),
            FittedParameter("torque", 0.1097, 1.1e-3, "N m", "pinned"),
            FittedParameter("delay", 4.02e-3, 5.5e-5, "s", "pinned"),
            FittedParameter("limit", 2.5, math.inf, "N m", "flat"),
        ),
        None,
        0.9,
        SECONDS,
        "rotary",
        model,
        None,
        PROVENANCE,
    )


def no_gap():
    """Nothing beyond the noise."""
    truth = Machine()
    comparison = compare("axis.csv", truth, Machine(), None)
    _, torque, velocity, position = record(truth, 8.0)
    gap = dataclasses.replace(gap_of(comparison, 1.99e-3), closed=math.nan, closed_interval=(math.nan, math.nan))
    where = where_of(comparison, velocity, position, torque, Machine())
    # what stands out of the noise is nothing, so every share is zero
    maps = {axis: tuple(dataclasses.replace(s, share=0.0) for s in bins) for axis, bins in where.maps.items()}
    regime = dict.fromkeys(where.regime, 0.0)
    where = dataclasses.replace(where, time=(), velocity=(), position=(), frequency=(), maps=maps, regime=regime)
    ranking = (
        Ranked("viscous_error", 0.011, gap.before, {"viscous": Estimate(0.0303, 0.0294, 0.0312, "N m s/rad")}),
        Ranked("velocity_bias", 0.006, gap.before, {"bias": Estimate(-4.0e-5, -1.3e-4, 5.0e-5, "rad/s")}),
    )
    return Diagnosis(
        "no_gap",
        (),
        ranking,
        gap,
        (),
        where,
        (),
        NOMINAL,
        (),
        (comparison,),
        (FittedParameter("inertia", 0.05, 4.0e-5, "kg m^2", "pinned"),),
        None,
        0.97,
        SECONDS,
        "rotary",
        NOMINAL,
        None,
        PROVENANCE,
    )


def unexplained():
    """A position-only log of a linear axis with pushes that no effect explains."""

    def push(t):
        return 0.5 if 3.0 <= t < 3.3 or 7.1 <= t < 7.35 else 0.0

    truth = Machine()
    comparison = compare(
        "press.mat",
        truth,
        Machine(),
        Machine(coulomb=0.385),
        signal="position",
        noise=2e-4,
        disturbance=push,
        scale=100.0,
    )
    _, torque, velocity, position = record(truth, 8.0, push)
    gap = dataclasses.replace(gap_of(comparison, 0.02), unit="N")
    where = where_of(comparison, velocity, position, torque, Machine(), scale=0.01)
    ranking = (
        Ranked("coulomb_error", 0.03, gap.after, {"coulomb": Estimate(38.5, 34.2, 42.8, "N")}),
        Ranked(
            "backlash",
            0.02,
            0.97 * gap.before,
            {"gap": Estimate(2.1e-5, 0.3e-5, 3.9e-5, "m", at_bound=True)},
            ("compliance",),
        ),
        Ranked("compliance", 0.01, 0.99 * gap.before, {"frequency": Estimate(61.0, 20.0, 102.0, "Hz")}, ("backlash",)),
    )
    model = """[units]
motion = "linear"
reference = "position"
sensors = "position"

[plant]
type = "one_mass"
inertia = 95.11

[friction]
type = "coulomb_viscous"
coulomb = 20.39
viscous = 203.5
offset = -3.165

[simulation]
dt = 0.001
"""
    return Diagnosis(
        "unexplained",
        (),
        ranking,
        gap,
        (),
        where,
        (
            Experiment(
                ("backlash", "compliance"),
                "Slow reversals at two payloads: backlash keeps its width, a spring does not.",
            ),
        ),
        model,
        ("Something pushes the axis between 3.0 and 3.3 s and between 7.1 and 7.35 s, whatever the motion is.",),
        (comparison,),
        (
            FittedParameter("mass", 95.2, 0.3, "kg", "pinned"),
            FittedParameter("coulomb", 20.4, 1.4, "N", "traded off with viscous"),
            FittedParameter("gap", 2.1e-5, 1.1e-5, "m", "at a bound"),
        ),
        where,
        0.94,
        SECONDS,
        "linear",
        model,
        None,
        {},
    )


def bare():
    """The least that a diagnosis can hold: no series, no maps, no intervals, no provenance."""
    nan2 = (math.nan, math.nan)
    gap = Gap("N m", 0.0523, 0.0101, math.nan, math.nan, nan2, nan2, nan2, nan2)
    where = Where(time=(Share(1.2, 1.5, 0.4),), regime={"reversal": 0.7, "cruise": 0.3})
    ranking = (Ranked("backlash", 0.8, 0.0101, {"gap": Estimate(1.02e-3, math.nan, math.nan, "rad")}),)
    return Diagnosis("explained", ("backlash",), ranking, gap, (), where, (), "", ())


def partly_explained():
    """The same friction, and a share that it leaves, of which a part follows the velocity."""
    found = explained()
    after = 0.4 * found.gap.before
    gap = dataclasses.replace(
        found.gap,
        after=after,
        closed=0.6,
        closed_interval=(0.5, 0.7),
        learned=0.8 * after,
        learned_interval=(0.7 * after, 0.9 * after),
    )
    step = Step("stribeck", after, (0.9 * after, 1.1 * after))
    at, torque = (-2.0, -0.5, 0.0, 0.0, 0.5, 2.0), (-0.02, -0.05, -0.01, 0.01, 0.05, 0.02)
    law = Learned("velocity", 0.3, at, torque, tuple(t - 0.004 for t in torque), tuple(t + 0.004 for t in torque))
    return dataclasses.replace(
        found, verdict="partly_explained", gap=gap, steps=(step,), residual_where=found.where, probability=0.93,
        learned=(law,), learned_model=found.model + "# with tables",
    )  # fmt: skip


CASES = {
    "explained": explained,
    "partly_explained": partly_explained,
    "pair_with_twins": pair_with_twins,
    "no_gap": no_gap,
    "unexplained": unexplained,
    "bare": bare,
}
