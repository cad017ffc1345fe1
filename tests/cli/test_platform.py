"""Where a command computes."""

import argparse

import jax
import pytest

from fpjax.cli.common import start_jax


@pytest.fixture
def platforms():
    before = jax.config.jax_platforms
    yield lambda named: jax.config.update("jax_platforms", named)
    jax.config.update("jax_platforms", before)


@pytest.mark.parametrize(("named", "used"), [(None, "cpu"), ("", "cpu"), ("cuda,cpu", "cuda,cpu")])
def test_a_command_stays_on_the_cpu_unless_the_environment_names_a_platform(named, used, platforms):
    platforms(named)
    start_jax(argparse.Namespace(no_cache=True))
    assert jax.config.jax_platforms == used
