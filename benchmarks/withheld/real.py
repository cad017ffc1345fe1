"""`--real DIR`: the diagnosis on the EMPS records (two real logs of one ball-screw axis).

Fitted on DATA_EMPS alone, scored on DATA_EMPS_PULSES; then the pulse record alone with its pulses
left out of the torque: a disturbance that no friction may be blamed for.

References:
    A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", 2019 Workshop on
    Nonlinear System Identification Benchmarks.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fpjax.errors import InputError

from .score import number, ranking_of

# the published symmetric fit: kg, N, N s/m, N
MODEL = """[units]
motion = "linear"
reference = "position"
sensors = "position"
[plant]
type = "one_mass"
inertia = 95.11
[friction]
type = "coulomb_viscous"
coulomb = 20.39
viscous = 203.5
offset = -3.165
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""
TIMING = {"actuator_lag", "actuator_delay", "velocity_lag", "velocity_delay"}
FRICTION = {
    "coulomb_error",
    "viscous_error",
    "stribeck",
    "presliding",
    "asymmetric_friction",
    "position_dependent_friction",
    "friction_drift",
    "quadratic_drag",
}
GOAL_AFTER = 1.56  # N rms on the withheld record

Check = tuple[str, bool | None, str]


def read_record(path: Path) -> dict[str, np.ndarray]:
    """Time [s], force [N], position and reference [m], pulses [N] of one EMPS record."""
    import scipy.io

    if not path.exists():
        raise InputError(f"--real: {path} is not there; give the folder that holds {path.name}")
    raw = scipy.io.loadmat(path)
    gain = float(raw["gtau"].item())
    pulses = raw["pulses_N"].ravel() if "pulses_N" in raw else np.zeros(raw["t"].size)
    return {
        "time": raw["t"].ravel(),
        "torque": gain * raw["vir"].ravel(),
        "position": raw["qm"].ravel(),
        "reference": raw["qg"].ravel(),
        "pulses": gain * pulses,
    }


def write_record(path: Path, record: dict[str, np.ndarray]) -> None:
    """A record as the contract's CSV."""
    names = ["time", "torque", "position", "reference"]
    columns = np.stack([record[name] for name in names], axis=1)
    np.savetxt(path, columns, fmt="%.12g", delimiter=",", header=",".join(names), comments="")


def intervals(active: np.ndarray, stamps: np.ndarray) -> list[tuple[float, float]]:
    """Stretches of time in which a mask is true [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(int), [0]])))
    return [(float(stamps[a]), float(stamps[b - 1])) for a, b in edges.reshape(-1, 2)]


def located(pulses: list[tuple[float, float]], where: list[dict[str, float]], slack: float) -> int:
    """How many pulses meet a place in time that stands out, within a slack [s]."""
    return sum(any(w["from"] - slack <= end and w["to"] + slack >= start for w in where) for start, end in pulses)


def check_ladder(diagnosis: dict[str, Any]) -> list[Check]:
    """The issue's expectations of the fit on one record, scored on the other."""
    ranking = ranking_of(diagnosis)
    names = [entry["effect"] for entry in ranking]
    gap = diagnosis.get("gap") or {}
    before, after, floor = (number(gap.get(k)) for k in ("before", "after", "noise_floor"))
    checks: list[Check] = [
        ("asymmetric friction comes first", names[:1] == ["asymmetric_friction"], ", ".join(names[:3])),
    ]
    found = next((e for e in ranking if e["effect"] == "asymmetric_friction"), {})
    given = found.get("parameters") or {}
    both = [number((given.get(f"viscous_{side}") or {}).get("value")) for side in ("positive", "negative")]
    checks.append(
        (
            "its viscous values are near 166.7 and 240.4 N s/m (10 %)",
            bool(abs(both[0] / 166.7 - 1) < 0.1 and abs(both[1] / 240.4 - 1) < 0.1),
            f"{both[0]:.1f}, {both[1]:.1f}",
        )
    )
    torques = [
        number((e.get("parameters", {}).get("stribeck_torque") or {}).get("value"))
        for e in ranking
        if e["effect"] == "stribeck"
    ]
    checks.append(("no Stribeck torque is negative", not any(t < 0 for t in torques), str(torques)))
    first = [*names[:2], *(diagnosis.get("causes") or [])[:2]]
    checks.append(("no delay or lag among the first two", not TIMING & set(first), ", ".join(first)))
    in_newtons = str(gap.get("unit")) == "N"
    checks.append(
        (
            f"withheld force residual at most {GOAL_AFTER} N rms (from 2.54, floor 0.29)",
            bool(after <= GOAL_AFTER) if in_newtons else None,
            f"{before:.3g} -> {after:.3g} {gap.get('unit')}, floor {floor:.3g}",
        )
    )
    where = diagnosis.get("where") or {}
    listed = any(where.get(name) for name in ("time", "velocity", "position", "frequency"))
    left = diagnosis.get("verdict") == "unexplained"
    checks.append(
        (
            "if structure remains, it says so and where",
            listed if left else bool(after < 1.5 * floor),
            f"{diagnosis.get('verdict')}, where {'given' if listed else 'empty'}",
        )
    )
    return checks


def check_pulses(diagnosis: dict[str, Any], pulses: list[tuple[float, float]]) -> list[Check]:
    """The pulses are found in time, and no friction effect is blamed for them."""
    where = (diagnosis.get("where") or {}).get("time") or []
    hits = located(pulses, where, 0.1)
    outside = [w for w in where if not any(w["from"] - 0.1 <= b and w["to"] + 0.1 >= a for a, b in pulses)]
    causes = diagnosis.get("causes") or []
    # asymmetric viscous friction is really there: it alone may be named beside the disturbance
    blamed = (set(causes) & FRICTION) - {"asymmetric_friction"}
    return [
        (
            "the pulses are located in time",
            hits == len(pulses) and len(outside) <= len(where) / 4,
            f"{hits} of {len(pulses)} pulses in {len(where)} places, {len(outside)} elsewhere",
        ),
        (
            "they are not explained away",
            diagnosis.get("verdict") == "unexplained" and not blamed,
            f"{diagnosis.get('verdict')}: {', '.join(causes) or 'no cause'}",
        ),
    ]


def _package() -> Callable[..., Any]:
    from fpjax.gap import diagnose

    return diagnose


def run_real(folder: Path, out: Path, diagnose: Callable[..., Any] | None = None) -> int:
    """Diagnose the EMPS records, print the checks, write `real.json`; 1 if a check fails."""
    tool = _package() if diagnose is None else diagnose
    fit = read_record(folder / "DATA_EMPS.mat")
    pulsed = read_record(folder / "DATA_EMPS_PULSES.mat")
    place = out / "real"
    place.mkdir(parents=True, exist_ok=True)
    (place / "servo.toml").write_text(MODEL)
    write_record(place / "emps.csv", fit)
    write_record(place / "pulses.csv", pulsed)
    write_record(place / "pulses_left_out.csv", pulsed | {"torque": pulsed["torque"] - pulsed["pulses"]})
    times, answers = {}, {}
    for name, log, holdout in (
        ("ladder", "emps.csv", [place / "pulses.csv"]),
        ("pulses", "pulses_left_out.csv", None),
    ):
        start = time.perf_counter()
        answer = tool(place / log, model=place / "servo.toml", holdout=holdout).to_dict()
        times[name], answers[name] = time.perf_counter() - start, answer
        (place / f"{name}.json").write_text(json.dumps(answer, indent=1) + "\n")
    active = intervals(pulsed["pulses"] != 0, pulsed["time"])
    results = {
        "ladder": check_ladder(answers["ladder"]),
        "pulses": check_pulses(answers["pulses"], active),
    }
    for name, checks in results.items():
        print(f"\nEMPS {name} ({times[name]:.1f} s)")
        for sentence, passed, found in checks:
            mark = {True: "yes", False: "NO", None: "n/a"}[passed]
            print(f"  {mark:4}{sentence:64}{found}")
    written = {name: [{"check": s, "passed": p, "found": f} for s, p, f in checks] for name, checks in results.items()}
    (out / "real.json").write_text(json.dumps(written | {"seconds": times}, indent=1) + "\n")
    return 0 if all(p is not False for checks in results.values() for _, p, _ in checks) else 1
