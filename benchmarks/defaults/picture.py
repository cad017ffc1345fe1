"""The picture of the defaults: cost against the best of many starts, and how far off the estimates end."""

from pathlib import Path
from typing import Any

import numpy as np

from fpjax.output.plotting import BLUE, GREY, RED, new_figure, save, style


def draw_defaults(rows: list[dict[str, Any]], near: float, path: Path) -> Path:
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
        for color, name in ((BLUE, "coulomb"), (RED, "viscous")):
            values = sorted(100.0 * abs(row["off"][name]) for row in rows if row["off"].get(name) is not None)
            share = 100.0 * (np.arange(len(values)) + 1.0) / len(rows)
            right.step(np.maximum(values, 1e-3), share, where="post", color=color, label=name)
        right.axvline(3.0, color=GREY, linestyle="--", label="3 %")
        right.set(xscale="log", xlabel="error of the settled estimate [%]", ylabel="machines up to it [%]")
        right.legend(loc="upper left")
    return save(figure, path)
