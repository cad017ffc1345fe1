"""Model files: a small servo to start from, and models compared."""

import equinox as eqx

# The two machines of the tests: a small joint, and the thesis' axis (kg m^2, N m, N m s/rad). Each ends within
# [friction], so that a steepness may follow.
SMALL_BODY = """
[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.4
viscous = 0.03
"""
LARGE_BODY = """
[plant]
type = "one_mass"
inertia = 10.0
[friction]
type = "coulomb_viscous"
coulomb = 20.0
viscous = 2.0
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
