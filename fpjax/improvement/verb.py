"""improve: from a log and a nominal model to gains that follow better in nearly every machine that the log allows."""

import dataclasses
import functools
import math
import os
from collections.abc import Callable, Sequence

import numpy as np

from ..errors import InputError
from ..gap import Diagnosis, diagnose
from ..gap.data.checks import refuse_contradicted, refuse_reference
from ..gap.data.record import Record
from ..logs import Log, LogSource, read_log
from ..logs.arrays import Values, rms
from ..logs.dynamics.derivative import slope
from ..model_file import Model, ModelSource, load_model
from ..output.stages import StageClock
from ..simulation.precision import double_precision
from ..simulation.seeds import checked_seed
from .answer import Change, Range
from .as_given import lead_as_given
from .decision import (
    ABOVE_RATING,
    KEEP,
    LEFT_OUT,
    LESS,
    NOT_APART,
    RATED,
    UNHELD_LOOP,
    WORTH,
    hopeless,
    objection,
    plausible,
    range_of,
    running,
    told_apart,
    too_large,
    too_much,
)
from .from_diagnosis import Known, about_left, known_in, known_of, refuse_other, same_controller
from .gains import Gains, freed, guesses
from .judge import Judge
from .machines import Ground, Machines, draw_machines, make_ground, one_piece, ready, records_of
from .nominal_gains import compare_nominal, nominal_gains
from .predictions import Predictions
from .reference import LONGEST, followed
from .result import Improvement
from .search import Found, limits_of, robust_costs, search
from .stage_costs import COSTS
from .torque_limit import HARDEST, largest_torque
from .traces import passed_on, run_traces, unlike

# Machines for the search; other machines for the prediction; how many of these for the margins.
TUNED_ON, JUDGED_ON, MARGINED = 16, 48, 12
BLENDS = (1.0, 0.6, 0.3)  # shares of the way from the current gains to the best ones, on the search's scales
AT_MOST = 0.95  # share of the allowed torque above which it is taken to have limited the gains
UNDONE = "No gains are tuned on this log"

Keep = Callable[[str, Diagnosis | Found], None]


def improve(
    log: LogSource,
    model: ModelSource,
    *,
    free: str | Sequence[str] = (),
    diagnosis: Diagnosis | Known | str | os.PathLike[str] | None = None,
    reference: str = "log",
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
    keep: Keep | None = None,
    kept: Found | None = None,
) -> Improvement:
    """Find gains that follow better in nearly all machines that a log leaves possible, or say why there are none.

    The log is diagnosed. Machines are drawn from the posterior of the diagnosis, with the missing torque and the
    learned laws. A search minimises the mean + 1.28 standard deviations of the tracking error over these machines. The
    result is compared with the present gains on other machines, drawn anew.

    Args:
        log: a `fpjax.logs.Log`, its path, or a mapping of arrays; with a reference.
        model: the nominal model with a known controller: a `Model`, or the path or text of a servo.toml.
        free: gains that may change besides the observer's and the feed-forward's: "controller", "feedforward" (added
            where there is none), or gains by their names in the file, "controller.kp" or "controller.kp=1:5".
        diagnosis: a finished diagnosis of this log and model, or the --out folder of `fpjax diagnose`; None to diagnose
            now.
        reference: "log" for the log's reference, or "model" for the file's own.
        seed: of all draws.
        progress: called with (name of the stage, share of the whole that is done [1]).
        keep: called with ("diagnosis", Diagnosis) and ("search", Found) as they are done.
        kept: an earlier search to use instead of a new one.

    Returns:
        An `Improvement`: it prints itself, `report(folder)` writes a page.

    Raises:
        InputError: for a log without a reference, an unknown controller, no gain that may change, or a diagnosis of
            another log or machine.
    """
    if isinstance(free, str):
        free = (free,)
    if not isinstance(diagnosis, Diagnosis | Known | str | os.PathLike | None):
        raise InputError(
            f"improve got {type(diagnosis).__name__} {str(diagnosis)[:40]!r} as its diagnosis: give a Diagnosis "
            "(fpjax.diagnose) or the --out folder of fpjax diagnose."
        )
    checked_seed(seed)
    clock = StageClock(progress, COSTS)
    clock("reading")
    with double_precision():
        nominal = model if isinstance(model, Model) else load_model(model)
    nominal.needed_controller()
    recorded = log if isinstance(log, Log) else read_log(log, linear=nominal.linear or None)
    # Of a log with breaks its longest stretch alone (a changed log has no further ones): gains are judged along it.
    whole, recorded = recorded, dataclasses.replace(recorded, since=0.0)
    table = followed(recorded, nominal, reference)
    if reference == "log":
        refuse_reference(recorded, UNDONE)
    # The choice of gains is checked before a diagnosis that takes half a minute. Their ranges need the corrected
    # machine, so the result is not used here.
    freed(nominal, {"inertia": nominal.nominal["inertia"]}, table, free)
    done: Diagnosis | None = None
    if diagnosis is None:
        refuse_contradicted(recorded, nominal, UNDONE)
        done = diagnose(recorded, nominal, progress=lambda stage, share: clock(f"diagnose: {stage}", share))
        if keep is not None:
            keep("diagnosis", done)
        known = known_of(done)
    elif isinstance(diagnosis, Known):
        known = diagnosis
    elif isinstance(diagnosis, Diagnosis):
        done, known = diagnosis, known_of(diagnosis)
        refuse_other(done.provenance, known.posterior, whole, nominal, "The diagnosis")
    else:
        known = known_in(diagnosis, whole, model=nominal)
    if diagnosis is not None and not same_controller(known, nominal):
        known = dataclasses.replace(known, made=False, same_gains=False)
    found = improve_known(known, recorded, nominal, table, free, seed, clock, keep, kept)
    clock.done()
    return dataclasses.replace(found, seconds=clock.seconds, diagnosis=done)


def improve_known(
    known: Known, log: Log, nominal: Model, table: Values, free: Sequence[str], seed: int, clock: StageClock,
    keep: Keep | None, kept: Found | None,
) -> Improvement:  # fmt: skip
    """The improvement from a diagnosis that is already there."""
    if known.contradiction:
        raise InputError(f"{UNDONE} until this is settled: {known.contradiction}")
    clock("machines")
    records = records_of(log, nominal)
    whole_table = table
    record, table = one_piece(records[0], log, table)
    known = lead_as_given(known, nominal, records[0])
    ground = make_ground(known, records, seed)
    tuned_on = draw_machines(known.posterior, nominal, ground, TUNED_ON, seed + 1)
    judged_on = draw_machines(known.posterior, nominal, ground, JUDGED_ON, seed + 2)
    one, two = tuned_on.periods(record.dt), judged_on.periods(record.dt)
    longest = max(one[0], two[0]), max(one[1], two[1])
    tuned_on, judged_on = ready(tuned_on, ground, longest), ready(judged_on, ground, longest)
    # Bounds without the user's own are multiples of the reported machine's friction and inertia.
    machine = corrected_values(judged_on.parts[1] if known.given else judged_on)
    gains = freed(nominal, machine, table, free)
    judge = Judge(gains.model, gains.names, ground, table, seed + 3)
    notes = _notes(known, gains, record, table, judge.start)
    clock("compiling the closed loop")
    now = judge(gains.now[None], judged_on)
    speed = _steady_speed(judge)
    ran = record.reference is not None and np.array_equal(table, np.asarray(record.reference)[: len(table)])
    told = known.made and ran  # only then can the log's tracking error be compared with the prediction
    measured = measured_error(record, judge, ground) if told else None
    now_tuned = judge(gains.now[None], tuned_on)
    if known.same_gains:
        # A machine that would not have followed as the log shows did not make it, nor does one that is unstable run.
        keeps = functools.partial(plausible, measured=measured) if told else running
        fits, fits_tuned = (keeps(each.of(0)) for each in (now, now_tuned))
        judged_on, tuned_on = judged_on.only(fits), tuned_on.only(fits_tuned)
        now, now_tuned = now.only(fits), now_tuned.only(fits_tuned)
        notes += [LEFT_OUT.format(1.0 - np.mean(fits))] if not fits.all() else []
    judged = Predictions(judge, gains, (judged_on, MARGINED), speed, known, measured, TUNED_ON)
    decision, reason = hopeless(now.of(0))
    if decision is not None:
        clock("margins")
        before = judged.side(gains.now, now.of(0), judged.margins(gains.now[None])[0])
        return judged.answer(decision, reason, before, before, None, (), 0.0, None, 0, notes)
    limits = limits_of(now_tuned.of(0), record, nominal)
    clock("nominal model")
    alone = nominal_gains(log, nominal, free, seed, whole_table)
    simple = np.array([alone[gain.word] for gain in gains.gains])
    clock("searching")
    if kept is not None and len(kept.values) == len(gains.gains):
        found = kept
    else:
        first = np.concatenate([guesses(gains, machine), simple[None]])
        found = search(judge, gains, tuned_on, first, limits, seed + 4, lambda share: clock("searching", share))
        if keep is not None:
            keep("search", found)
    clock("judging on other machines")
    # Besides the best gains of the search, points on the way to them are judged, so a large change that costs too much
    # margin may become a smaller one. And the feed-forward alone: it is outside the loop and costs no stability. And
    # the gains of the nominal model: whoever tuned there knows then what speaks for them here, or against them.
    shares, best = gains.shares(gains.now), gains.shares(found.values)
    steps = [shares + blend * (best - shares) for blend in BLENDS]
    outside = np.array([gain.word.startswith("feedforward.") for gain in gains.gains])
    if outside.any() and not outside.all():
        steps.append(np.where(outside, best, shares))
    tried = np.concatenate([gains.now[None], gains.values(np.stack(steps)), simple[None]])
    scores = judge(tried, judged_on)
    clock("margins")
    margins = judged.margins(tried)
    before = judged.side(tried[0], scores.of(0), margins[0])
    if "modulus" in before.margins and before.margins["modulus"].value <= 0.0:
        notes.append(UNHELD_LOOP)
    rated, unit = nominal.limits.get("torque", math.inf), judged.torque_unit
    against = [
        objection(scores.of(0), scores.of(i), margins[0], margins[i]) or too_large(scores.of(i), rated, unit, RATED)
        for i in range(1, len(tried))
    ]
    costs, fine = robust_costs(scores, limits), [place for place, said in enumerate(against, 1) if not said]
    chosen, reason = min(fine, key=lambda place: costs[place]) if fine else 0, KEEP.format(against[0])
    if (reached := largest_torque(record)) > rated:
        above = ABOVE_RATING.format(reached, rated, unit=unit)
        notes += [above] if chosen else []
        # Gains that keep to so little follow worse than those that run: that is no reason which helps.
        reason = f"Keep your gains. {above}"
    last = len(tried) - 1
    usable = chosen not in (0, last) and last in fine and not too_much(scores.of(last), limits, unit)
    if usable and not told_apart(scores.error[chosen], scores.error[last]):
        chosen = last
        notes += [] if against[0] else [NOT_APART.format(1.0 - WORTH)]
    if chosen and against[0]:
        parts = ["a part of the way"] * len(BLENDS) + ["the feed-forward alone"] * (len(tried) - len(BLENDS) - 2)
        notes.append(LESS.format([*parts, "the gains that are best in the nominal model"][chosen - 1], against[0]))
    seen = chosen or 1
    clock("runs over time")
    runs = run_traces(judge, tried[[0, seen]], judged_on)
    if ran:
        judged.compare(unlike(runs, judge, record, ground), passed_on(runs, judge))
    ratios = scores.error[seen] / scores.error[0]
    side = judged.side(tried[seen], scores.of(seen), margins[seen], new=True)
    wins = float(np.mean(ratios < 1.0))
    # Both errors are uncertain by the model itself, each on its own.
    doubts = judged.doubt(scores.of(0), new=False), judged.doubt(scores.of(seen), new=True)
    middle = range_of(ratios, "1", math.hypot(*doubts))
    if chosen:
        winners = f"all {judged_on.count}" if wins == 1.0 else f"{wins:.0%} of {judged_on.count}"
        reason = (
            f"The tracking error becomes {_smaller(middle)}, and smaller in {winners} machines that the log leaves "
            "possible."
        )
        if known.verdict == "unexplained":
            reason = f"Expected, not promised (the diagnosis does not explain this log): t{reason[1:]}"
    changes = tuple(
        Change(
            gain.word, gain.now, float(value) if chosen else gain.now, gain.low, gain.high,
            gain.edge(float(value)) if chosen else "",
        )
        for gain, value in zip(gains.gains, tried[seen], strict=True)
    )  # fmt: skip
    for change in changes:
        if change.at:
            notes.append(
                f"{change.gain} ended at the {change.at} end of its bounds ({change.after:.4g} in {change.low:.4g} to "
                f"{change.high:.4g}): the bound, not the machine, determined it; a wider one, [bounds] {change.gain} = "
                "[low, high], may follow better."
            )
    peak = float(np.median(scores.peak[seen]))
    if chosen and "torque" not in nominal.limits and peak > AT_MOST * limits.peak:
        notes.append(
            f"The largest torque reached what was allowed, {limits.peak:.3g} {judged.torque_unit}: {HARDEST - 1.0:.0%} "
            f"more than the log's. If the machine can take more, a larger [limits] torque in the model may gain more."
        )
    answer = judged.answer(
        "change" if chosen else "keep", reason, before, side if chosen else before, side, changes, wins, middle,
        found.simulations, notes, tried[chosen],
    )  # fmt: skip
    compared = compare_nominal(alone, scores, chosen, limits, against[-1], judged.torque_unit)
    return dataclasses.replace(
        answer, nominal=compared, notes=(*answer.notes, compared.sentence()), runs=runs.summary(10.0 * judge.size),
        ratios=ratios, tuned_on=tuned_on.count,
    )  # fmt: skip


def corrected_values(machines: Machines) -> dict[str, float]:
    """Inertia, coulomb and viscous of the corrected machine."""
    law = machines.machine.law
    inertia = float(np.asarray(machines.machine.plant.inertia)[0])
    friction = {name: float(np.asarray(getattr(law, name))[0]) for name in ("coulomb", "viscous")}
    return {"inertia": inertia, **friction}


def measured_error(record: Record, judge: Judge, ground: Ground) -> float | None:
    """Rms of the log's tracking error after the settling time, corrected for sensor noise; None without a reading."""
    channel = record.position if judge.position else record.reading
    if channel is None or record.reference is None:
        return None
    first = math.ceil(judge.start / judge.dt)
    error = (np.asarray(record.reference) - channel.values)[first : len(judge.reference)]
    noise = ground.noise[1] if judge.position else ground.noise[0]
    return math.sqrt(max(rms(error) ** 2 - noise**2, 0.0)) or None


def _steady_speed(judge: Judge) -> float:
    """The speed at which margins are computed: the rms of the reference's speed."""
    moving = slope(judge.reference, judge.dt) if judge.position else judge.reference
    return rms(moving)


def _smaller(ratio: Range) -> str:
    """How much smaller an error becomes, from the ratio of the errors: in per cent, below a tenth as a factor."""

    def told(value: float) -> str:
        return f"{1.0 / max(value, 1e-300):.3g}" if ratio.value < 0.1 else f"{1.0 - value:.0%}"

    least, most = told(ratio.high), told(ratio.low)
    between = "" if least == most else f" ({least} to {most})"
    return f"{told(ratio.value)}{' times' if ratio.value < 0.1 else ''} smaller{between}"


def _notes(known: Known, gains: Gains, record: Record, table: Values, settled: float) -> list[str]:
    notes = [
        f"The first {settled:.2g} s count in none of these figures: there the machine goes from its start to the "
        "reference, with a transient, and a torque, of their own."
    ]
    if gains.added:
        notes.append(f"[{gains.added[0]}] is not in the model: it was added, with zero gains at first.")
    if not known.made:
        notes.append(
            "The model's controller is not known to have made this log's torque (its gains were others, something else "
            "adds to it, or the log lacks a column that it reads: the reference, or the velocity that the drive used), "
            "so the prediction with the file's gains could not be compared with the log."
        )
    if record.recorded > len(record.time):
        begin, length = record.time[0], len(table) * record.dt
        notes.append(f"The log is long: {length:.3g} s of it were used, from {begin:.3g} s on.")
    elif len(table) == LONGEST:
        notes.append(f"The first {LONGEST * record.dt:.3g} s of the reference were simulated.")
    if known.posterior.noise[1] == 0.0:
        notes.append(
            "The log has no position, so that little in it shows what the velocity sensor itself misreads (a scale, a "
            "lag): what it misreads without being found adds to these errors."
        )
    if known.given:
        notes.append(
            "The diagnosis asserts no cause: half of the machines or more are the nominal one, with the torque that it "
            "misses along the log."
        )
    if known.posterior.rivals:
        names = [f"{', '.join(rival.causes) or 'nothing'} ({share:.0%})" for share, rival in known.posterior.rivals]
        notes.append(f"The log leaves other explanations open: {'; '.join(names)}. They are among the machines.")
    if known.verdict in ("partly_explained", "unexplained"):
        notes.append(about_left(known, rms(record.torque), gains.model.units.name("N m")))
    return notes
