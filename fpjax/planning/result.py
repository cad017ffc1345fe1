"""The result of planning: the run to record next, what it is expected to show, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..gap.select.thresholds import THRESHOLDS
from ..output.json_object import JsonObject
from .limits import Limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEEDED = THRESHOLDS.sure  # [nats] lead that a cause needs before the diagnosis asserts it
MATERIAL = THRESHOLDS.nothing  # [1] share of the commanded torque below which a missing torque counts as no gap


@dataclass(frozen=True)
class Visible:
    """An effect, and the evidence for it that the run would bring if the machine had it.

    Attributes:
        effect: its name in the vocabulary.
        size: its parameters by name: (value, unit).
        nats: expected log evidence over the nominal model with its parameters and an offset free; NaN for a twin.
        share: the torque that the nominal model lacks over the rms of the commanded torque [1]; NaN for a twin and for
            an error of a reading, which makes no torque.
        twin: why no run can show it; "" where a run can.
        unseen: why this run does not show it; "" where it does, and for a twin.
    """

    effect: str
    size: dict[str, tuple[float, str]]
    nats: float
    share: float = math.nan
    twin: str = ""
    unseen: str = ""

    @property
    def shown(self) -> bool:
        """Whether the run is expected to show it."""
        return not self.twin and not self.unseen

    def to_dict(self) -> JsonObject:
        """By name; both numbers are None for a twin, the share for an error of a reading."""
        size = {name: {"value": value, "unit": unit} for name, (value, unit) in self.size.items()}
        nats, share = (value if math.isfinite(value) else None for value in (self.nats, self.share))
        return {
            "effect": self.effect, "size": size, "nats": nats, "share": share, "shown": self.shown, "twin": self.twin,
            "unseen": self.unseen,
        }  # fmt: skip


@dataclass(frozen=True)
class Separation:
    """Two rivals and the evidence between them that the run would bring.

    Attributes:
        between: their names.
        nats: expected log evidence between them, the smaller of the two directions; NaN for exact twins.
        twins: whether no run with these sensors can separate them.
        where: the part of the run from which most of the evidence comes.
        experiment: an experiment that a person could do besides this run.
        sentence: a summary for the user.
    """

    between: tuple[str, str]
    nats: float
    twins: bool
    where: str
    experiment: str
    sentence: str

    @property
    def separated(self) -> bool:
        """Whether the run is expected to decide between them."""
        return not self.twins and self.nats >= NEEDED

    def to_dict(self) -> JsonObject:
        """By name; `nats` is None for twins."""
        nats = None if self.twins else self.nats
        return {
            "between": list(self.between), "nats": nats, "needed": NEEDED, "twins": self.twins,
            "separated": self.separated, "where": self.where, "experiment": self.experiment, "sentence": self.sentence,
        }  # fmt: skip


@dataclass(frozen=True)
class Plan:
    """A run under the machine's limits.

    Attributes:
        aim: "effects", to make every effect of the vocabulary visible, or "rivals", to separate causes between which a
            diagnosis could not decide.
        time: [s], shape (samples,).
        reference: for the drive [rad/s], or [rad] from its present position, shape (samples,).
        motion: the planned "speed" [rad/s], "acceleration" [rad/s^2] and "position" [rad], each of shape (samples,).
        torque: torque of the nominal machine on this run [N m], shape (samples,).
        limits: the limits of the run.
        visible: the effects of the vocabulary, the least visible first, what the run does not show and twins last; ()
            where the aim is "rivals".
        separations: pairs of rivals, the hardest to separate first; () where the aim is "effects".
        rivals: names of the rivals.
        missing: level of the missing torque that was assumed [N m].
        noise: noise standard deviations by sensor: "velocity" [rad/s], "position" [rad].
        position: whether the reference is a position.
        linear: whether the machine is linear, with units m and N.
        torque_unit: unit of the torque.
        model: name of the nominal model's file.
        evaluations: how many motions were tried, each with its gradient.
        gained: the smallest evidence over all comparisons, of the best start and of the plan, without those that no
            motion shows [nats].
        usual: of plain references, a "sine" and a "sweep" within the same limits: how many effects they show (or pairs
            of rivals they separate), and their smallest evidence [nats]; empty after an interrupt.
        ended: "converged", "time" or "interrupted".
        notes: choices made for the user, a sentence each.
        seconds: processor time by stage [s].
    """

    aim: Literal["effects", "rivals"]
    time: np.ndarray
    reference: np.ndarray
    motion: dict[str, np.ndarray]
    torque: np.ndarray
    limits: Limits
    visible: tuple[Visible, ...]
    separations: tuple[Separation, ...]
    rivals: tuple[str, ...]
    missing: float
    noise: dict[str, float]
    position: bool
    linear: bool
    torque_unit: str
    model: str
    evaluations: int
    gained: tuple[float, float]
    ended: str
    usual: dict[str, tuple[int, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def used(self) -> dict[str, float]:
        """Share of every limit that the motion uses [1]; a torque without a limit is left out."""
        limits = self.limits
        found = {
            "speed": float(np.max(np.abs(self.motion["speed"]))) / limits.speed,
            "acceleration": float(np.max(np.abs(self.motion["acceleration"]))) / limits.acceleration,
            "travel": float(np.ptp(self.motion["position"])) / limits.travel,
        }
        if np.isfinite(limits.torque):
            found["torque"] = float(np.max(np.abs(self.torque))) / limits.torque
        return found

    def plot(self, path: str | Path | None = None) -> Figure:
        """The picture of the run, its torque, and the evidence for each effect or pair.

        Args:
            path: picture file to write; None to write none.

        Raises:
            InputError: where the file cannot be written.
        """
        from ..output.plotting import saved
        from .picture import draw

        return saved(draw(self), path)

    def to_dataframe(self) -> Any:
        """The run as a `pandas.DataFrame`, the time [s] as its index: reference.csv's columns and `planned_torque`.

        Raises:
            InputError: where pandas is not installed.
        """
        from ..output.frames import to_frame

        planned = {f"planned_{name}": self.motion[name] for name in ("speed", "acceleration", "position")}
        return to_frame({"reference": self.reference, **planned, "planned_torque": self.torque}, self.time)

    def write(self, folder: str | Path) -> dict[str, Path]:
        """Write plan.json, reference.csv and plan.png into a folder.

        Args:
            folder: created if missing.

        Returns:
            Their paths by name.

        Raises:
            InputError: where they cannot be written.
        """
        from ..output.runfile import open_folder, write_json

        place = open_folder(folder)
        assert place is not None
        paths = {name: place / name for name in ("reference.csv", "plan.json", "plan.png")}
        self.write_reference(paths["reference.csv"])
        write_json(paths["plan.json"], self.to_dict())
        self.plot(paths["plan.png"])
        return paths

    def write_reference(self, path: Path) -> None:
        """Write the reference as a table, for `[reference] type = "recorded"` and for a drive.

        Columns: time [s], reference [rad/s or rad], planned speed [rad/s], acceleration [rad/s^2] and position [rad].
        """
        from ..output.runfile import whole_file

        columns = [self.time, self.reference, *(self.motion[name] for name in ("speed", "acceleration", "position"))]
        header = "time,reference,planned_speed,planned_acceleration,planned_position"
        with whole_file(path) as file:
            np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")

    def to_dict(self) -> JsonObject:
        """`plan.json`: numbers, strings, lists and dictionaries; the motion itself is in reference.csv."""
        return {
            "aim": self.aim,
            "model": self.model,
            "rivals": list(self.rivals),
            "limits": self.limits.to_dict(),
            "used": self.used,
            "reference": "position" if self.position else "velocity",
            "samples": len(self.time),
            "dt": float(self.time[1] - self.time[0]),
            "needed": NEEDED,
            "missing_torque": self.missing,
            "noise": self.noise,
            "visible": [one.to_dict() for one in self.visible],
            "separations": [one.to_dict() for one in self.separations],
            "evaluations": self.evaluations,
            "worst_nats": {
                "start": self.gained[0],
                "plan": self.gained[1],
                **{name: least for name, (_, least) in self.usual.items()},
            },
            "decided": {"plan": self.decided, **{name: count for name, (count, _) in self.usual.items()}},
            "ended": self.ended,
            "notes": list(self.notes),
            "seconds": {stage: round(spent, 3) for stage, spent in self.seconds.items()},
        }

    def sentence(self) -> str:
        """What the run is expected to show or separate, in one sentence."""
        if self.aim == "rivals":
            done = sum(one.separated for one in self.separations)
            twins = sum(one.twins for one in self.separations)
            more = f"; {twins} are exact twins, which no run with these sensors separates" if twins else ""
            return f"The run is expected to separate {done} of {len(self.separations)} pairs of rivals{more}."
        can = [one for one in self.visible if not one.twin]
        shown = [one for one in can if one.shown]
        least = ""
        if shown:
            first = shown[0]
            least = f"; of those the least visible is {_plain(first.effect)}: {first.nats:.3g} nats, {NEEDED:g} needed"
            if math.isfinite(first.share):
                least += f", and {first.share:.1%} of the commanded torque, {MATERIAL:.0%} needed"
        return (
            f"The run is expected to show {len(shown)} of the {len(can)} effects that a run can show, at the sizes in "
            f"plan.json{least}."
        )

    @property
    def decided(self) -> int:
        """Effects that the run is expected to show, or pairs of rivals that it separates."""
        return sum(one.shown for one in self.visible) + sum(one.separated for one in self.separations)

    def without(self) -> str:
        """What the plain references would show beside the plan, in one sentence."""
        what = "effects shown" if self.aim == "effects" else "pairs separated"
        told = ", ".join(f"a {name} {count} ({least:.3g})" for name, (count, least) in self.usual.items())
        enough = [f"a {name}" for name, (count, _) in self.usual.items() if count >= self.decided]
        more = f": {' or '.join(enough)} would do too" if enough else ""
        return (
            f"{what} within the same limits (and smallest evidence [nats]): this run {self.decided} "
            f"({self.gained[1]:.3g}), {told}{more}."
        )

    def unseen(self) -> list[str]:
        """Why the run does not show some effects, a sentence for each reason."""
        reasons: dict[str, list[str]] = {}
        for one in self.visible:
            if one.unseen:
                reasons.setdefault(one.unseen, []).append(_plain(one.effect))
        return [f"not made visible: {', '.join(names)}: {why}" for why, names in reasons.items()]

    def __str__(self) -> str:
        lines = [self.sentence()]
        lines += [f"  {one.sentence}" for one in self.separations]
        if self.visible:
            lines += [
                f"  {one.effect:<28}{one.nats:10.3g} nats{_of_torque(one.share)}" for one in self.visible if one.shown
            ]
            lines += [f"  {one}" for one in self.unseen()]
            lines += [f"  {one.effect:<28}{'':>10} {one.twin}" for one in self.visible if one.twin]
        if self.usual:
            lines.append(f"  {self.without()}")
        use = ", ".join(f"{name} {share:.0%}" for name, share in self.used.items())
        lines.append(f"  used of the limits: {use}")
        return "\n".join(lines)

    __repr__ = __str__


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _of_torque(share: float) -> str:
    return f"  {share:6.1%} of the commanded torque" if math.isfinite(share) else ""
