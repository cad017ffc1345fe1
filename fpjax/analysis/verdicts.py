"""Which parameters data pin: one rule and one set of limits, for gains, identified numbers and a diagnosis' fits."""

import numpy as np

DEAD = 1e-9  # slope, as a fraction of the largest, below which a parameter moves nothing
FLAT = 1e-2  # the same, below which it moves next to nothing, where that is asked
PARALLEL = 0.999  # of two slopes (cosine) or two estimates (correlation), beyond which the two trade off
# The same for correlations of a posterior: its priors keep the correlation of two parameters that the data alone trade
# off below one, so that the limit of the data alone would never be reached.
PARALLEL_POSTERIOR = 0.95
AT_BOUND = 0.96  # share of the way from the middle to a bound from which a parameter counts as at it


def is_alive(lengths: np.ndarray) -> np.ndarray:
    """Which parameters move anything.

    Args:
        lengths: of the slopes, shape (n,).
    """
    return lengths > DEAD * max(float(np.max(lengths, initial=0.0)), 1e-300)


def traded_with(alike: np.ndarray, index: int, *, limit: float = PARALLEL) -> list[int]:
    """Which others a parameter trades off with, the closest first.

    Args:
        alike: cosines of the slopes, or correlations of the estimates, shape (n, n).
        index: of the parameter.
        limit: size beyond which two trade off; `PARALLEL_POSTERIOR` where priors are in the estimates.
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
        lengths: of the residuals' slopes by each, in one measure for all, shape (n,).
        alike: cosines of the slopes, or correlations of the estimates, shape (n, n).
        unpinned: whether something else leaves a parameter open, shape (n,); said where no other reason is.
        share: where each lies between its bounds, -1 to 1, shape (n,).
        flat: slope, as a fraction of the largest, below which a parameter is "flat"; at most `DEAD` for never.
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
            f"traded off with {other}"
            for j, other in enumerate(names)
            if steep[i] and steep[j] and j in traded_with(alike, i)
        ]
        if unpinned[i] and not words[name]:
            words[name].append("not pinned")
        if abs(share[i]) >= AT_BOUND:
            words[name].append(f"at its {'high' if share[i] > 0 else 'low'} bound")
    return {name: ", ".join(said) or "pinned" for name, said in words.items()}
