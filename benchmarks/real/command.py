"""`python -m benchmarks real`: records of real machines with a documented cause, diagnosed and compared."""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fpjax import InputError
from fpjax.output.json_object import JsonObject
from fpjax.output.runfile import write_whole

from ..run_command import fpjax_command
from ..withheld.judge import commit, versions
from .check import Check, asserted, check_all, figures_of, probability
from .gallery import write_gallery
from .page import write_page
from .prepare import PREPARE, Stretch
from .records import RealCase, Records, find_records

# Beside the repository: the records are public, but not a part of it.
SHARED = Path(__file__).parents[2].parent / "shared" / "data"
Tool = Callable[[list[str]], Any]
FORMAT = 1  # of results.json; raised when a key is removed or changes its meaning


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--out", type=Path, required=True, help="folder of results.json, the gallery and the reports")
    parser.add_argument("--data", type=Path, help="folder of the records' folders (default ../shared/data)")
    parser.add_argument("--only", nargs="+", metavar="CASE", help="these cases only")
    parser.add_argument("--page", type=Path, metavar="FILE", help="also a page of the documentation (Markdown)")
    parser.add_argument("--afresh", action="store_true", help="diagnose again what is there already")


def run(args: argparse.Namespace) -> int:
    """Diagnose what is missing, print and write the results; exit code 1 where a check fails."""
    return run_real(SHARED if args.data is None else args.data, args.out, args.only, args.afresh, page=args.page)


def run_real(
    data: Path, out: Path, only: list[str] | None = None, afresh: bool = False, tool: Tool = fpjax_command,
    page: Path | None = None,
) -> int:  # fmt: skip
    """As the command, from Python.

    Args:
        data: folder of the records' folders.
        out: folder of the results.
        only: names of cases; None for all.
        afresh: diagnose again what is there already.
        tool: runs a command of the package, given as words.
        page: page of the documentation to write; None for none.
    """
    records = find_records(data)
    known = [case.name for some in records for case in some.cases]
    if len(set(known)) != len(known):
        raise InputError(f"two cases have one name: {', '.join(sorted({n for n in known if known.count(n) > 1}))}.")
    for name in only or ():
        if name not in known:
            raise InputError(f"--only {name}: there is no such case; there are {', '.join(known)}.")
    results = []
    for some in records:
        chosen = [case for case in some.cases if not only or case.name in only]
        if chosen:
            print(f"\n{some.title}")
        for case in chosen:
            found = run_case(case, some, out, afresh, tool)
            results.append(found)
            show(found)
    out.mkdir(parents=True, exist_ok=True)
    right = sum(one["right"] for one in results)
    sure = sum(one["wrongly_sure"] for one in results)
    provenance = {"date": time.strftime("%Y-%m-%d", time.gmtime()), "commit": commit(), "versions": versions()}
    whole = {"format": FORMAT, "provenance": provenance, "right": right, "wrongly_sure": sure, "cases": results}
    write_whole(out / "results.json", json.dumps(whole, indent=1) + "\n")
    write_gallery(out, results)
    if page is not None:
        write_page(page, out, results, made_with(out, results))
    found = ", ".join(f"{name} {number}" for name, number in provenance["versions"].items())
    print(f"\n{provenance['date']}, commit {provenance['commit']}, {found}")
    print(f"{right} of {len(results)} right, {sure} wrongly sure; written: {out / 'results.json'}, index.html")
    return 0 if right == len(results) else 1


def run_case(case: RealCase, records: Records, out: Path, afresh: bool, tool: Tool) -> JsonObject:
    """One case: the diagnosis through the command, and its checks."""
    place = out / case.name
    place.mkdir(parents=True, exist_ok=True)
    (place / "servo.toml").write_text(case.model)
    logs, hidden = [str(case.folder / name) for name in case.log], ()
    if case.prepare is not None:
        if case.prepare not in PREPARE:
            raise InputError(f"case {case.name}: prepare = {case.prepare!r} is not one of {', '.join(PREPARE)}.")
        prepared = [PREPARE[case.prepare](case.folder / name, place) for name in case.log]
        logs, hidden = [str(one.log) for one in prepared], prepared[0].hidden
    words = ["diagnose", *logs, "--model", str(place / "servo.toml"), "--out", str(place)]
    if case.holdout:
        words += ["--holdout", *(str(case.folder / name) for name in case.holdout)]
    if case.columns:
        words += ["--columns", case.columns]
    path, spent, error = place / "diagnosis.json", None, ""
    if afresh or not path.exists():
        path.unlink(missing_ok=True)
        start = time.process_time()
        try:
            tool(words)
            spent = time.process_time() - start
        except (Exception, SystemExit) as caught:
            # A record that the command refuses is a result, and counts as wrong.
            error = f"{type(caught).__name__}: {caught}"
    diagnosis = json.loads(path.read_text()) if path.exists() and not error else {"verdict": "failed"}
    checks = check_all(diagnosis, case.goal, hidden)
    if spent is not None:
        (place / "seconds.json").write_text(json.dumps(spent) + "\n")
    elif (place / "seconds.json").exists() and not error:
        spent = json.loads((place / "seconds.json").read_text())
    found = entry_of_case(case, records, diagnosis, checks, hidden, spent, error)
    pictures = [f"{case.name}/{path.name}" for path in sorted(place.glob("*.png"))]
    report = f"{case.name}/report.html" if (place / "report.html").exists() else None
    return found | {"pictures": pictures, "report": report}


def entry_of_case(
    case: RealCase, records: Records, diagnosis: JsonObject, checks: list[Check], hidden: tuple[Stretch, ...],
    spent: float | None, error: str,
) -> JsonObject:  # fmt: skip
    """The entry of a case in results.json."""
    ranking = [
        {"effect": entry.get("effect"), "probability": probability(entry), "parameters": entry.get("parameters")}
        for entry in (diagnosis.get("ranking") or [])[:3]
    ]
    sure = [check for check in checks if check.sentence.startswith("nothing wrong above")]
    return {
        "case": case.name,
        "records": records.title,
        "source": records.source,
        "question": case.question,
        "verdict": diagnosis.get("verdict"),
        "probability": diagnosis.get("probability"),
        "causes": asserted(diagnosis),
        "ranking": ranking,
        "gap": diagnosis.get("gap"),
        "learned": diagnosis.get("learned"),
        "warnings": diagnosis.get("warnings"),
        "hidden": hidden,
        "figures": [vars(figure) for figure in figures_of(diagnosis, case.goal)],
        "checks": [vars(check) for check in checks],
        "right": diagnosis.get("verdict") != "failed" and all(check.passed is not False for check in checks),
        "wrongly_sure": any(check.passed is False for check in sure),
        "seconds": spent,
        "error": error,
    }


def made_with(out: Path, results: list[JsonObject]) -> dict[str, str]:
    """Date and versions of the oldest diagnosis."""
    found = [json.loads(path.read_text()) for one in results if (path := out / one["case"] / "diagnosis.json").exists()]
    said = [one["provenance"] for one in found if one.get("provenance")]
    if not said:
        return {}
    oldest = min(said, key=lambda one: str(one.get("started")))
    versions = oldest.get("versions", {})
    return {name: versions[name] for name in ("fpjax", "jax") if name in versions} | {"of": str(oldest["started"])[:10]}


def show(found: JsonObject) -> None:
    """Print a case: verdict, causes, figures against the documented ones."""
    spent = "" if found["seconds"] is None else f" ({found['seconds']:.1f} s of processor)"
    print(f"\n  {found['case']}: {found['question']}{spent}")
    if found["error"]:
        print(f"    failed: {found['error']}")
        return
    print(f"    {found['verdict']}: {', '.join(found['causes']) or 'no cause asserted'}")
    for entry in found["ranking"]:
        print(f"    {100 * entry['probability']:5.1f} %  {str(entry['effect']).replace('_', ' ')}")
    for check in found["checks"]:
        mark = {True: "yes", False: "NO", None: "n/a"}[check["passed"]]
        print(f"    {mark:4}{check['sentence']:58}{check['found']}")
