"""The result of planning: the run to record next, what it is expected to show, and why."""

from __future__ import annotations

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


@dataclass(frozen=True)
class Visible:
    """An effect, and the evidence for it that the run would bring if the machine had it.

    Attributes:
        effect: its name in the vocabulary.
        size: its parameters by name: (value, unit).
        nats: expected log evidence over the nominal model with its parameters and an offset free; NaN for a twin.
        twin: why no run can show it; "" where a run can.
    """

    effect: str
    size: dict[str, tuple[float, str]]
    nats: float
    twin: str = ""

    @property
    def shown(self) -> bool:
        """Whether the run is expected to show it."""
        return not self.twin and self.nats >= NEEDED

    def to_dict(self) -> JsonObject:
        """By name; `nats` is None for a twin."""
        size = {name: {"value": value, "unit": unit} for name, (value, unit) in self.size.items()}
        nats = None if self.twin else self.nats
        return {"effect": self.effect, "size": size, "nats": nats, "shown": self.shown, "twin": self.twin}


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
        visible: the effects of the vocabulary, the least visible first; () where the aim is "rivals".
        separations: pairs of rivals, the hardest to separate first; () where the aim is "effects".
        rivals: names of the rivals.
        missing: level of the missing torque that was assumed [N m].
        noise: noise standard deviations by sensor: "velocity" [rad/s], "position" [rad].
        position: whether the reference is a position.
        linear: whether the machine is linear, with units m and N.
        torque_unit: unit of the torque.
        model: name of the nominal model's file.
        evaluations: how many motions were tried, each with its gradient.
        gained: the smallest evidence over all comparisons, of the best start and of the plan [nats].
        usual: the smallest evidence of plain references, a "sine" and a "sweep" within the same limits [nats]; empty
            after an interrupt.
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
    usual: dict[str, float] = field(default_factory=dict)
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
            "worst_nats": {"start": self.gained[0], "plan": self.gained[1], **self.usual},
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
        shown = sum(one.shown for one in can)
        return (
            f"The run is expected to show {shown} of {len(can)} effects at the sizes in plan.json; least visible is "
            f"{can[0].effect} with {can[0].nats:.3g} nats, {NEEDED:g} needed."
        )

    def without(self) -> str:
        """The evidence of the plain references beside the plan's, in one sentence."""
        told = ", ".join(f"a {name} {nats:.3g}" for name, nats in self.usual.items())
        enough = [f"a {name}" for name, nats in self.usual.items() if nats >= NEEDED]
        more = f": {' or '.join(enough)} would do too" if enough else ""
        return f"smallest evidence within the same limits [nats]: this run {self.gained[1]:.3g}, {told}{more}."

    def __str__(self) -> str:
        lines = [self.sentence()]
        lines += [f"  {one.sentence}" for one in self.separations]
        if self.visible:
            lines += [f"  {one.effect:<28}{one.nats:10.3g} nats" for one in self.visible if not one.twin]
            lines += [f"  {one.effect:<28}{'':>10} {one.twin}" for one in self.visible if one.twin]
        if self.usual:
            lines.append(f"  {self.without()}")
        use = ", ".join(f"{name} {share:.0%}" for name, share in self.used.items())
        lines.append(f"  used of the limits: {use}")
        return "\n".join(lines)

    __repr__ = __str__
