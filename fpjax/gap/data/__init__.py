"""Data: logs cut into windows, with what their sensors resolve."""
