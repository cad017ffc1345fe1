"""Rivals: what a diagnosis left open, as machines of its own parameters."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import InputError
from ..gap.answer.diagnosis import Diagnosis
from ..gap.effects.twins import exact_twins
from ..gap.effects.vocabulary import EFFECTS
from ..output.json_object import JsonObject, TomlTable
from ..output.runfile import refuse_unfinished
from .machines import Shop, Variant, reported, rival

MOST = 4  # rivals: every pair is a model to be replayed on a log
NEAR = 0.03  # of the first one's probability, to be a rival of it
FIRST = ("no_gap",)  # verdicts that leave nothing to separate


@dataclass(frozen=True)
class Rival:
    """One cause that a diagnosis could not rule out.

    Attributes:
        name: of the effect.
        probability: as the diagnosis has it.
        told: its reported parameters by name; NaN where there is none.
    """

    name: str
    probability: float
    told: Mapping[str, float]


def read_diagnosis(source: Any) -> JsonObject:
    """The contract's dictionary of a `Diagnosis`, a folder of `fpjax diagnose`, or its diagnosis.json.

    Raises:
        InputError: for what is none.
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
        path = pathlib.Path(source)
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
    return content


def rivals_of(diagnosis: TomlTable) -> tuple[Rival, ...]:
    """The first of the ranking, what cannot be told from it, and what is not far behind.

    Raises:
        InputError: where nothing is left to separate.
    """
    known = {effect.name for effect in EFFECTS}
    ranking = [one for one in diagnosis["ranking"] if isinstance(one, dict) and one.get("effect") in known]
    verdict = diagnosis.get("verdict")
    if verdict in FIRST or not ranking:
        raise InputError(
            f'The diagnosis says "{verdict}": it left no rivals to separate; leave --diagnosis out for a run that '
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
            f"The diagnosis left no rivals: {first['effect']} is first with probability {sure:.2f} and nothing else is "
            "near; leave --diagnosis (or --log) out for a run that makes all effects visible."
        )
    return tuple(_rival(by_name[name]) for name in chosen)


def settled_of(diagnosis: TomlTable) -> tuple[Rival, ...]:
    """Causes that the diagnosis asserts beside the one that is in question; every rival has them too."""
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
    """What the diagnosis left unexplained [N m], as the level of the missing torque; None where it does not say."""
    after = _number((diagnosis.get("gap") or {}).get("after"))
    return after if math.isfinite(after) and after > 0.0 else None


def machines_of(shop: Shop, rivals: Sequence[Rival], settled: Sequence[Rival] = ()) -> tuple[Variant, ...]:
    """The rivals as machines, in their order; what this machine's sensors cannot have is left out.

    Args:
        shop: makes them.
        rivals: one of which is there.
        settled: what every one of them has too, as far as its structure holds it.
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
    """Pairs that make exactly the same log whatever the run, each with the sentence that says so."""
    facts, found = shop.facts(), {}
    names = {variant.name for variant in variants}
    for variant in variants:
        for twin in exact_twins((variant.name,), {variant.name: reported(variant, shop)}, facts):
            for other in set(twin.instead) & names - {variant.name}:
                found.setdefault(frozenset((variant.name, other)), twin.sentence())
    return found


def hidden_by_twin(shop: Shop, variant: Variant) -> str:
    """Why no run shows an effect as itself: the nominal numbers together are its twin; "" where one does."""
    twins = exact_twins((variant.name,), {variant.name: reported(variant, shop)}, shop.facts())
    for twin in twins:
        if all(name.endswith("_error") for name in twin.instead):
            return twin.sentence()
    return ""
