"""What is tuned: the thesis' loops in its own convention (deg/s, see docs/thesis.md), with smooth laws."""

import dataclasses
import math

import fpjax
from fpjax import AbstractReference, ClosedLoop
from tuning import AbstractObjective, Axis, Estimation, Parameter, Thesis

DEGREE = math.pi / 180.0
INERTIA = 10.0 * DEGREE
STEEPNESS = 150.0  # of tanh in place of sign() [s/deg]: 69 % of the stability limit of ode3 at 1e-4 s
JOINT = "joint"

# Appendix B, lines 3, 5, 10, 11: start and first step of (gain_2, gain_1), in the thesis' units.
START, STEPS = (10.0, 100.0), (10.0, 50.0)


@dataclasses.dataclass(frozen=True)
class Case:
    """One observer to tune.

    Attributes:
        name: "efp", "extension_1" or "extension_2".
        loop: the closed loop.
        units: the thesis' units of (gain_2, gain_1) in those of the loop: a gain of b is in N m s/deg here.
        ranges: (low, high) of (gain_2, gain_1), in the thesis' units: of the sweep and of the bounded methods.
        scales: by estimate, its unit in the sum of Appendix B, in the loop's units.
    """

    name: str
    loop: ClosedLoop
    units: tuple[float, float]
    ranges: tuple[tuple[float, float], tuple[float, float]]
    scales: dict[str, float]

    @property
    def parameters(self) -> list[Parameter]:
        """(gain_2, gain_1), the order of Appendix B."""
        rows = zip(("observer.gain_2", "observer.gain_1"), START, self.units, self.ranges, strict=True)
        return [Parameter(name, start * unit, low * unit, high * unit) for name, start, unit, (low, high) in rows]

    @property
    def printed_parameters(self) -> list[Parameter]:
        """The same without bounds, which Algorithm 1 as printed does not have."""
        return [Parameter(one.name, one.start) for one in self.parameters]

    @property
    def steps(self) -> tuple[float, float]:
        """First steps of Algorithm 1, in the loop's units."""
        return STEPS[0] * self.units[0], STEPS[1] * self.units[1]

    def axes(self, count: int) -> list[Axis]:
        """The dense sweep's axes."""
        return [Axis(one.name, one.low or 0.0, one.high or 0.0, count) for one in self.parameters]

    def objective(self, name: str) -> AbstractObjective:
        """The objective by its name."""
        return Thesis(scales=self.scales) if name == "thesis" else Estimation()


def all_cases() -> list[Case]:
    """EFP (Table 4.1) and its two extensions (Table 4.6)."""
    pi = fpjax.ProportionalIntegral(150.0, 200.0)
    coulomb = fpjax.CoulombViscous(20.0, 2.0 * DEGREE, STEEPNESS)
    # Tables 4.5 to 4.7: the true steepness is 10 s/deg, which the extensions estimate.
    soft = fpjax.CoulombViscous(20.0, 2.0 * DEGREE, 10.0)
    by_degree, both = (1.0, DEGREE), ((1.0, 300.0), (1.0, 1e4))
    efp = fpjax.ExtendedFriedlandPark(INERTIA, 1.0, 1.0, STEEPNESS)
    first = fpjax.ExtendedSteepnessCoulomb(INERTIA, 1.0, 1.0, 2.0 * DEGREE, STEEPNESS)
    second = fpjax.ExtendedSteepnessViscous(INERTIA, 1.0, 1.0, 20.0, STEEPNESS)
    return [
        Case(
            "efp",
            ClosedLoop(fpjax.OneMass(inertia=INERTIA, friction=coulomb), pi, efp),
            by_degree,
            both,
            {"viscous": DEGREE},
        ),
        Case("extension_1", ClosedLoop(fpjax.OneMass(inertia=INERTIA, friction=soft), pi, first), (1.0, 1.0), both, {}),
        Case(
            "extension_2",
            ClosedLoop(fpjax.OneMass(inertia=INERTIA, friction=soft), pi, second),
            by_degree,
            both,
            {"viscous": DEGREE},
        ),
    ]


def references(duration: float) -> dict[str, AbstractReference]:
    """The five references of Table 4.2.

    The square wave has 2 Hz: one of 1 Hz does not reverse within 0.5 s, and would be the constant once more.
    """
    return {
        "sine": fpjax.Sine(1.0, 1.0),
        "constant": fpjax.Constant(1.0),
        "chirp": fpjax.Chirp(1.0, 1.0, 10.0, duration),
        "triangle": fpjax.Triangle(1.0, 1.0),
        "square": fpjax.Square(1.0, 2.0),
    }
