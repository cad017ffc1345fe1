"""The thesis' loops in its own convention (deg/s), for the tests of the tuning."""

import math

import fpjax
import tuning

DEGREE = math.pi / 180.0
INERTIA = 10.0 * DEGREE


def efp(steepness=None, gain_2=10.0, gain_1=100.0, viscous=2.0, sensor=None):
    """EFP on Coulomb and viscous friction; gains and b in the thesis' units, steepness in s/deg, None for sign."""
    return fpjax.ClosedLoop(
        fpjax.OneMass(INERTIA, fpjax.CoulombViscous(20.0, viscous * DEGREE, steepness)),
        fpjax.ProportionalIntegral(150.0, 200.0),
        fpjax.ExtendedFriedlandPark(INERTIA, gain_1 * DEGREE, gain_2, steepness),
        sensor=fpjax.IdealSensor() if sensor is None else sensor,
    )


def stiff(gain_1=100.0, gain_2=100.0):
    """EFP in SI units on exact friction under a fast loop, to be stepped exactly."""
    return fpjax.ClosedLoop(
        fpjax.OneMass(10.0, fpjax.CoulombViscous(20.0, 5.0)),
        fpjax.ProportionalIntegral(400.0, 2000.0),
        fpjax.ExtendedFriedlandPark(10.0, gain_1, gain_2, 500.0),
    )


GAINS = ("observer.gain_2", "observer.gain_1")
THESIS = tuning.Thesis(scales={"viscous": DEGREE})
SETUP = {"dt": 1e-4, "duration": 0.5, "solver": "ode3"}
SHORT = {"dt": 1e-4, "duration": 0.05, "solver": "ode3"}
PLAIN = SHORT | {"solver": "euler"}  # its gradients compile in half of the time
SINE, CONSTANT = fpjax.Sine(1.0, 1.0), fpjax.Constant(1.0)
COARSE = {"dt": 2e-3, "duration": 4.0, "stepping": "sampled", "solver": "exact"}  # for `stiff`
