"""The servo that plans are made for."""

from fpjax.model_file import load_model

SERVO = """
[units]
sensors = "{sensors}"
reference = "{reference}"
[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.5
viscous = 0.04
[controller]
type = "{controller}"
{gains}
[simulation]
dt = 4e-3
"""


def servo_text(sensors="velocity", controller="pi", gains="kp = 4.0\nki = 40.0", reference="velocity"):
    return SERVO.format(sensors=sensors, controller=controller, gains=gains, reference=reference)


def servo(*words, **named):
    return load_model(servo_text(*words, **named))
