"""What is kept compiled is bounded, and what is not kept is really given back."""

import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp
from fpjax.compiled.programs import MOST, Programs, jit_by
from fpjax.simulation import run as simulation_run


def test_the_least_recently_used_goes():
    programs = Programs(2)
    assert programs.get("a", lambda: 1) == (1, True)
    assert programs.get("b", lambda: 2) == (2, True)
    assert programs.get("a", lambda: 3) == (1, False)
    assert programs.get("c", lambda: 4) == (4, True)
    assert programs.get("a", lambda: 5) == (1, False)
    assert programs.get("b", lambda: 6) == (6, True)
    assert len(programs) == 2


def test_too_many_programs_are_forgotten_at_once():
    traced = []

    def fn(x):
        traced.append(x.shape)
        return jnp.sin(x)

    bounded = jit_by(lambda x: x.shape, most=3)(fn)
    for size in (1, 2, 3, 1, 2, 3, 4, 5, 6, 4):
        np.testing.assert_allclose(bounded(jnp.ones(size)), np.sin(np.ones(size)))
        assert len(bounded.keys) <= 3
    assert traced == [(size,) for size in (1, 2, 3, 4, 5, 6)]
    bounded(jnp.ones(1))
    assert traced[-1] == (1,)  # forgotten, and compiled again


@pytest.mark.long  # compiles many lengths
def test_runs_of_many_lengths_keep_a_bounded_number_of_programs():
    loop = fp.ClosedLoop(fp.OneMass(1.0, fp.NoFriction()), fp.Proportional(1.0))
    for samples in range(10, 10 + MOST + 2):
        run = fp.simulate(loop, fp.Constant(1.0), dt=1e-3, samples=samples, record=("velocity",))
        assert run.signals["velocity"].shape == (samples,)
        assert 1 <= len(simulation_run._run.keys) <= MOST
