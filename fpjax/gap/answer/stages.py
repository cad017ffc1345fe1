"""Stages of a diagnosis, and what each takes."""

# What a stage takes, in units of all effects alone: a tenth, the half and nine tenths of 118 withheld logs stay below
# (80 of them with a second round of causes together, 41 with a third, which come only where fewer do not suffice).
COSTS = {
    "looking": (0.26, 0.35, 0.48),
    "effects alone": (1.0, 1.0, 1.0),
    "effects together (2)": (0.0, 1.3, 1.8),
    "effects together (3)": (0.0, 0.8, 1.1),
    "simpler causes": (0.0, 0.08, 0.2),
    "what each cause takes": (0.02, 0.12, 0.3),
    "intervals and curves": (0.02, 0.05, 0.1),
    "learned law": (0.0, 0.01, 0.02),
    "closed loop": (0.0, 0.01, 0.05),
    "where": (0.0, 0.0, 0.01),
}
