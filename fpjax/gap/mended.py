"""Mended: columns that are corrected before anything is fitted, where less torque is missing then than as recorded."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from ..logs import Log
from .data.encoder_error import about_errors, encoder_errors, without_errors
from .data.torque_noise import TorqueNoise, about_torque_noise, torque_noise, without_noise
from .fit.search import Search
from .select.late_torque import least_missing


@dataclass(frozen=True)
class Runs:
    """The logs of one machine.

    Attributes:
        fitted: that models are fitted to.
        withheld: that they are scored on alone.
        noise: what is left of the noise of their measured torques, those that are fitted first; empty for none.
    """

    fitted: Sequence[Log]
    withheld: Sequence[Log]
    noise: tuple[TorqueNoise, ...] = ()

    @property
    def every(self) -> tuple[Log, ...]:
        """Those that are fitted first."""
        return (*self.fitted, *self.withheld)

    def each(self, change: Callable[[Log], Log]) -> "Runs":
        """The same runs, each changed."""
        return self.of([change(log) for log in self.every])

    def of(self, every: Sequence[Log]) -> "Runs":
        """The same runs by other logs, in the order of `every`."""
        return replace(self, fitted=every[: len(self.fitted)], withheld=every[len(self.fitted) :])


def mended(
    search: Search, runs: Runs, make: Callable[[Runs], Search], nominal: Mapping[str, float]
) -> tuple[Search, Runs, list[str]]:
    """(the search, the runs, what was done) after an encoder's errors and a measured torque's noise are taken out.

    Args:
        search: of the runs as recorded.
        runs: as recorded.
        make: gives the search of other ones.
        nominal: numbers of the nominal model.
    """
    said: list[str] = []
    errors = [encoder_errors(log, nominal["inertia"]) for log in runs.every]
    if any(errors):
        # A rate sensor that ripples with the position parts from the encoder likewise: what leaves less is right.
        parts = runs.of([without_errors(log, own) for log, own in zip(runs.every, errors, strict=True)])
        if (found := _if_better(search, make(parts))) is not None:
            said += [about_errors(log, own) for log, own in zip(runs.every, errors, strict=True) if own]
            search, runs = found, parts
    quiet = [without_noise(log, torque_noise(log, nominal["inertia"], nominal["viscous"])) for log in runs.every]
    if any(any(noise.taken) for _, noise in quiet):
        parts = runs.of([log for log, _ in quiet])
        # What leaves more is no noise: the machine felt it.
        if _if_better(search, make(parts)) is not None:
            runs = replace(parts, noise=tuple(noise for _, noise in quiet))
            said += [about_torque_noise(log, noise) for log, noise in quiet if noise.size]
            search = make(runs)
    return search, runs, said


def _if_better(recorded: Search, corrected: Search) -> Search | None:
    """The search of corrected logs where less torque is missing in them than as they were recorded."""
    best = least_missing({"recorded": recorded, "corrected": corrected}, None)
    return corrected if best == "corrected" else None
