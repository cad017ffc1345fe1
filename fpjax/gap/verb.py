"""diagnose: from a log and a nominal model to a `Diagnosis`."""

import dataclasses
import datetime
import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Literal, overload

import numpy as np

from ..blocks.plants import TwoMass
from ..blocks.plants.transmission import Transmission
from ..compiled.threads import one_blas_thread
from ..errors import InputError
from ..logs import Log, LogSource
from ..model_file import Model, ModelSource
from ..output.stages import StageClock
from ..simulation.precision import double_precision
from .answer.assemble import assemble
from .answer.curves import curves_of
from .answer.provenance import columns_hash, provenance
from .data.checks import about_noise, check
from .data.inputs import about_late_torque, on_one_clock, read_logs, read_model, with_earlier_torque
from .data.record import about_stretches, make_records
from .data.setting import make_setting
from .data.torque_noise import TorqueNoise
from .diagnosis import Diagnosis
from .effects.effect import Effect
from .effects.vocabulary import EFFECTS, on_rate_sensor
from .fit.candidate import Fit
from .fit.saved_fits import ResumingSearch, SavedFits, key_of
from .fit.search import Search
from .mended import Runs, mended
from .select.decision import decide, fit_alone
from .select.late_torque import lags, late_beside_numbers, late_torque, least_missing
from .simulate.family import Nominal
from .stage_costs import COSTS

Logs = LogSource | Sequence[LogSource]


@overload
def diagnose(
    log: Logs, model: ModelSource, *, holdout: Logs = (), each: Literal[False] = False,
    effects: tuple[Effect, ...] = EFFECTS, progress: Callable[[str, float], None] | None = None,
    keep: SavedFits | None = None,
) -> Diagnosis: ...  # fmt: skip


@overload
def diagnose(
    log: Logs, model: ModelSource, *, holdout: Logs = (), each: Literal[True], effects: tuple[Effect, ...] = EFFECTS,
    progress: Callable[[str, float], None] | None = None, keep: SavedFits | None = None,
) -> tuple[Diagnosis, ...]: ...  # fmt: skip


def diagnose(
    log: Logs,
    model: ModelSource,
    *,
    holdout: Logs = (),
    each: bool = False,
    effects: tuple[Effect, ...] = EFFECTS,
    progress: Callable[[str, float], None] | None = None,
    keep: SavedFits | None = None,
) -> Diagnosis | tuple[Diagnosis, ...]:
    """Where the simulation is wrong, which effect causes it, how far the gap shrinks.

    Args:
        log: a `fpjax.logs.Log`, a path, a mapping of arrays, or several of them (runs of one machine). The further
            stretches of a log (`Log.further`) are further runs.
        model: the nominal model: a `fpjax.model_file.Model`, or the path or text of a servo.toml.
        holdout: further logs, on which models are scored but never fitted.
        each: one diagnosis for each log, as for separate machines.
        effects: the vocabulary; append your own `Effect` to `fpjax.gap.EFFECTS`.
        progress: called with (name of the stage, share done [1]; an `fpjax.output.work_done.WorkDone`, with what is
            left).
        keep: a file for the fits made so far, `fpjax.gap.fit.saved_fits.SavedFits(path)`: an interrupted diagnosis of
            the same input resumes from it and ends with the same numbers. Its `discard` removes the file.

    Returns:
        A `Diagnosis`; with `each`, a tuple of one for each log.

    Raises:
        InputError: for logs or a model that cannot be diagnosed; the message is one sentence that says why.
    """
    allowed = allowed_effects(effects)
    clock = StageClock(progress, COSTS)
    clock("reading")
    groups, withheld = read_logs(log), list(itertools.chain(*read_logs(holdout)))
    if not groups:
        raise InputError("No log was given: pass a path, a Log or a mapping of arrays.")
    if keep is not None and each and len(groups) > 1:
        raise InputError("keep holds one diagnosis: diagnose each log with a file of its own.")
    found = []
    try:
        # Reading the model too: rounded to single precision, its values would differ.
        with double_precision(), one_blas_thread():
            nominal = read_model(model)
            for group in groups if each else [list(itertools.chain(*groups))]:
                found.append(_diagnose(group, withheld, nominal, effects, allowed, clock, keep))
                clock = StageClock(progress, COSTS)
    finally:
        if keep is not None:
            keep.close()
    return tuple(found) if each else found[0]


def _refuse_repeated(fitted: Sequence[Log], withheld: Sequence[Log]) -> None:
    """Refuse a log that is given twice: it would count twice, or be withheld from a fit that it is in."""
    seen: set[str] = set()
    for log in fitted:
        if (key := columns_hash(log)) in seen:
            raise InputError(f"{log.name} is given twice, and would count twice: give each log once.")
        seen.add(key)
    for log in withheld:
        if columns_hash(log) in seen:
            raise InputError(
                f"{log.name} is fitted and held out: a holdout must be a log that the fit has not seen. Give it as one "
                f"of the two; without a holdout blocks of the log itself are withheld."
            )


def _diagnose(
    logs: Sequence[Log], withheld: Sequence[Log], model: Model, effects: tuple[Effect, ...], allowed: tuple[str, ...],
    clock: StageClock, keep: SavedFits | None,
) -> Diagnosis:  # fmt: skip
    _refuse_repeated(logs, withheld)
    started = datetime.datetime.now(datetime.UTC)
    clock("looking")
    if model.units.motion == "linear":
        # The model decides the units of the answer (N, m/s); the numbers themselves are computed alike.
        logs, withheld = ([dataclasses.replace(one, linear=True) for one in some] for some in (logs, withheld))
    everything = on_one_clock([*logs, *withheld])
    logs, withheld = everything[: len(logs)], everything[len(logs) :]
    warnings = [sentence for one in everything for sentence in one.warnings]
    checked = check(everything, model)
    looked, doubts = checked.warnings(), checked.contradictions()
    warnings += looked
    if untried := " and ".join(effect.name for effect in without_place(model, effects)):
        warnings.append(
            f"{untried} is not tried: the model file has two masses, and bristles are simulated on one alone."
        )
    try:
        runs, make = Runs(logs, withheld), functools.partial(_search, model=model, effects=effects, keep=keep)
        search = make_search(logs, withheld, model, effects, keep)
        search, runs, said = mended(search, runs, make, model.nominal)
        warnings += said
        warnings += about_stretches(search.records)
        if doubts and search.records[0].velocity is None:
            doubts = checked.contradictions(rate=False)

        def earlier(late: float, chosen: Fit | None) -> Search:
            """Of the logs with the torque as it acted."""
            clock("looking")
            searches = {
                lag: make(runs.each(functools.partial(with_earlier_torque, late=late, lag=lag)))
                for lag in lags(late, search.setting.dt)
            }
            lag = least_missing(searches, chosen)
            warnings.append(about_late_torque(everything, late, lag))
            return searches[lag]

        first = fit_alone(search, clock)
        late = 0.0 if doubts else late_beside_numbers(search, first)
        if late > 0.0:
            search = earlier(late, None)
            first = fit_alone(search, clock)
        curves = curves_of(search)
        decision = decide(search, clock, curves.by, first)
        if not doubts and late == 0.0 and (late := late_torque(search, decision)) > 0.0:
            search = earlier(late, decision.chosen.fit)
            curves = curves_of(search)
            decision = decide(search, clock, curves.by)
        clock("intervals and curves")
        found = assemble(search, decision, curves, model, warnings, allowed, clock, doubts[0] if doubts else "")
    except np.linalg.LinAlgError as error:
        names = ", ".join(log.name for log in everything[:3])
        raise InputError(
            f"{names}: no model can be fitted to what is recorded ({error}): the motion is too uniform, a column is "
            "not what it says, or the model is far off; look at it with fpjax inspect, and record a run with reversals."
            + (f" Noticed: {' '.join(looked)}" if looked else "")
        ) from error
    made = provenance(everything, search.records, model, allowed, started)
    clock.done()
    warned = (*found.warnings, *about_noise(everything, found.gap.noise_floor, found.gap.unit))
    return Diagnosis.of(found, seconds=clock.seconds, provenance=made, warnings=warned)


def _search(runs: Runs, model: Model, effects: tuple[Effect, ...], keep: SavedFits | None) -> Search:
    """`make_search` of the same runs with a column that was corrected."""
    return make_search(runs.fitted, runs.withheld, model, effects, keep, again=True, noise=runs.noise)


def make_search(
    logs: Sequence[Log],
    withheld: Sequence[Log],
    model: Model,
    effects: tuple[Effect, ...] = EFFECTS,
    keep: SavedFits | None = None,
    *,
    again: bool = False,
    noise: tuple[TorqueNoise, ...] = (),
) -> Search:
    """The search over one machine's logs, with the nominal model fitted and no effect tried yet.

    Args:
        logs: fitted; without `withheld`, blocks of their windows are kept out of the fits.
        withheld: logs that are scored only.
        model: the nominal model.
        effects: the vocabulary.
        keep: the file that stores fits; None to store none.
        again: whether the file holds fits of the same logs already, before a column of them was corrected.
        noise: what is left of the noise of measured torques.

    Raises:
        InputError: for logs that are too short, or differ in period or columns.
    """
    records = make_records(logs, withheld, model.nominal["inertia"])
    if records[0].velocity is None:
        # Without a fitted rate reading its bias, scale, lag and delay change no residual.
        effects = tuple(effect for effect in effects if not on_rate_sensor(effect))
    effects = tuple(effect for effect in effects if effect not in without_place(model, effects))
    nominal = Nominal(model.loop.plant, model.loop.actuator, model.loop.sensor)
    setting = dataclasses.replace(make_setting(records, model), torque_noise=noise)
    arguments = records, nominal, effects, setting
    if keep is None:
        return Search(*arguments)
    if not again:
        keep.begin(key_of(logs, withheld, model, effects))
    return ResumingSearch(keep, *arguments)


def without_place(model: Model, effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Effects that the nominal model has no place for: bristles between two masses would need a state on either."""
    if not isinstance(model.loop.plant, TwoMass | Transmission):
        return ()
    return tuple(effect for effect in effects if effect.structure == "bristles")


def allowed_effects(effects: tuple[Effect, ...]) -> tuple[str, ...]:
    """Names of the effects where some of `EFFECTS` are missing; () where all are there, with or without others.

    Raises:
        InputError: for no effects at all, or for objects that are no `Effect`.
    """
    wrong = [effect for effect in effects if not isinstance(effect, Effect)]
    if wrong:
        raise InputError(
            f"effects holds {type(wrong[0]).__name__} {str(wrong[0])[:40]!r}: give Effect objects, for instance "
            'tuple(each for each in fpjax.gap.EFFECTS if each.name in ("stribeck", "backlash")).'
        )
    names = tuple(effect.name for effect in effects)
    if not names:
        raise InputError("effects is empty: give at least one effect, or leave it out to try the whole vocabulary.")
    return () if {effect.name for effect in EFFECTS} <= set(names) else names
