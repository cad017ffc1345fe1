"""Which parameters data pin: one rule and one set of limits, for tuned gains and for identified numbers."""

import numpy as np

DEAD = 1e-9  # slope, as a fraction of the largest, below which a parameter moves nothing
FLAT = 1e-2  # the same, below which it moves next to nothing, where that is asked
PARALLEL = 0.999  # of two slopes (cosine) or two estimates (correlation), beyond which the two trade off
AT_BOUND = 0.96  # share of the way from the middle to a bound from which a parameter counts as at it


def is_alive(lengths: np.ndarray) -> np.ndarray:
    """Which parameters move anything.

    Args:
        lengths: of the slopes, shape (n,).
    """
    return lengths > DEAD * max(float(np.max(lengths, initial=0.0)), 1e-300)


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
            if j != i and steep[i] and steep[j] and abs(alike[i, j]) > PARALLEL
        ]
        if unpinned[i] and not words[name]:
            words[name].append("not pinned")
        if abs(share[i]) >= AT_BOUND:
            words[name].append(f"at its {'high' if share[i] > 0 else 'low'} bound")
    return {name: ", ".join(said) or "pinned" for name, said in words.items()}
