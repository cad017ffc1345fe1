"""Chapter 3's figures: frequency responses, step responses, and the two-mass loop with friction."""

import functools
import math
from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

import fpjax
from fpjax.output import plotting

from .. import chapter3, presets
from . import panels

CHIRP_DURATION = 10.0  # [s], not printed
_NAMES = {"pi": "PI", "lead": "lead"}


def _bode(transfers: dict[str, Callable[[complex], complex]], name: str, marks: list[tuple[float, str]]) -> Figure:
    """Magnitude and phase; `marks` are (frequency [Hz], what it is)."""
    frequency = np.geomspace(1.0, 500.0, 1200)
    figure, axes = plotting.new_figure(2, 1, share_x=True, title=name, size=(7.0, 5.4))
    for (label, transfer), color in zip(transfers.items(), plotting.SERIES, strict=False):
        response = np.array([transfer(2j * math.pi * f) for f in frequency])
        axes[0, 0].semilogx(frequency, 20.0 * np.log10(np.abs(response)), color=color, label=label)
        axes[1, 0].semilogx(frequency, np.degrees(np.unwrap(np.angle(response))), color=color, label=label)
    for place, text in marks:
        for axis in axes[:, 0]:
            axis.axvline(place, color=plotting.GREY, ls=":", lw=1.0)
        axes[0, 0].annotate(
            text,
            (place, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(5, -11),
            textcoords="offset points",
            fontsize=8.5,
            color=plotting.GREY,
        )
    panels.finish(axes[0, 0], "", "magnitude [dB]")
    panels.finish(axes[1, 0], "", "phase [deg]")
    axes[1, 0].set_yticks(range(-360, 1, 45))
    low, high = axes[1, 0].dataLim.intervaly
    axes[1, 0].set_ylim(45 * math.floor(low / 45), min(45 * math.ceil(high / 45), 0) + 5)
    panels.outer_labels(axes, "frequency [Hz]")
    if len(transfers) > 1:
        axes[0, 0].legend()
    return figure


def figure_3_2() -> Figure:
    """Open loop of the plant."""
    phase = chapter3.design()["3/plant_phase_at_45_Hz"]
    name = "Fig 3.2  Two masses: $w_l / T_e$ [deg/s per N m]"
    return _bode({"plant": presets.two_mass_transfer}, name, [(45.0, f"45 Hz: phase {phase:.1f} deg")])


def figure_3_3() -> Figure:
    """Open loop with the lead controller."""
    found = chapter3.design()
    text = f"crossover {found['3/lead/crossover']:.1f} Hz, margin {found['3/lead/margin']:.1f} deg"
    transfers = {"with the lead": chapter3.open_loop, "plant alone": presets.two_mass_transfer}
    return _bode(transfers, "Fig 3.3  Open loop with the lead controller", [(found["3/lead/crossover"], text)])


def figure_3_4() -> Figure:
    """Closed loop with the lead controller."""
    bandwidth = chapter3.design()["3/lead/bandwidth"]
    name = "Fig 3.4  Closed loop with the lead controller"
    return _bode({"closed loop": chapter3.closed_loop}, name, [(bandwidth, f"-3 dB at {bandwidth:.1f} Hz")])


def figure_3_6() -> Figure:
    """Step responses without friction."""
    figure, axes = plotting.new_figure(title="Fig 3.6  Step responses without friction", size=(7.0, 3.8))
    axis = axes[0, 0]
    for name, color in zip(chapter3.CONTROLLERS, plotting.SERIES, strict=False):
        loop = presets.two_mass(name, coulomb=0.0)
        step = presets.traces(presets.run(loop, fpjax.Constant(1.0), 0.3, record=("velocity",)))
        info = fpjax.step_info(step["time"], step["velocity"], final_value=1.0)
        label = f"{_NAMES[name]}: overshoot {info['Overshoot']:.1f} %, settles in {info['SettlingTime']:.3f} s"
        axis.plot(*plotting.thin(step["time"], step["velocity"]), color=color, label=label)
    axis.axhspan(0.98, 1.02, color=plotting.GREY, alpha=0.2, lw=0, label="2 % band")
    axis.legend(loc="lower right")
    panels.finish(axis, "", panels.VELOCITY)
    panels.outer_labels(axes)
    return figure


@functools.cache
def _sine_run(name: str, coulomb: float, compensated: bool) -> dict[str, np.ndarray]:
    loop = presets.two_mass(name, coulomb=coulomb, compensated=compensated)
    return presets.traces(presets.run(loop, presets.sine(1.0), 2.0, record=("reference", "velocity")))


@functools.cache
def _motor_side_run(name: str) -> dict[str, np.ndarray]:
    loop = presets.two_mass_from_motor(name)
    return presets.traces(presets.run(loop, presets.sine(1.0), 2.0, record=("reference", "velocity")))


_TUNED_COLORS = {"without friction": plotting.GREEN, "with friction": plotting.UNCOMPENSATED}


def _tuned(name: str) -> dict[str, dict[str, np.ndarray]]:
    return {
        "with friction": _sine_run(name, presets.COULOMB, False),
        "without friction": _sine_run(name, 0.0, False),
    }


def _pair(name: str, runs: dict, colors: dict[str, str], zoom: tuple[float, float]) -> Figure:
    """A whole run above one of its reversals."""
    figure, axes = plotting.new_figure(2, 1, title=name, size=(7.4, 5.4))
    panels.velocities(axes[0, 0], runs, colors, title="(a) two periods")
    panels.velocities(axes[1, 0], runs, colors, title="(b) around a reversal", window=zoom)
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0], 4)
    return figure


def figure_3_7() -> Figure:
    """PI, with and without friction."""
    return _pair("Fig 3.7  Two masses under PI: 1 Hz sine", _tuned("pi"), _TUNED_COLORS, (0.9, 1.15))


def figure_3_8() -> Figure:
    """Lead, with and without friction."""
    return _pair("Fig 3.8  Two masses under lead: 1 Hz sine", _tuned("lead"), _TUNED_COLORS, (0.9, 1.15))


def figure_3_9() -> Figure:
    """Sticking with the Coulomb law."""
    name = "Fig 3.9  Sticking with the Coulomb law, PI: the solver chatters around zero velocity"
    figure, axes = plotting.new_figure(title=name, size=(7.4, 3.8))
    runs = {"with friction": _sine_run("pi", presets.COULOMB, False)}
    panels.velocities(axes[0, 0], runs, _TUNED_COLORS, window=(0.45, 0.62))
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


_COMPENSATED_COLORS = panels.COLORS | {"compensated at the motor": plotting.ORANGE}


def _compensated(name: str) -> dict[str, dict[str, np.ndarray]]:
    return {
        "uncompensated": _sine_run(name, presets.COULOMB, False),
        "compensated at the motor": _motor_side_run(name),
        "compensated": _sine_run(name, presets.COULOMB, True),
    }


def figure_3_10() -> Figure:
    """PI with CFP."""
    return _pair("Fig 3.10  Two masses under PI with CFP", _compensated("pi"), _COMPENSATED_COLORS, (0.9, 1.15))


def figure_3_11() -> Figure:
    """Lead with CFP."""
    return _pair("Fig 3.11  Two masses under lead with CFP", _compensated("lead"), _COMPENSATED_COLORS, (0.9, 1.15))


def figure_3_12() -> Figure:
    """Chirp under lead with CFP."""
    name = f"Fig 3.12  Two masses under lead: chirp 1 to 100 Hz in {CHIRP_DURATION:g} s (its length is not printed)"
    chirp = fpjax.Chirp(1.0, 1.0, 100.0, CHIRP_DURATION)
    runs = [
        presets.run(presets.two_mass("lead", compensated=on), chirp, CHIRP_DURATION, record=("reference", "velocity"))
        for on in (False, True)
    ]
    traces = panels.with_and_without(*map(presets.traces, runs))
    return panels.chirp_figure(name, traces, CHIRP_DURATION)


FIGURES = {
    "figure_3_02": figure_3_2,
    "figure_3_03": figure_3_3,
    "figure_3_04": figure_3_4,
    "figure_3_06": figure_3_6,
    "figure_3_07": figure_3_7,
    "figure_3_08": figure_3_8,
    "figure_3_09": figure_3_9,
    "figure_3_10": figure_3_10,
    "figure_3_11": figure_3_11,
    "figure_3_12": figure_3_12,
}
