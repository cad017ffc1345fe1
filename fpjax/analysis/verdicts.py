"""Which parameters are identifiable: one rule and one set of limits, for gains, identified values and the diagnosis."""

import numpy as np

DEAD = 1e-9  # slope, as a fraction of the largest, below which a parameter has no effect
FLAT = 1e-2  # slope, as a fraction of the largest, below which a parameter has hardly any effect, where that is asked
# |cosine| of two slopes, or |correlation| of two estimates, above which the two parameters trade off: only a
# combination of them is identifiable.
PARALLEL = 0.999
# The same for the correlations of a posterior. Its priors keep the correlation of two parameters below one even where
# the data cannot tell them apart at all, so the limit for data alone would never be reached.
PARALLEL_POSTERIOR = 0.95
AT_BOUND = 0.96  # share of the way from the middle to a bound, beyond which a parameter counts as at the bound


def is_alive(lengths: np.ndarray) -> np.ndarray:
    """Which parameters have an effect on the residuals, shape (n,).

    Args:
        lengths: norms of the residuals' slopes by each parameter, shape (n,).
    """
    return lengths > DEAD * max(float(np.max(lengths, initial=0.0)), 1e-300)


def traded_with(alike: np.ndarray, index: int, *, limit: float = PARALLEL) -> list[int]:
    """Indices of the parameters that a parameter trades off with, the closest first.

    Args:
        alike: cosines of the slopes, or correlations of the estimates, shape (n, n).
        index: of the parameter.
        limit: |cosine| or |correlation| above which two trade off; `PARALLEL_POSTERIOR` where priors are involved.
    """
    size = np.abs(alike[index])
    return [int(j) for j in np.argsort(-size, kind="stable") if j != index and size[j] > limit]


def verdicts(
    names: tuple[str, ...],
    lengths: np.ndarray,
    alike: np.ndarray,
    unpinned: np.ndarray,
    share: np.ndarray,
    *,
    flat: float = DEAD,
) -> dict[str, str]:
    """By parameter: "pinned", or some of "dead", "flat", "traded off with NAME", "not pinned", "at its low bound".

    Args:
        names: of the parameters.
        lengths: norms of the residuals' slopes by each parameter, all on comparable scales, shape (n,).
        alike: cosines of the slopes, or correlations of the estimates, shape (n, n).
        unpinned: whether a parameter is undetermined for another reason (a large standard error), shape (n,); reported
            only where none of the reasons above applies.
        share: where each lies between its bounds, -1 to 1, shape (n,).
        flat: slope, as a fraction of the largest, below which a parameter is "flat"; `DEAD` or less for never.
    """
    alive = is_alive(lengths)
    steep = alive & (lengths > flat * float(np.max(lengths, initial=0.0)))
    words: dict[str, list[str]] = {name: [] for name in names}
    for i, name in enumerate(names):
        if not alive[i]:
            words[name].append("dead")
        elif not steep[i]:
            words[name].append("flat")
        words[name] += [
            # The direction of a dead or flat slope is rounding: it is compared with no other.
            f"traded off with {other}"
            for j, other in enumerate(names)
            if steep[i] and steep[j] and j in traded_with(alike, i)
        ]
        if unpinned[i] and not words[name]:
            words[name].append("not pinned")
        if abs(share[i]) >= AT_BOUND:
            words[name].append(f"at its {'high' if share[i] > 0 else 'low'} bound")
    return {name: ", ".join(said) or "pinned" for name, said in words.items()}
