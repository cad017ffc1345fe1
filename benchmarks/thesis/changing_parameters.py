"""A question that the thesis does not ask: do the estimates follow when the true parameters change?

An observer whose estimate stays where it was has only been tuned to land there (see docs/thesis.md).
"""

from collections.abc import Sequence
from typing import NamedTuple

import fpjax

from . import presets
from .chapter4 import EXTENDED_STEEPNESS, EXTENSION_1, EXTENSION_2
from .presets import COULOMB, DEGREE, Setting

SINE_GAINS = (298.0, 72.6)  # (alpha_1, alpha_2) of Table 4.2
NOVEL_GAIN = 100.0


class Recovery(NamedTuple):
    """One observer run on a plant with another truth.

    Attributes:
        observer: its name; the gains are the printed ones.
        parameter: what it estimates.
        truth: in print's unit.
        estimate: at the end of the run, in print's unit.
        duration: of the run [s].
    """

    observer: str
    parameter: str
    truth: float
    estimate: float
    duration: float

    @property
    def error(self) -> float:
        """(estimate - truth) / truth [1]; the estimate itself where the truth is 0."""
        return (self.estimate - self.truth) / self.truth if self.truth else self.estimate


def recoveries(setting: Setting = presets.PRINTED) -> list[Recovery]:
    """EFP, NFP and both extensions, with the printed gains, on other true values; 1 Hz sine."""
    found = []
    for truth in (0.0, 1.0, 2.0, 4.0, 8.0, 20.0):
        loop = presets.one_mass(presets.extended(*SINE_GAINS), presets.friction(truth * DEGREE))
        found.append(_end("EFP", loop, "viscous", truth, DEGREE, 0.5, setting))
    for truth in (5.0, 10.0, 20.0):
        loop = presets.one_mass(presets.novel(NOVEL_GAIN), fpjax.Viscous(viscous=truth * DEGREE))
        found.append(_end("NFP", loop, "viscous", truth, DEGREE, 5.0, setting))
    for truth in (15.0, 20.0, 25.0):
        law = fpjax.CoulombViscous(truth, presets.VISCOUS, EXTENDED_STEEPNESS)
        loop = presets.one_mass(presets.extension_1(*EXTENSION_1), law)
        found.append(_end("extension 1", loop, "coulomb", truth, 1.0, 5.0, setting))
    for truth in (1.0, 2.0, 5.0, 20.0):
        law = fpjax.CoulombViscous(COULOMB, truth * DEGREE, EXTENDED_STEEPNESS)
        loop = presets.one_mass(presets.extension_2(*EXTENSION_2), law)
        found.append(_end("extension 2", loop, "viscous", truth, DEGREE, 5.0, setting))
    return found


def _end(
    observer: str,
    loop: fpjax.ClosedLoop,
    parameter: str,
    truth: float,
    unit: float,
    duration: float,
    setting: Setting,
) -> Recovery:
    measures = {"end": fpjax.EstimateFinal(parameter)}
    end = presets.numbers(presets.run(loop, presets.sine(1.0), duration, setting, measures=measures))["end"]
    return Recovery(observer, parameter, truth, end / unit, duration)


def text(found: Sequence[Recovery]) -> str:
    """As a table."""
    lines = ["Do the estimates follow another truth? (printed gains, 1 Hz sine)"]
    lines += [
        f"  {one.observer:<12} {one.parameter:<8} true {one.truth:>5g}  estimate {one.estimate:>8.4g}"
        f"  after {one.duration:g} s"
        for one in found
    ]
    return "\n".join(lines)
