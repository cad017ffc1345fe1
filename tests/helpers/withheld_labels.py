"""Labels and answers as the scoring of `benchmarks withheld` takes them."""


def label(kind="single", effects=("stribeck",), accepted=None, **changes):
    """A label as the truth generator writes it."""
    parameters = {
        "stribeck": {
            "stribeck_torque": {"value": 2.0, "unit": "N m"},
            "stribeck_velocity": {"value": 0.1, "unit": "rad/s"},
        }
    }
    return {
        "case": "case-1",
        "version": 1,
        "seed": 1,
        "half": "reported",
        "truth": 1,
        "set": kind,
        "sensors": "rate",
        "group": f"truth 1, {kind}, rate",
        "system": "servo",
        "effects": list(effects),
        "outside": None,
        "accepted": accepted or [sorted(effects)],
        "parameters": {e: v for e, v in parameters.items() if e in effects},
        "nominal_true": {"inertia": 1.0, "coulomb": 2.0, "viscous": 0.5},
        "nominal_error_percent": {"inertia": 0.0, "coulomb": 0.0, "viscous": 0.0},
    } | changes


def entry(effect, probability, twins=(), **parameters):
    return {
        "effect": effect,
        "probability": probability,
        "gap_after": 0.1,
        "parameters": {
            name: {"value": v, "low": low, "high": high, "unit": ""} for name, (v, low, high) in parameters.items()
        },
        "indistinguishable_from": list(twins),
    }


def answer(verdict, causes, *ranking, gap=None):
    return {"verdict": verdict, "causes": causes, "ranking": list(ranking), "gap": gap or {}}
