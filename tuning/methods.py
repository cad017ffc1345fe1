"""The methods of `tune` and their settings, as data: `method="adam"` is `Adam()`."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class GridSearch:
    """Algorithm 1 exactly as Appendix B runs it; see `grid_search.algorithm_1` for its quirks.

    Attributes:
        steps: first step of each of the two parameters, in their units; None for half the start.
        threshold: the cost below which it stops.
        iterations: at most so many, four costs each.
    """

    steps: tuple[float, ...] | None = None
    threshold: float = 1e-3
    iterations: int = 20


@dataclasses.dataclass(frozen=True)
class RepairedGridSearch:
    """Algorithm 1 with moves along the axes too, only improvements accepted, steps halved on failure.

    Attributes:
        steps: first step of each parameter, in their units; None for half the start.
        threshold: the cost below which it stops.
        iterations: at most so many, 3^n - 1 costs each.
    """

    steps: tuple[float, ...] | None = None
    threshold: float = 1e-3
    iterations: int = 20


@dataclasses.dataclass(frozen=True)
class Adam:
    """optax.adam in log-gain space.

    Attributes:
        rate: step [e-folds a step at first], decaying to a tenth over the iterations by a cosine.
        iterations: at most so many.
        tolerance: a lane ends once its gradient's norm is below this fraction of its cost.
        mode: "forward", "reverse", or "auto" by the number of parameters.
    """

    rate: float = 0.2
    iterations: int = 100
    tolerance: float = 1e-6
    mode: str = "auto"


@dataclasses.dataclass(frozen=True)
class LBFGS:
    """optax.lbfgs with a backtracking line search, in log-gain space.

    Attributes:
        iterations: at most so many.
        tolerance: a lane ends once its gradient's norm is below this fraction of its cost.
        memory: pairs kept.
        longest: longest step [e-folds].
        mode: "forward", "reverse", or "auto" by the number of parameters.
    """

    iterations: int = 50
    tolerance: float = 1e-6
    memory: int = 10
    longest: float = 2.0
    mode: str = "auto"


@dataclasses.dataclass(frozen=True)
class LevenbergMarquardt:
    """optimistix.LevenbergMarquardt on the residual vector.

    In coordinates that are linear in the gains below the start and logarithmic above.

    Attributes:
        iterations: at most so many.
        tolerance: a lane ends once a step changes parameters and residuals by less than this fraction.
    """

    iterations: int = 30
    tolerance: float = 1e-6


@dataclasses.dataclass(frozen=True)
class NelderMead:
    """scipy's Nelder-Mead in log-gain space: the outsider that needs no gradient.

    Attributes:
        iterations: at most so many costs.
        size: side of the first simplex [e-folds].
        tolerance: it ends once the simplex is smaller than this [e-folds] and its costs differ by less.
    """

    iterations: int = 200
    size: float = 0.3
    tolerance: float = 1e-6


Method = GridSearch | RepairedGridSearch | Adam | LBFGS | LevenbergMarquardt | NelderMead

METHODS: dict[str, type[Method]] = {
    "levenberg_marquardt": LevenbergMarquardt,
    "lbfgs": LBFGS,
    "adam": Adam,
    "grid": GridSearch,
    "grid_repaired": RepairedGridSearch,
    "nelder_mead": NelderMead,
}
