"""The diagnosis for a reader: `report.html`, self-contained, and every picture as PNG."""

from .html import write_report as write_report
from .pictures import draw_overview as draw_overview
from .pictures import draw_pictures as draw_pictures
