"""Files of a diagnosis in its folder."""

PICTURES = tuple(f"{name}.png" for name in ("overview", "record", "where", "left", "residual", "learned", "shrink"))
"""Beside `report.html`: those for which the diagnosis has data."""

RESULTS = ("diagnosis.json", "corrected.toml", "learned.toml", "posterior.npz", "report.html", *PICTURES)
"""All that a run may leave."""
