"""Settings of the methods of `tune`, as data: `method="adam"` means `Adam()`."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class GridSearch:
    """Algorithm 1 exactly as Appendix B runs it; see `grid_search.algorithm_1` for its quirks.

    Attributes:
        steps: first step of each of the two parameters, in their units; None for half the start.
        threshold: the cost below which it stops [1]; Appendix B has 1e-3.
        iterations: largest number of iterations, four costs each; Appendix B has 20.
    """

    steps: tuple[float, ...] | None = None
    threshold: float = 1e-3
    iterations: int = 20


@dataclasses.dataclass(frozen=True)
class RepairedGridSearch:
    """Algorithm 1 with moves along the axes too, only improvements accepted, steps halved on failure.

    Attributes:
        steps: first step of each parameter, in their units; None for half the start.
        threshold: the cost below which it stops [1]; Appendix B has 1e-3.
        iterations: largest number of iterations, 3^n - 1 costs each.
    """

    steps: tuple[float, ...] | None = None
    threshold: float = 1e-3
    iterations: int = 20


@dataclasses.dataclass(frozen=True)
class Adam:
    """optax.adam in log-gain space.

    Attributes:
        rate: first step length [e-folds], which decays to a tenth over the iterations by a cosine.
        iterations: largest number of iterations.
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
        iterations: largest number of iterations.
        tolerance: a lane ends once its gradient's norm is below this fraction of its cost.
        memory: pairs of steps and gradient changes that the approximate Hessian is made of.
        longest: longest step [e-folds]; a poor curvature at the start would ask for decades.
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

    The coordinates are linear in the gains below the start and logarithmic above (`Space.linear_below`).

    Attributes:
        iterations: largest number of iterations.
        tolerance: a lane ends once a step changes parameters and residuals by less than this fraction.
    """

    iterations: int = 30
    tolerance: float = 1e-6


@dataclasses.dataclass(frozen=True)
class NelderMead:
    """scipy's Nelder-Mead in log-gain space: needs no gradient, so that a sign() in the loop does not matter.

    Attributes:
        iterations: largest number of costs.
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
