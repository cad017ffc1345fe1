"""The speed benchmark runs from end to end, its implementations agree, and its goals' table says what it measured."""

import json
import subprocess
import sys

import jax
import numpy as np
import pytest

from benchmarks.speed import cpp, goals, gpu, measure, report, servo
from fpjax.compiled.batch import cores


@pytest.mark.slow
def test_quick_run_from_the_command_line(tmp_path):
    command = [sys.executable, "-m", "benchmarks", "speed", "--quick", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    results = json.loads((tmp_path / "speed.json").read_text())
    assert {"C++", "numpy", "numba", "diffrax", "vmap(lax.scan)", "fpjax"} == {
        row["implementation"] for row in results["values"]
    } | {skip["implementation"] for skip in results["skipped"]}
    for row in results["values"]:
        assert "disagrees" not in row, row
        assert row["seconds"] > 0.0
        assert row["version"]
    for row in results["gradients"]:
        assert row["what"] == "value" or row["relative_error"] < measure.AGREE[row["dtype"]]
    for goal in results["goals"]:
        assert set(goal) == {"name", "goal", "measured", "met", "reason"}
        assert goal["met"] or goal["reason"]
    assert results["first_call"]["value"] > 0.0
    assert results["first_call"]["fpjax --help"] > 0.0
    told = {row["implementation"]: row["megabytes"] for row in results["memory"]}
    assert told or any(skip["implementation"] == "memory" for skip in results["skipped"])
    assert all(megabytes >= 0.0 for megabytes in told.values())
    assert max(told.values(), default=1.0) > 0.0
    several = cores() > 1
    assert {(row["by"], row["workers"] > 1) for row in results["scaling"]} >= {("threads", several)}
    assert ("devices", True) in {(row["by"], row["workers"] > 1) for row in results["scaling"]} or not several
    assert "growth with the batch" in done.stdout
    assert (tmp_path / "speed.png").stat().st_size > 10_000
    assert "goals met" in done.stdout


def test_every_implementation_computes_the_same_numbers():
    """In float64, 200 steps; the rows are made and compared as in the benchmark itself."""
    bench = measure.Bench(steps=200, repeats=1, say=lambda line: None)
    if bench.cpp is None:
        assert any("g++" in skip["why"] for skip in bench.skipped)
    bench.peers.pop("diffrax", None)  # not written for strict promotion; the quick run has it
    for size in (1, 7):
        for row in bench.value_rows(np.float64, size):
            assert row["relative_error"] < 1e-10, row


def test_library_loop_is_the_equations():
    """Against the loop written out in plain Python floats."""
    steps = 60
    reference = servo.table(steps, np.float64)
    c = dict(servo.NOMINAL, velocity=0.05)
    w, q, z1, z2, total = c["velocity"], 0.0, 0.0, 0.0, 0.0
    for r in reference.tolist():
        w, q, z1, z2, total = (float(x) for x in servo.euler(c, w, q, z1, z2, total, r, servo.DT))
    cost, shared = servo.library(steps, np.float64)
    value = cost({name: np.asarray(value) for name, value in c.items()}, *shared)
    np.testing.assert_allclose(value, total / steps, rtol=1e-13)


def test_the_fast_loop_leaves_the_arithmetic_of_python_alone():
    """Linked with -ffast-math, it would set the processor to flush subnormal numbers for whoever runs after it."""
    cpp.build()
    assert np.finfo(np.float64).tiny / np.float64(2.0) > 0.0


def test_missing_compiler_is_said(monkeypatch):
    monkeypatch.setattr(cpp.shutil, "which", lambda name: None)
    assert cpp.build() == "no g++ on this machine"


def row(name, size, seconds, dtype="float64"):
    return {"implementation": name, "dtype": dtype, "candidates": size, "processor_seconds": seconds, "steps": 10}


@pytest.mark.parametrize("kind", gpu.KINDS)
def test_rows_of_a_gpu(kind):
    """The processor in its place: the same numbers, timed twice."""
    cpu = jax.devices("cpu")[0]
    found = gpu.row(cpu, cpu, *kind, np.float64, 3, 20, 1)
    assert found["relative_error"] == 0.0
    assert min(found["seconds"], found["cpu_seconds"]) > 0.0
    (head, told, last) = report.on_gpu({"device": "a card", "platform": "cuda 13", "rows": [found]})[1:]
    assert "a card" in head
    assert "differs by 0.0e+00" in told
    assert kind[0] in last


def test_crossover_is_where_the_gpu_stays_faster():
    rows = [
        {"candidates": size, "seconds": 1.0, "cpu_seconds": cpu}
        for size, cpu in ((1, 2.0), (64, 0.5), (9, 3.0), (99, 4.0))
    ]
    assert gpu.crossover(rows) == 99
    assert gpu.crossover(rows[:2]) is None


def test_missing_gpu_is_said(monkeypatch):
    def none(kind):
        raise RuntimeError(f"Unknown backend {kind}")

    monkeypatch.setattr(jax, "devices", none)
    found = gpu.main(10, 1, (1,))
    assert report.on_gpu(found) == ["", "no row of a GPU: jax sees no GPU on this machine"]


def test_growth_is_told():
    cells = [
        {"what": what, "steps": n, "gains": 2, "ns_per_step": 5.0, "scratch_bytes": 2e6}
        for what in ("value", "auto")
        for n in (10, 20)
    ]
    results = {
        "values": [
            {"implementation": "fpjax", "dtype": "float64", "candidates": b, "ns_per_step": 2.0 * b} for b in (1, 64)
        ],
        "growth": {"horizon": cells, "gains": []},
    }
    text = report.growth(results)
    assert "float64  B=1: 1  B=64: 64" in text
    assert "auto     10 steps: 5 (2.00)  20 steps: 5 (2.00)" in text


def test_goals_are_judged_by_the_rows():
    results = {
        "versions": {"jax": "0.99.1"},
        "values": [row("C++", 1, 1.0), row("fpjax", 1, 1.1), row("vmap(lax.scan)", 1, 0.5)],
        "flat": [],
        "gradients": [],
        "first_call": {"value": 0.5},
        "scaling": [],
        "calls": [{"dtype": "float64", "candidates": 1, "processor_seconds": 0.2}],
    }
    found = {goal["name"]: goal for goal in goals.goals(results)}
    assert found["f64 value over C++, B=1"]["met"] is True
    assert found["f64 value over C++, B=1"]["measured"] == pytest.approx(1.1)
    slower = found["f64 times as fast as vmap(lax.scan), B=1"]
    assert slower["met"] is False
    assert "jax 0.99.1 compiles" in slower["reason"]
    assert found["first call after import and inputs [s], value"]["met"] is False
    assert not any("B=64" in name for name in found)
    assert found["fpjax --help [s]"]["measured"] is None
    assert "1 of 7 goals met" in goals.table(list(found.values()))
    results["values"][1]["processor_seconds"] = 1.2
    (missed,) = (goal for goal in goals.goals(results) if goal["name"] == "f64 value over C++, B=1")
    assert "are the call, without it 1.00" in missed["reason"]
    results["values"][1]["disagrees"] = True
    (wrong,) = (goal for goal in goals.goals(results) if goal["name"] == "f64 value over C++, B=1")
    assert wrong["measured"] is None
    assert not wrong["met"]
    assert "the numbers of fpjax disagree" in wrong["reason"]
