"""The one name for what JSON, TOML and a row of results hold: text keys, values known only where they are read."""

from collections.abc import Mapping
from typing import Any, TypeAlias

JsonObject: TypeAlias = dict[str, Any]  # made here and written, or read back from a file
TomlTable: TypeAlias = Mapping[
    str, Any
]  # of a file that a user wrote: nothing in it is checked yet, and nobody changes it
