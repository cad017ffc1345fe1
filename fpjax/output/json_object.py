"""Types of JSON objects and TOML tables: text keys, and values whose types are known only where they are read."""

from collections.abc import Mapping
from typing import Any, TypeAlias

# An object that fpjax makes and writes, or reads back from its own file.
JsonObject: TypeAlias = dict[str, Any]
# A table of a file that a user wrote: its contents are not checked yet, and it is never changed.
TomlTable: TypeAlias = Mapping[str, Any]
