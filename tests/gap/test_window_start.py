"""What a window starts from: the state of the nominal actuator's lag."""

import gap_search
import jax.numpy as jnp
import numpy as np
import numpy_machine
import pytest

from fpjax import load_model
from fpjax.gap.machine import lanes
from fpjax.gap.simulate.family import window_fields
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
