"""Tables and pictures of the withheld check."""

from pathlib import Path
from typing import Any

from .truth.effects import EFFECTS

GOALS = {
    ("single", "top1"): 0.99,
    ("single_off", "top1"): 0.98,
    ("pairs", "both"): 0.94,
    ("pairs", "at_least_one"): 1.0,
    ("none", "false_alarms"): 0.0,
    ("outside", "wrongly_confident"): 0.025,
}
COLUMNS = {
    "single": ("top1", "name", "strict", "top3", "exact_causes"),
    "single_off": ("top1", "name", "strict", "top3", "exact_causes"),
    "pairs": ("both", "at_least_one", "both_in_first_three", "exact_causes"),
    "none": ("false_alarms",),
    "outside": ("wrongly_confident",),
}
BLUE, ORANGE, GREY = "#2a6fbb", "#d9772b", "#8a8f98"


def percent(value: float | None) -> str:
    """A share as a percentage."""
    return "-" if value is None else f"{100 * value:.1f} %"


def shown(value: float | None, digits: int = 3) -> str:
    """A number, or a dash."""
    return "-" if value is None else f"{value:.{digits}g}"


def print_report(summary: dict[str, Any]) -> None:
    """Print the tables."""
    print(f"\n{'set':12}{'cases':>6}  {'figure':24}{'obtained':>10}{'goal':>10}")
    for name, figures in summary["sets"].items():
        for column in COLUMNS[name]:
            goal = GOALS.get((name, column))
            print(f"{name:12}{figures['cases']:6d}  {column:24}{percent(figures[column]):>10}{percent(goal):>10}")
    print(
        f"\n{'set':12}{'Brier':>8}{'closed':>10}{'error':>10}{'p90':>10}{'coverage':>10}"
        f"{'median s':>10}{'worst s':>10}{'failed':>8}"
    )
    for name, figures in [*summary["sets"].items(), *summary["systems"].items()]:
        found, spent = figures["parameters"], figures["time"]
        print(
            f"{name:12}{shown(figures['brier']):>8}{percent(figures['gap_closed']):>10}"
            f"{percent(found['median_error']):>10}{percent(found['p90_error']):>10}"
            f"{percent(found['coverage']):>10}{shown(spent['median']):>10}"
            f"{shown(spent['worst']):>10}{figures['failed']:8d}"
        )
    print(
        f"\nBrier score (pairs apart) {shown(summary['brier'])}, goal 0.02; parameter error "
        f"{percent(summary['parameters']['median_error'])}, goal 0.1 %; coverage "
        f"{percent(summary['parameters']['coverage'])}, goal 90 +- 5 %"
    )
    if summary["calibration"]:
        print(f"\n{'stated':>14}{'mean':>8}{'right':>10}{'cases':>7}")
        for row in summary["calibration"]:
            print(
                f"{row['from']:6.2f} .. {row['to']:4.2f}{row['stated']:8.2f}"
                f"{percent(row['right']):>10}{row['count']:7d}"
            )
    _print_effects(summary)
    if summary["misses"]:
        print(f"\n{len(summary['misses'])} cases count against a goal:")
        for miss in summary["misses"]:
            print(
                f"  {miss['case']} {miss['set']:10} {miss['system']:7} {miss['truth']:44} -> "
                f"{miss['verdict']}: {', '.join(miss['causes']) or '-'} "
                f"(p {shown(miss['probability'], 2)})"
            )


def _print_effects(summary: dict[str, Any]) -> None:
    if not summary["effects"]:
        return
    print(
        f"\n{'effect (single sets)':30}{'cases':>6}{'top1':>10}{'name':>10}{'error':>10}{'coverage':>10}{'closed':>10}"
    )
    for name, figures in summary["effects"].items():
        found = figures["parameters"]
        print(
            f"{name:30}{figures['cases']:6d}{percent(figures['top1']):>10}"
            f"{percent(figures['name']):>10}{percent(found['median_error']):>10}"
            f"{percent(found['coverage']):>10}{percent(figures['gap_closed']):>10}"
        )


def write_pictures(folder: Path, summary: dict[str, Any]) -> None:
    """confusion.png, calibration.png, parameters.png."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    for name, size, draw in (
        ("confusion", (12.5, 11.0), draw_confusion),
        ("calibration", (5.6, 5.4), draw_calibration),
        ("parameters", (8.4, 7.6), draw_parameters),
    ):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure.add_subplot(), summary)
        figure.savefig(folder / f"{name}.png", dpi=130)


def words(name: str) -> str:
    """An effect's name as words."""
    return name.replace("_", " ")


def draw_confusion(axes: Any, summary: dict[str, Any]) -> None:
    """Truth by row, first asserted cause by column, shares of a row as colour, counts as text."""
    import numpy as np

    table = summary["confusion"]
    names = list(EFFECTS)
    rows = [*(n for n in names if n in table), *(n for n in ("no gap", "outside") if n in table)]
    if not rows:  # pairs alone have no first cause to be right
        axes.set_axis_off()
        return
    columns = [*names, "no_gap", "unexplained", "failed"]
    counts = np.array([[table[r].get(c, 0) for c in columns] for r in rows], dtype=float)
    right = {"no gap": ("no_gap",), "outside": ("unexplained",)}
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    # blue where the answer is right, orange where it is not: wrong answers stand out
    colours = np.ones((*counts.shape, 3))
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            good = column in right.get(row, (row,))
            ink = np.array([0.16, 0.44, 0.73]) if good else np.array([0.85, 0.47, 0.17])
            colours[i, j] = 1 - (1 - ink) * shares[i, j] ** 0.7
    axes.imshow(colours, aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        tone = "white" if shares[i, j] > 0.45 else "#333333"
        axes.text(j, i, f"{counts[i, j]:.0f}", ha="center", va="center", color=tone, fontsize=8)
    axes.set_xticks(range(len(columns)), [words(c) for c in columns], rotation=60, ha="right")
    axes.set_yticks(range(len(rows)), [words(r) for r in rows])
    axes.tick_params(length=0, labelsize=8.5)
    axes.set_xticks(np.arange(-0.5, len(columns)), minor=True)
    axes.set_yticks(np.arange(-0.5, len(rows)), minor=True)
    axes.grid(which="minor", color="#e6e8eb", linewidth=0.7)
    axes.tick_params(which="minor", length=0)
    axes.axvline(len(names) - 0.5, color=GREY, linewidth=1)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_xlabel("answered (exact twins and declared confusables count as the truth)")
    axes.set_ylabel("true cause")
    axes.set_title("What was there, and what the diagnosis asserted", loc="left", fontsize=12)


def draw_calibration(axes: Any, summary: dict[str, Any]) -> None:
    """Stated probability against the share that was right, with Wilson intervals."""
    import numpy as np

    axes.plot([0, 1], [0, 1], color=GREY, linewidth=1, linestyle="--", zorder=1)
    axes.text(
        0.30,
        0.34,
        "calibrated",
        rotation=45,
        color=GREY,
        fontsize=8.5,
        ha="center",
        rotation_mode="anchor",
        transform_rotates_text=True,
    )
    for row in summary["calibration"]:
        n, p, z = row["count"], row["right"], 1.96
        centre = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
        axes.plot([row["stated"]] * 2, [centre - half, centre + half], color=BLUE, linewidth=1.4)
        axes.scatter(
            [row["stated"]], [p], s=22 + 3.0 * min(n, 80), color=BLUE, zorder=3, edgecolor="white", linewidth=0.8
        )
        up = p < 0.9
        axes.annotate(
            f"{n}",
            (row["stated"], p),
            xytext=(9, 6 if up else -13),
            textcoords="offset points",
            fontsize=8,
            color="#444444",
        )
    axes.set(xlim=(-0.02, 1.03), ylim=(-0.02, 1.03), aspect="equal")
    axes.set_xlabel("stated probability of the class at the top")
    axes.set_ylabel("share that was right")
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(f"Calibration: Brier score {shown(summary['brier'])}", loc="left", fontsize=11)


def draw_parameters(axes: Any, summary: dict[str, Any]) -> None:
    """Median and 90th percentile of the parameter error of each effect that was found."""
    rows = [
        (name, figures["parameters"]) for name, figures in summary["effects"].items() if figures["parameters"]["count"]
    ]
    rows.sort(key=lambda row: row[1]["median_error"], reverse=True)
    for i, (_, found) in enumerate(rows):
        low, high = (max(100 * found[k], 1e-3) for k in ("median_error", "p90_error"))
        axes.plot([low, high], [i, i], color=BLUE, linewidth=1.6, alpha=0.55)
        axes.scatter([low], [i], color=BLUE, s=34, zorder=3)
        axes.scatter([high], [i], color=ORANGE, s=18, zorder=3)
        cover = found["coverage"]
        axes.text(
            1.01,
            i,
            "-" if cover is None else f"{100 * cover:.0f} %",
            fontsize=8.5,
            va="center",
            transform=axes.get_yaxis_transform(),
            color="#444444",
        )
    axes.text(1.01, 1.01, "coverage", fontsize=8.5, transform=axes.transAxes, color="#444444")
    axes.axvline(0.1, color=GREY, linewidth=1, linestyle="--")
    axes.set_yticks(range(len(rows)), [words(name) for name, _ in rows], fontsize=8.5)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
    axes.set_xlabel("relative error of a parameter [%]: median (blue), 90th percentile (orange)")
    axes.grid(axis="x", color="#e6e8eb", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_title("Parameters of the causes that were found", loc="left", fontsize=11)
