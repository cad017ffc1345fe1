"""Strict by default: double precision, no rank or dtype promotion, two host devices, warnings are errors."""

import os

os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

import matplotlib

matplotlib.use("Agg")


@pytest.fixture
def key():
    """A random key, the same each time."""
    return jax.random.key(0)
