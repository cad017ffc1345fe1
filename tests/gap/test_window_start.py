"""What a window starts from: the state of the nominal actuator's lag."""

import equinox as eqx
import gap_search
import jax.numpy as jnp
import numpy as np
import numpy_machine
import pytest

from fpjax import CoulombViscous, OneMass, Unbalance, load_model
from fpjax.gap.data.tables import TAPS, Guide, Tables
from fpjax.gap.machine import lanes, nominal_machine, with_structure
from fpjax.gap.simulate.family import window_fields
from fpjax.gap.simulate.hidden_states import PAST, _driven
from fpjax.gap.simulate.replay import initial
from fpjax.gap.simulate.windows import Windows
from fpjax.gap.verb import make_search
from fpjax.simulation.precision import double_precision


def test_a_window_starts_with_the_lagged_command_and_not_with_the_torque_behind_the_lag():
    """Limit and offset of the nominal actuator act behind its lag: they are no part of the lag's state."""
    log = numpy_machine.record(seconds=2.0, sensors=("position",))
    lagged = {}
    for name, more in {"lag": "", "more": "limit = 0.3\noffset = 0.2\n"}.items():
        search = make_search([log], [], load_model(f"{gap_search.MODEL}[actuator]\nlag = 2e-3\n{more}"))
        fields = window_fields(search.records[0], np.array([1]), np.zeros((2, len(search.records[0].starts))))
        with double_precision():
            at = {key: jnp.asarray(value) for key, value in fields.items()}
            windows = Windows(**at | {"hidden": tuple(at["hidden"])})
            machine = lanes(search.fitter(("rigid", ())).family.machine, 1)
            lagged[name] = float(initial(machine, windows, jnp.zeros((2, 1)), search.tables[0])[1][0])
    assert abs(lagged["lag"]) > 0.3  # beyond the limit
    assert lagged["more"] == pytest.approx(lagged["lag"], rel=1e-5)


def test_a_shaft_is_wound_up_by_the_known_load_behind_it():
    weight, angle, size = 2.0, 0.7, PAST + TAPS + 1
    plant = OneMass(0.05, CoulombViscous(0.0, 0.1), Unbalance(weight))
    with double_precision():
        machine = lanes(with_structure(nominal_machine(plant, None, None, ("shape",)), "transmission", 50.0, 1e-3), 1)
        machine = eqx.tree_at(lambda at: at.sensor.load_side, machine, jnp.zeros(1))  # the motor is measured
        none, zero = jnp.zeros(size), jnp.zeros(())
        tables = Tables(none, none, none, none, none, jnp.asarray(1e-3), Guide(none, none, zero, zero), none, zero)
        still, index = jnp.full((PAST + 1, 1), angle), jnp.arange(PAST + 1)[:, None]
        load, _, _ = _driven(machine, still, 0.0 * still, index, tables, lambda mean: None)
    torque = weight * np.sin(float(load[0]))
    # One side held, the swing decays by half of 2 zeta w = 0.05 x 2 pi 50 / s: exp(-3.0) of it is left after its past.
    assert angle - float(load[0]) == pytest.approx(torque / float(machine.plant.stiffness[0]), rel=0.05)
