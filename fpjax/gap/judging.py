"""Judging: evidence on one scale, and how much of a residual is more than noise."""

import numpy as np

from . import assemble
from .attribute import Fitted, Search
from .corners import corner_torque
from .decision import Decision
from .imposed import noise_torque
from .measure import correlation_time

MATERIAL = 0.01  # share of the residual energy that a cause must remove to be one
MATERIAL_ROUNDED = 0.05  # the same where the reading is rounded, which is no noise
DECISIVE = 8.0  # log evidence by which a cause must beat its absence
WHITE = 1.04  # residual energy over what its own differences say is noise; above it there is structure
TOLERANCE = 1.1  # to which the noise of a torque is known that was told from positions
TOO_QUIET = 0.5  # of the energy that a perfect model leaves of a torque: one that leaves less is not believed
WHITE_ROUNDED = 1.5  # the same of a rounded reading, whose error has up to three times the energy of even rounding
WHITE_WITH_PLAY = 1.3  # the same of a play, whose contacts a step of finite length blurs
RATTLES = 0.2  # share of the windows, best and worst, that the energy of hidden states is judged without


def weigh(search: Search, fitted: list[Fitted]) -> None:
    """Log evidence of every model on one scale: fitted and withheld windows, priors, and BIC's price for a
    parameter; divided by the autocorrelation time of the best model's residual, because neighbours are one witness.
    """
    loud = [f for f in fitted if np.isfinite(f.total) and not too_quiet(search, f)]
    best = min(loud or fitted, key=lambda f: f.total)
    scale = best.total / search.count
    search.colour = colour(search, best)
    for f in fitted:
        own = {p.name for effect in f.candidate.effects for p in effect.parameters}
        f.evidence = -0.5 * f.total / max(scale, 0.3) - 0.5 * len(own) * np.log(search.count) - f.candidate.occam
        f.evidence /= search.colour
        if not np.isfinite(f.evidence) or too_quiet(search, f):
            f.evidence = -np.inf


def too_quiet(search: Search, fitted: Fitted) -> bool:
    """Whether a model leaves less of the torque than a perfect one would.

    A small mass beside the encoder passes less of the encoder's noise on: such a model has bought its fit.
    """
    if not search.imposed:
        return False
    corners = corner_torque(search) / noise_torque(search.records[0], search.setting.inertia)
    return fitted.total < TOO_QUIET * max(corners, 1.0) ** 2 * search.count


def colour(search: Search, fitted: Fitted) -> float:
    """Integrated autocorrelation time of a model's residual [samples]."""
    if not fitted.colour:
        fitter = search.fitters[fitted.candidate.family.key]
        rows = [
            fitter.residuals(fitted.candidate, which, np.arange(len(record.starts)))[0]
            for which, record in enumerate(search.records)
        ]
        fitted.colour = correlation_time(np.concatenate(rows, axis=1))
    return fitted.colour


def energy(search: Search, fitted: Fitted) -> float:
    """Residual energy per sample [1], over all windows."""
    return float(np.sum(fitted.train) + np.sum(fitted.withheld)) / search.count


def noise_share(search: Search, fitted: Fitted) -> float:
    """Residual energy per sample that is white: half the mean square of the residual's differences, the quieter
    half of the windows. Of a torque it is what laps or the encoder's noise leave: its band holds nothing white.
    """
    if search.imposed:
        floor = assemble.torque_floor_of(search, fitted).value / noise_torque(search.records[0], search.setting.inertia)
        return (TOLERANCE * floor) ** 2
    fitter = search.fitters[fitted.candidate.family.key]
    found = []
    for which, record in enumerate(search.records):
        residual = fitter.residuals(fitted.candidate, which, np.arange(len(record.starts)))
        # The rate channel where there is one: an encoder's rounding is not white.
        difference = np.diff(residual[0], axis=0)
        found.append(0.5 * np.mean(difference**2, axis=0))
    return float(np.median(np.concatenate(found)))


def channel_energy(search: Search, fitted: Fitted) -> float:
    """Residual energy per sample [1] of the channel that the gap is told in."""
    fitter = search.fitters[fitted.candidate.family.key]
    windows = []
    for which, record in enumerate(search.records):
        residual = fitter.residuals(fitted.candidate, which, np.arange(len(record.starts)))[0]
        windows.append(np.mean(residual**2, axis=0))
    found = np.sort(np.concatenate(windows))
    if fitted.candidate.family.key[0] == "bristles" or search.has_play(fitted.candidate):
        # A load that rattles is chaotic, and bristles may remember more than one state holds: a few windows stay off
        # track however good the model is.
        cut = int(RATTLES * len(found))
        found = found[cut : len(found) - cut]
    return float(np.mean(found))


def judge(search: Search, decision: Decision, fitted: Fitted) -> None:
    """What a model leaves, into the decision: the noise's energy, and the residual's over it."""
    decision.floor = noise_share(search, fitted)
    decision.structure = channel_energy(search, fitted) / max(decision.floor, 1e-12)
    if rounded(search):
        # A rounded reading's error is not white: only the size of the step can be held against it.
        decision.floor = max(decision.floor, min(1.0, channel_energy(search, fitted)))
        decision.structure = channel_energy(search, fitted) / decision.floor


def material(search: Search, before: Fitted, after: Fitted) -> bool:
    """Whether a cause removes enough of what is left to be one."""
    least = MATERIAL_ROUNDED if rounded(search) else MATERIAL
    old, new = energy(search, before), energy(search, after)
    return old - new > least * old


def rounded(search: Search) -> bool:
    """Whether the rate reading, which the gap is told in, comes in steps."""
    rate = search.records[0].velocity
    return rate is not None and rate.step > 0


def quantised_reading(search: Search) -> bool:
    """Whether the rate reading comes in steps that the nominal model does not know and that are most of its noise."""
    rate = search.records[0].velocity
    known = float(getattr(search.nominal.sensor, "step_size", 0.0))
    return rate is not None and known == 0.0 and rate.step > 1.5 * rate.noise


def white(search: Search, fitted: Fitted) -> float:
    """Residual energy over the noise's up to which nothing is left to find."""
    if rounded(search):
        return WHITE_ROUNDED
    return WHITE_WITH_PLAY if search.has_play(fitted.candidate) else WHITE
