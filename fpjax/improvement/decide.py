"""Decide: whether gains are proposed, from the scores of many machines; pure, and all its thresholds stand here."""

import math

import numpy as np

from .answer import Decision, Range
from .judge import Score
from .search import allowed_roughness

NEARLY_ALL = 0.95  # of the machines must follow better with the new gains
WORTH = 0.98  # of the error: less than 2 % is no reason to touch a running machine
MARGIN_KEPT, MARGIN_ENOUGH = 0.9, 0.5  # of the current modulus margin; or a usual one
ROUGHNESS = 2.2  # times the current roughness of the torque
PROMISED = 3.0  # largest ratio of the ends of a 90 % interval of the error that still promises something
UNSTABLE = 0.1  # share of unstable machines with the current gains from which nothing can be promised

Values = np.ndarray


def hopeless(now: Score) -> tuple[Decision | None, str]:
    """Why nothing can be proposed whatever the gains; (None, "") where something may be."""
    unstable = ~np.isfinite(now.error)
    if unstable[0]:
        return "unstable", (
            "The corrected model is unstable with the gains in the file, though the machine ran: the diagnosis or the "
            "file's gains are wrong, and nothing is proposed; check [controller], and look at the diagnosis."
        )
    share = float(np.mean(unstable))
    if share > UNSTABLE:
        return "cannot_promise", (
            f"In {share:.0%} of the machines that the log leaves possible the loop is unstable with the gains that "
            f"ran: too little is known of this machine to promise anything, and nothing is proposed; record a log "
            f"that shows more (other speeds, more reversals)."
        )
    low, high = np.quantile(now.error[~unstable], (0.05, 0.95))
    if high > PROMISED * low:
        return "cannot_promise", (
            f"The log leaves machines possible whose tracking error with the gains that run now goes from {low:.3g} to "
            f"{high:.3g}: too little is known of this machine to promise anything, and nothing is proposed; record a "
            f"log that shows more (other speeds, more reversals)."
        )
    return None, ""


def objection(now: Score, new: Score, margins_now: dict[str, Values], margins_new: dict[str, Values]) -> str:
    """Why these gains are not proposed; "" for no objection."""
    if not np.isfinite(new.error).all():
        share = float(np.mean(~np.isfinite(new.error)))
        return f"Keep your gains: the best that the search saw are unstable in {share:.0%} of the possible machines."
    ratio = new.error / now.error
    wins, middle = float(np.mean(ratio < 1.0)), float(np.median(ratio))
    if wins < NEARLY_ALL:
        return (
            f"Keep your gains: the best others follow better in {wins:.0%} of the machines that the log leaves "
            f"possible, and a change needs {NEARLY_ALL:.0%}."
        )
    if middle > WORTH:
        return (
            f"Keep your gains: the best others would make the tracking error {max(1.0 - middle, 0.0):.1%} smaller, and "
            f"a change needs {1.0 - WORTH:.0%}."
        )
    old, then = (_lowest(margins["modulus"]) for margins in (margins_now, margins_new))
    if then < min(MARGIN_KEPT * old, MARGIN_ENOUGH):
        return (
            f"Keep your gains: the best others leave a modulus margin of {then:.2f}, where {MARGIN_ENOUGH:g} is usual "
            f"and yours have {old:.2f}."
        )
    rough = float(np.median(new.rough) / max(float(np.median(allowed_roughness(now))), 1e-300))
    if rough > ROUGHNESS:
        return f"Keep your gains: the best others make the torque {rough:.1f} times as rough from sample to sample."
    return ""


def _lowest(values: Values) -> float:
    fine = values[~np.isnan(values)]
    return float(np.quantile(fine, 0.05)) if len(fine) else math.inf


def range_of(values: Values, unit: str, doubt: float = 0.0) -> Range:
    """Median and 90 % interval, widened by a doubt of the model itself (half an interval of the logarithm)."""
    low, middle, high = (float(each) for each in np.quantile(values, (0.05, 0.5, 0.95), method="nearest"))
    if doubt > 0.0 and all(math.isfinite(each) and each > 0.0 for each in (low, middle, high)):
        low = middle * math.exp(-math.hypot(math.log(middle / low), doubt))
        high = middle * math.exp(math.hypot(math.log(high / middle), doubt))
    return Range(middle, low, high, unit)
