"""Gains tuned without noise whose cost sensor noise multiplies, and what replaces them.

A search without noise may end at gains with which the observer is unstable: on the truth, nothing excites the unstable
mode. Under noise such a loop costs many times as much, and the gains are tuned again under one draw of it.
"""

import dataclasses

import numpy as np

from .result import TuningResult

NOISE_RATIO = 2.0  # cost under the worst draw of noise over the cost without, above which gains are tuned again


def noise_sensitive(result: TuningResult) -> bool:
    """Whether the sensor's noise more than doubles the cost of the tuned gains."""
    # `not <=` and not `>`: a cost that is NaN under noise counts as sensitive.
    return result.noisy_cost is not None and not result.diverged and not result.noisy_cost <= NOISE_RATIO * result.cost


def less_sensitive(result: TuningResult, again: TuningResult) -> TuningResult:
    """The result of tuning again under noise, if it costs less under the worst draw; else the first result.

    The simulations and seconds of both searches are added up.

    Args:
        result: of the search without noise.
        again: of the search under one draw of it, judged by the same draws.
    """
    assert result.noisy_cost is not None
    if again.noisy_cost is None or not again.noisy_cost < result.noisy_cost:
        return result
    gains = ", ".join(f"{name} = {value:.4g}" for name, value in result.gains.items())
    # The worst draw may diverge, and infinity has no place in a sentence.
    cost = f"goes from {result.cost:.3g} to {result.noisy_cost:.3g}" if np.isfinite(result.noisy_cost) else "diverges"
    said = f"tuned under the sensor's noise: with the best gains without it ({gains}) the cost {cost} under it."
    return dataclasses.replace(
        again,
        notes=(said, *again.notes),
        simulations=result.simulations + again.simulations,
        simulated_steps=result.simulated_steps + again.simulated_steps,
        run_seconds=result.run_seconds + again.run_seconds,
        compile_seconds=result.compile_seconds + again.compile_seconds,
    )
