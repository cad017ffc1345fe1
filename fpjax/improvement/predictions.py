"""Predictions: the scores of gains as ranges with the model's own doubt in them, and the answer made of them."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..logs.arrays import Values
from ..model_file import dump_model, load_model
from ..simulation.precision import double_precision
from .answer import Change, Decision, Range, Side
from .decision import range_of
from .from_diagnosis import Known
from .gains import Gains
from .judge import Judge, Score
from .machines import Machines
from .margins import NAMES, UNITS, margins_of
from .result import Improvement
from .torque_limit import NO_LIMIT, controller_limit

# The uncertainty of a prediction by the model itself, as half of a 90 % interval of the logarithm of the error [1]:
LEAST_DOUBT = 0.03  # at least this, for one draw of the noise and one integrator
UNHELD = 0.08  # where no log tells how good the prediction is
MOST_DOUBT = math.log(2.0)  # at most a factor of two


class Predictions:
    """Turns the scores of gains into predictions and the answer.

    Args:
        judge: that gave the scores.
        gains: what may change.
        machines: those judged on, and the number of them of which margins are computed.
        speed: about which the loop is linearised [rad/s].
        known: of the diagnosis.
        measured: error in the log [rad or rad/s], where its controller made the torque.
        tuned_on: number of machines of the search, for the answer.
    """

    def __init__(
        self, judge: Judge, gains: Gains, machines: tuple[Machines, int], speed: float, known: Known,
        measured: float | None, tuned_on: int,
    ):  # fmt: skip
        self.judge, self.gains, self.speed = judge, gains, speed
        self.machines, self.margined = machines
        self.known, self.measured, self.tuned_on = known, measured, tuned_on
        units = gains.model.units
        self.unit = units.name("rad" if judge.position else "rad/s")
        self.torque_unit = units.name("N m")
        limit = self.machines.machine.actuator.limit
        value = None if limit is None else float(np.median(np.asarray(limit)))
        own = controller_limit(gains.model)
        values = [one for one in (value, own) if one is not None and one < NO_LIMIT]
        self.limit = min(values, default=None)
        self.unlike: float | None = None
        self.resolved = False

    def margins(self, values: Values) -> list[dict[str, Values]]:
        """The margins of each candidate, for the first `margined` machines."""
        return margins_of(self.judge, values, self.machines.first(self.margined), self.speed)

    def compare(self, unlike: tuple[float, bool] | None, passed_on: float) -> None:
        """Take the comparison of the log with its simulation into account.

        Args:
            unlike: rms difference of the log's motion and the simulated one, and whether it is larger than the noise;
                None where other gains made the log.
            passed_on: share of this difference that remains with the new gains [1].
        """
        if unlike is not None:
            self.unlike, self.resolved = unlike[0] * passed_on, unlike[1]

    def doubt(self, score: Score, *, new: bool) -> float:
        """The model's own uncertainty of a predicted error, as half of a 90 % interval of its logarithm [1]."""
        middle = float(np.median(score.error))
        if not (np.isfinite(middle) and middle > 0.0):
            return MOST_DOUBT
        # The part of the motion that the simulation misses adds to the predicted error, or takes away from it. So an
        # error that new gains make ten times smaller is ten times as uncertain, relatively.
        if not new:
            found = UNHELD if self.measured is None else abs(math.log(self.measured / middle))
        elif self.unlike is None:
            found = UNHELD
        else:
            found = self.unlike / middle if self.resolved else min(self.unlike / middle, UNHELD)
        return min(max(found, LEAST_DOUBT), MOST_DOUBT)

    def side(self, values: Values, score: Score, margins: dict[str, Values], *, new: bool = False) -> Side:
        """The prediction for one set of gains."""
        doubt = self.doubt(score, new=new)
        torque = self.torque_unit
        headroom = None if self.limit is None else range_of(self.limit / np.maximum(score.peak, 1e-300), "1")
        # A machine that diverged is linearised where it ended, with a saturated observer: its margins say nothing.
        held = {name: np.where(np.isfinite(score.error[: len(each)]), each, 0.0) for name, each in margins.items()}
        usable = {name: each[~np.isnan(each)] for name, each in held.items() if not np.isnan(each).all()}
        return Side(
            gains={gain.word: float(value) for gain, value in zip(self.gains.gains, values, strict=True)},
            error=range_of(score.error, self.unit, doubt),
            reversal=range_of(score.reversal, self.unit, doubt) if self.judge.turns else None,
            torque=range_of(score.torque, torque),
            peak=range_of(score.peak, torque),
            headroom=headroom,
            rough=range_of(score.rough, torque),
            margins={name: range_of(usable[name], UNITS[name]) for name in NAMES if name in usable},
            unstable=float(np.mean(~np.isfinite(score.error))),
        )

    def answer(
        self, decision: Decision, reason: str, before: Side, after: Side, found: Side | None,
        changes: tuple[Change, ...], wins: float, ratio: Range | None, simulations: int, notes: Sequence[str],
        values: Values | None = None,
    ) -> Improvement:  # fmt: skip
        """The whole answer, but for the pictures."""
        text, missing = "", ""
        if decision == "change" and values is not None:
            text, missing = tuned_text(self.known, self.gains, values)
        return Improvement(
            decision=decision, reason=reason, before=before, after=after, found=found, changes=changes, wins=wins,
            ratio=ratio, measured=self.measured, model=text, model_missing=missing,
            signal="position" if self.judge.position else "velocity", verdict=self.known.verdict,
            causes=self.known.causes, machines=self.machines.count, tuned_on=self.tuned_on, simulations=simulations,
            notes=tuple(dict.fromkeys([*notes, *([missing] if missing else [])])),
        )  # fmt: skip


def tuned_text(known: Known, gains: Gains, values: Values) -> tuple[str, str]:
    """(the corrected model with these gains as servo.toml text, ""), or ("", why there is none)."""
    if not known.model:
        return "", known.model_missing or "The diagnosis has no corrected model as text."
    try:
        with double_precision():
            corrected = load_model(known.model)
            if gains.model.path is not None:
                corrected = dataclasses.replace(corrected, path=gains.model.path)
            return dump_model(gains.apply(corrected, values)), ""
    except InputError as error:
        return "", f"The tuned model cannot be written as servo.toml: {error}"
