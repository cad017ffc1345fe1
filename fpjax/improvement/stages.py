"""Stages of an improvement, and what each takes."""

# What follows the diagnosis, in its unit of work (all effects alone); compiling depends on what the cache holds.
COSTS = {
    "machines": (0.01, 0.03, 0.1),
    "compiling the closed loop": (0.01, 0.4, 0.8),
    "searching": (0.05, 0.15, 0.3),
    "judging on other machines": (0.01, 0.01, 0.02),
    "margins": (0.1, 0.3, 0.4),
    "runs over time": (0.1, 0.3, 0.5),
}
