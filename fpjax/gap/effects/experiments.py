"""Experiments that distinguish two effects: one sentence for every pair of the vocabulary.

Effects are grouped in families by the excitation that shows them. A pair that is often confused has its own sentence;
for any other the sentence is put together from the signatures of the two families.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from ...output.json_object import JsonObject


@dataclass(frozen=True)
class Experiment:
    """An experiment that would distinguish two effects.

    Attributes:
        separates: the two effects.
        do: a sentence for the person at the machine.
    """

    separates: tuple[str, str]
    do: str

    def to_dict(self) -> JsonObject:
        """The contract's keys."""
        return {"separates": list(self.separates), "do": self.do}


FAMILIES: dict[str, tuple[str, ...]] = {
    "inertia": ("inertia_error",),
    "direction": ("coulomb_error", "asymmetric_friction", "torque_dead_zone"),
    "rest": ("stribeck", "presliding"),
    "load": ("load_dependent_friction",),
    "speed": ("viscous_error", "quadratic_drag"),
    "time": ("friction_drift",),
    "angle": ("position_dependent_friction", "unbalance", "cogging"),
    "constant": ("constant_torque",),
    "transmission": ("backlash", "compliance"),
    "gain": ("torque_gain_error",),
    "late_actuator": ("actuator_lag", "actuator_delay"),
    "late_sensor": ("velocity_lag", "velocity_delay"),
    "limit": ("torque_saturation",),
    "reading": ("velocity_bias", "velocity_scale_error", "velocity_quantisation"),
}
"""The effects by family; every effect of the vocabulary once."""

SIGNATURE = {
    "inertia": "Run the same motion at two accelerations (or with a known payload added)",
    "direction": "Run constant speeds of several sizes in both directions",
    "rest": "Make slow reversals, from a tenth to a hundredth of the working speed",
    "load": "Hold the same constant speed with two known loads (a weight on a lever, a brake) in both directions",
    "speed": "Hold constant speeds from the lowest to the highest and note the torque of each",
    "time": "Run the same lap cold and again after half an hour of motion",
    "angle": "Turn slowly through the whole travel in both directions, with an encoder recorded",
    "constant": "Let the machine coast down from the same speed in both directions with the drive off",
    "transmission": (
        "Record an encoder on the load beside the one on the motor, and excite with a chirp past the resonance"
    ),
    "gain": (
        "Hang a known weight on a known lever (or hold against a force gauge) and note the command that balances it"
    ),
    "late_actuator": "Command torque steps of two amplitudes and record at the highest rate that the drive offers",
    "late_sensor": "Record the encoder position beside the rate sensor during a chirp",
    "limit": "Command short torque steps of rising amplitude until the acceleration no longer grows",
    "reading": "Record the encoder position beside the rate sensor, once at rest and once at a high constant speed",
}
"""The experiment that shows a family most clearly, as the beginning of a sentence."""

TELLS = {
    "inertia": "only a wrong inertia grows with acceleration",
    "direction": "this friction depends on the direction and not on how fast or where",
    "rest": "friction near rest shows within the first instants of a reversal only",
    "load": "only friction of a gear grows with the torque that it carries",
    "speed": "this drag grows with speed at any acceleration",
    "time": "only a drift changes from the first lap to the last",
    "angle": "a torque tied to the angle comes back at the same angle whatever the speed",
    "constant": "a constant torque acts at rest and in both directions alike",
    "transmission": "backlash and twist show as a difference between motor and load",
    "gain": "a gain error scales the known torque too",
    "late_actuator": "a late actuator shifts the motion itself, in proportion at any amplitude",
    "late_sensor": "a late sensor disagrees with the position, a late torque does not",
    "limit": "a limit acts above its torque only",
    "reading": "a wrong reading disagrees with the position, a torque does not",
}
"""Why that experiment shows the family, as the end of a sentence."""

PLAINEST = (
    "reading", "late_sensor", "transmission", "limit", "gain", "late_actuator", "time", "angle", "rest", "load",
    "constant", "speed", "inertia", "direction",
)  # fmt: skip
"""Families by how clearly their signature shows: of a pair, the experiment of the first one is proposed."""

PAIRS: dict[frozenset[str], str] = {
    frozenset(pair): sentence
    for pair, sentence in (
        (
            ("actuator_delay", "velocity_delay"),
            "Record the encoder position beside the rate sensor during a chirp: a late sensor lags behind the"
            " position, a late actuator does not.",
        ),
        (
            ("actuator_lag", "velocity_lag"),
            "Record the encoder position beside the rate sensor during a chirp: a sensor's lag is smaller in "
            "the position, an actuator's is in both.",
        ),
        (
            ("actuator_delay", "actuator_lag"),
            "Chirp up to a third of the control rate: a dead time leaves the amplitude and turns the phase in"
            " proportion to frequency, a lag lowers the amplitude and its phase levels off.",
        ),
        (
            ("velocity_delay", "velocity_lag"),
            "Chirp up to a third of the control rate with the position recorded: a dead time leaves the "
            "reading's amplitude, a lag lowers it.",
        ),
        (
            ("constant_torque", "asymmetric_friction"),
            "Let the machine coast down from the same speed in both directions, and release it at rest with "
            "the drive off: a constant torque also acts at rest, friction only against motion. Without that "
            "the two are the same in any log.",
        ),
        (
            ("asymmetric_friction", "coulomb_error"),
            "Hold the same constant speed in both directions: an error of the level is the same both ways, an"
            " asymmetry is their difference.",
        ),
        (
            ("constant_torque", "velocity_bias"),
            "Record the rate sensor with the drive off and the machine blocked: a bias is read at rest, a "
            "torque is not.",
        ),
        (
            ("constant_torque", "unbalance"),
            "Turn slowly through a whole revolution: an unbalance changes sign within it, a constant torque does not.",
        ),
        (
            ("unbalance", "cogging"),
            "Turn slowly through a whole revolution with the encoder recorded: an unbalance has one period a turn, "
            "cogging several.",
        ),
        (
            ("cogging", "position_dependent_friction"),
            "Pass the same angles slowly in both directions: cogging keeps its sign at an angle, friction "
            "turns with the direction.",
        ),
        (
            ("unbalance", "position_dependent_friction"),
            "Pass the same angles slowly in both directions: an unbalance keeps its sign at an angle, "
            "friction turns with the direction.",
        ),
        (
            ("friction_drift", "position_dependent_friction"),
            "Run the same lap cold and again after half an hour: what is tied to the angle comes back, a "
            "drift is gone.",
        ),
        (
            ("friction_drift", "coulomb_error"),
            "Record for several times longer, from cold: a drift fades, a wrong level stays.",
        ),
        (
            ("torque_gain_error", "inertia_error"),
            "Run with two known payloads (or hold a known weight): a gain scales every torque alike, a wrong "
            "inertia only what accelerates.",
        ),
        (
            ("torque_gain_error", "velocity_scale_error"),
            "Compare the rate sensor's integral with the encoder over a long turn, and hold a known weight: "
            "the first shows the sensor's scale, the second the torque's.",
        ),
        (
            ("torque_gain_error", "coulomb_error"),
            "Hold a known weight, or run with two known payloads: friction does not depend on the "
            "acceleration, what a gain changes does.",
        ),
        (
            ("velocity_scale_error", "inertia_error"),
            "Record the encoder position too, over a long one-way turn: the scale is the ratio of the "
            "integral of the rate to the position.",
        ),
        (
            ("velocity_scale_error", "viscous_error"),
            "Record the encoder position too, over a long one-way turn: the scale is the ratio of the "
            "integral of the rate to the position.",
        ),
        (
            ("viscous_error", "quadratic_drag"),
            "Hold constant speeds up to the highest: the torque follows a straight line for viscous friction and a "
            "parabola for a quadratic one.",
        ),
        (
            ("viscous_error", "coulomb_error"),
            "Hold constant speeds, the highest at least five times the lowest: one error is the same at all, the other "
            "grows with speed.",
        ),
        (
            ("viscous_error", "actuator_lag"),
            "Hold constant speeds: a lag has no effect when nothing changes, viscous friction has.",
        ),
        (
            ("stribeck", "presliding"),
            "Make slow reversals at two accelerations with the position recorded: bristles give way over a distance, "
            "Stribeck's friction falls with speed.",
        ),
        (
            ("stribeck", "coulomb_error"),
            "Hold constant speeds down to a hundredth of the working speed: Stribeck's friction rises towards"
            " rest, a wrong level does not.",
        ),
        (
            ("stribeck", "torque_dead_zone"),
            "Hold constant speeds down to a hundredth of the working speed: a dead zone loses the same torque"
            " at any speed, Stribeck's friction falls with it.",
        ),
        (
            ("presliding", "backlash"),
            "Push with small torques below friction and record an encoder on the load: bristles spring back, "
            "a clearance does not, and the load stays behind.",
        ),
        (
            ("presliding", "compliance"),
            "Push with small torques below friction and record an encoder on the load: bristles let motor and"
            " load move together, a spring lets them move apart.",
        ),
        (
            ("torque_dead_zone", "coulomb_error"),
            "Let the machine coast down with the drive off: friction still slows it, a dead zone has no "
            "effect. While the torque never changes sign in motion the two are the same.",
        ),
        (
            ("torque_dead_zone", "backlash"),
            "Record an encoder on the load: with backlash the load stays behind the motor, in a dead zone both stay.",
        ),
        (
            ("backlash", "compliance"),
            "Record an encoder on the load, and make slow reversals at two payloads: backlash keeps its width, "
            "twist grows with the torque.",
        ),
        (
            ("compliance", "actuator_lag"),
            "Chirp past the suspected resonance (or record an encoder on the load): a spring has a resonance and an "
            "anti-resonance, a lag only falls.",
        ),
        (
            ("compliance", "actuator_delay"),
            "Chirp past the suspected resonance (or record an encoder on the load): a spring has a resonance and an "
            "anti-resonance, a dead time leaves the amplitude.",
        ),
        (
            ("compliance", "velocity_lag"),
            "Chirp past the suspected resonance with the position recorded: a spring has a resonance, a sensor's lag "
            "disagrees with the position.",
        ),
        (
            ("compliance", "velocity_delay"),
            "Chirp past the suspected resonance with the position recorded: a spring has a resonance, a late sensor "
            "disagrees with the position.",
        ),
        (
            ("compliance", "inertia_error"),
            "Chirp from a tenth of the suspected resonance to past it: a wrong inertia is the same at all frequencies.",
        ),
        (
            ("torque_saturation", "torque_gain_error"),
            "Command torque steps of two amplitudes: a gain acts on the small one too, a limit does not.",
        ),
        (
            ("torque_saturation", "actuator_lag"),
            "Command torque steps of two amplitudes: a lag is in proportion to both, a limit acts on the "
            "large one only.",
        ),
        (
            ("velocity_quantisation", "velocity_bias"),
            "Record the rate sensor at rest and during a slow ramp: rounding is a staircase, a bias is the "
            "same everywhere.",
        ),
        (
            ("velocity_bias", "asymmetric_friction"),
            "Record the rate sensor at rest, and the encoder position beside it: a bias is read at rest too.",
        ),
    )
}
"""Pairs that are often confused, each with its own experiment."""


def family_of(effect: str) -> str | None:
    """The family of an effect; None for one that the vocabulary does not hold."""
    return next((family for family, effects in FAMILIES.items() if effect in effects), None)


def experiment_for(first: str, second: str) -> Experiment:
    """The experiment that distinguishes two effects; for an effect of the user's own, by the signature of the other.

    Args:
        first: name of an effect.
        second: name of another.
    """
    sentence = PAIRS.get(frozenset((first, second)))
    if sentence is None:
        sentence = _from_families(family_of(first), family_of(second))
    return Experiment((first, second), sentence)


def next_experiment(confusable: Iterable[tuple[str, str]], *, most: int = 6) -> tuple[Experiment, ...]:
    """Experiments for pairs of effects that a log cannot distinguish; each pair once, in the order given.

    Args:
        confusable: pairs of names, most probable first.
        most: largest number of experiments that are named.
    """
    found: dict[frozenset[str], Experiment] = {}
    for first, second in confusable:
        if first != second:
            found.setdefault(frozenset((first, second)), experiment_for(first, second))
    return tuple(found.values())[:most]


def _from_families(first: str | None, second: str | None) -> str:
    """The sentence for two effects by their families; None is the family of an effect of the user's own."""
    if first is None and second is None:
        return (
            "Repeat the run at half and at twice the amplitude, and once in the other direction: two effects "
            "that respond alike to both are one."
        )
    # The signature of one family does not show the other, unless both effects are of the same family.
    if first is not None and second is not None and first == second:
        return f"{SIGNATURE[first]}, and once more at another amplitude: the two then differ in shape."
    chosen = next(family for family in PLAINEST if family in (first, second))
    return f"{SIGNATURE[chosen]}: {TELLS[chosen]}."
