"""How the tests of the tuning compile searches of a few runs: two thirds of their time was LLVM's."""

import jax
import pytest


@pytest.fixture(scope="module")
def unoptimised():
    """Compiled without LLVM's optimisation, as by `compiling.quick`; other files, and the gallery, keep it."""
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", before)
