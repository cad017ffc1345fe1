"""[controller] and [feedforward] <-> their blocks."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..blocks.controllers import (
    AbstractController,
    Lead,
    Limited,
    PositionLoop,
    Proportional,
    ProportionalIntegral,
    TransferFunction,
)
from ..blocks.feedforward import AbstractFeedforward, Feedforward, PositionFeedforward
from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from ..simulation.precision import double_precision
from .block_types import Form, form_for, form_of, number, numbers, pick
from .keys import Key, Units, check_keys, read_values

_LIMIT = Key("limit", "N m", "positive", None)
_KP, _KI = Key("kp", "N m s/rad", "not negative"), Key("ki", "N m/rad", "not negative")
CONTROLLERS = (
    Form("pi", ProportionalIntegral, (_KP, _KI, _LIMIT, Key("tracking_time", "s", "positive", 0.01))),
    Form("p", Proportional, (_KP,)),
    Form("lead", Lead, (Key("gain", "N m s/rad"), Key("zero", "rad/s"), Key("pole", "rad/s", "positive"))),
)
_NUMERATOR, _DENOMINATOR = (Key(name, "s^n", many=True) for name in ("numerator", "denominator"))
_CASCADE = (Key("kp", "1/s", "not negative"), Key("kv", "N m s/rad", "not negative"))
_INNER = Key("ki", "N m/rad", "not negative", None)
_TRACKING = Key("tracking_time", "s", "positive", 0.01)
_OTHERS = ("transfer_function", "position_cascade", "unknown")


def build_controller(table: TomlTable, units: Units, dt: float) -> AbstractController | None:
    """The controller of [controller]; None where it is "unknown".

    Raises:
        InputError: for invalid keys or values.
    """
    name = form_of("controller", table, CONTROLLERS, _OTHERS)
    if name == "unknown":
        check_keys("controller", table, ["type"])
        return None
    if name == "pi":
        return pick(CONTROLLERS, name).build("controller", table, units)
    limit = read_values("controller", table, (_LIMIT,), units)["limit"]
    own = {key: value for key, value in table.items() if key != "limit"}
    hint = f" for type = {name!r}"
    if name == "transfer_function":
        keys = (_NUMERATOR, _DENOMINATOR)
        check_keys("controller", own, ["type", "numerator", "denominator", "limit"], hint)
        values = read_values("controller", own, keys, units)
        controller: AbstractController = TransferFunction(*values.values(), period=dt)
    elif name == "position_cascade":
        check_keys("controller", own, ["type", "kp", "kv", "ki", "tracking_time", "limit"], hint)
        values = read_values("controller", own, (*_CASCADE, _INNER, _TRACKING), units)
        if values["ki"] is None and "tracking_time" in own:
            raise InputError(
                "[controller] tracking_time belongs to the integral part: write ki too, or drop tracking_time."
            )
        if values["ki"] is None:
            controller = PositionLoop(values["kp"], Proportional(values["kv"]))
        else:
            inner = ProportionalIntegral(values["kv"], values["ki"], limit, values["tracking_time"])
            return PositionLoop(values["kp"], inner)
    else:
        controller = pick(CONTROLLERS, name).build("controller", own, units)
    return controller if limit is None else Limited(controller, limit)


def describe_controller(controller: AbstractController | None, written: TomlTable) -> JsonObject:
    """The [controller] section.

    Args:
        controller: the block; None for unknown.
        written: the section it was read from, for what the block does not keep (a transfer function's polynomials).
    """
    if controller is None:
        return {"type": "unknown"}
    if isinstance(controller, AbstractFeedforward):
        return describe_controller(controller.controller, written)
    if isinstance(controller, Limited):
        return describe_controller(controller.controller, written) | {"limit": number(controller.limit, "limit")}
    if isinstance(controller, TransferFunction):
        return {"type": "transfer_function", **_polynomials(controller, written)}
    if isinstance(controller, PositionLoop):
        table: JsonObject = {"type": "position_cascade", "kp": number(controller.kp, "kp")}
        inner = controller.velocity_controller
        if isinstance(inner, Proportional):
            return table | {"kv": number(inner.kp, "kv")}
        if isinstance(inner, ProportionalIntegral):
            own = numbers(inner, (_KP, _KI, _LIMIT, _TRACKING))
            own["kv"] = own.pop("kp")
            return table | own
        raise InputError(
            f"servo.toml cannot hold {type(inner).__name__} inside a position cascade: keep such a loop in Python."
        )
    return form_for(controller, CONTROLLERS, "controller").describe(controller)


def _polynomials(controller: TransferFunction, written: TomlTable) -> dict[str, list[float]]:
    # The file's own coefficients where the loop still has them: those computed back from the state space differ in the
    # last digits.
    if written.get("type") == "transfer_function":
        own = {name: [float(each) for each in written[name]] for name in ("numerator", "denominator")}
        if _is_built_of(controller, own):
            return own
    if controller.drive.shape[-1] == 0:
        return {"numerator": [float(controller.through)], "denominator": [1.0]}
    from scipy import signal

    a, b, c, d = (
        np.asarray(each, float)
        for each in (controller.transition, controller.drive, controller.output, controller.through)
    )
    numerator, denominator = (np.asarray(each) for each in signal.ss2tf(a, b[:, None], c[None, :], d.reshape(1, 1)))
    if np.array_equal(b, np.eye(len(b))[0]) and np.array_equal(a[1:], np.eye(len(b))[:-1]):
        # the form in which the block is built holds the coefficients themselves
        numerator, denominator = np.append(d, c - d * a[0])[None, :], np.append(1.0, -a[0])
    if controller.period is not None:
        made: Any = signal.cont2discrete((a, b[:, None], c[None, :], d), controller.period, method="zoh")
        transition, drive = np.asarray(made[0]), np.asarray(made[1])
        held = (controller.sampled_transition, transition), (controller.sampled_drive, drive[:, 0])
        if not all(np.allclose(np.asarray(own, float), each, 1e-4, 1e-6 * np.max(np.abs(each))) for own, each in held):
            raise InputError(
                "servo.toml cannot hold a transfer function whose sampled matrices are not those of its transition "
                "and drive: build it anew, as TransferFunction(numerator, denominator, period=dt)."
            )
    return {"numerator": numerator[0].tolist(), "denominator": denominator.tolist()}


def _is_built_of(controller: TransferFunction, polynomials: Mapping[str, list[float]]) -> bool:
    with double_precision():
        built = TransferFunction(**polynomials, period=controller.period)
    for name in ("transition", "drive", "output", "through", "sampled_transition", "sampled_drive"):
        own, same = getattr(controller, name), getattr(built, name)
        if own is None or same is None:
            if own is not same:
                return False
            continue
        own, same = np.asarray(own), np.asarray(same)
        # a loop read in single precision, and perhaps converted since, holds the rounded numbers
        if not any(np.array_equal(own, same.astype(kind).astype(own.dtype)) for kind in (own.dtype, np.float32)):
            return False
    return True


# ------------------------------------------------------------------------------------------- feed-forward

FEEDFORWARD = "feedforward"
_RATE = Key("velocity", "1", "not negative", 0.0)  # where the reference is a position
_FORWARD = (
    Key("inertia", "kg m^2", "not negative", 0.0),
    Key("coulomb", "N m", "not negative", 0.0),
    Key("viscous", "N m s/rad", "not negative", 0.0),
    Key("speed", "rad/s", "positive", None),
    Key("lag", "s", "positive", None),
)


def with_feedforward(
    controller: AbstractController | None, table: TomlTable | None, units: Units, dt: float
) -> AbstractController | None:
    """The controller with the [feedforward] section around it.

    Args:
        controller: of [controller]; None where it is unknown.
        table: the section; None without one.
        units: of the machine.
        dt: control period [s], the lag where none is written.

    Raises:
        InputError: for unknown keys, values out of range, or an unknown controller.
    """
    if table is None:
        return controller
    if controller is None:
        raise InputError(f"[{FEEDFORWARD}] needs a known controller: write [controller] type, or drop [{FEEDFORWARD}].")
    inner = controller.controller if isinstance(controller, Limited) else controller
    cascade = isinstance(inner, PositionLoop)
    keys = (_RATE, *_FORWARD) if cascade else _FORWARD
    check_keys(FEEDFORWARD, table, [*(key.name for key in keys), "ahead"])
    ahead = table.get("ahead", True)
    if not isinstance(ahead, bool):
        raise InputError(f"[{FEEDFORWARD}] ahead = {ahead!r} is not true or false: write one of them, without quotes.")
    values = read_values(FEEDFORWARD, table, keys, units)
    if values["speed"] is None:
        if values["coulomb"]:
            raise InputError(
                f"[{FEEDFORWARD}] speed is missing: write the reference's speed [{units.name('rad/s')}] at which three "
                f"quarters of coulomb are applied, for instance 2 % of the largest speed."
            )
        values["speed"] = 1.0  # any value will do where there is no Coulomb torque to shape
    values["lag"] = dt if values["lag"] is None else values["lag"]
    return (PositionFeedforward if cascade else Feedforward)(controller, **values, ahead=ahead)


def describe_feedforward(controller: AbstractController | None) -> JsonObject:
    """The [feedforward] section; empty without one."""
    if not isinstance(controller, AbstractFeedforward):
        return {}
    keys = (_RATE, *_FORWARD) if isinstance(controller, PositionFeedforward) else _FORWARD
    return numbers(controller, keys) | ({} if controller.looks_ahead else {"ahead": False})
