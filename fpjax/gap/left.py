"""Left: whether what the best model leaves is structure, as a sentence for the verdict `unexplained`."""

import numpy as np

from . import assemble
from .attribute import Search
from .decision import Decision
from .diagnosis import Gap
from .measure import lap_length
from .structure import left_over, repeats

CHANCE = 0.01  # below which a pattern is none of chance
DRAWS = 99


def left_sentence(search: Search, decision: Decision, gap: Gap) -> str:
    """What speaks for structure in what is left on withheld data; "" where nothing does.

    Args:
        search: the fits.
        decision: the search's.
        gap: of that decision.
    """
    which = next(index for index, record in enumerate(search.records) if np.any(record.withheld))
    record = search.records[which]
    residual = assemble.residual_trace(search, decision.chosen, which)
    window, withheld = assemble.window_of(search, which)
    residual = np.where(withheld, residual, np.nan)
    told = []
    lap = 0 if record.reference is None else lap_length(record.reference)
    if lap:
        alike, chance = repeats(residual, lap, draws=DRAWS)
        if chance <= CHANCE:
            told.append(f"it repeats with the laps of the reference (correlation {alike:.2f})")
    speed = record.speed
    slow = speed / (np.abs(speed) + 0.05 * search.setting.speed)
    motion = np.stack([speed, np.sign(speed), slow, speed * np.abs(speed), record.acceleration])
    found = left_over(residual, max(gap.noise_floor, 1e-300), motion, window, draws=DRAWS)
    if found.follows <= CHANCE:
        told.append(f"it follows speed and acceleration ({found.explained:.0%} of its energy)")
    if not told:
        return ""
    size = f"{gap.after:.3g} {gap.unit} rms on withheld data, noise floor {gap.noise_floor:.3g}"
    return f"What is left ({size}) is structure and not noise: {' and '.join(told)}."
