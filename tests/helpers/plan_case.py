"""The servo that plans are made for, its limits, and the diagnoses that leave rivals."""

from model_files import body

from fpjax import load_model
from fpjax.planning.limits import Limits

LIMITS = Limits(speed=5.0, acceleration=40.0, torque=3.0, travel=6.0, duration=4.0)

SERVO = (
    """
[units]
sensors = "{sensors}"
reference = "{reference}"
"""
    + body(0.05, 0.5, 0.04)
    + """
[controller]
type = "{controller}"
{gains}
[simulation]
dt = 4e-3
"""
)


def servo_text(sensors="velocity", controller="pi", gains="kp = 4.0\nki = 40.0", reference="velocity"):
    return SERVO.format(sensors=sensors, controller=controller, gains=gains, reference=reference)


def servo(*words, **named):
    return load_model(servo_text(*words, **named))


def ranking(*entries):
    return {
        "verdict": "unexplained",
        "ranking": [
            {"effect": name, "probability": p, "parameters": {}, "indistinguishable_from": same}
            for name, p, same in entries
        ],
    }
