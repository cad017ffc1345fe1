"""Stages of a diagnosis and their cost, for the progress bar's estimate of the time left."""

from ..output.work_done import StageCosts

# Processor time as a multiple of that of "effects alone". Measured with compiled programs on disk, on simulated logs of
# 8 s at 1 kHz with no cause, one (lag, unbalance), two and three, each with a known controller, and on a log of 18 s at
# 500 Hz with an unknown one; those up to "intervals and curves" again (2026-11-26) on nine opened logs of the second
# generator, 10 s at 500 Hz to 2 kHz. "effects together (2)" runs where one cause leaves more than a twentieth (or
# nothing is missing), "(3)" where two do; hence the least of 0.
COSTS: StageCosts = {
    "looking": (0.28, 0.4, 0.55),
    "effects alone": (1.0, 1.0, 1.0),
    "effects together (2)": (0.0, 1.2, 1.8),
    "effects together (3)": (0.0, 0.6, 1.1),
    "simpler causes": (0.0, 0.03, 0.08),
    "what each cause takes": (0.0, 0.13, 0.35),
    "intervals and curves": (0.0, 0.07, 0.14),
    "learned law": (0.0, 0.0, 0.02),
    "closed loop": (0.0, 0.12, 0.26),
    "where": (0.0, 0.0, 0.01),
}
