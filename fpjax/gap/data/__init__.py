"""Data: logs cut into windows, with the noise and the resolution of their sensors."""
