"""The design of a motion improves what a motion can show, whatever none shows."""

import time
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fpjax.planning.design import design
from fpjax.planning.trajectory import Shape
from fpjax.planning.trial import ExpectedRun
from fpjax.simulation.precision import double_precision


class OneNumberTrial:
    """Two things to see: one that no motion shows, one that is best shown by knots of 1."""

    course = SimpleNamespace(
        starts=lambda seed, count: [Shape(*(jnp.full(1, 0.05 * (i + 1)) for _ in range(5))) for i in range(count)]
    )

    def reference(self, shape):
        return shape.knots

    def cost(self, reference, wanted):
        nats = jnp.stack([jnp.asarray(1e-7), 1e3 * jnp.exp(-4.0 * (reference[0] - 1.0) ** 2)])
        worth = jnp.log(jnp.maximum(nats, 1e-3))
        soft = -jax.nn.logsumexp(-4.0 * worth, b=wanted.each) / 4.0
        return -soft, ExpectedRun(nats, jnp.zeros(1), jnp.ones(2), jnp.zeros(()), jnp.zeros(()), None)

    def beyond(self, seen):
        return False


def test_what_no_motion_shows_does_not_keep_the_rest_from_being_improved():
    with double_precision():
        found = design(OneNumberTrial(), np.ones(2), seconds=60.0, seed=0, progress=lambda stage, share: None)
    assert float(found.shape.knots[0]) == pytest.approx(1.0, abs=0.1)
    assert float(found.seen.nats[1]) > 990.0  # of 1000
    assert float(found.first.nats[1]) < 500.0
    assert float(found.seen.nats[0]) < 1e-6
    assert found.unseen.tolist() == [True, False]


class SlowlyCompiledTrial(OneNumberTrial):
    """Its first call takes half a second of processor time, as compiling does."""

    def cost(self, reference, wanted):
        begun = time.process_time()
        while time.process_time() - begun < 0.5:
            pass
        return super().cost(reference, wanted)


def test_compiling_takes_nothing_from_the_search():
    with double_precision():
        found = design(SlowlyCompiledTrial(), np.ones(2), seconds=0.4, seed=0, progress=lambda stage, share: None)
    assert found.evaluations > 1
    assert float(found.seen.nats[1]) > float(found.first.nats[1])
