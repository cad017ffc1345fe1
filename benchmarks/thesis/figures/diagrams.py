"""Block diagrams: Figs 2.10, 2.14 and 3.5, from one list of boxes and arrows."""

import dataclasses
from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from fpjax import plotting

HEIGHT = 0.62
RADIUS = 0.16


@dataclasses.dataclass(frozen=True)
class Box:
    """A block at (x, y), `width` wide."""

    text: str
    x: float
    y: float
    width: float = 1.3


def _draw(name: str, boxes: Sequence[Box], sums: Sequence[tuple[float, float]], arrows: Sequence, texts: Sequence) -> Figure:
    """Boxes, sums, arrows (each a list of corners) and texts (x, y, text)."""
    figure, axes = plotting.new_figure(title=name, size=(8.6, 3.4))
    axis = axes[0, 0]
    for box in boxes:
        corner = (box.x - box.width / 2, box.y - HEIGHT / 2)
        axis.add_patch(
            FancyBboxPatch(corner, box.width, HEIGHT, boxstyle="round,pad=0.03", fc="#EEF4FA", ec=plotting.BLUE, lw=1.1)
        )
        axis.text(box.x, box.y, box.text, ha="center", va="center", fontsize=10)
    for place in sums:
        axis.add_patch(Circle(place, RADIUS, fc="white", ec=plotting.BLACK, lw=1.0, zorder=3))
        axis.text(*place, "+", ha="center", va="center", fontsize=10, zorder=4)
    for corners in arrows:
        xs, ys = zip(*corners, strict=True)
        axis.plot(xs[:-1], ys[:-1], color=plotting.BLACK, lw=1.0)
        axis.annotate(
            "", corners[-1], corners[-2], arrowprops={"arrowstyle": "-|>", "color": plotting.BLACK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
        )
    for x, y, text in texts:
        axis.text(x, y, text, ha="center", va="center", fontsize=9.5)
    axis.set_xlim(-0.6, 9.6)
    axis.set_ylim(-2.5, 1.3)
    axis.set_aspect("equal")
    axis.set_axis_off()
    return figure


def _observer_loop(name: str, observer: str, friction: str, compensation: str, high_order: str = "") -> Figure:
    """Controller, sum of compensation, plant with its friction, and the observer below."""
    tap = 3.2  # where the observer takes u
    boxes = [
        Box("$C(s)$", 1.9, 0.0, 1.1),
        Box(f"{high_order}$\\frac{{1}}{{Js}}$" if not high_order else "$P_{HO}(s)$", 5.3, 0.0, 1.1),
        Box(observer, 4.2, -1.9, 2.4),
        Box(friction, 7.6, 1.0, 1.9),
    ]
    del tap
    return _draw(name, boxes, [], [], [])


FIGURES: dict = {}
