"""Strict by default: double precision, no rank or dtype promotion, two host devices, warnings are errors."""

import contextlib
import ctypes
import gc
import os
import pathlib
import shutil
import sys
import tempfile

import threadpoolctl

# One thread for matrix products, in xdist's workers and in the commands that tests start: OpenBLAS's threads wait for
# the next product by spinning. `-n 1 tests/gap tests/analysis tests/improvement` took 185 s of processor time with two
# threads and 127 s with one, on two cores.
for _library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
threadpoolctl.threadpool_limits(1, user_api="blas")  # of this process, where a plugin has imported numpy already

os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"

# One cache of compiled programs for all processes of a test run: xdist's workers, and the commands and examples that
# tests start. A diagnosis compiles for 15 s; without the cache it does so in each of them. The first process of the run
# makes the folder, hands it on by the environment and removes it; nothing is kept from one run to the next, but for
# `.ci/run`, which empties FPJAX_TESTS_CACHE and hands it to its several runs.
_MADE_HERE = _CACHE = None
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    _CACHE = os.environ.get("FPJAX_TESTS_CACHE")
    if not _CACHE:
        _CACHE = _MADE_HERE = tempfile.mkdtemp(prefix="fpjax-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = os.path.join(_CACHE, "programs")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"  # below, writing costs about what it saves
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
# The same for Python's bytecode, where none is written beside the sources: from them `import fpjax.gap` takes 2.9 s of
# processor time, with it 1.2 s, and tests start dozens of processes.
if _CACHE is not None and sys.dont_write_bytecode:
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix = os.path.join(_CACHE, "bytecode")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

import matplotlib

matplotlib.use("Agg")


@pytest.hookimpl(wrapper=True)
def pytest_collection(session):
    """No search for garbage among what stays: modules and their tests live until the end.

    It took 2.4 of 9.8 s of collecting 3774 tests, and 0.7 of 7.4 s of the loops with each friction law and observer
    (0.3 with these thresholds): tracing makes many objects, and every round of the oldest generation looks at 400,000.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000, 20, 50)
        gc.enable()


# A worker of a whole run grew to 4.7 GB: compiled programs that no later module uses, and memory that the compiler's
# threads gave back to the allocator, which kept it (396 MB after one module, 301 after the trim).
# What is forgotten is compiled again by the next module that needs it, down to every operation outside of a program.
MOST_KEPT = 2e9  # bytes of a worker, above which compiled programs are forgotten


def pytest_runtest_teardown(item, nextitem):
    """Between modules a worker gives its memory back."""
    if nextitem is not None and nextitem.path == item.path:
        return
    if _resident() > MOST_KEPT:
        jax.clear_caches()
        gc.collect()
    with contextlib.suppress(OSError, AttributeError):  # glibc's own
        ctypes.CDLL("libc.so.6").malloc_trim(0)


def _resident():
    try:
        return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:  # no such file on this system: nothing is known, so nothing is forgotten
        return 0


def pytest_unconfigure():
    if _MADE_HERE is not None:
        shutil.rmtree(_MADE_HERE, ignore_errors=True)


# Files that take longest begin first, so that at the end no worker waits for another's last file. By processor time:
# 30 to 6 s of the default set, then those of `long`.
LONGEST_FIRST = """
alone in_loop c estimate guide withheld_truth native sweep improve identify at_rest batch linear thesis objective
sweep_store withheld_second_physics learned examples report body missing_torque diagnose gradient
withheld_second_truth corrected verbs tune truth_solvers tutorial lazy_import grid_search suspicions start_values
result_notes speed sampled behaviour simulate excitation emps elementary truth_sensors notes bad_input
plan gallery loops pages command
"""


# Of their `long` tests each is a whole diagnosis, tuning or benchmark.
WHOLE = {"gap", "tuning", "benchmarks"}
TESTS = pathlib.Path(__file__).parent


# Before pytest's own, which picks by markers.
@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    for item in items:
        own = item.path.relative_to(TESTS).parts if item.path.is_relative_to(TESTS) else ()
        if item.get_closest_marker("long") and WHOLE.intersection(own[:1]):
            item.add_marker("whole")
    if hasattr(config, "workerinput"):
        place = {f"test_{name}.py": at for at, name in enumerate(LONGEST_FIRST.split())}
        items.sort(key=lambda item: place.get(item.path.name, len(place)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """A file's tests stay in one worker: what they simulate, draw and compile is made once and not once a worker."""
    if config.getvalue("dist") != "load":  # what `-n` alone means; another one was asked for
        return None
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False  # by number of tests, which says little of their time
    return LoadFileScheduling(config, log)


@pytest.fixture
def key():
    """A random key, the same each time."""
    return jax.random.key(0)
