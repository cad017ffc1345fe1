"""Tables and pictures of the withheld check."""

from pathlib import Path

from matplotlib.axes import Axes

from fpjax.output.json_object import JsonObject

from .calibration import print_by_verdict, print_curves
from .contract import EFFECTS
from .goals import print_goals
from .summary import VERDICTS

HEADS = (
    ("right first", "name"),
    ("asserted", "right"),
    ("both", "both"),
    ("one", "at_least_one"),
    ("alarms", "false_alarms"),
    ("wrong cause", "wrongly_asserted"),
    ("wrongly sure", "wrongly_sure"),
    ("closed", "gap_closed"),
)
BLUE, ORANGE, GREY = "#2a6fbb", "#d9772b", "#8a8f98"
KIND_COLOURS = {"rate sensor": BLUE, "encoder only": ORANGE, "derived velocity": "#3a8f5c"}


def percent(value: float | None) -> str:
    """A share as a percentage."""
    return "-" if value is None else f"{100 * value:.1f} %"


def shown(value: float | None, digits: int = 3) -> str:
    """A number, or a dash."""
    return "-" if value is None else f"{value:.{digits}g}"


def print_report(summary: JsonObject) -> None:
    """Print the tables."""
    print_goals(summary["goals"])
    print(f"\n{'logs':32}{'cases':>6}" + "".join(f"{head:>13}" for head, _ in HEADS))
    rows = [*summary["groups"].items(), *summary["recordings"].items(), ("all", summary["all"])]
    for name, figures in rows:
        cells = "".join(f"{percent(figures[column]):>13}" for _, column in HEADS)
        print(f"{name:32}{figures['cases']:6d}{cells}")
    print(f"\n{'logs':32}" + "".join(f"{verdict:>17}" for verdict in VERDICTS))
    for name, figures in rows:
        print(f"{name:32}" + "".join(f"{figures['verdicts'][verdict]:>17}" for verdict in VERDICTS))
    print(
        f"\n{'logs':32}{'error':>9}{'p90':>9}{'90 % intervals hold the truth: same law':>42}{'another form':>18}"
        f"{'nominal named':>16}{'corrected':>16}{'median s':>10}{'worst s':>9}"
    )
    for name, figures in rows:
        found, spent = figures["parameters"], figures["time"]
        print(
            f"{name:32}{percent(found['median_error']):>9}{percent(found['p90_error']):>9}"
            f"{percent(found['coverage_same_law']) + ' of ' + str(found['count_same_law']):>42}"
            f"{percent(found['coverage_other_form']) + ' of ' + str(found['count_other_form']):>18}"
            f"{percent(figures['nominal_named']):>16}"
            f"{percent(figures['nominal_corrected']) + ' of ' + str(figures['nominal_count']):>16}"
            f"{shown(spent['median']):>10}{shown(spent['worst']):>9}"
        )
    sure = summary["sure"]
    print(
        f"\n{sure['statements']} statements above {sure['limit']:g}, {sure['wrong']} of them wrong, in "
        f"{sure['wrong_cases']} logs. Brier score (pairs apart) {shown(summary['brier'])}."
    )
    print_by_verdict(summary["statements"])
    print_curves(summary["calibration"])
    _print_effects(summary)
    if summary["misses"]:
        print(f"\n{len(summary['misses'])} cases count against a goal:")
        for miss in summary["misses"]:
            print(
                f"  {miss['case']} {miss['group']:28} {miss['system']:7} {miss['truth']:44} -> "
                f"{miss['verdict']}: {', '.join(miss['causes']) or '-'} "
                f"(p {shown(miss['probability'], 2)}){' WRONGLY SURE' if miss['wrongly_sure'] else ''}"
            )


def _print_effects(summary: JsonObject) -> None:
    if not summary["effects"]:
        return
    heads = "".join(f"{head:>10}" for head in ("first", "asserted", "error", "coverage", "closed"))
    print(f"\n{'effect (one at a time)':30}{'cases':>6}{heads}")
    for name, figures in summary["effects"].items():
        found = figures["parameters"]
        print(
            f"{name:30}{figures['cases']:6d}{percent(figures['name']):>10}"
            f"{percent(figures['right']):>10}{percent(found['median_error']):>10}"
            f"{percent(found['coverage']):>10}{percent(figures['gap_closed']):>10}"
        )


def write_pictures(folder: Path, summary: JsonObject) -> None:
    """confusion.png, calibration.png, parameters.png."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    for name, size, draw in (
        ("confusion", (12.5, 4.0 + 0.27 * len(summary["confusion"])), draw_confusion),
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


def draw_confusion(axes: Axes, summary: JsonObject) -> None:
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
    # Blue where the answer is right, orange where it is wrong.
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


def draw_calibration(axes: Axes, summary: JsonObject) -> None:
    """Stated probability against the share that was right, by kind of sensors, with Wilson intervals and counts."""
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
    kinds = [kind for kind in summary["calibration"] if kind != "all"]
    for place, kind in enumerate(kinds):
        colour, shift = KIND_COLOURS[kind], 0.006 * (place - (len(kinds) - 1) / 2)
        for row in summary["calibration"][kind]:
            # Wilson score interval of a proportion p of n at 95 %: it stays within 0 to 1 also for few cases.
            n, p, z = row["count"], row["right"], 1.96
            centre = (p + z * z / (2 * n)) / (1 + z * z / n)
            half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
            x = row["stated"] + shift
            axes.plot([x, x], [centre - half, centre + half], color=colour, linewidth=1.2, alpha=0.7)
            axes.scatter([x], [p], s=18 + 2.5 * min(n, 80), color=colour, zorder=3, edgecolor="white", linewidth=0.8)
            axes.annotate(
                f"{n}",
                (x, p),
                # the last two bins lie close together: their counts stand on either side
                xytext=(-7 if 0.88 < row["stated"] < 0.955 else 7, 5 if p < 0.9 else -11 - 9 * place),
                ha="right" if 0.88 < row["stated"] < 0.955 else "left",
                textcoords="offset points",
                fontsize=7.5,
                color=colour,
            )
        axes.scatter([], [], color=colour, label=f"{kind} ({sum(r['count'] for r in summary['calibration'][kind])})")
    if kinds:
        axes.legend(frameon=False, fontsize=8.5, loc="upper left")
    axes.set(xlim=(-0.02, 1.06), ylim=(-0.02, 1.03), aspect="equal")
    axes.set_xlabel("stated probability of the class at the top")
    axes.set_ylabel("share that was right")
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(f"Calibration: Brier score {shown(summary['brier'])}", loc="left", fontsize=11)


def draw_parameters(axes: Axes, summary: JsonObject) -> None:
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
