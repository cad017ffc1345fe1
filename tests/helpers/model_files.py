"""Model files: a small servo to start from, and models compared."""

import equinox as eqx

SMALL_SERVO = """
[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.4
viscous = 0.03
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


def same(first, second):
    return bool(eqx.tree_equal((first.loop, first.reference), (second.loop, second.reference)))
