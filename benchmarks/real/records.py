"""Descriptions of real records: cases, nominal models and documented causes, from cases.toml files."""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fpjax import InputError
from fpjax.output.json_object import JsonObject

OWN = Path(__file__).parent / "records"
FILE = "cases.toml"  # description in a folder of the user's own
CASE_KEYS = {"name", "question", "log", "holdout", "columns", "model", "prepare", "goal"}
GOAL_KEYS = {"verdict", "causes", "first", "may", "parameters", "after", "located"}


@dataclass(frozen=True)
class Goal:
    """What is documented of a case.

    Attributes:
        verdict: verdicts that are right; empty for any.
        causes: effects that must all be asserted.
        first: one of them must come first in the ranking; empty for any.
        may: further effects that may be asserted; all others are wrong.
        parameters: "effect.parameter" -> {value, within}: within a share of the value.
        after: {at_most, unit}: largest missing torque that may be left on withheld data.
        located: {pulses, slack, elsewhere} for a case whose preparation knows when a disturbance acted.
    """

    verdict: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    first: tuple[str, ...] = ()
    may: tuple[str, ...] = ()
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    after: JsonObject | None = None
    located: JsonObject | None = None


@dataclass(frozen=True)
class RealCase:
    """One diagnosis of real records."""

    name: str
    question: str
    folder: Path
    log: tuple[str, ...]
    model: str
    holdout: tuple[str, ...] = ()
    columns: str | None = None
    prepare: str | None = None
    goal: Goal = field(default_factory=Goal)


@dataclass(frozen=True)
class Records:
    """A folder of records."""

    title: str
    source: str
    cases: tuple[RealCase, ...]


def find_records(data: Path) -> list[Records]:
    """The records below a folder: those that the benchmark knows by their file names, and folders with a `cases.toml`.

    Raises:
        InputError: where there are none, or a description is not right.
    """
    if not data.is_dir():
        raise InputError(f"--data {data} is not a folder; give the one that holds the records' folders, such as emps/.")
    own = [tomllib.loads(path.read_text()) for path in sorted(OWN.glob("*.toml"))]
    found = []
    for folder in sorted({data, *(path for path in data.iterdir() if path.is_dir())}):
        if (folder / FILE).exists():
            found.append(read_records(folder / FILE, folder))
        else:
            found += [_records(said, folder) for said in own if all((folder / n).exists() for n in said["needs"])]
    if not found:
        needs = "; ".join(", ".join(said["needs"]) for said in own)
        raise InputError(f"--data {data} holds no records: neither a folder with {FILE} nor one with {needs}.")
    return found


def read_records(path: Path, folder: Path) -> Records:
    """Read a `cases.toml`.

    Raises:
        InputError: where it is not right, in one sentence.
    """
    try:
        said = tomllib.loads(path.read_text())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not valid TOML: {error}.") from error
    return _records(said, folder)


def _records(said: JsonObject, folder: Path) -> Records:
    cases = said.get("case")
    if not isinstance(cases, list) or not cases:
        raise InputError(f"{folder / FILE} has no [[case]]: give at least one, with name, log and model.")
    found = tuple(_case(one, folder) for one in cases)
    return Records(str(said.get("title", folder.name)), str(said.get("source", "")), found)


def _case(said: JsonObject, folder: Path) -> RealCase:
    place = f"{folder / FILE}, case {said.get('name', '?')}"
    for key in ("name", "log", "model"):
        if key not in said:
            raise InputError(f"{place}: {key} is missing.")
    goal = said.get("goal", {})
    for keys, given in ((CASE_KEYS, said), (GOAL_KEYS, goal)):
        if strange := sorted(set(given) - keys):
            raise InputError(f"{place}: {', '.join(strange)} is not known; there are {', '.join(sorted(keys))}.")
    for name in (*_words(said["log"]), *_words(said.get("holdout", ()))):
        if not (folder / name).exists():
            raise InputError(f"{place}: {folder / name} is not there.")
    model = str(said["model"])
    if "\n" not in model:
        if not (folder / model).exists():
            raise InputError(
                f"{place}: the model {folder / model} is not there; give a file's name or the text itself."
            )
        model = (folder / model).read_text()
    return RealCase(
        name=str(said["name"]),
        question=str(said.get("question", "")),
        folder=folder,
        log=_words(said["log"]),
        model=model.lstrip("\n"),
        holdout=_words(said.get("holdout", ())),
        columns=said.get("columns"),
        prepare=said.get("prepare"),
        goal=Goal(
            verdict=_words(goal.get("verdict", ())),
            causes=_words(goal.get("causes", ())),
            first=_words(goal.get("first", ())),
            may=_words(goal.get("may", ())),
            parameters=dict(goal.get("parameters", {})),
            after=goal.get("after"),
            located=goal.get("located"),
        ),
    )


def _words(given: Any) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(str(word) for word in given)
