"""Delay lines long enough for their delays: how many periods an actuator or a sensor keeps is static structure."""

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import numpy as np
from jax.core import Tracer

from ..blocks.actuators import Actuator
from ..blocks.servo_sensor import ServoSensor
from ..errors import InputError
from .loop import ClosedLoop, LoopState

LONGEST = 1000  # periods; a longer delay is a mistyped unit, and would take minutes to compile
BEYOND = 8  # periods beyond its start, to which a delay is looked for where nobody gave it a bound
DELAYED = ("actuator", "sensor")


def usual_largest(name: str, start: float, dt: float) -> float:
    """The largest value that is looked for without an upper bound: of a delay some periods more than it starts with.

    Args:
        name: of a parameter, dotted.
        start: its start value, in its unit.
        dt: control period [s].

    Returns:
        In the parameter's unit; infinite for what is no delay.
    """
    return start + BEYOND * dt if name in [f"{part}.delay" for part in DELAYED] else math.inf


def periods_of(delay: float | None, dt: float, least: int, name: str, bound: float = 0.0) -> int:
    """Whole periods of history that a delay needs, `least` at least.

    Args:
        delay: [s]; None for none.
        dt: control period [s].
        least: periods kept at least.
        name: of the delay, for the message.
        bound: largest value that it will have [s].

    Raises:
        InputError: for a delay of over 1000 periods.
    """
    largest = max(delay or 0.0, bound)
    if not largest / dt <= LONGEST:
        what, advice = (
            (f"the largest {name}, {largest:g} s,", "give it a smaller upper bound")
            if bound > (delay or 0.0)
            else (f"{name} = {largest:g} s", "check its unit (s)")
        )
        raise InputError(f"{what} is {largest / dt:.6g} periods of dt = {dt:g} s, more than {LONGEST}: {advice}.")
    return max(least, math.ceil(largest / dt) + 1)


def with_histories(loop: ClosedLoop, dt: float, largest: Mapping[str, float] | None = None) -> ClosedLoop:
    """The loop with histories that hold its delays; beyond its history a delayed signal would be zero.

    A delay that is traced, and not in `largest`, must stay below the block's own `longest_delay`.

    Args:
        loop: the closed loop.
        dt: control period [s].
        largest: the largest value that a parameter will have, by dotted name, as {"actuator.delay": 0.01} [s].

    Raises:
        InputError: for a delay of over 1000 periods.
    """
    longer = {}
    for part in DELAYED:
        block, name = getattr(loop, part), f"{part}.delay"
        if not isinstance(block, Actuator | ServoSensor) or block.delay is None:
            continue
        own = 0.0 if isinstance(block.delay, Tracer) else float(np.max(np.asarray(block.delay)))
        periods = periods_of(own, dt, 1, name, (largest or {}).get(name, 0.0))
        # one period of reserve is no reason to compile another program
        if periods - 1 > block.longest_delay:
            longer[part] = dataclasses.replace(block, longest_delay=periods)
    return dataclasses.replace(loop, **longer) if longer else loop


def with_history(state: LoopState, loop: ClosedLoop) -> LoopState:
    """The state with histories as long as the loop's: what one lacks is its oldest value, what is older is left out."""
    for part in DELAYED:
        block, past = getattr(loop, part), getattr(getattr(state, part), "history", ())
        if isinstance(block, Actuator | ServoSensor) and past and len(past) != block.longest_delay:
            kept = (*past, *(past[-1] for _ in range(block.longest_delay)))[: block.longest_delay]
            state = eqx.tree_at(lambda at, part=part: getattr(at, part).history, state, kept)
    return state
