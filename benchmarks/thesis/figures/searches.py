"""Figs 4.3 and 4.4: the course of Algorithm 1."""

from matplotlib.figure import Figure

from fpjax.output import plotting

from .. import presets, search
from . import panels


def figure_4_3() -> Figure:
    """Gains and error by iteration, on the sine."""
    name = "Fig 4.3  Algorithm 1 on the 1 Hz sine"
    figure, axes = plotting.new_figure(3, 1, share_x=True, title=name, size=(6.8, 6.4))
    found = search.efp_searches(presets.PRINTED)["sine"]
    iterations = range(1, len(found.errors) + 1)
    rows = (("$\\alpha_2$", found.gain_2), ("$\\alpha_1$", found.gain_1), ("cost", found.errors))
    for axis, (label, values), color in zip(axes[:, 0], rows, plotting.SERIES, strict=False):
        axis.plot(iterations, values, color=color, marker="o", ms=3)
        panels.finish(axis, "", label)
    axes[2, 0].set_yscale("log")
    axes[2, 0].axhline(search.THRESHOLD, color=plotting.TRUTH, ls="--", lw=1.0)
    panels.outer_labels(axes, "iteration")
    return figure


def figure_4_4() -> Figure:
    """Cost by iteration, on every reference."""
    name = "Fig 4.4  Algorithm 1: cost by iteration and reference"
    figure, axes = plotting.new_figure(title=name, size=(7.4, 4.2))
    axis = axes[0, 0]
    colors = dict(zip(search.REFERENCES, plotting.SERIES, strict=False)) | {"square": plotting.YELLOW}
    for reference, found in search.efp_searches(presets.PRINTED).items():
        # Drawn wide: within 0.5 s the 1 Hz square is the constant, and its curve lies on this one.
        wide = reference == "constant"
        axis.semilogy(
            range(1, len(found.errors) + 1),
            found.errors,
            color=colors[reference],
            marker="o",
            ms=6 if wide else 3,
            lw=4.0 if wide else 1.3,
            label=reference,
        )
    axis.axhline(search.THRESHOLD, color=plotting.TRUTH, ls="--", lw=1.0)
    panels.finish(axis, "", "final |errors| of $\\hat k$ and $\\hat b$, summed")
    panels.outer_labels(axes, "iteration")
    panels.legend(figure, axis, 5)
    return figure


FIGURES = {"figure_4_03": figure_4_3, "figure_4_04": figure_4_4}
