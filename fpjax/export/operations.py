"""The operations of a drive's code, each defined once: its C expression and the same in numpy.

`ELEMENTWISE` says how each elementwise primitive of jax is written with them.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .program import Atom, FixedNumber

Emit = Callable[[str, Sequence[Atom], str], Atom]
FLOATS = ("float32", "float64")
INTEGERS = ("int32", "int64", "uint32", "uint64")
C_TYPES = {
    "float32": "float", "float64": "double", "bool": "int", "int32": "int32_t", "int64": "int64_t",
    "uint32": "uint32_t", "uint64": "uint64_t",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Operator:
    """How an operation is written in C and evaluated in numpy.

    Attributes:
        c: an expression with the arguments as {0}, {1} ...; {t} stands for the result's C type, {s} for "f" in single
            precision.
        value: the same in numpy.
        libm: the function of <math.h> that it calls, "" for none.
        helper: the helper of `c_helpers` that it calls, "" for none.
    """

    c: str
    value: Callable[..., Any]
    libm: str = ""
    helper: str = ""


def _libm(name: str, value: Callable[..., Any], arguments: int = 1) -> Operator:
    words = ", ".join(f"{{{i}}}" for i in range(arguments))
    return Operator(f"{name}{{s}}({words})", value, libm=name)


def _round_away(x: Any) -> Any:
    """Rounding half away from zero, as C's round; numpy's rint rounds half to even."""
    return np.trunc(x) + np.where(np.abs(x - np.trunc(x)) >= 0.5, np.sign(x), 0.0)


def _special(name: str) -> Callable[..., Any]:
    """A function of scipy.special, imported when it is called: that takes 0.15 s, and few laws need it."""

    def value(x: Any) -> Any:
        from scipy import special

        return getattr(special, name)(x)

    return value


OPERATIONS: dict[str, Operator] = {
    "add": Operator("{0} + {1}", np.add),
    "sub": Operator("{0} - {1}", np.subtract),
    "mul": Operator("{0} * {1}", np.multiply),
    "div": Operator("{0} / {1}", np.divide),
    "neg": Operator("-{0}", np.negative),
    "abs": _libm("fabs", np.abs),
    "sqrt": _libm("sqrt", np.sqrt),
    "floor": _libm("floor", np.floor),
    "ceil": _libm("ceil", np.ceil),
    "round_even": _libm("rint", np.rint),
    "round_away": _libm("round", _round_away),
    "max": Operator("largest_{t}({0}, {1})", np.maximum, helper="largest"),
    "min": Operator("smallest_{t}({0}, {1})", np.minimum, helper="smallest"),
    "sign": Operator("sign_{t}({0})", np.sign, helper="sign"),
    "select": Operator("{0} ? {1} : {2}", np.where),
    "eq": Operator("{0} == {1}", np.equal),
    "ne": Operator("{0} != {1}", np.not_equal),
    "lt": Operator("{0} < {1}", np.less),
    "le": Operator("{0} <= {1}", np.less_equal),
    "gt": Operator("{0} > {1}", np.greater),
    "ge": Operator("{0} >= {1}", np.greater_equal),
    "and": Operator("{0} && {1}", np.logical_and),
    "or": Operator("{0} || {1}", np.logical_or),
    "not": Operator("!{0}", np.logical_not),
    "xor": Operator("{0} != {1}", np.logical_xor),
    "bits_and": Operator("{0} & {1}", np.bitwise_and),
    "bits_or": Operator("{0} | {1}", np.bitwise_or),
    "bits_xor": Operator("{0} ^ {1}", np.bitwise_xor),
    "shift_left": Operator("({t}){0} << {1}", np.left_shift),
    # C leaves the right shift of a negative number to the compiler: all current ones copy the sign, as jax does.
    "shift_right": Operator("{0} >> {1}", np.right_shift),
    "is_finite": Operator("isfinite({0}) ? 1 : 0", np.isfinite),
    "convert": Operator("({t}){0}", lambda x: x),
    "to_integer": Operator("whole_{t}({0})", np.trunc, helper="whole"),
    "bits": Operator("bits_{t}({0})", lambda x: x, helper="bits"),
    "exp": _libm("exp", np.exp),
    "exp2": _libm("exp2", np.exp2),
    "expm1": _libm("expm1", np.expm1),
    "log": _libm("log", np.log),
    "log1p": _libm("log1p", np.log1p),
    "pow": _libm("pow", np.power, 2),
    "rem": _libm("fmod", np.fmod, 2),
    "cbrt": _libm("cbrt", np.cbrt),
    "sin": _libm("sin", np.sin),
    "cos": _libm("cos", np.cos),
    "tan": _libm("tan", np.tan),
    "asin": _libm("asin", np.arcsin),
    "acos": _libm("acos", np.arccos),
    "atan": _libm("atan", np.arctan),
    "atan2": _libm("atan2", np.arctan2, 2),
    "sinh": _libm("sinh", np.sinh),
    "cosh": _libm("cosh", np.cosh),
    "tanh": _libm("tanh", np.tanh),
    "asinh": _libm("asinh", np.arcsinh),
    "acosh": _libm("acosh", np.arccosh),
    "atanh": _libm("atanh", np.arctanh),
    "erf": _libm("erf", _special("erf")),
    "erfc": _libm("erfc", _special("erfc")),
}
# Operations that call a function of <math.h>; fabs does not count, compilers turn it into an instruction.
LIBRARY = frozenset(name for name, form in OPERATIONS.items() if form.libm) - {"abs"}

# (emit, arguments, the equation's parameters, the result's kind) -> the result; None where the kinds are not supported.
Writer = Callable[[Emit, Sequence[Atom], dict[str, Any], str], Atom | None]


def _same(name: str, kinds: tuple[str, ...] = FLOATS) -> Writer:
    def write(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
        del parameters
        return emit(name, atoms, kind) if atoms[-1].kind in kinds else None

    return write


def _logic(name: str, bits: str) -> Writer:
    def write(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
        del parameters
        if kind == "bool":
            return emit(name, atoms, kind)
        return emit(bits, atoms, kind) if kind in INTEGERS else None

    return write


def _not(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    return emit("not", atoms, kind) if kind == "bool" else None


def _one(kind: str) -> FixedNumber:
    return FixedNumber(np.dtype(kind).type(1))


def _clamp(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    low, value, high = atoms
    return emit("min", (emit("max", (value, low), kind), high), kind) if kind in (*FLOATS, *INTEGERS) else None


def _select(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    which, *cases = atoms
    if which.kind == "bool":  # jax's select_n puts the case for False first
        no, yes = cases
        return emit("select", (which, yes, no), kind)
    value = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        # select_n with an integer takes case `which`: a chain of comparisons from the last case down
        chosen = emit("le", (which, FixedNumber(np.dtype(which.kind).type(number))), "bool")
        value = emit("select", (chosen, cases[number], value), kind)
    return value


def _integer_pow(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    """By repeated squaring, in the order of jax's own, so that it rounds alike."""
    exponent, (base,) = parameters["y"], atoms
    if kind not in FLOATS:
        return None
    left, value, power = abs(exponent), None, base
    while left:
        if left & 1:
            value = power if value is None else emit("mul", (value, power), kind)
        left >>= 1
        if left:
            power = emit("mul", (power, power), kind)
    if value is None:
        return _one(kind)
    return value if exponent > 0 else emit("div", (_one(kind), value), kind)


def _square(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    return emit("mul", (atoms[0], atoms[0]), kind) if kind in (*FLOATS, *INTEGERS) else None


def _rsqrt(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    return emit("div", (_one(kind), emit("sqrt", atoms, kind)), kind) if kind in FLOATS else None


def _logistic(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    if kind not in FLOATS:
        return None
    # 1 / (1 + exp(-x)): exp overflows to infinity for large -x, and the quotient is then 0, as it should be
    grown = emit("exp", (emit("neg", atoms, kind),), kind)
    return emit("div", (_one(kind), emit("add", (_one(kind), grown), kind)), kind)


def _round(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    even = int(parameters["rounding_method"]) == 1
    return emit("round_even" if even else "round_away", atoms, kind) if kind in FLOATS else None


def _pow(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    if kind not in FLOATS:
        return None
    base, exponent = atoms
    return emit("pow", (base, _converted(emit, exponent, kind) or exponent), kind)


def _convert(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    return _converted(emit, atoms[0], kind)


def _converted(emit: Emit, atom: Atom, kind: str) -> Atom | None:
    if atom.kind == kind:
        return atom
    if kind not in C_TYPES or atom.kind not in C_TYPES:
        return None
    if isinstance(atom, FixedNumber):
        return FixedNumber(atom.value.astype(kind))
    if kind == "bool":
        return emit("ne", (atom, FixedNumber(np.dtype(atom.kind).type(0))), kind)
    if kind in INTEGERS and atom.kind in FLOATS:
        # A plain cast would be undefined behaviour for a float outside the integer's range.
        return emit("to_integer", (atom,), kind) if kind in ("int32", "int64") else None
    return emit("convert", (atom,), kind)


def _bitcast(emit: Emit, atoms: Sequence[Atom], parameters: dict[str, Any], kind: str) -> Atom | None:
    del parameters
    pairs = {("float64", "int64"), ("int64", "float64"), ("float32", "int32"), ("int32", "float32")}
    return emit("bits", atoms, kind) if (atoms[0].kind, kind) in pairs else None


_NUMBERS = (*FLOATS, *INTEGERS)
_ANY = (*_NUMBERS, "bool")
_PLAIN = {"add": "add", "add_any": "add", "sub": "sub", "mul": "mul", "neg": "neg", "max": "max", "min": "min"}
_COMPARED = {name: name for name in ("eq", "ne", "lt", "le", "gt", "ge")} | {"lt_to": "lt", "le_to": "le"}
_FLOATING = """
div abs sqrt floor ceil sign is_finite exp exp2 expm1 log log1p rem cbrt sin cos tan asin acos atan atan2 sinh cosh tanh
asinh acosh atanh erf erfc
"""

ELEMENTWISE: dict[str, Writer] = {
    **{primitive: _same(name, _NUMBERS) for primitive, name in _PLAIN.items()},
    **{primitive: _same(name, _ANY) for primitive, name in _COMPARED.items()},
    **{name: _same(name) for name in _FLOATING.split()},
    "and": _logic("and", "bits_and"),
    "or": _logic("or", "bits_or"),
    "xor": _logic("xor", "bits_xor"),
    "not": _not,
    "shift_left": _same("shift_left", INTEGERS),
    "shift_right_arithmetic": _same("shift_right", ("int32", "int64")),
    "shift_right_logical": _same("shift_right", ("uint32", "uint64")),
    "clamp": _clamp,
    "select_n": _select,
    "integer_pow": _integer_pow,
    "square": _square,
    "rsqrt": _rsqrt,
    "logistic": _logistic,
    "round": _round,
    "pow": _pow,
    "convert_element_type": _convert,
    "bitcast_convert_type": _bitcast,
}
