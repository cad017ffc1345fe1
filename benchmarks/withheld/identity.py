"""The cases of a seed, of both generators, and samples of them that are spread evenly."""

import hashlib
import itertools
from collections import Counter
from dataclasses import dataclass

import numpy as np

from .second.effects import ACTUATOR, ON_RATE, pair_fits
from .second.effects import EFFECTS as EFFECTS_2
from .second.machines import KINDS as KINDS_2
from .second.machines import ROTARY
from .second.outside import OUTSIDE as OUTSIDE_2
from .second.recording import RECORDINGS
from .truth.effects import EFFECTS as EFFECTS_1
from .truth.effects import compatible
from .truth.outside import OUTSIDE as OUTSIDE_1
from .truth.systems import KINDS as KINDS_1

SETS = ("single", "single_off", "wide", "starter", "recorded", "pairs", "none", "outside")
SENSORS = ("rate", "both", "encoder", "derived")
SYSTEMS = (*KINDS_1, *KINDS_2)
NOMINAL = ("coulomb_error", "viscous_error", "inertia_error")
PAIRS_PER_SYSTEM, NONE_PER_SYSTEM = 6, 2  # of the first truth
PAIRS_2 = 10  # a seed of the second truth, with a rate sensor; half of them again with an encoder only

# Effects that cannot be asked for under a nominal that is 10 to 30 % off, or that was regressed on the log itself: they
# cannot be distinguished from the errors of that nominal, or the regression has absorbed them.
NOT_WIDE = {*NOMINAL, "torque_gain_error", "velocity_scale_error"}
NOT_STARTER = {*NOT_WIDE, "constant_torque", "asymmetric_friction", "load_dependent_friction", "unbalance"}


def split(seed: int) -> str:
    """Even seeds are for development, odd ones are reported."""
    return "development" if seed % 2 == 0 else "reported"


def seeds_of(half: str, count: int, skip: int = 0) -> list[int]:
    """The first seeds of a half, or those after the first `skip`."""
    first = 0 if half == "development" else 1
    return [first + 2 * (skip + k) for k in range(count)]


@dataclass(frozen=True)
class Identity:
    """What a case is, before anything is drawn: all random draws follow from it."""

    truth: int  # 1 or 2
    seed: int
    set: str
    sensors: str
    system: str
    effects: tuple[str, ...]  # or the kind outside the vocabulary
    number: int  # within its set and system
    recording: str = ""  # key of `RECORDINGS`; "" for ten seconds at 1 kHz

    @property
    def name(self) -> str:
        """A hash as name, so that the path of a log does not reveal its effect."""
        words = f"{self.truth}/{self.seed}/{self.set}/{self.sensors}/{self.system}/{self.number}/{self.effects}"
        words += f"/{self.recording}" if self.recording else ""
        return "case-" + hashlib.sha256(words.encode()).hexdigest()[:10]

    @property
    def group(self) -> str:
        """The row of the tables in which the case counts."""
        sensors = {"rate": "rate", "both": "rate"}.get(self.sensors, self.sensors)
        return f"truth {self.truth}, {self.set}, {sensors}"


def identities(seed: int, truth: int) -> list[Identity]:
    """Every case of a seed."""
    found = _first(seed) if truth == 1 else _second(seed)
    if len({one.name for one in found}) != len(found):
        raise AssertionError("two cases of one name")
    return found


def _first(seed: int) -> list[Identity]:
    """Three machines; all effects on each with a rate sensor and with an encoder only, elsewhere on one of them."""
    found, systems = [], list(KINDS_1)

    def add(set_: str, sensors: str, system: str, effects: tuple[str, ...], number: int) -> None:
        found.append(Identity(1, seed, set_, sensors, system, effects, number))

    def drawn(system: str, number: int) -> str:
        return "both" if (number + systems.index(system) + seed // 2) % 2 == 0 else "rate"

    pairs = {system: _pairs_1(seed, system) for system in systems}
    for system in systems:
        for number, effect in enumerate(EFFECTS_1):
            add("single", drawn(system, number), system, (effect,), number)
            add("single_off", drawn(system, number), system, (effect,), number)
            if effect not in ON_RATE:
                add("single", "encoder", system, (effect,), number)
        for number, pair in enumerate(pairs[system]):
            add("pairs", drawn(system, number), system, pair, number)
            if not ON_RATE & set(pair) and number < 3:
                add("pairs", "encoder", system, pair, number)
        for number in range(NONE_PER_SYSTEM):
            add("none", drawn(system, number), system, (), number)
            add("none", "encoder", system, (), number)
        add("none", "derived", system, (), NONE_PER_SYSTEM)
        for number, kind in enumerate(OUTSIDE_1):
            add("outside", drawn(system, number), system, (kind,), number)
            if kind != "held_readings":
                add("outside", "encoder", system, (kind,), number)
    for number, effect in enumerate(EFFECTS_1):
        system = systems[(number + seed // 2) % len(systems)]
        if effect not in ON_RATE:
            add("single", "derived", system, (effect,), number)
        for set_, left_out in (("wide", NOT_WIDE), ("starter", NOT_STARTER)):
            if effect not in left_out:
                sensors = "encoder" if number % 2 and effect not in ON_RATE else drawn(system, number)
                add(set_, sensors, system, (effect,), number)
    return found


def _pairs_1(seed: int, system: str) -> list[tuple[str, ...]]:
    rng = np.random.default_rng([seed, list(KINDS_1).index(system), 77])
    names = list(EFFECTS_1)
    pairs: list[tuple[str, ...]] = []
    while len(pairs) < PAIRS_PER_SYSTEM:
        first, second = (names[i] for i in rng.choice(len(names), 2, replace=False))
        # The transmission is applied first: lags are sized by the bandwidth that it leaves.
        pair = tuple(sorted((first, second), key=lambda e: e not in ("compliance", "backlash")))
        used = {effect for chosen in pairs for effect in chosen}
        if compatible(first, second) and not {first, second} & used:
            pairs.append(pair)
    return pairs


def _second(seed: int) -> list[Identity]:
    """Six machines, turned from effect to effect; linear ones have no rate sensor and nothing that turns."""
    found: list[Identity] = []
    turn = itertools.count(seed // 2)

    def add(set_: str, sensors: str, effects: tuple[str, ...]) -> None:
        rotary = sensors == "rate" or bool({"unbalance", "changing_inertia"} & set(effects))
        pool = ROTARY if rotary else tuple(KINDS_2)
        number = next(turn)
        found.append(Identity(2, seed, set_, sensors, pool[number % len(pool)], effects, number))

    rates = itertools.cycle(("rate", "both"))
    for effect in EFFECTS_2:
        one, free = (effect,), effect not in ON_RATE
        add("single", next(rates), one)
        add("single_off", next(rates), one)
        if free:
            add("single", "encoder", one)
            add("single", "derived", one)
        for set_, left_out in (("wide", NOT_WIDE), ("starter", NOT_STARTER)):
            if effect not in left_out:
                sensors = ("rate", "encoder", "both", "derived")[next(turn) % 4]
                add(set_, sensors if free or sensors in ("rate", "both") else "both", one)
        next(turn)  # so that an effect does not meet the same machines in all its sets
    for number, pair in enumerate(_pairs_2(seed)):
        add("pairs", next(rates), pair)
        if not ON_RATE & set(pair) and number % 2 == 0:
            add("pairs", "encoder", pair)
    for sensors in ("rate", "both", "encoder", "encoder", "derived", "derived"):
        for _ in range(2):
            add("none", sensors, ())
    for kind in OUTSIDE_2:
        add("outside", next(rates), (kind,))
        add("outside", "encoder", (kind,))
    return found + _recorded(seed)


def _recorded(seed: int) -> list[Identity]:
    """Logs as drives record them: each effect in one way of recording, turned from seed to seed, and none in each."""
    found, ways, turn = [], list(RECORDINGS), seed // 2
    for number, effect in enumerate((*EFFECTS_2, *[""] * len(ways))):
        way = (number + turn) % len(ways)
        if effect in ACTUATOR and RECORDINGS[ways[way]].filtered:
            way = (way + 1) % len(ways)  # A measured current contains what the actuator did: the effect is then no gap.
        # 9 ways of recording and 4 kinds of sensors have no common factor: all pairs of them occur.
        sensors = SENSORS[(number + turn) % len(SENSORS)]
        if RECORDINGS[ways[way]].coarse and sensors in ("rate", "both"):
            sensors = "encoder"  # Beside a rate sensor a coarse encoder makes no difference.
        if effect in ON_RATE and sensors not in ("rate", "both"):
            sensors = "both"
        pool = ROTARY if sensors == "rate" or effect == "unbalance" else tuple(KINDS_2)
        system, effects = pool[(number + number // len(pool) + 5 * turn) % len(pool)], (effect,) if effect else ()
        found.append(Identity(2, seed, "recorded" if effect else "none", sensors, system, effects, number, ways[way]))
    return found


def _pairs_2(seed: int) -> list[tuple[str, ...]]:
    rng = np.random.default_rng([2, seed, 41])
    pairs: list[tuple[str, ...]] = []
    uses: Counter[str] = Counter()
    while len(pairs) < PAIRS_2:
        names = rng.permutation(list(EFFECTS_2))
        first, second = sorted(str(name) for name in names[:2])
        if pair_fits(first, second) and not uses[first] and not uses[second]:
            pairs.append((first, second))
            uses.update((first, second))
    return pairs


def spread_over(found: list[Identity], limit: int) -> list[Identity]:
    """`limit` cases, each the one whose generator, set, sensors, effects and machine were chosen least so far.

    An interrupted run, which goes in this order, is spread evenly too.
    """
    if limit >= len(found):
        return found
    left = {one: _marks(one) for one in found}
    # One of four kinds of sensors is met more often than one of thirty effects: each is weighted by the number of
    # alternatives.
    worth = Counter(name for name, _ in {mark for marks in left.values() for mark in marks})
    met: Counter[tuple[str, str]] = Counter()
    chosen: list[Identity] = []

    def known(one: Identity) -> float:
        # Each effect of a pair counts half; logs without a gap are a large set, so "none" counts half too.
        part = {"effect": 1 / len(one.effects) if one.effects else 0.5}
        return sum(met[mark] * worth[mark[0]] * part.get(mark[0], 1.0) for mark in left[one])

    for _ in range(limit):
        # Ties are broken by name, a hash: the order of the list has no influence.
        best = min(left, key=lambda one: (known(one), one.name))
        met.update(left.pop(best))
        chosen.append(best)
    return chosen


def _marks(one: Identity) -> list[tuple[str, str]]:
    """(property, value) of a case, whose values are to be chosen evenly."""
    marks = [("truth", str(one.truth)), ("set", one.set), ("sensors", one.sensors), ("system", one.system)]
    marks += [("effect", effect) for effect in one.effects or ("none",)]
    return [*marks, ("group", one.group), *([("recording", one.recording)] if one.recording else [])]
