"""Chapter 4's figures: two-parameter estimates, LuGre, and the tanh law."""

import functools

import numpy as np
from matplotlib.figure import Figure

import fpjax
from fpjax.output import plotting

from .. import chapter4, presets
from ..presets import COULOMB, DEGREE
from . import panels

SINE_GAINS, TRIANGULAR_GAINS = (298.0, 72.6), (2.6, 28.4)  # (alpha_1, alpha_2) as printed in Table 4.2


def figure_4_2() -> Figure:
    """k_hat and b_hat for three pairs of gains."""
    figure, axes = plotting.new_figure(
        2, 1, share_x=True, title="Fig 4.2  EFP: estimates for three pairs of gains, 1 Hz sine", size=(7.4, 5.4)
    )
    for (gain_2, gain_1), color in zip(chapter4.FIG_4_2_GAINS, plotting.SERIES, strict=False):
        signals = panels.record(
            presets.extended(gain_1, gain_2), presets.sine(1.0), 2.0, "estimates.coulomb", "estimates.viscous"
        )
        label = f"$\\alpha_2$ = {gain_2:g}, $\\alpha_1$ = {gain_1:g}"
        axes[0, 0].plot(*plotting.thin(signals["time"], signals["estimates.coulomb"]), color=color, label=label)
        axes[1, 0].plot(
            *plotting.thin(signals["time"], signals["estimates.viscous"] / DEGREE), color=color, label=label
        )
    axes[0, 0].axhline(COULOMB, color=plotting.TRUTH, ls="--", lw=1.0, label="true")
    axes[1, 0].axhline(presets.VISCOUS / DEGREE, color=plotting.TRUTH, ls="--", lw=1.0)
    panels.finish(axes[0, 0], "", "$\\hat k$ [N m]")
    panels.finish(axes[1, 0], "", "$\\hat b$ [N m s/rad]")
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0], 4)
    return figure


def _two_runs(
    name: str,
    observer: fpjax.AbstractObserver,
    reference: fpjax.AbstractReference,
    law: fpjax.AbstractFriction | None = None,
    zoom: tuple[float, float] = (0.46, 0.6),
) -> Figure:
    """With and without compensation: the whole run above one of its reversals."""
    figure, axes = plotting.new_figure(2, 1, title=name, size=(7.4, 5.4))
    runs = panels.with_and_without(
        *(
            panels.record(one, reference, 2.0, "reference", "velocity", law=law)
            for one in (fpjax.NoObserver(), observer)
        )
    )
    panels.velocities(axes[0, 0], runs, panels.COLORS, title="(a) two periods")
    panels.velocities(axes[1, 0], runs, panels.COLORS, title="(b) around a reversal", window=zoom)
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


def figure_4_5() -> Figure:
    """EFP on the sine."""
    name = "Fig 4.5  EFP with the printed gains of the sine: 1 Hz sine"
    return _two_runs(name, presets.extended(*SINE_GAINS), presets.sine(1.0))


def figure_4_6() -> Figure:
    """EFP on the triangle."""
    name = "Fig 4.6  EFP with the printed gains of the triangle: 1 Hz triangle"
    return _two_runs(name, presets.extended(*TRIANGULAR_GAINS), fpjax.Triangle(1.0, 1.0))


def figure_4_7() -> Figure:
    """LuGre friction compensated as if it were Coulomb friction."""
    name = "Fig 4.7  LuGre friction ($F_s$ is not printed: $F_s = F_c$), EFP, 1 Hz sine"
    return _two_runs(name, presets.extended(*SINE_GAINS), presets.sine(1.0), presets.lugre())


@functools.cache
def _tanh_runs() -> dict[float, dict[str, np.ndarray]]:
    return {
        steepness: panels.record(
            presets.modified(fpjax.LogCosh(100.0, 1.0), steepness),
            presets.sine(1.0),
            1.0,
            "reference",
            "velocity",
            "compensation",
        )
        for steepness in chapter4.STEEPNESSES
    }


def _steepness_titles() -> list[str]:
    return panels.lettered([f"$\\lambda$ = {steepness:g} s/deg" for steepness in chapter4.STEEPNESSES])


def figure_4_8() -> Figure:
    """Sign friction compensated with tanh: torques."""
    name = "Fig 4.8  sign(w) in the plant, tanh($\\lambda$w) in the estimate: torques"
    figure, axes = plotting.new_figure(2, 2, share_x=True, share_y=True, title=name, size=(8.8, 5.2))
    for axis, signals, title in zip(axes.flat, _tanh_runs().values(), _steepness_titles(), strict=True):
        existing = signals["time"], COULOMB * np.sign(signals["velocity"])
        panels.estimate_panel(axis, existing, (signals["time"], signals["compensation"]), title=title)
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


def figure_4_9() -> Figure:
    """Sign friction compensated with tanh: velocities around a reversal."""
    name = "Fig 4.9  sign(w) in the plant, tanh($\\lambda$w) in the estimate: velocities"
    figure, axes = plotting.new_figure(2, 2, share_x=True, share_y=True, title=name, size=(8.8, 5.2))
    bare = panels.record(fpjax.NoObserver(), presets.sine(1.0), 1.0, "reference", "velocity")
    for axis, signals, title in zip(axes.flat, _tanh_runs().values(), _steepness_titles(), strict=True):
        runs = panels.with_and_without(bare, signals)
        panels.velocities(axis, runs, panels.COLORS, title=title, window=(0.42, 0.62))
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


def _steepness_run(truth: float, setting: presets.Setting = presets.PRINTED) -> dict[str, np.ndarray]:
    return panels.record(
        presets.steepness_observer(),
        presets.sine(1.0),
        2.0,
        "reference",
        "velocity",
        "torque",
        "estimates.steepness",
        law=fpjax.SmoothCoulomb(COULOMB, truth),
        setting=setting,
    )


def figure_4_10() -> Figure:
    """Velocity and estimate while lambda is estimated."""
    truth = chapter4.OBSERVED_STEEPNESS
    name = f"Fig 4.10  Steepness observer: true $\\lambda$ = {truth:g} s/deg"
    figure, axes = plotting.new_figure(2, 1, title=name, size=(7.4, 5.4))
    law = fpjax.SmoothCoulomb(COULOMB, truth)
    bare = panels.record(fpjax.NoObserver(), presets.sine(1.0), 2.0, "reference", "velocity", law=law)
    estimated = _steepness_run(truth)
    panels.velocities(axes[0, 0], panels.with_and_without(bare, estimated), panels.COLORS, title="(a) velocity")
    axes[1, 0].plot(*plotting.thin(estimated["time"], estimated["estimates.steepness"]), color=plotting.COMPENSATED)
    axes[1, 0].axhline(truth, color=plotting.TRUTH, ls="--", lw=1.0)
    panels.finish(axes[1, 0], "(b) estimate", "$\\hat\\lambda$ [s/deg]")
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


def figure_4_11() -> Figure:
    """The oscillation at lambda = 1, which the thesis calls instability: ode3 beside RK4, which is stable there."""
    name = "Fig 4.11  Nominal input with the steepness observer: the oscillation at $\\lambda$ = 1 is the solver's"
    cases = (
        (1.0, presets.PRINTED, plotting.UNCOMPENSATED),
        (1.0, presets.OTHER_SOLVER, plotting.GREEN),
        (chapter4.OBSERVED_STEEPNESS, presets.PRINTED, plotting.COMPENSATED),
    )
    figure, axes = plotting.new_figure(3, 2, share_x="col", title=name, size=(9.2, 6.4))
    for row, (truth, setting, color) in zip(axes, cases, strict=True):
        signals = _steepness_run(truth, setting)
        for axis, window in zip(row, (None, (1.7, 1.9)), strict=True):
            shown = panels.within(signals, window)
            axis.plot(*plotting.thin(shown["time"], shown["torque"]), color=color, lw=1.0)
            panels.finish(axis, f"$\\lambda$ = {truth:g} s/deg, {setting}" if window is None else "", panels.TORQUE)
    panels.outer_labels(axes)
    return figure


def _extension(number: int, observer: fpjax.AbstractObserver) -> Figure:
    law = presets.friction(steepness=chapter4.EXTENDED_STEEPNESS)
    name = f"Fig 4.{11 + number}  Extension {number} with the printed gains: 1 Hz sine, $\\lambda$ = 10 s/deg"
    return _two_runs(name, observer, presets.sine(1.0), law)


def figure_4_12() -> Figure:
    """Extension 1."""
    return _extension(1, presets.extension_1(*chapter4.EXTENSION_1))


def figure_4_13() -> Figure:
    """Extension 2."""
    return _extension(2, presets.extension_2(*chapter4.EXTENSION_2))


FIGURES = {
    "figure_4_02": figure_4_2,
    "figure_4_05": figure_4_5,
    "figure_4_06": figure_4_6,
    "figure_4_07": figure_4_7,
    "figure_4_08": figure_4_8,
    "figure_4_09": figure_4_9,
    "figure_4_10": figure_4_10,
    "figure_4_11": figure_4_11,
    "figure_4_12": figure_4_12,
    "figure_4_13": figure_4_13,
}
