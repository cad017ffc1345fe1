"""Stages of a diagnosis and their cost, for the progress bar's estimate of the time left."""

from ..output.work_done import StageCosts

# Processor time as a multiple of that of "effects alone". Measured with compiled programs on disk, on simulated logs of
# 8 s at 1 kHz with no cause, one (lag, unbalance), two and three, each with a known controller, and on a log of 18 s at
# 500 Hz with an unknown one. "effects together (2)" runs where one cause does not suffice (or nothing is missing),
# "(3)" where two do not; hence the least of 0.
COSTS: StageCosts = {
    "looking": (0.21, 0.28, 0.34),
    "effects alone": (1.0, 1.0, 1.0),
    "effects together (2)": (0.0, 1.1, 1.8),
    "effects together (3)": (0.0, 0.6, 1.1),
    "simpler causes": (0.0, 0.03, 0.08),
    "what each cause takes": (0.0, 0.06, 0.15),
    "intervals and curves": (0.05, 0.11, 0.19),
    "learned law": (0.0, 0.0, 0.02),
    "closed loop": (0.0, 0.12, 0.26),
    "where": (0.0, 0.0, 0.01),
}
