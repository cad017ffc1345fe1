"""What both generators share: names of effects and units of their parameters; no law and no number.

The two generators share this table and the identities of their cases, and nothing else (a test compares their lines).
"""

EFFECTS = (
    "coulomb_error", "viscous_error", "inertia_error", "stribeck", "presliding", "asymmetric_friction",
    "position_dependent_friction", "friction_drift", "load_dependent_friction", "quadratic_drag", "backlash",
    "compliance", "unbalance", "cogging", "constant_torque", "torque_gain_error", "actuator_lag", "velocity_lag",
    "actuator_delay", "velocity_delay", "torque_saturation", "torque_dead_zone", "velocity_bias",
    "velocity_scale_error", "velocity_quantisation",
)  # fmt: skip

_UNITS = {
    "coulomb": "N m",
    "viscous": "N m s/rad",
    "inertia": "kg m^2",
    "stribeck_torque": "N m",
    "stribeck_velocity": "rad/s",
    "bristle_deflection": "rad",
    "bristle_stiffness": "N m/rad",
    "coulomb_positive": "N m",
    "coulomb_negative": "N m",
    "viscous_positive": "N m s/rad",
    "viscous_negative": "N m s/rad",
    "amplitude": "N m",
    "periods": "1/rev",
    "time_constant": "s",
    "gap": "rad",
    "frequency": "Hz",
    "stiffness": "N m/rad",
    "torque": "N m",
    "gain": "1",
    "delay": "s",
    "limit": "N m",
    "width": "N m",
    "bias": "rad/s",
    "scale": "1",
    "step": "rad/s",
}
_COEFFICIENTS = {"load_dependent_friction": "1", "quadratic_drag": "N m s^2/rad^2"}


def unit_of(effect: str, parameter: str) -> str:
    """Unit of an effect's parameter on a rotary machine; KeyError where the contract has none of that name."""
    return _COEFFICIENTS[effect] if parameter == "coefficient" else _UNITS[parameter]
