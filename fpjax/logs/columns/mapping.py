"""Which column of a file is which quantity: from the mapping that the user gives, then from the columns' own names."""

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from ...errors import InputError
from .axes import about_axis, axis_of, choose_axis, choose_owner, has, numbered, of_owner
from .missing import MOST_COMPARED, listed
from .names import MOTIONS, TORQUES, WEAK, Guess, bracket_unit, guess
from .units import PER_SECOND, QUANTITIES, find_unit, parse_unit

CANONICAL = tuple(QUANTITIES)
PRESETS = {
    # Janot, Gautier, Brunot, "Data Set and Reference Models of EMPS", 2019: vir is in volts, 35.15 N/V.
    "emps": "time=t,torque=vir*35.15:N,position=qm:m,reference=qg:m",
}
# a unit with a scale: "A*0.12", "A*120 mNm/A", "counts/4096", "counts*5e-8"
_SCALED = re.compile(
    r"^(?P<head>.*?)\s*(?P<sign>[*/])\s*(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?P<per>[A-Za-zµ°%][^*]*)?$"
)


class Source(NamedTuple):
    """Where a canonical column comes from.

    Attributes:
        column: the file's name for it.
        unit: as written; None where no unit is given, which means SI.
        factor: factor of the column, written before its unit.
        scale: factor written after the unit: N m per A, or a gear ratio; for counts the turns per count.
        per: unit of the scale ("mNm/A"); "" for SI.
        scaled: whether a scale was given.
        divided: whether the scale was given as a division: counts per turn.
        guessed: whether the column was found in the table of names.
        measured: whether it is a torque that the drive measured and not the commanded one.
    """

    column: str
    unit: str | None = None
    factor: float = 1.0
    scale: float = 1.0
    per: str = ""
    scaled: bool = False
    divided: bool = False
    guessed: bool = False
    measured: bool = False


Columns = str | Mapping[str, str] | None


def parse_columns(columns: Columns) -> dict[str, str]:
    """The user's mapping as {canonical name: "column", "column:unit" or "column*factor:unit*scale"}.

    Args:
        columns: "velocity=gyro_z:deg/s,torque=tau_cmd", a mapping of the same, the name of a preset ("emps") or None.
            "axis=2" chooses among the axes of a robot.

    Raises:
        InputError: for a part that is not name=column, or a name that is not canonical.
    """
    if columns is None:
        return {}
    if isinstance(columns, str):
        columns = PRESETS.get(columns.strip().lower(), columns)
        pairs = [part.partition("=") for part in columns.split(",") if part.strip()]
        wrong = [name for name, equals, column in pairs if not equals or not column.strip()]
        if wrong:
            raise InputError(
                f"--columns {columns[:80]!r} cannot be read at {wrong[0].strip()[:40]!r}: write name=column or "
                f"name=column:unit, separated by commas, such as velocity=gyro_z:deg/s,torque=Iq:A*0.12."
            )
        columns = {name.strip(): column.strip() for name, _, column in pairs}
    for name in columns:
        if name not in CANONICAL and name != "axis":
            near = difflib.get_close_matches(name[:40], CANONICAL, n=1)
            raise InputError(
                f"--columns maps {name[:40]!r}, which is no column of a log: "
                f"{f'did you mean {near[0]!r}? ' if near else ''}There are {', '.join(CANONICAL)}."
            )
    if not str(columns.get("axis", "0")).strip().isdigit():
        raise InputError(
            f"--columns axis={columns['axis']!s:.20} is not the number of an axis: write for instance axis=2."
        )
    return {name: str(column) for name, column in columns.items()}


def find_sources(
    names: Iterable[str],
    mapping: Mapping[str, str],
    where: str,
    units: Mapping[str, str] | None = None,
    travel: Callable[[str], float] | None = None,
) -> tuple[dict[str, Source], list[str]]:
    """The file's column for each canonical column that is there; and a sentence for each guess.

    Args:
        names: the file's columns.
        mapping: from `parse_columns`; what it leaves out is looked for under its own name, any case, with its unit in
            brackets ("velocity [deg/s]"), and then in the table of `names`.
        where: the file's name, for messages.
        units: from a row of units, by name.
        travel: range of a column, so that an axis that stands still is not taken; None to take the first axis.

    Raises:
        InputError: for a mapped column that the file does not have.
    """
    names, units = list(names), units or {}
    axis = int(mapping["axis"]) if "axis" in mapping else None
    found = {
        canonical: _mapped(canonical, text, names, where, units, axis)
        for canonical, text in mapping.items()
        if canonical != "axis"
    }
    taken = {source.column for source in found.values()}
    for name in names:
        text, unit = bracket_unit(name)
        plain = text.strip().lower()
        if name not in taken and plain in CANONICAL and plain not in found:
            found[plain] = Source(name, unit or units.get(name))
            taken.add(name)
    # A torque column that the user mapped by the name of a measured one (`Iq`, `effort`) counts as measured too.
    if "torque" in mapping and "torque_measured" in guess([found["torque"].column], units):
        found["torque"] = found["torque"]._replace(measured=True)
    notes = _guessed(found, taken, names, units, mapping.get("axis"), where, travel)
    if "torque" not in found and "torque_measured" in found:
        found["torque"] = found.pop("torque_measured")._replace(measured=True)
    return found, notes


def _guessed(
    found: dict[str, Source],
    taken: set[str],
    names: list[str],
    units: Mapping[str, str],
    wanted_axis: str | None,
    where: str,
    travel: Callable[[str], float] | None,
) -> list[str]:
    """Add to `found` the columns that the table of names knows; a sentence on them."""
    known = guess(names, units)
    guesses = {name: [each for each in every if each.column not in taken] for name, every in known.items()}
    axes = sorted({each.axis for every in known.values() for each in every if each.axis is not None})
    said: list[str] = []
    mapped = [source.column for canonical, source in found.items() if canonical != "time"]
    chosen = int(wanted_axis) if wanted_axis is not None else choose_axis(guesses, axes, mapped, travel)
    if wanted_axis is not None and chosen not in axes:
        numbers = f"its axes are {', '.join(map(str, axes))}" if axes else "no column's name ends with an axis' number"
        raise InputError(f"--columns axis={wanted_axis}: {where} has no such axis: {numbers}.")
    of_axis = {name: [one for one in each if one.axis in (None, chosen)] for name, each in guesses.items()}
    owner, owners = choose_owner(of_axis, mapped, travel)
    for canonical in CANONICAL:
        # Where the user takes a measured torque for the command, another measured one is none of it.
        if canonical in found or (canonical == "torque_measured" and "torque" in found and found["torque"].measured):
            continue
        fitting = of_owner(of_axis.get(canonical, []), owner if canonical != "time" else "")
        if canonical == "time":
            fitting = [each for each in fitting if each.axis is None] or fitting
        other = {"velocity": "position", "position": "velocity", "torque": "torque_measured"}.get(canonical)
        # words with several meanings ("target", "p", "command") are taken only where the other motion, or the measured
        # torque, has no sure name; as a reference never
        if canonical == "reference" or (other is not None and (other in found or _surer(guesses, other, fitting))):
            fitting = [each for each in fitting if each.rank < WEAK[canonical]]
        if not fitting:
            continue
        best: Guess = fitting[0] if travel is None or len(fitting) == 1 else _changing(fitting, travel)
        found[canonical] = Source(best.column, best.unit or None, guessed=True, measured=canonical == "torque_measured")
        said.append(f"{best.column!r} as {canonical}{f' in {best.unit}' if best.unit else ''}")
    if not said:
        return []
    notes = [f"{where}: taken by their names: {', '.join(said)}; say otherwise with --columns."]
    if len(axes) > 1 and wanted_axis is None and any(axis_of(source.column) is not None for source in found.values()):
        lacking = "hardly moves" if has(guesses, TORQUES, axes[0]) else "has no torque"
        why = "" if chosen == axes[0] or mapped else f", since axis {axes[0]} {lacking}"
        other = next(axis for axis in axes[1:] if axis != chosen) if len(axes) > 2 or chosen == axes[0] else axes[0]
        notes.append(
            f"{where} has {len(axes)} axes ({axes[0]} to {axes[-1]}): axis {chosen} was taken{why}; choose with "
            f"--columns axis={other}."
        )
    if len(owners) > 1 and not mapped:
        others = ", ".join(each for each in owners[:9] if each != owner)
        notes.append(f"{where} holds several machines: {owner} was taken, and not {others}; choose with --columns.")
    return notes


def _changing(fitting: list[Guess], travel: Callable[[str], float]) -> Guess:
    """The surest column; where it never changes, the surest that does: a set point that nobody used shows nothing."""
    return next((each for each in fitting if travel(each.column) > 0.0), fitting[0])


def _surer(guesses: Mapping[str, list[Guess]], other: str, than: list[Guess]) -> bool:
    """Whether the other quantity has an unambiguous name, so that an ambiguous one is not needed."""
    return bool(than) and any(each.rank < WEAK[other] for each in guesses.get(other, []))


def _mapped(
    canonical: str, text: str, names: list[str], where: str, units: Mapping[str, str], axis: int | None = None
) -> Source:
    """The source that a mapping describes: COLUMN, COLUMN*2, COLUMN:UNIT, COLUMN:UNIT*SCALE or COLUMN:counts/4096."""
    # A column's own name may hold ":" or "*", so the whole text is tried as a name first, then what is
    # left of the last colon, then what is left of the last star.
    column = _resolved(text, names, axis)
    head, colon, unit = text, "", ""
    if column is None and ":" in text:
        head, colon, unit = text.rpartition(":")
        column = _resolved(head, names, axis)
    factor = 1.0
    if column is None and (parts := re.match(r"^(?P<head>.*)(?P<sign>[*])(?P<number>[^*]*)$", head)):
        head, factor = parts["head"], _factor(parts["number"], canonical, text, parts["head"])
        column = _resolved(head, names, axis)
    if column is None:
        head = head.strip()
        if clause := about_axis(head, names, axis):
            raise InputError(f"For {canonical}, {where} has {clause}.")
        near = difflib.get_close_matches(head[:60], names[:MOST_COMPARED], n=1)
        raise InputError(
            f"{where} has no column {head[:60]!r} for {canonical}: "
            f"{f'did you mean {near[0]!r}? ' if near else ''}It has {listed(names)}."
        )
    if colon and not unit.strip():
        raise InputError(f"--columns {canonical}={text} ends with a colon: write the unit after it, or leave both out.")
    written = bracket_unit(column)[1] or units.get(column)
    known = factor == 1.0 or find_unit(written or "") is not None  # else the factor says what the column is in
    source = Source(column, unit.strip() or (written if known else None), factor)
    scaled = _SCALED.match(unit.strip())
    if scaled and (find_unit(unit) is None):
        number = _factor(scaled["number"], canonical, text, head)
        divided = scaled["sign"] == "/"
        source = source._replace(
            unit=scaled["head"].strip(), scale=1.0 / number if divided else number, per=(scaled["per"] or "").strip(),
            scaled=True, divided=divided,
        )  # fmt: skip
    return source


def _factor(number: str, canonical: str, text: str, head: str) -> float:
    try:
        value = float(number) if "_" not in number else float("nan")
    except ValueError:
        value = float("nan")
    if not 0.0 < abs(value) < float("inf"):
        raise InputError(
            f"--columns {canonical}={text}: the factor {number.strip()!r} is not a number other than zero; "
            f"write for instance {canonical}={head.strip()}*35.15."
        )
    return value


def _resolved(text: str, names: list[str], axis: int | None) -> str | None:
    """The file's column of this name: literally, else in any case, else without unit, else that of the chosen axis."""
    text = text.strip()
    if text in names:
        return text
    for same in (str.lower, lambda name: bracket_unit(name)[0].strip().lower()):
        fitting = [name for name in names if same(name) == text.lower()]
        if len(fitting) == 1:
            return fitting[0]
    return numbered(text, names, axis)


def motion_of(sources: Mapping[str, Source]) -> bool | None:
    """Whether the units given are those of a linear (True) or a rotary axis (False); None where none of them decides.

    Raises:
        InputError: where they mix the two.
    """
    said = set()
    for canonical, source in sources.items():
        unit = None if source.unit is None else find_unit(source.unit)
        if unit is not None and canonical != "time":
            said |= {True} if unit.quantity in ("length", "speed", "force") else set()
            said |= {False} if unit.quantity in ("angle", "rate", "torque") else set()
    if len(said) == 2:
        units = ", ".join(f"{name} {source.unit}" for name, source in sources.items() if source.unit)
        raise InputError(f"The units mix rotary and linear motion ({units}): give all of them for one kind of axis.")
    return said.pop() if said else None


def scale_of(canonical: str, source: Source, linear: bool | None) -> tuple[float, str]:
    """(factor to SI, ""), or (factor to a label, the label) for a torque in V, A, PWM or counts.

    Raises:
        InputError: for a unit that does not fit the column, or counts without their size.
    """
    if source.unit is None:
        return source.factor, ""
    unit = parse_unit(source.unit, canonical, linear)
    spelt = f"{canonical}={source.column}:{source.unit}"
    if unit.quantity in ("count", "count rate"):
        if canonical in ("torque", "torque_measured"):
            return (source.factor * _per(source, spelt, linear), "") if source.scaled else (source.factor, "counts")
        return source.factor * _of_counts(source, spelt, linear), ""
    if unit.quantity == "label":
        if source.scaled:
            return source.factor * unit.factor * _per(source, spelt, linear), ""
        return source.factor * unit.factor, unit.label
    return source.factor * unit.factor * source.scale, ""


def without_unknown_sizes(
    sources: Mapping[str, Source], mapping: Mapping[str, str], linear: bool | None, where: str
) -> tuple[dict[str, Source], list[str]]:
    """The sources but those that nobody mapped, whose unit has no known size, and that a log can do without.

    Args:
        sources: where the canonical columns come from.
        mapping: of the user: what is in it was meant, and is an error where it cannot be read.
        linear: whether the axis is linear; None where that is not known.
        where: the file's name, for messages.

    Returns:
        The sources that are left; a sentence for each other.
    """
    found, notes = dict(sources), []
    for canonical in ("reference", "torque_measured", "temperature", "position", "velocity"):
        other = {"position": "velocity", "velocity": "position"}.get(canonical)
        if canonical in mapping or canonical not in found or (other is not None and other not in found):
            continue
        try:
            scale_of(canonical, found[canonical], linear)
        except InputError as error:
            notes.append(f"{where}: {found.pop(canonical).column!r} was left out as {canonical}: {error}")
    return found, notes


def torque_without_unit(sources: Mapping[str, Source], mapping: Mapping[str, str], where: str) -> list[str]:
    """A sentence where a torque without a unit stands beside a motion in units that only drives use."""
    torque = sources.get("torque")
    if torque is None or torque.unit is not None or {"torque", "torque_measured"} & set(mapping):
        return []
    motions = [(sources[name], find_unit(sources[name].unit or "")) for name in MOTIONS if name in sources]
    drive = next((motion for motion, unit in motions if unit is not None and unit.factor != 1.0), None)
    if drive is None:
        return []
    return [
        f"{where}: {torque.column!r} has no unit and was read in N m, beside {drive.column!r} in {drive.unit}: many "
        f"drives record per cent of their rated torque; then say so with --columns torque={torque.column}:%, or "
        f"with N m for one of them, such as torque={torque.column}:%*0.024."
    ]


def rates_without_angle(sources: Mapping[str, Source], where: str) -> list[str]:
    """A sentence for each speed in 1/s, which was read in rad/s: some drives count turns so."""
    return [
        f"{where}: {source.column!r} is in {source.unit} and was read in rad/s; where it counts turns say so with "
        f"--columns {name}={bracket_unit(source.column)[0]}:rev/s."
        for name, source in sources.items()
        if name in ("velocity", "reference") and re.sub(r"\s", "", source.unit or "") in PER_SECOND
    ]


def _per(source: Source, spelt: str, linear: bool | None) -> float:
    """Torque [N m] or force [N] per unit of the column, from "*0.12" or "*120 mNm/A"."""
    if not source.per:
        return source.scale
    unit = find_unit(source.per.partition("/")[0])
    if unit is None or unit.quantity != ("force" if linear else "torque"):
        raise InputError(
            f"--columns {spelt}*{source.scale:g} {source.per}: the scale's unit is not a "
            f"{'force' if linear else 'torque'}: write for instance {spelt}*0.12 or "
            f"{spelt}*120 {'mN' if linear else 'mNm'}."
        )
    return source.scale * unit.factor


def _of_counts(source: Source, spelt: str, linear: bool | None) -> float:
    """Radians or metres per count, from "/4096" (counts per turn) or "*5e-8" (metres or radians per count)."""
    if source.divided and not linear:
        return 2.0 * math.pi * source.scale
    if source.scaled and not source.divided:
        unit = find_unit(source.per) if source.per else None
        return source.scale * (unit.factor if unit else 1.0)
    size = f"{spelt}*5e-8, in metres per count" if linear else f"{spelt}/4096, the counts per turn"
    raise InputError(f"--columns {spelt}: how large is a count? Write for instance {size}.")
