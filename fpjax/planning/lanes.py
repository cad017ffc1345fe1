"""The lanes of a trial: a batch of small changes of the models, whose differences are the tangents of the readings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..gap.effects.shaft import stiffness_of
from ..gap.simulate.family import Family
from ..gap.simulate.replay import STATES
from .machines import Shop, Variant

STATE_STEP = 1e-4  # step of the tangents by a window's initial state, in its prior deviations [1]
SHARE_DEVIATION = 0.5  # prior deviation of the bristles' share at a window's start, which no sensor measures [1]


@dataclass(frozen=True)
class RivalLanes:
    """The lanes in which some variants of one family are replayed: each variant itself, and small changes of it.

    A lane is one simulation of a batch. The differences of lanes give the tangents of the readings.

    Attributes:
        family: of the variants.
        vectors: parameters of each lane, shape (parameters, lanes).
        states: deviations of the initial states, shape (states, lanes).
        owner: index of the variant of each lane, shape (lanes,).
        base: lane of each unchanged variant.
        tangents: for each variant, by parameter: (lane, its step in prior deviations).
        shifts: for each variant, by initial state: (lane, its step in prior deviations).
    """

    family: Family
    vectors: np.ndarray
    states: np.ndarray
    owner: np.ndarray
    base: tuple[int, ...]
    tangents: tuple[dict[str, tuple[int, float]], ...]
    shifts: tuple[tuple[tuple[int, float], ...], ...]


def make_lanes(shop: Shop, variants: Sequence[Variant], names: Sequence[tuple[str, ...]]) -> RivalLanes:
    """The lanes of variants of one structure.

    Args:
        shop: makes their machines.
        variants: of one structure.
        names: for each variant, the parameters that may move.
    """
    family = shop.family(variants[0].structure)
    count = STATES[family.key[0]]
    vectors: list[np.ndarray] = []
    states: list[np.ndarray] = []
    owner: list[int] = []
    base, tangents, shifts = [], [], []

    def add(vector: np.ndarray, state: np.ndarray, variant: int) -> int:
        vectors.append(vector)
        states.append(state)
        owner.append(variant)
        return len(vectors) - 1

    for index, (variant, moving) in enumerate(zip(variants, names, strict=True)):
        vector, still = shop.vector(variant), np.zeros(count)
        base.append(add(vector, still, index))
        spreads, steps = shop.spreads(variant, moving), shop.steps(family, moving)
        own: dict[str, tuple[int, float]] = {}
        for name, spread, step in zip(moving, spreads, steps, strict=True):
            parameter = family.parameters[family.index(name)]
            moved = vector.copy()
            # Stepped downwards where a step up would leave the parameter's bounds.
            sign = 1.0 if moved[family.index(name)] + step <= parameter.high(shop.setting) else -1.0
            moved[family.index(name)] += sign * step
            own[name] = add(moved, still, index), sign * step / spread
        tangents.append(own)
        shifted = []
        for place, deviation in enumerate(_state_deviations(shop, family, variant)):
            moved = still.copy()
            moved[place] = STATE_STEP * deviation
            shifted.append((add(vector, moved, index), STATE_STEP))
        shifts.append(tuple(shifted))
    return RivalLanes(
        family, np.stack(vectors, axis=1), np.stack(states, axis=1), np.array(owner), tuple(base), tuple(tangents),
        tuple(shifts),
    )  # fmt: skip


def _state_deviations(shop: Shop, family: Family, variant: Variant) -> list[float]:
    """Prior deviations of a window's initial state: velocity, position, and the states that no sensor measures."""
    setting = shop.setting
    # 5 % of the top speed, and the angle that it makes over a window: what the readings of velocity and position leave
    # open, generously.
    found = [0.05 * setting.speed, 0.05 * setting.speed * setting.window]
    if family.key[0] == "bristles":
        found.append(SHARE_DEVIATION)
    if family.key[0] == "transmission":
        values = family.neutral_values(setting) | dict(variant.values)
        found += [
            0.3 * (setting.friction + setting.torque) / stiffness_of(values) + 0.3 * values["gap"],
            0.02 * setting.speed,
        ]
    return found
