"""The thesis' cases in the units that give its printed numbers.

The loop runs in deg/s: velocity, reference and error are in deg/s, torques in N m. So inertia, viscous friction,
spring and damper are scaled by pi/180, and a steepness is in s/deg. Nothing in the text says so; the printed digits do,
and the lead controller's gain does (57.1 with the factor, 3268 without).
"""

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np

import fpjax
from fpjax.output.json_object import JsonObject

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
OTHER_SOLVER = Setting("rk4", 1e-4)  # checks whether a cell depends on the solver
FINER_STEP = Setting("ode3", 1e-5)  # checks whether it depends on the step
FINEST_STEP = Setting("ode3", 1e-6)  # stands for a step of zero


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
    plant = fpjax.OneMass(inertia=INERTIA, friction=friction() if law is None else law)
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


def two_mass(name: str, *, coulomb: float = COULOMB, compensated: bool = False) -> fpjax.ClosedLoop:
    """Fig 3.5 as the text reads it: u is the controller's output behind P_HO, "the torque exerted on load".

    The compensation is added there, where no motor sits; so the observer sees its own u and cancels the friction
    exactly, and P_HO belongs to the controller's side. CFP has g2 with alpha = 100.
    """
    reduced = MOTOR_INERTIA * LOAD_INERTIA / (MOTOR_INERTIA + LOAD_INERTIA)
    high_order = [DAMPING, STIFFNESS], [reduced, DAMPING, STIFFNESS]  # P_HO (3.28)
    if name == "pi":
        controller = [40.0, 500.0], [1.0, 0.0]
    else:
        lead = fpjax.design_lead(two_mass_transfer, CROSSOVER, PHASE_LEAD)
        controller = [float(lead.gain), float(lead.gain * lead.zero)], [1.0, float(lead.pole)]
    numerator, denominator = (np.polymul(*pair) for pair in zip(controller, high_order, strict=True))
    plant = fpjax.OneMass(inertia=MOTOR_INERTIA + LOAD_INERTIA, friction=fpjax.Coulomb(coulomb=coulomb))
    observer = _two_mass_observer() if compensated else fpjax.NoObserver()
    return fpjax.ClosedLoop(plant, fpjax.TransferFunction(numerator, denominator), observer)


def two_mass_from_motor(name: str) -> fpjax.ClosedLoop:
    """The same with the compensation given by the motor: like the control it passes through P_HO and comes late."""
    plant = fpjax.SeriesTwoMass(
        motor_inertia=MOTOR_INERTIA,
        load_inertia=LOAD_INERTIA,
        stiffness=STIFFNESS,
        damping=DAMPING,
        friction=fpjax.Coulomb(coulomb=COULOMB),
    )
    controller: fpjax.AbstractController = fpjax.ProportionalIntegral(40.0, 500.0)
    if name == "lead":
        controller = fpjax.design_lead(two_mass_transfer, CROSSOVER, PHASE_LEAD)
    observer = fpjax.HighOrderFeedforward(_two_mass_observer(), MOTOR_INERTIA, LOAD_INERTIA, STIFFNESS, DAMPING)
    return fpjax.ClosedLoop(plant, controller, observer)


def _two_mass_observer() -> fpjax.ClassicalFriedlandPark:
    return fpjax.ClassicalFriedlandPark(MOTOR_INERTIA + LOAD_INERTIA, fpjax.Absolute(100.0))


def run(
    loop: fpjax.ClosedLoop,
    reference: fpjax.AbstractReference,
    duration: float,
    setting: Setting = PRINTED,
    *,
    measures: Mapping[str, fpjax.AbstractMeasure] | None = None,
    record: tuple[str, ...] = (),
) -> fpjax.Run:
    """Simulate from rest, as the thesis does: continuous stepping, all states zero."""
    return fpjax.simulate(
        loop,
        reference,
        dt=setting.dt,
        duration=duration,
        solver=setting.solver,
        measures=dict(measures or {}),
        record=record,
    )


def traces(result: fpjax.Run) -> dict[str, np.ndarray]:
    """Recorded signals by name, and "time" [s], as numpy arrays."""
    return {"time": np.asarray(result.time)} | {name: np.asarray(value) for name, value in result.signals.items()}


def numbers(result: fpjax.Run) -> dict[str, float]:
    """Measures by name as floats."""
    return {name: float(value) for name, value in result.measures.items()}


@functools.cache
def velocity_and_friction() -> JsonObject:
    """The two errors of most tables: mean |r - w| [deg/s] and mean |(k - k_hat) sign(w)| [N m]."""
    return {"velocity": fpjax.MeanAbsolute(), "friction": fpjax.CoulombTorqueError(COULOMB)}
