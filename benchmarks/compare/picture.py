"""Curves of cost against budget."""

from pathlib import Path

from matplotlib import rc_context
from matplotlib.ticker import NullFormatter

from fpjax.output.json_object import JsonObject
from fpjax.output.plotting import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, STYLE, new_figure, save

from .race import SWEEP

COLOURS = {
    "algorithm_1": RED,
    "algorithm_1_repaired": ORANGE,
    "levenberg_marquardt": BLUE,
    "lbfgs": GREEN,
    "adam": PURPLE,
    "nelder_mead": GREY,
}


def draw(rows: list[JsonObject], observer: str, objective: str, path: Path) -> Path:
    """One panel for each reference: best cost so far over simulations used, and the minimum of the sweep."""
    ours = [row for row in rows if (row["observer"], row["objective"]) == (observer, objective)]
    labels = list(dict.fromkeys(row["reference"] for row in ours))
    with rc_context(STYLE):
        columns = min(3, len(labels))
        figure, panels = new_figure(
            -(-len(labels) // columns),
            columns,
            size=(4.0 * columns, 2.9 * -(-len(labels) // columns) + 0.6),
            title=f"{observer}: best {objective} cost so far",
        )
        handles: JsonObject = {}
        for place, axes in enumerate(panels.flat):
            if place >= len(labels):
                axes.set_visible(False)
                continue
            for row in (row for row in ours if row["reference"] == labels[place]):
                method = row["method"]
                if method == SWEEP:
                    # The joint panel is the last of six; its sweep counts the simulations of all five references.
                    name = f"minimum of the dense sweep ({row['simulations'] // (5 if place == 5 else 1)} simulations)"
                    handles["least cost of the dense sweep"] = axes.axhline(
                        row["cost"], color=BLACK, linestyle=":", linewidth=1.2, label=name
                    )
                    continue
                used = [number for number, cost in row["history"] if cost is not None]
                costs = [cost for _, cost in row["history"] if cost is not None]
                (handles[method],) = axes.step(used, costs, where="post", color=COLOURS[method], label=method)
                axes.plot(used[-1], costs[-1], ".", color=COLOURS[method])
            axes.set(title=labels[place], xscale="log", yscale="log")
            axes.xaxis.set_minor_formatter(NullFormatter())
            if place + columns >= len(labels):
                axes.set_xlabel("simulations, tangents counted")
            if place % columns == 0:
                axes.set_ylabel("cost")
        named = [name.replace("_", " ") for name in handles]
        figure.legend(list(handles.values()), named, loc="outside lower center", ncols=4, frameon=False)
        return save(figure, path)
