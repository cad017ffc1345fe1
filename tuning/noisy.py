"""Noisy: what becomes of tuned gains that the sensor's noise upsets."""

import dataclasses

import numpy as np

from .result import TuningResult

UPSET = 2.0  # times the cost without noise, above which gains are none to run a machine with


def upset(result: TuningResult) -> bool:
    """Whether the sensor's noise throws the tuned loop off."""
    return result.noisy_cost is not None and not result.diverged and not result.noisy_cost <= UPSET * result.cost


def calmer(result: TuningResult, again: TuningResult) -> TuningResult:
    """The gains that were tuned under a draw of the noise, in place of those that it upsets; both searches counted."""
    assert result.noisy_cost is not None
    if again.noisy_cost is None or not again.noisy_cost < result.noisy_cost:
        return result
    gains = ", ".join(f"{name} = {value:.4g}" for name, value in result.gains.items())
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
