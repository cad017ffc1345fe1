"""Block diagrams: Figs 2.10, 2.14 and 3.5."""

import dataclasses
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from fpjax.output import plotting

HEIGHT, RADIUS = 0.66, 0.17  # of a box and of a summing point, in the units of the diagram
FILL = "#EEF4FA"

Corners = Sequence[tuple[float, float]]


@dataclasses.dataclass(frozen=True)
class _Loop:
    """What differs between the diagrams."""

    observer: str
    compensation: str
    friction: str
    high_order: bool = False


def _box(axis: Axes, text: str, x: float, y: float, width: float) -> None:
    corner = (x - width / 2.0, y - HEIGHT / 2.0)
    axis.add_patch(FancyBboxPatch(corner, width, HEIGHT, boxstyle="round,pad=0.02", fc=FILL, ec=plotting.BLUE, lw=1.2))
    axis.text(x, y, text, ha="center", va="center", fontsize=10)


def _sum(axis: Axes, x: float, signs: dict[tuple[float, float], str]) -> None:
    axis.add_patch(Circle((x, 0.0), RADIUS, fc="white", ec=plotting.BLACK, lw=1.1, zorder=3))
    for (right, up), sign in signs.items():
        axis.text(x + right, up, sign, ha="center", va="center", fontsize=9)


def _arrow(axis: Axes, corners: Corners) -> None:
    xs, ys = zip(*corners, strict=True)
    axis.plot(xs, ys, color=plotting.BLACK, lw=1.1)
    # An arrow head without a shaft: the line drawn before it keeps the corners square.
    axis.annotate(
        "",
        corners[-1],
        corners[-2],
        arrowprops={"arrowstyle": "-|>", "color": plotting.BLACK, "lw": 1.1, "shrinkA": 0, "shrinkB": 0},
    )


def _draw(name: str, loop: _Loop) -> Figure:
    figure, axes = plotting.new_figure(title=name, size=(9.2, 3.9))
    axis = axes[0, 0]
    # The block P_HO needs room: everything to the right of the controller is shifted.
    shift = 1.75 if loop.high_order else 0.0
    tap, first, second, plant, end = (3.3 + shift, 4.2 + shift, 5.6 + shift, 7.0 + shift, 8.2 + shift)
    low, high, bottom = -1.55, 1.25, -2.45

    _arrow(axis, [(0.0, 0.0), (0.85 - RADIUS, 0.0)])
    _sum(axis, 0.85, {(-0.32, 0.2): "+", (-0.2, -0.34): "\N{MINUS SIGN}"})
    _arrow(axis, [(0.85 + RADIUS, 0.0), (1.5, 0.0)])
    _box(axis, "$C(s)$", 2.1, 0.0, 1.1)
    if loop.high_order:
        _arrow(axis, [(2.65, 0.0), (3.25, 0.0)])
        _box(axis, "$P_{HO}(s)$", 3.9, 0.0, 1.25)
    _arrow(axis, [(2.65 + shift * 1.07, 0.0), (first - RADIUS, 0.0)])
    _sum(axis, first, {(-0.3, 0.2): "+", (-0.2, -0.34): "+"})
    _arrow(axis, [(first + RADIUS, 0.0), (second - RADIUS, 0.0)])
    _sum(axis, second, {(-0.3, 0.2): "+", (-0.2, 0.36): "\N{MINUS SIGN}"})
    _arrow(axis, [(second + RADIUS, 0.0), (plant - 0.5, 0.0)])
    _box(axis, r"$\dfrac{1}{(J_m + J_l)s}$" if loop.high_order else r"$\dfrac{1}{Js}$", plant, 0.0, 1.2)
    _arrow(axis, [(plant + 0.6, 0.0), (end + 0.7, 0.0)])

    _box(axis, loop.friction, plant - 0.1, high, 1.9)
    _arrow(axis, [(end, 0.0), (end, high), (plant + 0.85, high)])
    _arrow(axis, [(plant - 1.05, high), (second, high), (second, RADIUS)])
    _box(axis, loop.observer, 5.7 + shift, low, 3.4)
    _arrow(axis, [(tap, 0.0), (tap, low), (4.0 + shift, low)])
    _arrow(axis, [(end, 0.0), (end, low), (7.4 + shift, low)])
    _arrow(axis, [(first, low + HEIGHT / 2.0), (first, -RADIUS)])
    _arrow(axis, [(end + 0.3, 0.0), (end + 0.3, bottom), (0.85, bottom), (0.85, -RADIUS)])

    for x, text in ((0.2, "$r$"), (tap, "$u$"), (0.5 * (first + second), "$u_n$"), (end + 0.55, "$w$")):
        axis.text(x, 0.22, text, ha="center", va="center")
    axis.text(first + 0.12, 0.45 * low, loop.compensation, ha="left", va="center")
    axis.set(xlim=(-0.2, end + 0.9), ylim=(bottom - 0.2, high + HEIGHT), aspect="equal")
    axis.set_axis_off()
    return figure


def figure_2_10() -> Figure:
    """System with MFP."""
    observer = r"$\dot z = g'(w)\,(u - bw)/J,\quad \hat k = z - g(w)$"
    return _draw(
        "Fig 2.10  System with MFP", _Loop(observer, r"$\hat k\,\mathrm{sign}(w)$", r"$k\,\mathrm{sign}(w) + bw$")
    )


def figure_2_14() -> Figure:
    """System with NFP."""
    observer = r"$\dot z = g'(w)\,u/J,\quad \hat b = z - g(w)$"
    return _draw("Fig 2.14  System with NFP", _Loop(observer, r"$\hat b\,w$", "$bw$"))


def figure_3_5() -> Figure:
    """Two masses with CFP."""
    observer = r"$\dot z = g'(w)\,u/J,\quad \hat k = z - g(w)$"
    loop = _Loop(observer, r"$\hat k\,\mathrm{sign}(w)$", r"$k\,\mathrm{sign}(w)$", high_order=True)
    return _draw("Fig 3.5  Two masses with CFP: friction and compensation act on the load", loop)


FIGURES = {"figure_2_10": figure_2_10, "figure_2_14": figure_2_14, "figure_3_05": figure_3_5}
