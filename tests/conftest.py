"""Strict by default: double precision, no rank or dtype promotion, two host devices, warnings are errors."""

import os
import shutil
import tempfile

os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"

# One cache of compiled programs for all processes of a test run: xdist's workers, and the commands and examples that
# tests start. A diagnosis compiles for 15 s; without the cache it does so in each of them. The first process of the run
# makes the folder, hands it on by the environment and removes it; nothing is kept from one run to the next.
_MADE_HERE = None
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    _MADE_HERE = tempfile.mkdtemp(prefix="fpjax-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = _MADE_HERE
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"  # below, writing costs about what it saves
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

import matplotlib

matplotlib.use("Agg")


def pytest_unconfigure():
    if _MADE_HERE is not None:
        shutil.rmtree(_MADE_HERE, ignore_errors=True)


@pytest.fixture
def key():
    """A random key, the same each time."""
    return jax.random.key(0)
