"""Names and meanings of effects, regimes and parameters for a reader, of rotary and of linear axes."""

import math
from dataclasses import dataclass

from ..answer.summary import PLACES
from ..effects.estimate import NINETY


@dataclass(frozen=True)
class EffectWords:
    """What the report says about an effect.

    Attributes:
        name: a noun phrase that fits after "the simulation lacks" (or, of a wrong value, "the simulation has").
        meaning: one clause on what it does to the machine.
        wrong_value: whether the nominal value is wrong rather than an effect absent.
    """

    name: str
    meaning: str
    wrong_value: bool = False


EFFECTS = {
    "coulomb_error": EffectWords("a wrong Coulomb friction", "the nominal Coulomb level is off", True),
    "viscous_error": EffectWords("a wrong viscous friction", "the nominal viscous friction is off", True),
    "inertia_error": EffectWords("a wrong inertia", "the nominal inertia is off", True),
    "stribeck": EffectWords("Stribeck friction", "extra friction near rest that falls with speed"),
    "presliding": EffectWords("presliding friction", "contacts bend like bristles before they slide"),
    "asymmetric_friction": EffectWords("asymmetric friction", "friction depends on the direction of motion"),
    "position_dependent_friction": EffectWords(
        "position-dependent friction", "the Coulomb level varies with the angle"
    ),
    "friction_drift": EffectWords("friction drift", "friction falls as the machine warms up"),
    "load_dependent_friction": EffectWords(
        "load-dependent friction", "the Coulomb level grows with the torque through the gear"
    ),
    "quadratic_drag": EffectWords("quadratic drag", "a torque that grows with the square of the speed"),
    "backlash": EffectWords("backlash", "lost motion between motor and load"),
    "compliance": EffectWords("compliance", "an elastic transmission between motor and load"),
    "unbalance": EffectWords("unbalance", "gravity on an off-centre mass, one period per turn"),
    "cogging": EffectWords("cogging", "a torque locked to the angle, several periods per turn"),
    "constant_torque": EffectWords("a constant torque", "an offset added to the commanded torque"),
    "torque_gain_error": EffectWords("a torque gain error", "the applied torque is not the commanded one", True),
    "actuator_lag": EffectWords("an actuator lag", "the torque follows its command to first order"),
    "actuator_delay": EffectWords("an actuator delay", "the torque follows its command after a dead time"),
    "velocity_lag": EffectWords("a velocity sensor lag", "the reading follows the velocity to first order"),
    "velocity_delay": EffectWords("a velocity sensor delay", "the reading comes after a dead time"),
    "torque_saturation": EffectWords("torque saturation", "the applied torque is limited"),
    "torque_dead_zone": EffectWords("a torque dead zone", "the first part of the command is lost"),
    "velocity_bias": EffectWords("a velocity sensor bias", "the reading has an offset"),
    "velocity_scale_error": EffectWords("a velocity scale error", "the reading is too large or too small", True),
    "velocity_quantisation": EffectWords("velocity quantisation", "the reading is rounded to a step"),
}

# Standard deviation over value below which a parameter is known, whatever it is traded off with.
KNOWN = 0.02
# The meaning of an identifiability verdict, by how the verdict begins.
STATE_MEANINGS = {
    "pinned": "this log determines it",
    "traded": "only their combination is determined",
    "flat": "this log hardly depends on it",
    "dead": "it changes nothing in this log",
    "absent": "the law does without it",
    "at a bound": "the fit ended at a bound of the search: not a measurement",
}

# The names and meanings above are written for a rotary axis: words that a linear one replaces.
_LINEAR = (
    ("torque", "force"),
    ("inertia", "mass"),
    ("the angle", "the position"),
    ("per turn", "per period of travel"),
)


def _spell(name: str) -> str:
    return name.replace("_", " ").strip()


def effect_name(effect: str, motion: str = "rotary") -> str:
    """The name of an effect in a sentence; an effect of the user's own keeps its name."""
    words = EFFECTS.get(effect)
    return for_motion(words.name, motion) if words else _spell(effect)


def effect_title(effect: str, motion: str = "rotary") -> str:
    """The name of an effect as the start of a row: no article, capital first."""
    name = effect_name(effect, motion)
    if effect not in EFFECTS:
        return name[:1].upper() + name[1:]
    for article in ("a ", "an ", "the "):
        name = name.removeprefix(article)
    return name[:1].upper() + name[1:]


def effect_meaning(effect: str, motion: str = "rotary") -> str:
    """One clause on what the effect does, "" where it is not of the vocabulary."""
    words = EFFECTS.get(effect)
    return for_motion(words.meaning, motion) if words else ""


def is_wrong_value(effect: str) -> bool:
    """Whether the effect is a nominal value that is off rather than something absent."""
    words = EFFECTS.get(effect)
    return words is not None and words.wrong_value


def regime_name(regime: str, motion: str = "rotary") -> str:
    """Where a regime lies, in words."""
    return for_motion(PLACES.get(regime, _spell(regime)), motion)


def parameter_name(parameter: str, motion: str = "rotary") -> str:
    """A parameter's name with spaces; `inertia` of a linear axis is its mass."""
    return for_motion(_spell(parameter), motion)


def state_meaning(state: str, uncertainty: float = math.nan) -> str:
    """The meaning of an identifiability verdict; "" for an unknown one.

    Args:
        state: the verdict.
        uncertainty: standard deviation over value [1]: a parameter that is traded off may still be known well enough,
            and the interval of one that is pinned may reach over zero; NaN where it is not known.
    """
    if state.startswith("traded") and uncertainty < KNOWN:
        return "its small error is correlated with the other's"
    if state.startswith("pinned") and uncertainty > 1.0 / NINETY:
        return "this log determines it; it may be zero"
    return next((meaning for start, meaning in STATE_MEANINGS.items() if state.startswith(start)), "")


def motion_units(motion: str) -> dict[str, str]:
    """Units of time, velocity, position and frequency for a rotary or a linear axis."""
    length = "m" if motion == "linear" else "rad"
    return {"time": "s", "velocity": f"{length}/s", "position": length, "frequency": "Hz"}


def clip(text: str, length: int = 26) -> str:
    """A name shortened for a picture; the page has the whole name."""
    return text if len(text) <= length else f"{text[: length - 1].rstrip()}…"


def join(names: list[str], last: str = "and") -> str:
    """`a, b and c`."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def sure(probability: float) -> str:
    """Confidence in words."""
    for least, words in _CONFIDENCE:
        if probability >= least:
            return words
    return "little more than a guess"


# (least probability, words), falling.
_CONFIDENCE = (
    (0.98, "practically certain"),
    (0.9, "very likely"),
    (0.75, "likely"),
    (0.5, "more likely than not"),
    (0.25, "doubtful"),
)


def for_motion(text: str, motion: str) -> str:
    """Words of a rotary axis as those of the given one."""
    if motion == "linear":
        for rotary, linear in _LINEAR:
            text = text.replace(rotary, linear)
    return text
