"""Stages of a diagnosis, and what each takes."""

# What a stage takes, in units of all effects alone: (at least, expected, at most). Processor time with compiled
# programs on disk, of simulated logs of 8 s at 1 kHz without a gap, with one cause (lag, unbalance), two and three,
# each with a known controller, and of a log of 18 s at 500 Hz with an unknown one. A second round of causes together
# came where one cause did not suffice (or nothing was missing), a third where two did not.
COSTS = {
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
