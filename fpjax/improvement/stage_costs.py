"""The stages of an improvement after the diagnosis, and their costs for the progress bar."""

from ..output.work_done import StageCosts

# Time in units of the diagnosis' stage "effects alone". Compilation times depend on the contents of jax's cache.
COSTS: StageCosts = {
    "machines": (0.01, 0.03, 0.1),
    "compiling the closed loop": (0.01, 0.4, 0.8),
    "nominal model": (0.05, 0.2, 0.4),
    "searching": (0.05, 0.15, 0.3),
    "judging on other machines": (0.01, 0.01, 0.02),
    "margins": (0.1, 0.3, 0.4),
    "runs over time": (0.1, 0.3, 0.5),
}
