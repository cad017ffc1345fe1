"""One set of colours for pictures and page: each role has a light and a dark shade, and pictures follow the page."""

from contextlib import AbstractContextManager
from typing import Any

from matplotlib import rc_context

from ...output.plotting import BLUE, GREY, RED, STYLE

# role: (light, dark). All light shades differ, because `svg` finds the role of a colour by its shade.
# Before and after are the vermilion and the blue of Okabe and Ito, which colour-blind readers can distinguish.
ROLES = {
    "paper": ("#ffffff", "#14171b"),
    "ink": ("#1a1d21", "#e9ecef"),
    "muted": ("#5a616b", "#a7afba"),
    "axis": ("#8a919b", "#6d7681"),
    "grid": ("#e6e8eb", "#2b3138"),
    "soft": ("#c3cad4", "#4a535e"),
    "band": ("#f4ead0", "#3a3424"),
    "before": (RED.lower(), "#f0883e"),
    "after": (BLUE.lower(), "#5ab2ef"),
    "floor": (GREY.lower(), "#98a1ac"),
}
PAPER, INK, MUTED, AXIS, GRID, SOFT, BAND, BEFORE, AFTER, FLOOR = (light for light, _ in ROLES.values())

# What the report changes in the common style: its own greys, and text that stays text in an SVG.
_STYLE: Any = {
    **STYLE,
    "figure.facecolor": PAPER,
    "axes.facecolor": "none",
    "savefig.facecolor": PAPER,
    "text.color": INK,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": AXIS,
    "axes.titlecolor": INK,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlepad": 7.0,
    "axes.labelsize": 8.5,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.formatter.use_mathtext": False,
    "axes.unicode_minus": True,
    "font.size": 9.0,
    "grid.color": GRID,
    "xtick.color": AXIS,
    "ytick.color": AXIS,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    # on paper: a legend without free space of its own stays readable over the curves
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.facecolor": PAPER,
    "legend.edgecolor": "none",
    "legend.fontsize": 8.5,
    "svg.fonttype": "none",
    # a log's name may hold a dollar sign
    "text.parse_math": False,
}


def report_style(salt: str = "fpjax") -> AbstractContextManager[None]:
    """The style within a `with` block.

    Args:
        salt: of the identifiers within an SVG, so that the same figure gives the same bytes.
    """
    return rc_context({**_STYLE, "svg.hashsalt": salt})


def css_variables() -> str:
    """The roles as CSS variables: light by default and in print, dark where the reader's device asks for it."""
    light = "".join(f"--{role}:{shade};" for role, (shade, _) in ROLES.items())
    dark = "".join(f"--{role}:{shade};" for role, (_, shade) in ROLES.items())
    return f":root{{color-scheme:light dark;{light}}}@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}"
