"""A sweep on Dask distributed: a killed worker or driver loses at most its chunk, and nothing changes by a bit."""

import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest
from tuning_loops import SINE, THESIS, efp

import tuning
from fpjax import InputError
from tuning import Axis

pytest.importorskip("distributed")

AXES = (Axis("observer.gain_1", 1.0, 1e3, 60), Axis("observer.gain_2", 5.0, 50.0, 50, "linear"))
COMMON = {"axes": AXES, "objective": THESIS, "dt": 1e-4, "samples": 3001, "solver": "ode3", "chunk": 100}
REPO = pathlib.Path(__file__).parents[2]
HERE = os.pathsep.join([str(REPO / "tests" / "tuning"), str(REPO / "tests" / "helpers")])
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(REPO), "PYTHONWARNINGS": "ignore"}


def wait_for(condition, seconds, what):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what} did not happen within {seconds} s"
        time.sleep(0.05)


@pytest.fixture
def cluster(tmp_path):
    """(address, worker processes) of a scheduler and two workers in processes of their own."""
    file = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"]
    started = [subprocess.Popen([*dask, "--scheduler-file", str(file)], env=ENVIRONMENT, stderr=subprocess.DEVNULL)]
    wait_for(lambda: file.exists() and file.stat().st_size > 0, 60, "a scheduler")
    import json

    address = json.loads(file.read_text())["address"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
    workers = [
        subprocess.Popen([*worker, "--no-dashboard"], env=ENVIRONMENT, cwd=tmp_path, stderr=subprocess.DEVNULL)
        for _ in range(2)
    ]
    yield address, workers
    for process in (*workers, *started):
        process.kill()
        process.wait()


def chunks(folder):
    return len(list(folder.glob("chunk-*.npy"))) if folder.exists() else 0


DRIVER = """
    import os, sys; sys.path[:0] = sys.argv[1].split(os.pathsep)
    import jax; jax.config.update("jax_enable_x64", True)
    import tuning
    from test_cluster import COMMON, SINE, efp
    tuning.sweep(efp(150.0), SINE, out=sys.argv[2], scheduler=sys.argv[3], **COMMON)
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_and_a_killed_driver_lose_at_most_their_chunk(cluster, tmp_path):
    address, workers = cluster
    folder = tmp_path / "sweep"
    driver = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(DRIVER), HERE, str(folder), address],
        env=ENVIRONMENT,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(lambda: chunks(folder) >= 3 or driver.poll() is not None, 200, "a third chunk")
    assert driver.poll() is None, driver.communicate()[1][-2000:]
    workers[0].send_signal(signal.SIGKILL)
    after = chunks(folder)
    wait_for(lambda: chunks(folder) >= after + 3, 120, "work without the killed worker")
    driver.send_signal(signal.SIGKILL)
    driver.communicate()
    kept = chunks(folder)
    assert kept < 30, "the sweep was over before the driver was killed"
    before = {path.name: path.stat().st_mtime_ns for path in folder.glob("chunk-*.npy")}
    resumed = tuning.sweep(efp(150.0), SINE, out=folder, resume=True, scheduler=address, **COMMON)
    touched = [name for name, at in before.items() if (folder / name).stat().st_mtime_ns != at]
    # The chunk that the remaining worker was at when the driver died may be written once more.
    assert len(touched) <= 1
    alone = tuning.sweep(efp(150.0), SINE, **COMMON)
    np.testing.assert_array_equal(resumed.costs, alone.costs)


MILLION = {
    **COMMON,
    "axes": (Axis("observer.gain_1", 1.0, 1e3, 1000), Axis("observer.gain_2", 5.0, 50.0, 1000, "linear")),
    "samples": 201,
    "chunk": 20_000,
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_million_candidates_on_two_workers_one_of_them_killed(cluster, tmp_path):
    address, workers = cluster
    folder = tmp_path / "sweep"
    killed = threading.Event()

    def kill() -> None:
        wait_for(lambda: chunks(folder) >= 5, 300, "a fifth chunk")
        if chunks(folder) < 40:
            workers[0].send_signal(signal.SIGKILL)
            killed.set()

    killer = threading.Thread(target=kill)
    killer.start()
    shared = tuning.sweep(efp(150.0), SINE, out=folder, scheduler=address, **MILLION)
    killer.join()
    assert killed.is_set(), "the sweep was nearly over before the worker was killed"
    assert workers[0].wait(30) == -signal.SIGKILL
    assert shared.costs.size == 1_000_000
    alone = tuning.sweep(efp(150.0), SINE, **MILLION)
    np.testing.assert_array_equal(shared.costs, alone.costs)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_workers_that_do_not_see_the_folder_send_their_chunks(cluster, tmp_path, monkeypatch):
    address, _ = cluster
    result = tuning.sweep(efp(150.0), SINE, scheduler=address, **{**COMMON, "chunk": 1000})
    alone = tuning.sweep(efp(150.0), SINE, **{**COMMON, "chunk": 1000})
    np.testing.assert_array_equal(result.costs, alone.costs)


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_does_not_answer_is_said_so(tmp_path, monkeypatch):
    from tuning import cluster as module

    monkeypatch.setattr(module, "TIMEOUT", "1s")
    with pytest.raises(InputError, match="No Dask scheduler answers"):
        tuning.sweep(efp(150.0), SINE, scheduler="tcp://127.0.0.1:9", out=tmp_path, **COMMON)
    # nothing was computed, so the folder is not one of a sweep to resume
    assert not (tmp_path / "sweep.json").exists()
    with pytest.raises(InputError, match="No Dask scheduler answers"):
        tuning.sweep(efp(150.0), SINE, scheduler="tcp://127.0.0.1:9", out=tmp_path, **COMMON)
