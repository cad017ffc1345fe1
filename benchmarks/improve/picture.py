"""Picture: the true tracking error with each way of tuning, and the promises beside it."""

from pathlib import Path

import numpy as np

from fpjax.output.plotting import BLUE, GREY, RED, new_figure, save, style

from .score import Row


def draw(rows: list[Row], path: Path) -> None:
    """One line for each machine: error in the truth over that with the recorded gains."""
    order = sorted(rows, key=lambda row: row["error_improve"] / row["error_now"])
    names = [f"{'+'.join(row['effects']) or 'none'}, {row['sensors']}" for row in order]
    with style():
        figure, axes = new_figure(1, 1, size=(8.0, 1.2 + 0.28 * len(order)))
        axis = axes[0, 0]
        for place, row in enumerate(order):
            now = row["error_now"]
            low, high = row["promised"]
            if low is not None:
                axis.plot([low / now, high / now], [place, place], color=BLUE, linewidth=5.0, alpha=0.25)
            for key, colour, mark in (("nominal", RED, "o"), ("improve", BLUE, "o"), ("truth", GREY, "|")):
                if row[f"error_{key}"] is None:
                    continue
                value = row[f"error_{key}"] / now
                axis.plot([np.clip(value, 0.0, 2.0)], [place], mark, color=colour, markersize=7 if mark == "|" else 5)
        axis.axvline(1.0, color=GREY, linewidth=0.8, linestyle="--")
        axis.set_yticks(range(len(order)), names, fontsize=7)
        axis.set(
            xlabel="tracking error in the truth, over that with the gains that ran; bar: promised", xlim=(0.0, 2.05)
        )
        for label, colour in (("tuned in the nominal model", RED), ("improve", BLUE), ("tuned in the truth", GREY)):
            axis.plot([], [], "o", color=colour, label=label)
        axis.legend(loc="lower right")
    save(figure, path)
