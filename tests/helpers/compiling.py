"""How the tests compile what runs a few times only."""

import jax


def quick(function):
    """Compiled without LLVM's optimisation, which takes most of the time of a program that runs once."""
    return jax.jit(function, compiler_options={"xla_backend_optimization_level": 0})
