"""Rivals: the causes between which a diagnosis could not decide, as machines with the parameters that it reports."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import InputError
from ..gap.diagnosis import Diagnosis
from ..gap.effects.twins import exact_twins
from ..gap.effects.vocabulary import EFFECTS
from ..output.json_object import JsonObject, TomlTable
from ..output.paths import expanded
from ..output.runfile import refuse_unfinished
from .machines import Shop, Variant, reported, rival

MOST = 4  # rivals at most: every ordered pair is one model to replay on one log
NEAR = 0.03  # share of the first cause's probability above which another cause counts as its rival
LIKELY = 0.5  # probability of all rivals together below which the cause is likelier one that is not among them
FIRST = ("no_gap",)  # verdicts that leave nothing to separate


@dataclass(frozen=True)
class Rival:
    """One cause that a diagnosis could not rule out.

    Attributes:
        name: of the effect.
        probability: from the diagnosis.
        told: its reported parameters by name; NaN where there is no number.
    """

    name: str
    probability: float
    told: Mapping[str, float]


def read_diagnosis(source: Any) -> JsonObject:
    """The dictionary of diagnosis.json, from a `Diagnosis`, a folder of `fpjax diagnose`, or the file.

    Raises:
        InputError: for anything else, or a file that cannot be read.
    """
    if isinstance(source, Diagnosis):
        return source.to_dict()
    if isinstance(source, Mapping):
        content: Any = dict(source)
        name = "the diagnosis"
    elif not isinstance(source, str | os.PathLike):
        raise InputError(
            f"plan got {type(source).__name__} {str(source)[:40]!r} as its diagnosis: give a Diagnosis "
            "(fpjax.diagnose), its dictionary, or the --out folder of fpjax diagnose."
        )
    else:
        path = expanded(source)
        path = path / "diagnosis.json" if path.is_dir() else path
        refuse_unfinished(path)
        name = str(path)
        try:
            content = json.loads(path.read_text())
        except OSError as error:
            raise InputError(
                f"{path} cannot be read ({error.strerror or error}): give the --out folder of fpjax diagnose."
            ) from error
        except ValueError as error:
            raise InputError(f"{path} is not JSON ({error}): give the --out folder of fpjax diagnose.") from error
    if not isinstance(content, dict) or not isinstance(content.get("ranking"), list):
        raise InputError(f"{name} holds no ranking: give the --out folder of fpjax diagnose.")
    if content.get("contradiction"):
        raise InputError(f"No run is planned from this diagnosis until this is settled: {content['contradiction']}")
    return content


def rivals_of(diagnosis: TomlTable) -> tuple[Rival, ...]:
    """The first cause of the ranking, those indistinguishable from it, and those of a similar probability.

    Raises:
        InputError: where nothing is left to separate.
    """
    known = {effect.name for effect in EFFECTS}
    ranking = [one for one in diagnosis["ranking"] if isinstance(one, dict) and one.get("effect") in known]
    verdict = diagnosis.get("verdict")
    if verdict in FIRST or not ranking:
        raise InputError(
            f'The diagnosis says "{verdict}": there are no rivals to separate; leave out --diagnosis for a run that '
            "makes all effects visible."
        )
    by_name = {one["effect"]: one for one in ranking}
    first = ranking[0]
    beside = _settled_names(diagnosis, first)
    least = NEAR * _number(first.get("probability"))
    names = [first["effect"], *first.get("indistinguishable_from", ())]
    ordered = sorted(ranking, key=lambda one: -_number(one.get("probability")))
    names += [one["effect"] for one in ordered if _number(one.get("probability")) > max(least, 1e-9)]
    chosen = [name for name in dict.fromkeys(names) if name in by_name and name not in beside][:MOST]
    if len(chosen) < 2:
        sure = _number(first.get("probability"))
        raise InputError(
            f"The diagnosis has no rivals: {first['effect']} is first with probability {sure:.2f}, and no cause is "
            "near it; leave out --diagnosis (or --log) for a run that makes all effects visible."
        )
    return tuple(_rival(by_name[name]) for name in chosen)


def unlikely(rivals: Sequence[Rival]) -> str:
    """Why not to plan for these rivals: all together are improbable; "" where they are not.

    Where a log shows little, what leads its ranking has no size to speak of: rivals of 1e-8 nats were separated.
    """
    together = sum(one.probability for one in rivals if math.isfinite(one.probability))
    if together >= LIKELY:
        return ""
    names = ", ".join(one.name.replace("_", " ") for one in rivals)
    return (
        f"the diagnosis gives its rivals ({names}) a probability of {together:.0%} together: the cause is likelier "
        "another one, so that this run makes all effects visible."
    )


def settled_of(diagnosis: TomlTable) -> tuple[Rival, ...]:
    """Causes that the diagnosis asserts besides the one in question; every rival machine gets them too."""
    known = {effect.name for effect in EFFECTS}
    ranking = [one for one in diagnosis["ranking"] if isinstance(one, dict) and one.get("effect") in known]
    names = _settled_names(diagnosis, ranking[0]) if ranking else frozenset[str]()
    return tuple(_rival(one) for one in ranking if one["effect"] in names)


def _settled_names(diagnosis: TomlTable, first: TomlTable) -> frozenset[str]:
    open_ones = {first["effect"], *first.get("indistinguishable_from", ())}
    return frozenset(name for name in diagnosis.get("causes") or () if name not in open_ones)


def _rival(entry: TomlTable) -> Rival:
    parameters = entry.get("parameters") or {}
    told = {
        name: _number(value.get("value") if isinstance(value, dict) else value) for name, value in parameters.items()
    }
    return Rival(str(entry["effect"]), _number(entry.get("probability")), told)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def level_of(diagnosis: TomlTable) -> float | None:
    """The sim-to-real gap after the diagnosis [N m], as the level of the missing torque; None where it is unknown."""
    after = _number((diagnosis.get("gap") or {}).get("after"))
    return after if math.isfinite(after) and after > 0.0 else None


def machines_of(shop: Shop, rivals: Sequence[Rival], settled: Sequence[Rival] = ()) -> tuple[Variant, ...]:
    """The rivals as machines, in their order; effects that this machine's sensors cannot have are left out.

    Args:
        shop: makes the machines.
        rivals: causes of which one is true.
        settled: causes that every machine gets too, as far as its structure can hold them.
    """
    allowed = {effect.name for effect in shop.effects()}
    beside = [made for one in settled if one.name in allowed and (made := rival(shop, one.name, one.told)) is not None]
    found = []
    for one in rivals:
        made = rival(shop, one.name, one.told) if one.name in allowed else None
        if made is None:
            continue
        common: dict[str, float] = {}
        for other in beside:
            if other.structure in ("rigid", made.structure):
                common |= other.values
        found.append(dataclasses.replace(made, values=common | dict(made.values)))
    return tuple(found)


def twins_of(shop: Shop, variants: Sequence[Variant]) -> dict[frozenset[str], str]:
    """Pairs that give exactly the same log whatever the run, each with the sentence that explains why."""
    facts, found = shop.facts(), {}
    names = {variant.name for variant in variants}
    for variant in variants:
        for twin in exact_twins((variant.name,), {variant.name: reported(variant, shop)}, facts):
            for other in set(twin.instead) & names - {variant.name}:
                found.setdefault(frozenset((variant.name, other)), twin.sentence())
    return found


def hidden_by_twin(shop: Shop, variant: Variant) -> str:
    """Why no run can show an effect: errors of the nominal numbers are its exact twin; "" where a run can show it."""
    twins = exact_twins((variant.name,), {variant.name: reported(variant, shop)}, shop.facts())
    for twin in twins:
        if all(name.endswith("_error") for name in twin.instead):
            return twin.sentence()
    return ""
