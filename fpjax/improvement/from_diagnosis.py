"""The part of a diagnosis that `improve` uses, from memory or from a folder."""

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import numpy as np

from ..errors import InputError
from ..gap import Diagnosis
from ..gap.answer.findings import Learned
from ..gap.answer.posterior import FILE, Posterior, load_posterior
from ..gap.answer.provenance import refuse_other_log, refuse_other_machine
from ..logs import Log
from ..logs.checks.agreement import one_unit
from ..model_file import Model, load_model
from ..output.json_object import JsonObject
from ..output.paths import expanded
from ..output.runfile import refuse_unfinished
from ..simulation.precision import double_precision

RESULT = "diagnosis.json"
SCALED = "velocity_scale_error"


@dataclasses.dataclass(frozen=True)
class Known:
    """The part of a diagnosis that `improve` uses.

    Attributes:
        posterior: of the machine's parameters.
        verdict: "no_gap", "explained", "partly_explained" or "unexplained".
        causes: the asserted causes.
        gap_after: rms of the torque that is still missing [N m].
        learned: laws learned from that torque.
        made: whether the model's controller is known to have made the log's torque.
        model: the corrected model with the learned laws, as servo.toml text; "" where there is none.
        model_missing: why there is none.
        contradiction: what of the log cannot be so; "" for nothing.
        gap_before: rms of the torque that the nominal model lacks [N m].
        likely: probability that what `posterior` changes in the nominal model is so [1], asserted or not.
        given: whether the nominal machine leads `posterior` (`lead_as_given`).
        same_gains: whether the file's gains are those that the log was diagnosed with.
    """

    posterior: Posterior
    verdict: str
    causes: tuple[str, ...]
    gap_after: float
    learned: tuple[Learned, ...]
    made: bool
    model: str
    model_missing: str
    contradiction: str = ""
    gap_before: float = math.nan
    likely: float = 1.0
    given: bool = False
    same_gains: bool = True


def known_of(diagnosis: Diagnosis) -> Known:
    """The part of a finished diagnosis that `improve` uses.

    Raises:
        InputError: for one without a posterior.
    """
    if diagnosis.posterior is None:
        raise InputError("This diagnosis has no posterior to draw machines from: diagnose the log again.")
    scales = [one.parameters["scale"].value for one in diagnosis.ranking if one.effect == SCALED]
    return Known(
        diagnosis.posterior, diagnosis.verdict, diagnosis.causes, diagnosis.gap.after, diagnosis.learned,
        diagnosis.tracking is not None, diagnosis.learned_model or diagnosis.model, diagnosis.model_missing,
        diagnosis.contradiction or _in_another_unit(diagnosis.posterior, diagnosis.causes, scales),
        diagnosis.gap.before,
        _likely(diagnosis.posterior, {one.effect: one.cause_probability for one in diagnosis.ranking}),
    )  # fmt: skip


def _likely(posterior: Posterior, of_causes: Mapping[str, float | None]) -> float:
    """The probability of the likeliest change of the nominal model in a posterior; 0 where none is ranked."""
    found = [of_causes.get(name) or 0.0 for name in posterior.causes]
    return max((one for one in found if math.isfinite(one)), default=0.0)


def _in_another_unit(posterior: Posterior, causes: Sequence[str], scales: Sequence[float]) -> str:
    """What is wrong with a velocity column that is a multiple of the position's rate; "" for one that is not.

    The drive's loop did not see it, but what is measured and predicted here are errors of that column.
    """
    beside = SCALED in causes and posterior.noise[1] > 0.0
    if not beside or all(map(one_unit, scales)):
        return ""
    return (
        f"the velocity column is {scales[0]:.4g} times the position's rate; give its unit or turn its sign, such as "
        "--columns velocity=NAME:deg/s."
    )


def same_controller(known: Known, model: Model) -> bool:
    """Whether a model has the controller and the observer, with the gains, that the log was diagnosed with.

    Args:
        known: of the diagnosis, whose corrected model holds both; without one they count as the same.
        model: the nominal model whose gains are to be improved.
    """
    if not known.model:
        return True
    try:
        with double_precision():
            loop = load_model(known.model).loop
    except InputError:  # a text that names a file beside itself, the recorded reference
        return True
    # Both in double precision; a model that was read in single precision has gains rounded to 6e-8.
    old, new = (
        jax.tree.map(lambda gain: np.asarray(gain, float), (one.controller, one.observer)) for one in (loop, model.loop)
    )
    return bool(eqx.tree_equal(old, new, rtol=1e-6))


def about_left(known: Known, torque: float, unit: str) -> str:
    """What the unexplained torque means for the prediction, in a sentence or two.

    Args:
        known: of a log that is not wholly explained.
        torque: rms of the log's torque [N m].
        unit: of the torque.
    """
    size = ""
    if math.isfinite(known.gap_after) and torque > 0.0:
        size = f" ({known.gap_after:.3g} {unit} rms, {known.gap_after / torque:.0%} of the torque in the log)"
    means = (
        "it acts on the simulated machines as it was found along the log, with its size and spectrum. If it depends on "
        "the motion, other gains change it: "
    )
    if known.verdict == "unexplained":
        missing = f"the torque that the nominal model misses{size}" if known.given else f"the missing torque{size}"
        return (
            f"The diagnosis does not explain this log: {missing} has no known cause, and {means}the "
            "intervals are expected values, no promise. Try new gains in small steps, and record a log with them."
        )
    return f"A part of the missing torque{size} has no known cause: {means}the intervals hold if it does not."


def known_in(folder: str | os.PathLike[str], log: Log, *, finished: bool = True, model: Model | None = None) -> Known:
    """The part of a diagnosis that `improve` uses, from the --out folder of `fpjax diagnose`.

    Args:
        folder: with diagnosis.json and posterior.npz.
        log: the log that was diagnosed.
        finished: refuse the folder of an unfinished run; False for the diagnosis that `improve` itself wrote there.
        model: the nominal one, whose machine must be the one that was diagnosed; None not to ask.

    Raises:
        InputError: where there is no diagnosis, or one of another log, of another machine or of more than one log.
    """
    folder = expanded(folder)
    path = folder / RESULT
    if finished:
        refuse_unfinished(path)
    try:
        content: JsonObject = json.loads(path.read_text())
        made: JsonObject = dict(content["provenance"])
        laws = tuple(_law(law) for law in content.get("learned", []))
        # JSON has no NaN: an unknown gap is null in the file
        after = content["gap"]["after"]
        scales = [
            one["parameters"]["scale"]["value"] or 1.0 for one in content.get("ranking", []) if one["effect"] == SCALED
        ]
        posterior = load_posterior(folder / FILE)
        before = content["gap"].get("before")
        of_causes = {one["effect"]: one.get("cause_probability") for one in content.get("ranking", [])}
        found = Known(
            posterior, content["verdict"], tuple(content["causes"]),
            float(after) if after is not None else math.nan, laws, content.get("tracking") is not None,
            content.get("learned_model") or content["model"], content.get("model_missing", ""),
            content.get("contradiction") or _in_another_unit(posterior, content["causes"], scales),
            float(before) if before is not None else math.nan, _likely(posterior, of_causes),
        )  # fmt: skip
    except FileNotFoundError:
        raise InputError(
            f"{folder} holds no {RESULT}: give the --out folder of a `fpjax diagnose` that has finished, or leave out "
            f"--diagnosis to diagnose now."
        ) from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"{path} is not a diagnosis of this version of fpjax: diagnose the log again.") from None
    refuse_other(made, found.posterior, log, model, str(folder))
    return found


def refuse_other(provenance: JsonObject, posterior: Posterior, log: Log, model: Model | None, name: str) -> None:
    """Refuse a diagnosis of another log, of another machine, or of more than one log.

    Args:
        provenance: of the diagnosis.
        posterior: of the diagnosis.
        log: whose gains are to be improved.
        model: the nominal one; None not to ask.
        name: of the diagnosis, for messages.

    Raises:
        InputError: for such a diagnosis.
    """
    others = refuse_other_log(provenance, log, name)
    if model is not None:
        refuse_other_machine(provenance, model, name)
    samples = [len(course) for course in posterior.missing]
    # Stretches of one recording are runs of the machine that `log`, the longest of them, is the first of.
    if others:
        raise InputError(
            f"{name} is a diagnosis of {len(samples)} logs, but improve judges gains on one: diagnose the one log "
            f"that is typical of the machine's work."
        )
    # A log that is too long to be simulated as a whole is diagnosed in parts; its whole length is in the provenance.
    inputs = provenance.get("inputs", [])
    whole = [entry["samples"] for entry in inputs if entry.get("role") == "fitted" and "samples" in entry]
    diagnosed = whole[0] if whole else samples[0]
    if diagnosed != len(log.time):
        raise InputError(
            f"{log.name} has {len(log.time)} samples, but was diagnosed with {diagnosed}: use the same --from, --to "
            f"and --every, or leave out --diagnosis."
        )


def _law(law: JsonObject) -> Learned:
    curve = law["curve"]
    at, torque, low, high = (tuple(curve[name]) for name in ("at", "torque", "low", "high"))
    return Learned(law["of"], law["share"], at, torque, low, high, curve.get("period"))
