"""A figure as inline SVG or PNG; in SVG, colours become CSS variables of the page and text takes its font."""

import io
import json
import re
from html import escape

from matplotlib.figure import Figure

from ...output.json_object import JsonObject
from .theme import ROLES, report_style

# From a light shade, as drawn, to its role: matplotlib writes colours as hexadecimal numbers.
_SHADES = {light: role for role, (light, _) in ROLES.items()}


def to_svg(figure: Figure, name: str, description: str) -> str:
    """The figure as one `<svg>` element for a page.

    Args:
        figure: drawn in the theme's colours.
        name: unique on the page; identifiers in the picture begin with it.
        description: what the picture shows, for readers who cannot see it.
    """
    buffer = io.StringIO()
    # No date, and identifiers from `name`: the same diagnosis gives the same bytes.
    with report_style(name):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    # Without the XML header, comments and metadata, which have no place within HTML.
    text = text[text.index("<svg") :]
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    # Identifiers and references to them get the name as prefix: several pictures share one page.
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r"url\(#", f"url(#{name}-", text)
    text = re.sub(r'xlink:href="#', f'href="#{name}-', text)
    # The root keeps its viewBox only: the page sets the width, and inline SVG needs no namespaces.
    box = re.search(r'viewBox="[^"]*"', text)
    label, axes = escape(description, quote=True), escape(json.dumps(_axes(figure)), quote=True)
    text = re.sub(
        r"<svg[^>]*>",
        lambda _: f'<svg {box.group() if box else ""} role="img" aria-label="{label}" data-axes="{axes}">',
        text,
        count=1,
    )
    text = re.sub(r"#[0-9a-f]{6}\b", lambda found: _shade(found.group()), text)
    text = re.sub(r'(?<= d=")[^"]*', lambda found: _shorten(found.group()), text)
    text = re.sub(r"(font(?:-family)?): [^;\"]*?('[^;\"]*|sans-serif)(?=[;\"])", _inherit_font, text)
    return re.sub(r"\n\s*", "\n", text).strip()


def _axes(figure: Figure) -> list[JsonObject]:
    """Position and range of each panel, for the values under the reader's pointer.

    An axis is [from, to, low, high, log, label]: where it lies in the picture [1/72 inch], its values there, whether
    it is logarithmic, and its label.

    SVG has its origin at the top and 72 units an inch, matplotlib at the bottom and `dpi` pixels.
    """
    found = []
    points, height = 72.0 / figure.dpi, 72.0 * figure.get_figheight()
    for axes in figure.axes:
        box = axes.get_window_extent()
        sides = {"x": (box.x0, box.x1), "y": (box.y0, box.y1)}
        panel: JsonObject = {}
        for side, (low, high) in sides.items():
            axis = getattr(axes, f"{side}axis")
            # Axes with words as ticks have no number under the pointer.
            if axis.get_major_formatter().__class__.__name__ == "FixedFormatter" or not len(axis.get_ticklocs()):
                continue  # names, not numbers
            ends = [points * low, points * high] if side == "x" else [height - points * low, height - points * high]
            limits = [float(end) for end in axis.get_view_interval()]
            together = getattr(axes, f"get_shared_{side}_axes")().get_siblings(axes)  # a shared axis is labelled once
            labels = (getattr(each, f"{side}axis").get_label().get_text() for each in (axes, *together))
            label = next(filter(None, labels), "")
            panel[side] = [*(round(float(end), 2) for end in ends), *limits, axis.get_scale() == "log", label]
        panel["box"] = [
            round(float(v), 2)
            for v in (points * box.x0, height - points * box.y1, points * box.x1, height - points * box.y0)
        ]
        found.append(panel)
    return found


def to_png(figure: Figure, dots_per_inch: int = 150) -> bytes:
    """The figure as PNG, on light paper."""
    buffer = io.BytesIO()
    with report_style():
        # Level 6, the default, takes as long as drawing, for a file a tenth smaller.
        options = {"compress_level": 2}
        figure.savefig(buffer, format="png", dpi=dots_per_inch, metadata={"Software": None}, pil_kwargs=options)
    return buffer.getvalue()


def _shade(found: str) -> str:
    """The CSS variable of a colour of the theme; any other colour unchanged."""
    role = _SHADES.get(found)
    return f"var(--{role})" if role else found


def _shorten(path: str) -> str:
    """A path with two decimals: a hundredth of a point cannot be seen, and the page is half as large."""
    return re.sub(r"-?\d+\.\d+", lambda found: f"{float(found.group()):.2f}".rstrip("0").rstrip("."), path)


def _inherit_font(found: re.Match[str]) -> str:
    """The page's font in place of a list of families, the size kept."""
    size = re.search(r"[\d.]+px", found.group())
    return f"font-size: {size.group()}" if size else "font-family: inherit"
