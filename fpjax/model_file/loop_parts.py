"""[controller], [observer] and [reference] <-> their blocks."""

import pathlib
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
from ..blocks.feedforward import Feedforward
from ..blocks.observers import (
    Absolute,
    AbstractNonlinearity,
    AbstractObserver,
    ClassicalFriedlandPark,
    ExtendedFriedlandPark,
    ExtendedSteepnessCoulomb,
    ExtendedSteepnessViscous,
    HighOrderFeedforward,
    LogCosh,
    ModifiedFriedlandPark,
    NoObserver,
    NovelFriedlandPark,
    Quadratic,
    SteepnessObserver,
)
from ..blocks.plants import AbstractPlant, SeriesTwoMass, TwoMass
from ..blocks.references import AbstractReference, Chirp, Constant, Multisine, Recorded, Sine, Square, Triangle
from ..errors import InputError
from .forms import Form, form_for, form_of, number, numbers, pick
from .keys import Key, Units, check_keys, choose, read_number, read_values

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


def build_controller(table: Mapping[str, Any], units: Units, dt: float) -> AbstractController | None:
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
            raise InputError("[controller] tracking_time is of the integral: write ki too, or drop tracking_time.")
        if values["ki"] is None:
            controller = PositionLoop(values["kp"], Proportional(values["kv"]))
        else:
            inner = ProportionalIntegral(values["kv"], values["ki"], limit, values["tracking_time"])
            return PositionLoop(values["kp"], inner)
    else:
        controller = pick(CONTROLLERS, name).build("controller", own, units)
    return controller if limit is None else Limited(controller, limit)


def describe_controller(controller: AbstractController | None, written: Mapping[str, Any]) -> dict[str, Any]:
    """The [controller] section.

    Args:
        controller: the block; None for unknown.
        written: the section it was read from, for what a block does not keep (a transfer function's polynomials).
    """
    if controller is None:
        return {"type": "unknown"}
    if isinstance(controller, Feedforward):
        return describe_controller(controller.controller, written)
    if isinstance(controller, Limited):
        return describe_controller(controller.controller, written) | {"limit": number(controller.limit, "limit")}
    if isinstance(controller, TransferFunction):
        return {"type": "transfer_function", **_polynomials(controller, written)}
    if isinstance(controller, PositionLoop):
        table: dict[str, Any] = {"type": "position_cascade", "kp": number(controller.kp, "kp")}
        inner = controller.velocity_controller
        if isinstance(inner, Proportional):
            return table | {"kv": number(inner.kp, "kv")}
        if isinstance(inner, ProportionalIntegral):
            own = numbers(inner, (_KP, _KI, _LIMIT, _TRACKING))
            own["kv"] = own.pop("kp")
            return table | own
        raise InputError(f"servo.toml has no words for {type(inner).__name__} inside a position cascade.")
    return form_for(controller, CONTROLLERS, "controller").describe(controller)


# ------------------------------------------------------------------------------------------- feed-forward

FEEDFORWARD = "feedforward"
_FORWARD = (
    Key("inertia", "kg m^2", "not negative", 0.0),
    Key("coulomb", "N m", "not negative", 0.0),
    Key("viscous", "N m s/rad", "not negative", 0.0),
    Key("speed", "rad/s", "positive", None),
    Key("lag", "s", "positive", None),
)


def with_feedforward(
    controller: AbstractController | None, table: Mapping[str, Any] | None, units: Units, dt: float
) -> AbstractController | None:
    """The controller with the [feedforward] section around it.

    Args:
        controller: of [controller]; None where it is unknown.
        table: the section; None without one.
        units: of the machine.
        dt: control period [s], which the lag is where none is written.

    Raises:
        InputError: for keys or values that cannot be, or a controller that has no velocity reference.
    """
    if table is None:
        return controller
    check_keys(FEEDFORWARD, table, [key.name for key in _FORWARD])
    values = read_values(FEEDFORWARD, table, _FORWARD, units)
    if controller is None:
        raise InputError(f"[{FEEDFORWARD}] needs a controller that is known: write [controller] type, or drop it.")
    inner = controller.controller if isinstance(controller, Limited) else controller
    if isinstance(inner, PositionLoop) or units.reference == "position":
        raise InputError(
            f"[{FEEDFORWARD}] follows a velocity reference, and this loop has one of position: drop [{FEEDFORWARD}]."
        )
    if values["speed"] is None:
        if values["coulomb"]:
            raise InputError(
                f"[{FEEDFORWARD}] speed is missing: write the reference [{units.name('rad/s')}] at which three "
                f"quarters of coulomb are given, for instance 2 % of the largest."
            )
        values["speed"] = 1.0
    values["lag"] = dt if values["lag"] is None else values["lag"]
    return Feedforward(controller, **values)


def describe_feedforward(controller: AbstractController | None) -> dict[str, Any]:
    """The [feedforward] section; empty without one."""
    return numbers(controller, _FORWARD) if isinstance(controller, Feedforward) else {}


def _polynomials(controller: TransferFunction, written: Mapping[str, Any]) -> dict[str, list[float]]:
    if written.get("type") == "transfer_function":
        return {name: [float(each) for each in written[name]] for name in ("numerator", "denominator")}
    from scipy import signal

    if controller.drive.shape[-1] == 0:
        return {"numerator": [float(controller.through)], "denominator": [1.0]}
    a, b, c, d = (
        np.asarray(each) for each in (controller.transition, controller.drive, controller.output, controller.through)
    )
    numerator, denominator = (np.asarray(each) for each in signal.ss2tf(a, b[:, None], c[None, :], d.reshape(1, 1)))
    return {"numerator": numerator[0].tolist(), "denominator": denominator.tolist()}


# ----------------------------------------------------------------------------------------------- observer

_GAIN = Key("gain", "1", "not negative")
_GAINS = (Key("gain_1", "1", "not negative"), Key("gain_2", "1", "not negative"))


def unwritten_gains(controller: Mapping[str, Any] | None, observer: Mapping[str, Any] | None) -> tuple[str, ...]:
    """Gains that the file leaves to pole placement: keys as "observer.gain_1"; one of a pair is a mistake."""
    # As text: whatever stands there that is none is told where the part is built.
    law, kind = str((controller or {}).get("type", "")), str((observer or {}).get("type", ""))
    wanted = {
        "controller": {"pi": ("kp", "ki"), "p": ("kp",)}.get(law, ()),
        "observer": ("gain",) if kind in _SINGLE else ("gain_1", "gain_2") if kind in _DOUBLE else (),
    }
    written = {"controller": controller or {}, "observer": observer or {}}
    return tuple(
        f"{section}.{name}"
        for section, names in wanted.items()
        if not set(names) & set(written[section])
        for name in names
    )


_SINGLE = {
    "cfp": (ClassicalFriedlandPark, ("viscous",)),
    "mfp": (ModifiedFriedlandPark, ("viscous",)),
    "nfp": (NovelFriedlandPark, ("coulomb",)),
    "steepness": (SteepnessObserver, ("coulomb",)),
}
_DOUBLE = {
    "efp": (ExtendedFriedlandPark, ()),
    "efp_steepness_coulomb": (ExtendedSteepnessCoulomb, ("viscous",)),
    "efp_steepness_viscous": (ExtendedSteepnessViscous, ("coulomb",)),
}
_NONLINEARITIES: dict[str, type[AbstractNonlinearity]] = {
    "quadratic": Quadratic,
    "absolute": Absolute,
    "log_cosh": LogCosh,
}
OBSERVERS = ("none", *_SINGLE, *_DOUBLE)
_KNOWN = {
    "coulomb": Key("coulomb", "N m", "not negative"),
    "viscous": Key("viscous", "N m s/rad", "not negative"),
    "inertia": Key("inertia", "kg m^2", "positive"),
    "steepness": Key("steepness", "s/rad", "positive"),
}


def build_observer(
    table: Mapping[str, Any] | None, units: Units, plant: AbstractPlant, known: Mapping[str, float | None]
) -> AbstractObserver:
    """The observer of [observer].

    Args:
        table: the section.
        units: of the machine.
        plant: for `high_order = true`.
        known: inertia, coulomb, viscous and steepness (None for sign) of the model, which the observer takes where the
            section does not write its own.

    Raises:
        InputError: for invalid keys or values.
    """
    if table is None:
        return NoObserver()
    name = choose("observer", "type", table.get("type", ""), OBSERVERS)
    if name == "none":
        check_keys("observer", table, ["type"])
        return NoObserver()
    single = name in _SINGLE
    block, takes = _SINGLE[name] if single else _DOUBLE[name]
    gains = ("gain", "nonlinearity") if single else ("gain_1", "gain_2")
    check_keys(
        "observer", table, ["type", *gains, "inertia", *takes, "steepness", "high_order"], f" for type = {name!r}"
    )

    def own(key: str) -> float | None:
        if table.get(key) == "sign" and key == "steepness":
            return None
        return read_number("observer", _KNOWN[key], table[key], units) if key in table else known[key]

    steepness = own("steepness")
    fields: dict[str, Any] = {key: own(key) for key in ("inertia", *takes)}
    if single:
        gain = read_values("observer", table, (_GAIN,), units)["gain"]
        fields["nonlinearity"] = _nonlinearity(table.get("nonlinearity"), gain, steepness)
    else:
        fields |= read_values("observer", table, _GAINS, units)
    if name != "steepness":
        fields["steepness"] = steepness
    observer = block(**fields)
    if "high_order" not in table:
        return observer
    if not isinstance(table["high_order"], bool):
        raise InputError("[observer] high_order is yes or no: write high_order = true or leave it out.")
    return _high_order(observer, plant) if table["high_order"] else observer


def _nonlinearity(word: Any, gain: float, steepness: float | None) -> AbstractNonlinearity:
    if word is None:
        word = "absolute" if steepness is None else "log_cosh"
    choose("observer", "nonlinearity", word, _NONLINEARITIES)
    if word == "log_cosh":
        if steepness is None:
            raise InputError('[observer] nonlinearity = "log_cosh" needs a steepness: write a number, not "sign".')
        return LogCosh(gain, steepness)
    return _NONLINEARITIES[word](gain)  # type: ignore[call-arg]


def _high_order(observer: AbstractObserver, plant: AbstractPlant) -> HighOrderFeedforward:
    if not isinstance(plant, TwoMass | SeriesTwoMass):
        raise InputError('[observer] high_order = true needs [plant] type = "two_mass" or "series_two_mass".')
    return HighOrderFeedforward(observer, plant.motor_inertia, plant.load_inertia, plant.stiffness, plant.damping)


def describe_observer(observer: AbstractObserver) -> dict[str, Any]:
    """The [observer] section; empty without an observer."""
    if isinstance(observer, NoObserver):
        return {}
    if isinstance(observer, HighOrderFeedforward):
        return describe_observer(observer.observer) | {"high_order": True}
    for name, (block, takes) in {**_SINGLE, **_DOUBLE}.items():
        if type(observer) is not block:
            continue
        at: Any = observer
        steepness = getattr(at, "steepness", None)
        table: dict[str, Any] = {"type": name}
        if name in _SINGLE:
            shape = at.nonlinearity
            word = next(word for word, kind in _NONLINEARITIES.items() if type(shape) is kind)
            gain = number(getattr(shape, "gain"), "gain")  # noqa: B009 (each has one; their base does not say so)
            table |= {"gain": gain, "nonlinearity": word}
            steepness = getattr(shape, "steepness", steepness)
        else:
            table |= numbers(at, _GAINS)
        table |= {key: number(getattr(at, key), key) for key in ("inertia", *takes)}
        return table | {"steepness": "sign" if steepness is None else number(steepness, "steepness")}
    raise InputError(f"servo.toml has no words for {type(observer).__name__} in [observer].")


# ---------------------------------------------------------------------------------------------- reference

_AMPLITUDE = Key("amplitude", "rad/s")
_FREQUENCY = Key("frequency", "Hz", "positive")
_PHASE = Key("phase", "rad", "any", 0.0)
REFERENCES = (
    Form("sine", Sine, (_AMPLITUDE, _FREQUENCY, _PHASE, Key("offset", "rad/s", "any", 0.0))),
    Form("constant", Constant, (_AMPLITUDE,)),
    Form(
        "chirp",
        Chirp,
        (
            _AMPLITUDE,
            Key("start_frequency", "Hz", "not negative"),
            Key("end_frequency", "Hz", "not negative"),
            Key("sweep_time", "s", "positive"),
        ),
    ),
    Form("triangle", Triangle, (_AMPLITUDE, _FREQUENCY, _PHASE)),
    Form("square", Square, (_AMPLITUDE, _FREQUENCY, _PHASE)),
    Form(
        "multisine",
        Multisine,
        (
            Key("amplitudes", "rad/s", many=True),
            Key("frequencies", "Hz", "not negative", many=True),
            Key("phases", "rad", many=True),
        ),
    ),
)


def build_reference(
    table: Mapping[str, Any] | None, units: Units, folder: pathlib.Path | None, linear: bool, duration: float | None
) -> AbstractReference | None:
    """The reference of [reference]; None without one.

    Args:
        table: the section; type = "recorded" reads the column `reference` of `file`, mapped by `columns`.
        units: of the machine.
        folder: what a relative `file` is relative to.
        linear: whether the log is of a linear axis.
        duration: of the simulation [s], for a chirp without its own.

    Raises:
        InputError: for invalid keys or values, or a record that cannot be read.
    """
    if table is None:
        return None
    name = form_of("reference", table, REFERENCES, ("recorded",))
    if name == "recorded":
        return _recorded(table, folder, linear)
    if name == "chirp" and "sweep_time" not in table and duration is not None:
        table = {**table, "sweep_time": duration}
    if name == "multisine":
        given = table.get("frequencies")
        table = {"phases": [0.0] * max(len(given) if isinstance(given, list) else 1, 1), **table}
    return pick(REFERENCES, name).build("reference", table, units)


def _recorded(table: Mapping[str, Any], folder: pathlib.Path | None, linear: bool) -> Recorded:
    from ..logs import read_log

    check_keys("reference", table, ["type", "file", "columns", "hold"], ' for type = "recorded"')
    if not isinstance(table.get("file"), str):
        raise InputError('[reference] file is missing: write file = "LOG.csv", a log with the column reference.')
    hold, columns = table.get("hold", True), table.get("columns")
    if not isinstance(hold, bool) or not isinstance(columns, str | None):
        raise InputError('[reference] hold is true or false, and columns is text such as "reference=qg:mm".')
    path = pathlib.Path(table["file"]).expanduser()
    path = path if path.is_absolute() or folder is None else folder / path
    log = read_log(path, columns=columns, linear=linear or None, require=("reference",))
    assert log.reference is not None
    return Recorded(log.reference, log.dt, hold)


def describe_reference(reference: AbstractReference | None, written: Mapping[str, Any]) -> dict[str, Any]:
    """The [reference] section; empty without a reference."""
    if reference is None:
        return {}
    if isinstance(reference, Recorded):
        if written.get("type") != "recorded":
            raise InputError(
                "A recorded reference made in Python has no file: save it as a log, and write [reference] "
                'type = "recorded" with file = "LOG.csv".'
            )
        return dict(written)
    return form_for(reference, REFERENCES, "reference").describe(reference)
