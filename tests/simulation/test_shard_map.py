"""`roll` within `shard_map`, whose check of what varies over devices is on unless a user turns it off."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh, PartitionSpec

import fpjax as fp

GAINS = jnp.array([50.0, 100.0, 200.0, 400.0])


def built(stepping):
    law = fp.CoulombViscous(20.0, 2.0, steepness=200.0)
    sampled = {"actuator": fp.Actuator(delay=1e-3), "sensor": fp.Gyro(noise=0.0)} if stepping == "sampled" else {}
    observer = fp.ExtendedFriedlandPark(10.0, 100.0, 300.0, steepness=200.0)
    return fp.ClosedLoop(fp.OneMass(10.0, law), fp.ProportionalIntegral(800.0, 8000.0), observer, **sampled)


@pytest.mark.parametrize(
    ("stepping", "substeps", "derivative"),
    [
        ("continuous", 1, False),
        ("sampled", 6, False),
        pytest.param("sampled", 1, False, marks=pytest.mark.long),
        *(
            pytest.param(*at, True, marks=pytest.mark.long)
            for at in (("continuous", 1), ("sampled", 1), ("sampled", 6))
        ),
    ],
)
def test_roll_is_mapped_over_devices(stepping, substeps, derivative):
    loop = built(stepping)
    stepper = fp.make_stepper(dt=1e-3, samples=40, stepping=stepping, substeps=substeps)
    inputs = fp.make_inputs(loop, fp.Sine(1.0, 2.0), stepper)

    def cost(gain):
        candidate = fp.set_parameters(loop, {"observer.gain_2": gain})
        return fp.roll(candidate, inputs, stepper, {"cost": fp.MeanSquare()})[0]["cost"]

    each = jax.vmap(jax.grad(cost) if derivative else cost)
    mesh = Mesh(np.array(jax.devices()[:2]), ("candidates",))
    spec = PartitionSpec("candidates")
    mapped = jax.jit(jax.shard_map(each, mesh=mesh, in_specs=spec, out_specs=spec))
    np.testing.assert_allclose(mapped(GAINS), each(GAINS), rtol=1e-9)
