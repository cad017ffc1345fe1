"""The decision whether gains are proposed, from the scores of many machines: pure functions and their thresholds."""

import math

import numpy as np

from ..logs.arrays import Values
from .answer import Decision, Range
from .judge import Score
from .search import ROUGHEST, AllowedScore, allowed_roughness

NEARLY_ALL = 0.95  # share of the machines that must follow better with the new gains
WORTH = 0.98  # largest error, relative to the present one, of a proposal: under 2 % no running machine is changed
# A proposal keeps this share of the present modulus margin, or has this margin, which is a usual design value.
MARGIN_KEPT, MARGIN_ENOUGH = 0.9, 0.5
ROUGHNESS = 2.2  # largest roughness of the torque, relative to the present one
PROMISED = 3.0  # largest ratio of the ends of the error's 90 % interval with which a prediction is of use
# Largest factor between the tracking error of a drawn machine with the gains that ran and the log's. A machine beyond
# it is not the one that made the log.
PLAUSIBLE = 2.0
LEFT = 0.5  # smallest share of the drawn machines that such a comparison may leave
# Of the torque that the model file rates the drive at, what gains may need [1]: the search only fines what is above it,
# and on other machines than these, so that the best gains under a rating end just beside it.
RATED = 1.02
UNSTABLE = 0.1  # share of machines unstable with the current gains above which no prediction is made

ABOVE_RATING = (
    "The log's largest torque, {:.4g} {unit}, is above the {:.4g} {unit} of [limits] torque in the model file: one of "
    "the two is wrong, and nothing that needs more than the file's is proposed."
)
LEFT_OUT = (
    "{:.0%} of the machines that the diagnosis leaves possible were left out: with the gains that ran they would be "
    "unstable, or follow much better or worse than the log shows."
)
UNHELD_LOOP = (
    "With the gains in the file the corrected loop is unstable about a steady motion, and only its torque limit holds "
    "it: check [controller], or look at the log for a torque that swings from limit to limit."
)
KEEP = "Keep your gains: the best others {}."
NOT_APART = (
    "The best gains that the search found follow less than {:.0%} better on these machines than the gains that are "
    "best in the nominal model, which are proposed instead."
)
LESS = "The best gains that the search found are not proposed, but {}: they {}."


def plausible(now: Score, measured: float | None) -> Values:
    """Whether each drawn machine may have made the log: it was stable with the gains that ran, and followed as well.

    The draws know the log's windows, each from its own initial state, but not that the loop as a whole was stable.
    Where the error would refute most of them, it is not asked, and where being stable would, the posterior is what is
    wrong, and all are kept.

    Args:
        now: scores with the gains that made the log, each of shape (machines,); the first machine is the fit itself.
        measured: rms of the tracking error in the log, in its unit; None where the log does not show it.
    """
    stable = np.isfinite(now.error)
    tried = [stable]
    if measured is not None and abs(math.log(max(now.error[0], 1e-300) / measured)) < math.log(PLAUSIBLE):
        ratio = np.where(stable, now.error, np.inf) / measured
        tried.insert(0, stable & (np.abs(np.log(ratio)) < math.log(PLAUSIBLE)))
    fine = [kept for kept in tried if kept[0] and np.mean(kept) >= LEFT]
    return fine[0] if fine else np.ones(len(stable), bool)


def running(now: Score) -> Values:
    """Whether each drawn machine runs with the current gains, where the log does not tell that they made it.

    The user says that they run. A tenth of the machines may be left out for that; where more are unstable, too little
    is known, which `hopeless` says, and all are kept.

    Args:
        now: scores with the current gains, each of shape (machines,); the first machine is the fit itself.
    """
    stable = np.isfinite(now.error)
    return stable if stable[0] and np.mean(~stable) <= UNSTABLE else np.ones(len(stable), bool)


def told_apart(error: Values, nominal: Values) -> bool:
    """Whether gains follow better than those of the nominal model by what a change is worth.

    A tuning without the log has these already. Where the log does not tell the two apart, what the search found
    hangs on the drawn machines, and the nominal model's gains are the ones with a reason.

    Args:
        error: with the gains, shape (machines,).
        nominal: with the nominal model's gains, in the same machines; finite.
    """
    return float(np.median(error / nominal)) < WORTH


def hopeless(now: Score) -> tuple[Decision | None, str]:
    """(decision, reason) where nothing can be proposed whatever the gains; (None, "") where a search makes sense.

    Args:
        now: scores of the current gains, each of shape (machines,); the first machine is the fit itself.
    """
    unstable = ~np.isfinite(now.error)
    if unstable[0]:
        return "unstable", (
            "The likeliest model is unstable with the gains in the file, but the machine ran: the diagnosis or the "
            "file's gains are wrong, and nothing is proposed; check [controller], and look at the diagnosis."
        )
    share = float(np.mean(unstable))
    if share > UNSTABLE:
        return "cannot_promise", (
            f"In {share:.0%} of the machines that the log leaves possible the loop is unstable with the gains that "
            f"ran: too little is known of this machine for a prediction, and nothing is proposed; record a log with "
            f"more information (other speeds, more reversals)."
        )
    low, high = np.quantile(now.error[~unstable], (0.05, 0.95))
    if high > PROMISED * low:
        return "cannot_promise", (
            f"Over the machines that the log leaves possible, the tracking error with the present gains goes from "
            f"{low:.3g} to {high:.3g}: too little is known of this machine for a prediction, and nothing is proposed; "
            f"record a log with more information (other speeds, more reversals)."
        )
    return None, ""


def objection(now: Score, new: Score, margins_now: dict[str, Values], margins_new: dict[str, Values]) -> str:
    """Why these gains are not proposed, as the end of a sentence about them; "" for no objection.

    Args:
        now: scores of the current gains, each of shape (machines,).
        new: scores of the other gains, in the same machines.
        margins_now: margins by name with the current gains, each of shape (machines,).
        margins_new: margins by name with the other gains.
    """
    if not np.isfinite(new.error).all():
        return f"are unstable in {float(np.mean(~np.isfinite(new.error))):.0%} of the possible machines"
    ratio = new.error / now.error  # machine by machine: what they have in common drops out
    wins, middle = float(np.mean(ratio < 1.0)), float(np.median(ratio))
    if wins < NEARLY_ALL:
        return (
            f"follow better in {wins:.0%} of the machines that the log leaves possible, and a change needs "
            f"{NEARLY_ALL:.0%}"
        )
    if middle > WORTH:
        return (
            f"would make the tracking error {max(1.0 - middle, 0.0):.1%} smaller, and a change needs {1.0 - WORTH:.0%}"
        )
    old, then = (_lowest(margins["modulus"]) for margins in (margins_now, margins_new))
    if then <= 0.0:
        return "make a loop that is unstable about a steady motion, which only its torque limit holds"
    if then < min(MARGIN_KEPT * old, MARGIN_ENOUGH):
        return f"leave a modulus margin of {then:.2f}, where {MARGIN_ENOUGH:g} is usual and yours have {old:.2f}"
    rough = roughness(now, new)
    if rough > ROUGHNESS:
        return f"make the torque {rough:.1f} times as rough from sample to sample, and {ROUGHNESS:g} is allowed"
    return ""


def roughness(now: Score, new: Score) -> float:
    """Roughness of the torque with other gains, over the current gains', medians of the machines [1]."""
    return float(np.median(new.rough) / max(float(np.median(allowed_roughness(now))), 1e-300))


def too_much(new: Score, limits: AllowedScore, unit: str) -> str:
    """What the search's limits of the torque say against gains, as `objection` does; "" for nothing.

    Args:
        new: their scores, each of shape (machines,).
        limits: of the search.
        unit: of the torque.
    """
    if large := too_large(new, limits.peak, unit):
        return large
    rough = _mean(new.rough)
    if rough > ROUGHEST * limits.rough:
        return f"make the torque {rough / limits.rough:.2f} times as rough, and the search allows {ROUGHEST:g}"
    return ""


def too_large(new: Score, most: float, unit: str, beyond: float = 1.0) -> str:
    """What a largest torque says against gains, as `objection` does; "" for nothing.

    Args:
        new: their scores, each of shape (machines,).
        most: that is allowed, in `unit`.
        unit: of the torque.
        beyond: of what is allowed, that is taken as no more [1].
    """
    peak = _mean(new.peak)
    if not peak > beyond * most:
        return ""
    return f"need a largest torque of {peak:.4g} {unit}, {peak / most - 1.0:.1%} above the allowed {most:.4g} {unit}"


def _mean(values: Values) -> float:
    return float(np.mean(np.where(np.isfinite(values), values, 0.0)))


def _lowest(values: Values) -> float:
    """The 5 % quantile, without machines whose margin is not known (NaN); infinite without any."""
    fine = values[~np.isnan(values)]
    return float(np.quantile(fine, 0.05)) if len(fine) else math.inf


def range_of(values: Values, unit: str, doubt: float = 0.0) -> Range:
    """Median and 90 % interval of some values, widened by the uncertainty of the model itself.

    Args:
        values: one for each machine.
        unit: of the values.
        doubt: half of the 90 % interval of the logarithm that the model's own error makes [1].
    """
    # "nearest" instead of interpolation, which would give NaN between a finite value and infinity.
    low, middle, high = (float(each) for each in np.quantile(values, (0.05, 0.5, 0.95), method="nearest"))
    if doubt > 0.0 and all(math.isfinite(each) and each > 0.0 for each in (low, middle, high)):
        # Both uncertainties are independent factors, so their logarithms add as squares.
        low = middle * math.exp(-math.hypot(math.log(middle / low), doubt))
        high = middle * math.exp(math.hypot(math.log(high / middle), doubt))
    return Range(middle, low, high, unit)
