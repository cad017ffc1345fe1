"""Doubt: a sentence on what was noticed in a log and left as it is."""


class Doubt(str):
    """A sentence on something that was not changed: `strict` does not refuse a log for it."""
