"""The picture of the defaults: cost against the best of many starts, and how far off the estimates end."""

from pathlib import Path

import numpy as np
from matplotlib.ticker import LogFormatter, LogLocator, NullFormatter

from fpjax.output.json_object import JsonObject
from fpjax.output.plotting import BLUE, GREY, RED, new_figure, save, style

ENDS = (1e-2, 1e3)  # range of errors that is shown [%]; others are drawn at its ends


def draw_defaults(rows: list[JsonObject], near: float, path: Path) -> Path:
    """Draw and save.

    Args:
        rows: of the machines, as in defaults.json.
        near: times the best of the many starts that counts as reached [1].
        path: of the picture.
    """
    figure, axes = new_figure(1, 2, size=(9.4, 4.0), title=f"default tuning of {len(rows)} machines")
    with style():
        left, right = axes[0]
        best, cost = (np.array([row[name] for row in rows], float) for name in ("best", "cost"))
        reached = np.array([row["reached"] for row in rows])
        for chosen, color, word in ((reached, BLUE, "reached"), (~reached, RED, "missed")):
            if chosen.any():
                left.loglog(best[chosen], cost[chosen], "o", color=color, markersize=4, label=f"{word}: {chosen.sum()}")
        finite = np.concatenate([best[np.isfinite(best)], cost[np.isfinite(cost)]])
        if finite.size:
            ends = np.array([finite.min(), finite.max()])
            left.loglog(ends, ends, color=GREY, linewidth=0.8, label="equal")
            left.loglog(ends, near * ends, color=GREY, linewidth=0.8, linestyle="--", label=f"{near:g} times the best")
        left.set(xlabel="best cost of many starts", ylabel="cost of the default tuning")
        left.legend(loc="upper left")
        for axis in (left.xaxis, left.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(LogFormatter(labelOnlyBase=False, minor_thresholds=(np.inf, np.inf)))
            axis.set_minor_formatter(NullFormatter())
        for color, name in ((BLUE, "coulomb"), (RED, "viscous")):
            values = sorted(100.0 * abs(row["off"][name]) for row in rows if row["off"].get(name) is not None)
            share = 100.0 * (np.arange(len(values)) + 1.0) / len(rows)
            right.step(np.clip(values, *ENDS), share, where="post", color=color, label=name)
        right.axvline(3.0, color=GREY, linestyle="--", label="3 %")
        right.set(xscale="log", xlabel="error of the settled estimate [%]", ylabel="machines up to it [%]", xlim=ENDS)
        right.legend(loc="lower right")
    return save(figure, path)
