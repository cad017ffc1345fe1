"""Plan: the run to record next, for a user: printed, plotted, written to files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..output.data_frames import to_frame
from ..output.drawable import Drawable
from ..output.runfile import open_folder, whole_file, write_json
from .answer import MATERIAL, NEEDED, Answer

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False, eq=False)
class Plan(Drawable, Answer):
    """A run under the machine's limits.

    Its fields are those of `Answer`. `plot` draws the run, its torque, and the evidence for each effect or pair.
    """

    def _figure(self) -> Figure:
        from .picture import draw  # importing matplotlib takes a second

        return draw(self)

    def to_dataframe(self) -> Any:
        """The run as a `pandas.DataFrame`, the time [s] as its index: reference.csv's columns and `planned_torque`.

        Raises:
            InputError: where pandas is not installed.
        """
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
        columns = [self.time, self.reference, *(self.motion[name] for name in ("speed", "acceleration", "position"))]
        header = "time,reference,planned_speed,planned_acceleration,planned_position"
        with whole_file(path) as file:
            np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")

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
                least += f", and {first.share:.1%} of the commanded torque, {MATERIAL:.1%} needed"
        return (
            f"The run is expected to show {len(shown)} of the {len(can)} effects that a run can show, at the sizes in "
            f"plan.json{least}."
        )

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
