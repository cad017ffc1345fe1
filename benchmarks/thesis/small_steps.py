"""Table 2.3 as the step goes to zero: the part of a printed number that is not chatter of the solver.

sign() at a fixed step makes the velocity chatter around zero with an amplitude proportional to the step.
"""

from collections.abc import Mapping

import fpjax

from . import chapter2, presets
from .cells import Printed
from .presets import Setting

PRINTED = tuple(
    Printed(f"limit/{one.cell}", one.text, one.tolerance) for one in chapter2.PRINTED if one.cell.startswith("2.3/")
)


def obtain(setting: Setting) -> dict[str, float]:
    """Table 2.3 with one solver and step, as cells "limit/2.3/...": ask for the finest step."""
    found = {}
    for alpha in (0.0, *chapter2.ALPHAS):
        observer = presets.classical(fpjax.Absolute(alpha)) if alpha else fpjax.NoObserver()
        measures = presets.velocity_and_friction()
        loop = presets.one_mass(observer)
        errors = presets.numbers(presets.run(loop, presets.sine(10.0), chapter2.DURATION, setting, measures=measures))
        for signal, value in errors.items():
            found[f"limit/2.3/g2/alpha={alpha:g}/{signal}"] = value
    return found


def reasons(found: Mapping[str, float]) -> dict[str, str]:
    """What part of a printed figure is chatter."""
    texts = {}
    for one in PRINTED:
        share = 100.0 * (one.value / found[one.cell] - 1.0)
        texts[one.cell] = f"print is {share:+.0f} % away from the limit: chatter of the solver at its step of 1e-4 s"
    return texts
