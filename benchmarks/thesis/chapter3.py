"""Chapter 3: the lead controller's design, the step responses, and Table 3.4."""

import cmath
import math
from collections.abc import Callable, Mapping

import numpy as np

import fpjax

from . import presets
from .cells import Printed
from .chapter2 import reduction
from .presets import Setting

DURATION = 2.0  # [s] assumed for Table 3.4, whose horizon is not printed
HORIZONS = (0.5, 1.0, 2.0, 5.0)  # [s] horizons for which Table 3.4 is computed
STEP_DURATION = 1.0  # [s]
CONTROLLERS = ("pi", "lead")
LEAD_AS_PRINTED = (57.1, 217.0, 368.0)  # K_c, z, p

PRINTED = (
    Printed("3/plant_phase_at_45_Hz", "-148"),
    Printed("3/plant_margin", "32"),
    Printed("3/lead/alpha", "1.7"),
    Printed("3/lead/zero", "217"),
    Printed("3/lead/pole", "368"),
    Printed("3/lead/gain", "57.1"),
    Printed("3/lead/crossover", "45"),
    Printed("3/lead/phase", "-133"),
    Printed("3/lead/margin", "47"),
    Printed("3/lead/bandwidth", "68"),
    Printed("3/pi/overshoot", "30", below=True),
    Printed("3/pi/settling_time", "0.2", below=True),
    Printed("3/lead/overshoot", "30", below=True),
    Printed("3/lead/settling_time", "0.2", below=True),
    Printed("3.4/pi/compensated", "3.09e-4", 0.025),
    Printed("3.4/pi/uncompensated", "1.1e-3", 0.025),
    Printed("3.4/lead/compensated", "2.81e-4", 0.025),
    Printed("3.4/lead/uncompensated", "1e-3", 0.025),
    Printed("3.4/pi/reduction", "71.9"),
    Printed("3.4/lead/reduction", "71.9"),
)

Transfer = Callable[[complex], complex]


def lead_as_printed(s: complex) -> complex:
    """The printed controller (3.16), with its rounded figures, at s [rad/s]."""
    gain, zero, pole = LEAD_AS_PRINTED
    return gain * (s + zero) / (s + pole)


def open_loop(s: complex) -> complex:
    """Printed lead times plant (3.14)."""
    return lead_as_printed(s) * presets.two_mass_transfer(s)


def closed_loop(s: complex) -> complex:
    """From reference to velocity."""
    return open_loop(s) / (1.0 + open_loop(s))


def phase(transfer: Transfer, frequency: float) -> float:
    """Phase [deg] at `frequency` [Hz], between -360 and 0."""
    degrees = math.degrees(cmath.phase(transfer(2j * math.pi * frequency)))
    return degrees - 360.0 if degrees > 0.0 else degrees


def falls_below(transfer: Transfer, level: float, *, low: float = 1.0, high: float = 1000.0) -> float:
    """First frequency [Hz] above `low` at which |transfer| falls below `level`, by bisection."""
    # A grid first: |transfer| need not fall monotonically (resonance), and bisection wants one crossing.
    grid = np.geomspace(low, high, 4001)
    below = np.flatnonzero([abs(transfer(2j * math.pi * float(f))) < level for f in grid])
    if below.size == 0 or below[0] == 0:
        return math.nan
    left, right = float(grid[below[0] - 1]), float(grid[below[0]])
    for _ in range(60):
        middle = 0.5 * (left + right)
        if abs(transfer(2j * math.pi * middle)) < level:
            right = middle
        else:
            left = middle
    return right


def design() -> dict[str, float]:
    """The design's figures: the lead from (3.20)-(3.26), the loop with the controller as printed."""
    lead = fpjax.design_lead(presets.two_mass_transfer, presets.CROSSOVER, presets.PHASE_LEAD)
    plant_phase = phase(presets.two_mass_transfer, presets.CROSSOVER)
    crossover = falls_below(open_loop, 1.0)
    return {
        "3/plant_phase_at_45_Hz": plant_phase,
        "3/plant_margin": 180.0 + plant_phase,
        "3/lead/alpha": float(lead.pole / lead.zero),
        "3/lead/zero": float(lead.zero),
        "3/lead/pole": float(lead.pole),
        "3/lead/gain": float(lead.gain),
        "3/lead/crossover": crossover,
        "3/lead/phase": phase(open_loop, crossover),
        "3/lead/margin": 180.0 + phase(open_loop, crossover),
        "3/lead/bandwidth": falls_below(closed_loop, math.sqrt(0.5)),
    }


def obtain(setting: Setting) -> dict[str, float]:
    """Every cell of the chapter with one solver and step; Table 3.4 also for other horizons."""
    found = design()
    for name in CONTROLLERS:
        loop = presets.two_mass(name, coulomb=0.0)
        step = presets.traces(presets.run(loop, fpjax.Constant(1.0), STEP_DURATION, setting, record=("velocity",)))
        # The lead has no integrator, but the plant without friction is one: both end at the reference.
        info = fpjax.step_info(step["time"], step["velocity"], final_value=1.0)
        found[f"3/{name}/overshoot"], found[f"3/{name}/settling_time"] = info["Overshoot"], info["SettlingTime"]
        loops = {
            "compensated": presets.two_mass(name, compensated=True),
            "uncompensated": presets.two_mass(name),
            "motor_side": presets.two_mass_from_motor(name),
        }
        gradients = {word: _gradients(loop, setting) for word, loop in loops.items()}
        for horizon in HORIZONS:
            suffix = "" if horizon == DURATION else f"@{horizon:g}s"
            for word in loops:
                found[f"3.4/{name}/{word}{suffix}"] = gradients[word][horizon]
            before = gradients["uncompensated"][horizon]
            found[f"3.4/{name}/reduction{suffix}"] = reduction(before, gradients["compensated"][horizon])
            found[f"3.4/{name}/motor_side_reduction{suffix}"] = reduction(before, gradients["motor_side"][horizon])
    return found


def _gradients(loop: fpjax.ClosedLoop, setting: Setting) -> dict[float, float]:
    """Root mean square of the error's difference from sample to sample [deg/s], by horizon [s]."""
    signals = presets.traces(
        presets.run(loop, presets.sine(1.0), max(HORIZONS), setting, record=("reference", "velocity"))
    )
    differences = np.diff(signals["reference"] - signals["velocity"])
    return {horizon: float(np.sqrt(np.mean(differences[: round(horizon / setting.dt)] ** 2))) for horizon in HORIZONS}


def reasons(found: Mapping[str, float]) -> dict[str, str]:
    """Why cells of this chapter miss."""
    texts = {"3/pi/overshoot": f"the printed gains overshoot by {found['3/pi/overshoot']:.1f} %, not under 30 %"}
    for name in CONTROLLERS:
        motor = _span(found, f"3.4/{name}/motor_side")
        motor_reduction = _span(found, f"3.4/{name}/motor_side_reduction", " %")
        texts |= {
            f"3.4/{name}/compensated": (
                f"the horizon is not printed: {_span(found, f'3.4/{name}/compensated')}; with the compensation given "
                f"by the motor {motor}"
            ),
            f"3.4/{name}/uncompensated": (
                f"the horizon is not printed: {_span(found, f'3.4/{name}/uncompensated')}; a difference from sample to "
                "sample is mostly the switching of sign(w) while the mass sticks, and scales with the step"
            ),
            f"3.4/{name}/reduction": (
                f"the horizon is not printed: {_span(found, f'3.4/{name}/reduction', ' %')}; with the compensation "
                f"given by the motor {motor_reduction}"
            ),
        }
    return texts


def _span(found: Mapping[str, float], cell: str, unit: str = "") -> str:
    values = [found[cell if horizon == DURATION else f"{cell}@{horizon:g}s"] for horizon in HORIZONS]
    return f"{min(values):.3g} to {max(values):.3g}{unit} over horizons of {HORIZONS[0]:g} to {HORIZONS[-1]:g} s"
