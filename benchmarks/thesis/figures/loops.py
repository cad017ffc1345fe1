"""Chapter 2's figures: velocities, friction torques and their estimates, nominal inputs."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

import fpjax
from fpjax.output import plotting

from .. import chapter2, presets
from ..presets import COULOMB, DEGREE
from . import panels

CHIRP_DURATION = 10.0  # [s], not printed
NOVEL_GAINS = (1.0, 10.0, 100.0, 500.0)  # not printed

_ALPHA_TITLES = [f"$\\alpha$ = {alpha:g}" for alpha in chapter2.ALPHAS]
_PAIR_TITLES = [f"$\\alpha$ = {alpha:g}, $\\lambda$ = {steepness:g}" for alpha, steepness in chapter2.PAIRS]


def _quadratic() -> list[fpjax.AbstractObserver]:
    return [presets.classical(fpjax.Quadratic(alpha)) for alpha in chapter2.ALPHAS]


def _absolute() -> list[fpjax.AbstractObserver]:
    return [presets.classical(fpjax.Absolute(alpha)) for alpha in chapter2.ALPHAS]


def _log_cosh() -> list[fpjax.AbstractObserver]:
    return [presets.classical(fpjax.LogCosh(alpha, steepness)) for alpha, steepness in chapter2.PAIRS]


def _torques(observers: Sequence[fpjax.AbstractObserver], titles: Sequence[str], name: str) -> Figure:
    """Coulomb torque and its estimate, at 10 Hz."""
    figure, axes = plotting.new_figure(2, 2, share_x=True, share_y=True, title=name, size=(8.8, 5.2))
    for axis, observer, title in zip(axes.flat, observers, panels.lettered(titles), strict=True):
        signals = panels.record(observer, presets.sine(10.0), chapter2.DURATION, "velocity", "estimates.coulomb")
        side = np.sign(signals["velocity"])
        existing = signals["time"], COULOMB * side
        estimated = signals["time"], signals["estimates.coulomb"] * side
        panels.estimate_panel(axis, existing, estimated, title=title)
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


def figure_2_4() -> Figure:
    """Velocities with CFP through g1."""
    name = "Fig 2.4  CFP with $g_1$: 10 Hz sine, with and without compensation"
    figure, axes = plotting.new_figure(2, 2, share_x=True, share_y=True, title=name, size=(8.8, 5.2))
    signals = ("reference", "velocity")
    bare = panels.record(fpjax.NoObserver(), presets.sine(10.0), chapter2.DURATION, *signals)
    for axis, observer, title in zip(axes.flat, _quadratic(), panels.lettered(_ALPHA_TITLES), strict=True):
        with_it = panels.record(observer, presets.sine(10.0), chapter2.DURATION, *signals)
        panels.velocities(axis, panels.with_and_without(bare, with_it), panels.COLORS, title=title)
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


def figure_2_5() -> Figure:
    """Torques with CFP through g1."""
    return _torques(_quadratic(), _ALPHA_TITLES, "Fig 2.5  CFP with $g_1$: Coulomb torque and its estimate")


def figure_2_6() -> Figure:
    """Nominal input for growing gains."""
    figure, axes = plotting.new_figure(2, 1, title="Fig 2.6  Nominal input $u_n$, CFP with $g_1$", size=(6.8, 5.6))
    observers = {"no compensation": fpjax.NoObserver()} | dict(zip(_ALPHA_TITLES, _quadratic(), strict=True))
    for (label, observer), color in zip(observers.items(), (plotting.GREY, *plotting.SERIES), strict=False):
        signals = panels.record(observer, presets.sine(10.0), chapter2.DURATION, "torque")
        for axis, window in ((axes[0, 0], None), (axes[1, 0], (0.0, 0.03))):
            shown = panels.within(signals, window)
            axis.plot(*plotting.thin(shown["time"], shown["torque"]), color=color, label=label, lw=1.0)
    for axis, title in zip(axes[:, 0], ("(a) whole run", "(b) its start, where the overshoot is"), strict=True):
        panels.finish(axis, title, panels.TORQUE)
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0], 5)
    return figure


def figure_2_7() -> Figure:
    """Torques with CFP through g2."""
    return _torques(_absolute(), _ALPHA_TITLES, "Fig 2.7  CFP with $g_2$: Coulomb torque and its estimate")


def figure_2_8() -> Figure:
    """Torques with CFP through g3."""
    return _torques(_log_cosh(), _PAIR_TITLES, "Fig 2.8  CFP with $g_3$: Coulomb torque and its estimate")


def figure_2_9() -> Figure:
    """The three nonlinearities."""
    velocity = np.linspace(-3.0, 3.0, 601)
    figure, axes = plotting.new_figure(title="Fig 2.9  The nonlinearities for $\\alpha$ = 10, $\\lambda$ = 1")
    functions = {"$g_1$": fpjax.Quadratic(10.0), "$g_2$": fpjax.Absolute(10.0), "$g_3$": fpjax.LogCosh(10.0, 1.0)}
    for (label, function), color in zip(functions.items(), plotting.SERIES, strict=False):
        axes[0, 0].plot(velocity, np.asarray(function.value(velocity)), color=color, label=label)
    panels.finish(axes[0, 0], "", "g [N m]")
    axes[0, 0].set_xlabel(panels.VELOCITY)
    axes[0, 0].legend()
    return figure


def _modified(duration: float, reference: fpjax.AbstractReference) -> dict:
    runs = [
        panels.record(observer, reference, duration, "reference", "velocity")
        for observer in (fpjax.NoObserver(), presets.modified(fpjax.Absolute(10.0)))
    ]
    return panels.with_and_without(*runs)


def figure_2_11() -> Figure:
    """Velocities with MFP."""
    figure, axes = plotting.new_figure(title="Fig 2.11  MFP with $g_2$, $\\alpha$ = 10: 10 Hz sine", size=(7.4, 3.8))
    panels.velocities(axes[0, 0], _modified(chapter2.DURATION, presets.sine(10.0)), panels.COLORS)
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


def figure_2_12() -> Figure:
    """A reversal of Fig 2.11."""
    figure, axes = plotting.new_figure(title="Fig 2.12  Reversals of Fig 2.11", size=(7.4, 3.8))
    runs = _modified(chapter2.DURATION, presets.sine(10.0))
    panels.velocities(axes[0, 0], runs, panels.COLORS, window=(0.24, 0.32))
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


def figure_2_13() -> Figure:
    """Chirp response with MFP."""
    name = f"Fig 2.13  MFP: chirp from 1 to 100 Hz in {CHIRP_DURATION:g} s (its length is not printed)"
    runs = _modified(CHIRP_DURATION, fpjax.Chirp(1.0, 1.0, 100.0, CHIRP_DURATION))
    return panels.chirp_figure(name, runs, CHIRP_DURATION)


def _novel(gain: float, *signals: str) -> dict[str, np.ndarray]:
    return panels.record(
        presets.novel(gain), presets.sine(1.0), 2.0, *signals, law=fpjax.Viscous(viscous=presets.NOVEL_VISCOUS)
    )


def figure_2_15() -> Figure:
    """NFP's estimate of b."""
    name = "Fig 2.15  NFP: estimate of b, 1 Hz sine (the gains are not printed)"
    figure, axes = plotting.new_figure(title=name, size=(7.4, 3.8))
    axis = axes[0, 0]
    for gain, color in zip(NOVEL_GAINS, plotting.SERIES, strict=False):
        signals = _novel(gain, "estimates.viscous")
        axis.plot(
            *plotting.thin(signals["time"], signals["estimates.viscous"] / DEGREE),
            color=color,
            label=f"$\\alpha$ = {gain:g}",
        )
    axis.axhline(presets.NOVEL_VISCOUS / DEGREE, color=plotting.TRUTH, ls="--", lw=1.0, label="true")
    panels.finish(axis, "", "$\\hat b$ [N m s/rad]")
    panels.outer_labels(axes)
    panels.legend(figure, axis, 5)
    return figure


def figure_2_16() -> Figure:
    """Viscous torque and its estimate on top of the Coulomb torque."""
    name = "Fig 2.16  NFP, $\\alpha$ = 100: viscous torque on top of the Coulomb torque"
    figure, axes = plotting.new_figure(2, 1, share_x=True, title=name, size=(7.4, 5.2))
    signals = _novel(100.0, "velocity", "estimates.viscous")
    time, velocity = signals["time"], signals["velocity"]
    true, estimated = presets.NOVEL_VISCOUS * velocity, signals["estimates.viscous"] * velocity
    coulomb = COULOMB * np.sign(velocity)
    panels.estimate_panel(
        axes[0, 0], (time, coulomb + true), (time, coulomb + estimated), title="(a) Coulomb + viscous"
    )
    panels.estimate_panel(axes[1, 0], (time, true), (time, estimated), title="(b) viscous alone")
    panels.outer_labels(axes)
    panels.legend(figure, axes[0, 0])
    return figure


FIGURES = {
    "figure_2_04": figure_2_4,
    "figure_2_05": figure_2_5,
    "figure_2_06": figure_2_6,
    "figure_2_07": figure_2_7,
    "figure_2_08": figure_2_8,
    "figure_2_09": figure_2_9,
    "figure_2_11": figure_2_11,
    "figure_2_12": figure_2_12,
    "figure_2_13": figure_2_13,
    "figure_2_15": figure_2_15,
    "figure_2_16": figure_2_16,
}
