"""Paths as users write them."""

import os
import pathlib


def expanded(path: str | os.PathLike[str]) -> pathlib.Path:
    """The path with "~" as the home folder, where no shell has put it in; that of an unknown user stays as it is."""
    return pathlib.Path(os.path.expanduser(path))
