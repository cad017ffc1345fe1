"""[reference] <-> its block."""

import pathlib

from ..blocks.references import AbstractReference, Chirp, Constant, Multisine, Recorded, Sine, Square, Triangle
from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from ..output.paths import expanded
from .block_types import Form, form_for, form_of, pick
from .keys import Key, Units, check_keys

_AMPLITUDE = Key("amplitude", "rad/s")
_FREQUENCY = Key("frequency", "Hz", "positive")
_PHASE = Key("phase", "rad", "any", 0.0)
REFERENCES = (
    Form("sine", Sine, (_AMPLITUDE, _FREQUENCY, _PHASE, Key("offset", "rad/s", "any", 0.0))),
    Form("constant", Constant, (_AMPLITUDE,)),
    Form(
        "chirp",
        Chirp,
        (
            _AMPLITUDE,
            Key("start_frequency", "Hz", "not negative"),
            Key("end_frequency", "Hz", "not negative"),
            Key("sweep_time", "s", "positive"),
        ),
    ),
    Form("triangle", Triangle, (_AMPLITUDE, _FREQUENCY, _PHASE)),
    Form("square", Square, (_AMPLITUDE, _FREQUENCY, _PHASE)),
    Form(
        "multisine",
        Multisine,
        (
            Key("amplitudes", "rad/s", many=True),
            Key("frequencies", "Hz", "not negative", many=True),
            Key("phases", "rad", many=True),
        ),
    ),
)


def build_reference(
    table: TomlTable | None, units: Units, folder: pathlib.Path | None, linear: bool, duration: float | None
) -> AbstractReference | None:
    """The reference of [reference]; None without one.

    Args:
        table: the section; type = "recorded" reads the column `reference` of `file`, mapped by `columns`.
        units: of the machine.
        folder: what a relative `file` is relative to.
        linear: whether the log is of a linear axis.
        duration: of the simulation [s], for a chirp without its own.

    Raises:
        InputError: for invalid keys or values, or a log that cannot be read.
    """
    if table is None:
        return None
    name = form_of("reference", table, REFERENCES, ("recorded",))
    if name == "recorded":
        return _recorded(table, folder, linear)
    if name == "chirp" and "sweep_time" not in table and duration is not None:
        table = {**table, "sweep_time": duration}
    if name == "multisine":
        given = table.get("frequencies")
        table = {"phases": [0.0] * max(len(given) if isinstance(given, list) else 1, 1), **table}
    return pick(REFERENCES, name).build("reference", table, units)


def _recorded(table: TomlTable, folder: pathlib.Path | None, linear: bool) -> Recorded:
    from ..logs import read_log

    check_keys("reference", table, ["type", "file", "columns", "hold"], ' for type = "recorded"')
    if not isinstance(table.get("file"), str):
        raise InputError('[reference] file is missing: write file = "LOG.csv", a log with the column reference.')
    hold, columns = table.get("hold", True), table.get("columns")
    if not isinstance(hold, bool) or not isinstance(columns, str | None):
        raise InputError('[reference] hold must be true or false, and columns text such as "reference=qg:mm".')
    path = expanded(table["file"])
    path = path if path.is_absolute() or folder is None else folder / path
    log = read_log(path, columns=columns, linear=linear or None, require=("reference",))
    assert log.reference is not None
    return Recorded(log.reference, log.dt, hold)


def describe_reference(
    reference: AbstractReference | None, written: TomlTable, folder: pathlib.Path | None = None
) -> JsonObject:
    """The [reference] section; empty without a reference.

    Args:
        reference: the block; None without one.
        written: the section it was read from, for what the block does not keep (the file of a recorded one).
        folder: what a relative `file` was relative to: the section that is returned may go to another one.
    """
    if reference is None:
        return {}
    if isinstance(reference, Recorded):
        if written.get("type") != "recorded":
            raise InputError(
                "A recorded reference made in Python has no file: save it as a log, and write [reference] "
                'type = "recorded" with file = "LOG.csv".'
            )
        path = expanded(written["file"])
        if folder is None or path.is_absolute():
            return dict(written)
        return {**written, "file": str((folder / path).resolve())}
    return form_for(reference, REFERENCES, "reference").describe(reference)
