"""The thesis' cases in the units that give its printed numbers.

The loop runs in deg/s: velocity, reference and error are in deg/s, torques in N m. So inertia, viscous friction, spring
and damper are scaled by pi/180, and a steepness is in s/deg. Nothing in the text says so; the printed digits do, and the
lead controller's gain does (57.1 with the factor, 3268 without).
"""

import dataclasses
import functools
import math
from typing import Any

import numpy as np

import fpjax

DEGREE = math.pi / 180.0

INERTIA = 10.0 * DEGREE  # J = 10 kg m^2 [N m s^2/deg]
COULOMB = 20.0  # k [N m]
VISCOUS = 2.0 * DEGREE  # b = 2 N m s/rad [N m s/deg]
NOVEL_VISCOUS = 10.0 * DEGREE  # b of Table 2.6 [N m s/deg]

MOTOR_INERTIA = 0.02 * DEGREE  # Table 3.2 [N m s^2/deg]
LOAD_INERTIA = 10.0 * DEGREE
STIFFNESS = 1000.0 * DEGREE  # [N m/deg]
DAMPING = 5.0 * DEGREE  # [N m s/deg]
CROSSOVER = 45.0  # [Hz]
PHASE_LEAD = math.radians(15.0)  # 13 degrees wanted, 15 taken (3.20)


@dataclasses.dataclass(frozen=True)
class Setting:
    """A solver and its step.

    Attributes:
        solver: name of the solver.
        dt: step [s].
    """

    solver: str
    dt: float

    def __str__(self) -> str:
        return f"{self.solver} at {self.dt:g} s"


PRINTED = Setting("ode3", 1e-4)  # what the thesis ran
OTHER_SOLVER = Setting("rk4", 1e-4)
FINER_STEP = Setting("ode3", 1e-5)
FINEST_STEP = Setting("ode3", 1e-6)


def sine(frequency: float) -> fpjax.Sine:
    """1 deg/s at `frequency` [Hz]."""
    return fpjax.Sine(1.0, frequency)


def references(duration: float) -> dict[str, fpjax.AbstractReference]:
    """Table 4.2's references; the chirp sweeps 1 to 10 Hz within `duration` [s]."""
    return {
        "sine": sine(1.0),
        "constant": fpjax.Constant(1.0),
        "chirp": fpjax.Chirp(1.0, 1.0, 10.0, duration),
        "triangular": fpjax.Triangle(1.0, 1.0),
        "square": fpjax.Square(1.0, 1.0),
    }


def friction(viscous: float = VISCOUS, steepness: float | None = None) -> fpjax.CoulombViscous:
    """k = 20 N m with a viscous part [N m s/deg] and a steepness [s/deg], None for sign."""
    return fpjax.CoulombViscous(COULOMB, viscous, steepness)


def one_mass(observer: fpjax.AbstractObserver, law: fpjax.AbstractFriction | None = None) -> fpjax.ClosedLoop:
    """One mass under the PI controller of Table 2.1."""
    plant = fpjax.OneMass(INERTIA, friction() if law is None else law)
    return fpjax.ClosedLoop(plant, fpjax.ProportionalIntegral(150.0, 200.0), observer)


def classical(nonlinearity: fpjax.AbstractNonlinearity) -> fpjax.ClassicalFriedlandPark:
    """CFP with a known b."""
    return fpjax.ClassicalFriedlandPark(INERTIA, nonlinearity, viscous=VISCOUS)


def modified(nonlinearity: fpjax.AbstractNonlinearity, steepness: float | None = None) -> fpjax.ModifiedFriedlandPark:
    """MFP with a known b, compensating with tanh where a steepness [s/deg] is given."""
    return fpjax.ModifiedFriedlandPark(INERTIA, nonlinearity, viscous=VISCOUS, steepness=steepness)


def novel(gain: float) -> fpjax.NovelFriedlandPark:
    """NFP through g2; its estimate of b is in N m s/deg, so the printed gain is scaled like b."""
    return fpjax.NovelFriedlandPark(INERTIA, fpjax.Absolute(gain * DEGREE))


def extended(gain_1: float, gain_2: float) -> fpjax.ExtendedFriedlandPark:
    """EFP with the printed gains: alpha_1 drives b_hat, so it is scaled like b."""
    return fpjax.ExtendedFriedlandPark(INERTIA, gain_1 * DEGREE, gain_2)


def extension_1(gain_1: float, gain_2: float) -> fpjax.ExtendedSteepnessCoulomb:
    """Extension 1 (k and lambda) with the printed gains."""
    return fpjax.ExtendedSteepnessCoulomb(INERTIA, gain_1, gain_2, viscous=VISCOUS)


def extension_2(gain_1: float, gain_2: float) -> fpjax.ExtendedSteepnessViscous:
    """Extension 2 (lambda and b) with the printed gains: alpha_1 drives b_hat, so it is scaled like b."""
    return fpjax.ExtendedSteepnessViscous(INERTIA, gain_1 * DEGREE, gain_2, COULOMB)


def steepness_observer() -> fpjax.SteepnessObserver:
    """The observer of Table 4.5."""
    return fpjax.SteepnessObserver(INERTIA, fpjax.LogCosh(500.0, 100.0), COULOMB)


def lugre(static: float = COULOMB) -> fpjax.LuGre:
    """Table 4.3. It prints no F_s, so F_s = F_c (no Stribeck dip) is taken.

    The bristles' stiffness and damping act on radians, so they are scaled; the Stribeck velocity becomes deg/s.
    """
    return fpjax.LuGre(COULOMB, static, 0.03 / DEGREE, 20000.0 * DEGREE, 1000.0 * DEGREE, VISCOUS)


def two_mass_transfer(s: complex) -> complex:
    """w_l / T_e (3.14) [deg/s / N m] at the complex frequency s [rad/s]."""
    reduced = MOTOR_INERTIA * LOAD_INERTIA / (MOTOR_INERTIA + LOAD_INERTIA)
    spring = DAMPING * s + STIFFNESS
    return spring / (reduced * s * s + spring) / ((MOTOR_INERTIA + LOAD_INERTIA) * s)


def two_mass_controller(name: str) -> fpjax.AbstractController:
    """Chapter 3's "pi" or "lead" controller; the lead as designed, not as rounded in print."""
    if name == "pi":
        return fpjax.ProportionalIntegral(40.0, 500.0)
    return fpjax.design_lead(two_mass_transfer, CROSSOVER, PHASE_LEAD)


def two_mass(name: str, *, coulomb: float = COULOMB, compensated: bool = False) -> fpjax.ClosedLoop:
    """Fig 3.5: P_HO, then friction and P_LO, with CFP (g2, alpha = 100) fed by P_HO u where `compensated`."""
    plant = fpjax.SeriesTwoMass(MOTOR_INERTIA, LOAD_INERTIA, STIFFNESS, DAMPING, fpjax.Coulomb(coulomb))
    observer: fpjax.AbstractObserver = fpjax.NoObserver()
    if compensated:
        inner = fpjax.ClassicalFriedlandPark(MOTOR_INERTIA + LOAD_INERTIA, fpjax.Absolute(100.0))
        observer = fpjax.HighOrderFeedforward(inner, MOTOR_INERTIA, LOAD_INERTIA, STIFFNESS, DAMPING)
    return fpjax.ClosedLoop(plant, two_mass_controller(name), observer)


def run(
    loop: fpjax.ClosedLoop,
    reference: fpjax.AbstractReference,
    duration: float,
    setting: Setting = PRINTED,
    *,
    measures: dict[str, fpjax.AbstractMeasure] | None = None,
    record: tuple[str, ...] = (),
) -> fpjax.Run:
    """Simulate from rest, as the thesis does: continuous stepping, all states zero."""
    return fpjax.simulate(
        loop, reference, dt=setting.dt, duration=duration, solver=setting.solver, measures=measures, record=record
    )


def traces(result: fpjax.Run) -> dict[str, np.ndarray]:
    """Recorded signals by name, and "time" [s], as numpy arrays."""
    return {"time": np.asarray(result.time)} | {name: np.asarray(value) for name, value in result.signals.items()}


def numbers(result: fpjax.Run) -> dict[str, float]:
    """Measures by name as floats."""
    return {name: float(value) for name, value in result.measures.items()}


@functools.cache
def velocity_and_friction() -> dict[str, Any]:
    """The two errors of most tables: mean |r - w| [deg/s] and mean |(k - k_hat) sign(w)| [N m]."""
    return {"velocity": fpjax.MeanAbsolute(), "friction": fpjax.CoulombTorqueError(COULOMB)}
