"""Warnings beside an answer: each function gives a list of sentences, empty where there is nothing to warn of."""

import math
from collections.abc import Sequence

import numpy as np

from ...logs.arrays import Values
from ...model_file import Units
from ..data.record import Record
from ..data.setting import Setting
from ..fit.candidate import SPIKE, Fit
from ..fit.modes import Modes
from ..select.decision import Decision
from ..select.readings import Reading
from ..thresholds import THRESHOLDS
from .gap import Gap
from .intervals import read_estimates


def at_bounds(fit: Fit, units: Units) -> list[str]:
    """Warnings about parameters that ended at a bound of the search."""
    c = fit.candidate
    named = {p.name: units.name(p.unit) for p in c.family.parameters}
    return [
        f"{name} ended at a bound of the search ({c.values()[name]:.4g} {named[name]}): its value is that bound, "
        f"not a measurement."
        for name in c.at_bound()
        if name in {p.name for effect in c.effects for p in effect.parameters} | c.wide
    ]


def load_error(fit: Fit, setting: Setting, *, written: bool) -> list[str]:
    """What a model changes in a known load that is no cause, or a warning where that is all it may.

    Args:
        fit: of the model.
        setting: of the logs.
        written: whether it is the corrected model; else the log is matched with it, but the model file stays.
    """
    c = fit.candidate
    if not c.load_error:
        return []
    values = c.values()
    amount = math.hypot(*(values[name] for name in c.load_error))
    unit, share = setting.units.name("N m"), amount / abs(setting.turning_load)
    if set(c.load_error) & set(c.at_bound()):
        return [
            f"The known load of the model file is off by {amount:.3g} {unit} ({100 * share:.2g} % of its amplitude), "
            "at the bound of what counts as right: an unbalance is likely. Check its amplitude and its angle."
        ]
    if share < SPIKE:
        return []
    if not written:
        return [
            f"The log is matched best with the known load of the model file off by {amount:.3g} {unit} "
            f"({100 * share:.2g} % of its amplitude): that much counts as right, and the corrected model keeps it."
        ]
    return [
        f"The corrected model changes the known load by {amount:.3g} {unit} ({100 * share:.2g} % of its amplitude): "
        "that much counts as right, and is no cause."
    ]


def not_answered(modes: Modes, unfelt: Values, units: Units, torque: float) -> list[str]:
    """What counts as noise of the readings although a machine that vibrates would show it too, with its number.

    Args:
        modes: of a window.
        unfelt: what of it is noise of a measured torque, which has a sentence of its own, by octave [N m].
        units: of the model file.
        torque: rms of the commanded torque [N m].
    """
    own = np.sqrt(np.maximum(modes.unanswered**2 - unfelt**2, 0.0))
    held = np.where(modes.sensor, 0.0, own[modes.band])
    size = float(np.sqrt(np.sum(held**2) / len(modes.torque)))
    if not size > THRESHOLDS.slight * torque:
        return []
    lowest = float(np.min(modes.frequency[held > 0.0]))
    return [
        f"Above {lowest:.2g} Hz the readings hold more than the command and the smoothed motion account for, as a "
        f"torque {size:.3g} {units.name('N m')} rms: rounding, jitter of the stamps, or a vibration of the sensor or "
        "of the machine. It counts as noise and not as missing torque; a faster log or a second sensor tells which."
    ]


def pushes(decision: Decision, records: Sequence[Record]) -> list[str]:
    """Which windows models were not compared on."""
    times = [
        float(record.time[start])
        for record, judged in zip(records, decision.judged, strict=True)
        for index, start in enumerate(record.starts)
        if index not in set(judged.tolist())
    ]
    if not times:
        return []
    where = ", ".join(f"{time:.4g}" for time in times[:5]) + (" ..." if len(times) > 5 else "")
    return [
        f"From {where} s on, for one window each, far more torque is missing than elsewhere and no model takes much of "
        "it, as of a push: models were compared on the other windows. The gap that is told holds them."
    ]


def beyond_torque(gap: Gap, torque: float) -> list[str]:
    """A warning where more torque is missing than was commanded."""
    if not gap.before > torque:
        return []
    return [
        f"The nominal model misses {gap.before:.3g} {gap.unit} where {torque:.3g} {gap.unit} rms were commanded: its "
        f"inertia, a unit, or the times at which the position was read are likelier wrong than its friction. Check "
        f"them before any cause named here."
    ]


def undecided_effects(undecided: Sequence[str], causes: Sequence[str], rivals: Sequence[str]) -> list[str]:
    """A warning about effects of the corrected model that take a part of the gap and are not asserted.

    Args:
        undecided: their names.
        causes: that are asserted.
        rivals: effects that do nearly as well in their place, the best first.
    """
    if not undecided:
        return []
    many = len(undecided) > 1
    instead = f": {' or '.join(rivals)} would do nearly as well" if rivals else ""
    return [
        f"The corrected model also holds {' and '.join(undecided)}, which {'take' if many else 'takes'} a part of the "
        f"gap, but this log does not make sure of {'them' if many else 'it'}{instead}. Whichever it is, "
        f"{' and '.join(causes)} {'stand' if len(causes) > 1 else 'stands'} beside it."
    ]


def details(chosen: Fit, causes: Sequence[str], undecided: Sequence[str] = ()) -> list[str]:
    """A warning about effects that the corrected model holds beside the causes and what is undecided."""
    told = {*causes, *undecided}
    beside = [name for name in chosen.candidate.structural if name not in told] if causes else []
    if not beside:
        return []
    what = "a detail, not a cause" if len(beside) == 1 else "details, not causes"
    return [
        f"The corrected model also holds {' and '.join(beside)}: {what}, since hardly any of the gap would come back "
        "without it, or its size cannot be distinguished from zero in this log."
    ]


def rounding_left(rounding: float, gap: Gap) -> list[str]:
    """A warning where much of what the causes leave is what the rounding of the readings makes.

    Args:
        rounding: that missing torque on withheld windows [N m] (`fpjax.gap.answer.rounded.rounding_of`).
        gap: on the same windows.
    """
    if not 2.0 * rounding > max(gap.after, gap.noise_floor):
        return []
    return [
        f"Of the {gap.after:.3g} {gap.unit} that are missing with the causes in, {rounding:.3g} {gap.unit} rms come "
        "from the rounding of the readings, which jump where the motion is slow: this is no torque, and the verdict "
        "does not count it."
    ]


def slight_rounding(step: float, share: float, units: Units) -> list[str]:
    """A warning about a rounded velocity column that is no cause."""
    return [
        f"The velocity column is rounded to steps of {step:.4g} {units.name('rad/s')}, an error of "
        f"{100 * share:.2g} % of the speed: the corrected model has it, but it is no cause of what is missing."
    ]


def slight_readings(readings: Sequence[Reading], units: Units) -> list[str]:
    """Warnings about errors of the velocity column that are sure and no causes."""
    found = []
    for one in readings:
        ((name, estimate),) = read_estimates(one, units).items()
        size = f"{estimate.value:.4g}{'' if estimate.unit == '1' else f' {estimate.unit}'}"
        found.append(
            f"The velocity column has a {one.effect} ({name} {size}), an error of {100 * one.size:.2g} % of the speed: "
            "the corrected model has it, but it is no cause of what is missing."
        )
    return found


def where_fitted_alone(gap: Gap, everywhere: float) -> list[str]:
    """A warning where the gap shows in fitted windows only, so that the withheld ones cannot confirm a cause."""
    if gap.before > gap.noise_floor or not everywhere > gap.noise_floor:
        return []
    return [
        f"What is missing shows in the fitted windows alone ({everywhere:.3g} {gap.unit} over all windows): the "
        "withheld ones hold none of it, so the gap reported on them is that of noise, and they can confirm no cause. "
        "Record for longer, so that the event recurs, or withhold a log in which it occurs (--holdout)."
    ]
