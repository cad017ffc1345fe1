"""[limits]: the largest speed, acceleration, torque and travel of the machine, to which planned runs keep."""

from ..output.json_object import TomlTable
from .keys import Key, Units, check_keys, read_values

SECTION = "limits"
KEYS = (
    Key("speed", "rad/s", "positive", None),
    Key("acceleration", "rad/s^2", "positive", None),
    Key("torque", "N m", "positive", None),
    Key("travel", "rad", "positive", None),
)


def read_limits(table: TomlTable | None, units: Units) -> dict[str, float]:
    """The limits that are written, by name, in the machine's units.

    Raises:
        InputError: for a key that is not known, or a number that is not above zero.
    """
    table = table or {}
    check_keys(SECTION, table, [key.name for key in KEYS])
    return {name: value for name, value in read_values(SECTION, table, KEYS, units).items() if value is not None}
