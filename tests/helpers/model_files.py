"""Model files: machines and servos to start from, and models compared."""

import equinox as eqx


def body(inertia, coulomb, viscous):
    """A mass with friction [kg m^2, N m, N m s/rad]; it ends within [friction], so that a steepness may follow."""
    return f"""
[plant]
type = "one_mass"
inertia = {inertia}
[friction]
type = "coulomb_viscous"
coulomb = {coulomb}
viscous = {viscous}
"""


# The two machines of the tests: a small joint, as in `numpy_machine`, and the thesis' axis.
SMALL_BODY = body(0.05, 0.4, 0.03)
LARGE_BODY = body(10.0, 20.0, 2.0)
# A loop around the thesis' axis, and an observer of its friction.
LARGE_LOOP = """
[controller]
type = "pi"
kp = 150.0
ki = 200.0
[observer]
type = "efp"
gain_1 = 298.0
gain_2 = 72.6
"""
SMALL_SERVO = (
    SMALL_BODY
    + """
[controller]
type = "pi"
kp = 2.0
ki = 12.0
[reference]
type = "sine"
amplitude = 2.0
frequency = 1.0
[simulation]
dt = 1e-3
duration = 0.6
"""
)


def same(first, second):
    return bool(eqx.tree_equal((first.loop, first.reference), (second.loop, second.reference)))
