"""Which axis or machine of a file is taken: never the motion of one with the torque of another."""

from collections.abc import Callable, Iterable, Mapping

from .names import MOTIONS, TORQUES, Guess, taken_apart

STILL = 1e-3  # of the travel of the machine that moves most: with less, a machine stands still
# The same of a robot's axes: they are of one controller, which holds those that are not moved; what it leaves of them,
# creep over minutes and the shaking by the others, is some per cent of the one that the run is of.
HELD = 0.05

Guesses = Mapping[str, list[Guess]]


def axis_of(column: str) -> int | None:
    """Number of the axis in a column's name; None without."""
    return next((named.axis for named in taken_apart(column) if named.axis is not None), None)


def owner_of(column: str) -> str:
    """What stands before the last part of a column's name ("knee" of "knee.torque"); "" without."""
    return next((named.owner for named in taken_apart(column) if named.owner), "")


def numbered(text: str, names: Iterable[str], axis: int | None) -> str | None:
    """The one column that is `text` of this axis: "tau" is "tau.6" of axis 6; None without, or where several are."""
    if axis is None:
        return None
    fitting = {name for name, number in _of_axes(text, names) if number == axis}
    return fitting.pop() if len(fitting) == 1 else None


def about_axis(text: str, names: Iterable[str], axis: int | None) -> str:
    """A clause on why no column is `text` of this axis (others have one, it has several); "" where no axis has one."""
    axes = sorted({number for _, number in _of_axes(text, names)})
    if axis is None or not axes:
        return ""
    of = f"{text[:60]!r} of axis {axis}"
    if axis in axes:
        return f"several columns {of}: write the one that is meant as it is spelt"
    return f"no column {of}: there is one for each of the axes {', '.join(map(str, axes[:12]))}"


def _of_axes(text: str, names: Iterable[str]) -> list[tuple[str, int]]:
    """Each column that is `text` of an axis, with the axis' number."""
    plain = {each.plain for each in taken_apart(text)[:1]}
    return [
        (name, named.axis)
        for name in names
        for named in taken_apart(name)
        if named.axis is not None and named.plain in plain
    ]


def choose_axis(
    guesses: Guesses, axes: list[int], mapped: Iterable[str], travel: Callable[[str], float] | None
) -> int | None:
    """The axis of the columns that the user mapped; else the first that moves and has a torque.

    Args:
        guesses: columns that the table of names knows, by canonical name.
        axes: the axes among them, in increasing order.
        mapped: the file's columns that the user mapped.
        travel: range of a column; None to take the first axis.
    """
    said = [axis for axis in map(axis_of, mapped) if axis in axes]
    if said or not axes:
        return said[0] if said else None
    # an axis whose torque was not recorded cannot be simulated
    whole = [axis for axis in axes if has(guesses, MOTIONS, axis) and has(guesses, TORQUES, axis)]
    possible = whole or axes
    if travel is None or len(possible) == 1:
        return possible[0]
    for motion in MOTIONS:
        moved = {one.axis: travel(one.column) for one in reversed(guesses.get(motion, [])) if one.axis in possible}
        if len(moved) > 1:
            most = max(moved, key=lambda axis: moved[axis])
            return possible[0] if moved.get(possible[0], 0.0) > HELD * moved[most] else most
    return possible[0]


def has(guesses: Guesses, kinds: tuple[str, ...], axis: int) -> bool:
    """Whether one of these quantities was recorded of this axis."""
    return any(one.axis == axis for kind in kinds for one in guesses.get(kind, []))


def choose_owner(
    guesses: Guesses, mapped: Iterable[str], travel: Callable[[str], float] | None
) -> tuple[str, list[str]]:
    """(owner whose columns are preferred, "" for none; all that have a motion and a torque).

    Args:
        guesses: columns that the table of names knows, of the chosen axis.
        mapped: the file's columns that the user mapped: their owner is meant.
        travel: range of a column, so that a machine that stands still is not taken; None to take the first.
    """
    kinds = (*MOTIONS, *TORQUES)
    owners = list(dict.fromkeys(one.owner for kind in kinds for one in guesses.get(kind, []) if one.owner))
    whole = [
        owner
        for owner in owners
        if all(any(one.owner == owner for kind in part for one in guesses.get(kind, [])) for part in (MOTIONS, TORQUES))
    ]
    said = [owner for owner in map(owner_of, mapped) if owner in owners]
    if said:
        return said[0], whole
    if not whole:
        return "", whole
    if travel is None or len(whole) == 1:
        return whole[0], whole
    moved = {
        owner: max(travel(one.column) for kind in MOTIONS for one in guesses.get(kind, []) if one.owner == owner)
        for owner in whole
    }
    most = max(moved.values())
    return next((owner for owner in whole if moved[owner] > STILL * most), whole[0]), whole


def of_owner(fitting: list[Guess], owner: str) -> list[Guess]:
    """The guesses of this owner, and those of none; all where it has none: its command may stand elsewhere."""
    own = [one for one in fitting if one.owner == owner]
    return own or fitting if owner else fitting
