"""A control law as C99: one header and one source, without dynamic memory."""

import dataclasses
import re
import textwrap
from collections.abc import Sequence

import numpy as np

from .._version import __version__
from ..errors import InputError
from ..model_file import Units
from .c_helpers import helper_text
from .law import Law
from .operations import C_TYPES, OPERATIONS
from .program import Atom, FixedNumber, Operation

_LONGEST = 88  # an expression longer than this [characters] gets a variable of its own, for readability
_INFIX = re.compile(r"^\{0\} (\S+) \{1\}$")


@dataclasses.dataclass(frozen=True)
class Code:
    """The C code of a control law.

    Attributes:
        name: prefix of every symbol and file.
        header: the text of NAME_control.h.
        source: the text of NAME_control.c.
        libm: functions of <math.h> that the code calls, sorted.
        state_bytes: size of the state [bytes].
        constants: how many numbers in the code are not parameters.
    """

    name: str
    header: str
    source: str
    libm: tuple[str, ...]
    state_bytes: int
    constants: int


def write_c(law: Law, name: str, units: Units, origin: str) -> Code:
    """The header and the source of a law.

    Args:
        law: from `trace_law`.
        name: prefix of every symbol, a C identifier.
        units: of the machine.
        origin: what the code was made from, for its first line.

    Raises:
        InputError: for a name that is not an identifier of C.
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,40}", name):
        raise InputError(f'--name "{name}" is not a C identifier: use letters, digits and _, and begin with a letter.')
    body = _Body(law)
    libm = tuple(sorted(body.libm))
    return Code(
        name,
        _header(law, name, units, origin, libm),
        _source(law, name, units, body),
        libm,
        max(1, len(law.states)) * np.dtype(law.dtype).itemsize,
        body.written_out,
    )


class _Body:
    """The statements of `step`; an operation that is read only once is written into the expression that reads it."""

    def __init__(self, law: Law) -> None:
        self.law = law
        self.libm: set[str] = set()
        self.helpers: set[tuple[str, str]] = set()
        self.parameters: dict[str, FixedNumber] = {}
        self.written_out = 0
        self.lines: list[str] = []
        program = law.program
        # inputs and state of the program are read where they are, without a copy into a local variable
        words = [f"in->{name}" for name in law.inputs] + [f"state->{name}" for name in law.states]
        self.expressions = {v.index: word for v, word in zip(program.inputs, words, strict=True)}
        uses = program.uses()
        for number, operation in enumerate(program.operations):
            text = self.expression(operation)
            # Moving an expression to where it is read is safe: the state changes only at the end of the step.
            if uses[operation.result.index] == 1 and len(text) <= _LONGEST:
                self.expressions[operation.result.index] = text
                continue
            local = f"x{number}"
            kind = C_TYPES[operation.result.kind]
            self.lines.append(f"const {kind} {local} = {_bare(text)};")
            self.expressions[operation.result.index] = local
        # the outputs that a drive needs stand first, the next state after them
        outputs = [self.atom(atom) for atom in program.outputs]
        shown = len(law.outputs)
        self.outputs = outputs[:shown]
        self.next_state = outputs[shown:]
        self.state_kinds = [v.kind for v in program.inputs[len(law.inputs) :]]

    def expression(self, operation: Operation) -> str:
        form = OPERATIONS[operation.name]
        kind = operation.result.kind
        arguments = [self.atom(atom) for atom in operation.arguments]
        single = operation.arguments[0].kind == "float32"
        if form.libm:
            self.libm.add(form.libm + ("f" if single else ""))
        if form.helper:
            self.helpers.add((form.helper, kind))
        text = form.c
        for place, word in enumerate(arguments):
            text = text.replace(f"{{{place}}}", word)
        text = text.replace("{t}", C_TYPES[kind]).replace("{s}", "f" if single else "")
        called = bool(form.libm or form.helper)
        return text if called else f"({text})"

    def atom(self, atom: Atom) -> str:
        if not isinstance(atom, FixedNumber):
            return self.expressions[atom.index]
        if atom.name:
            self.parameters[atom.name] = atom
            return atom.name
        self.written_out += 1
        return number(atom.value)


def number(value: np.generic) -> str:
    """A C literal of exactly this value: numpy prints the shortest digits that read back to the same bits."""
    kind = value.dtype.name
    if kind == "bool":
        return "1" if value else "0"
    if kind in ("float32", "float64"):
        suffix = "f" if kind == "float32" else ""
        if np.isnan(value):
            return "NAN"
        if np.isinf(value):
            return "INFINITY" if float(value) > 0.0 else "(-INFINITY)"
        text = str(value)
        text = text if any(letter in text for letter in ".e") else f"{text}.0"
        return f"({text}{suffix})" if text.startswith("-") else f"{text}{suffix}"
    whole = int(value)
    ends = {"int32": "INT32_C", "int64": "INT64_C", "uint32": "UINT32_C", "uint64": "UINT64_C"}
    if kind in ends:
        # C has no negative literals: -2^31 is the negation of 2^31, which does not fit, so it is written as a sum.
        least = {"int32": -(2**31), "int64": -(2**63)}.get(kind)
        if whole == least:
            return f"({ends[kind]}({whole + 1}) - 1)"
        return f"{ends[kind]}({whole})"
    raise AssertionError(kind)


def _bare(text: str) -> str:
    """The expression without its outermost brackets, where these enclose the whole."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for place, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and place < len(text) - 1:
            return text
    inner = text[1:-1]
    return text if inner.startswith("-") and _INFIX.match(inner) else inner


def unit_of(name: str, units: Units) -> str:
    """The unit of an input or an output."""
    motion = "rad" if units.reference == "position" else "rad/s"
    words = {
        "reference": motion, "next_reference": motion, "velocity": "rad/s", "position": "rad",
        "torque": "N m", "control": "N m",
        "compensation": "N m", "coulomb_estimate": "N m", "viscous_estimate": "N m s/rad",
        "steepness_estimate": "s/rad",
    }  # fmt: skip
    return units.name(words[name]) if name in words else ""


_WORDS = {
    "reference": "what the loop must follow", "next_reference": "the reference one period later",
    "velocity": "as measured", "position": "as measured",
    "torque": "commanded: control + compensation", "control": "the controller's part",
    "compensation": "the observer's part",
}  # fmt: skip


def _member(kind: str, name: str, units: Units, words: str = "") -> str:
    unit = unit_of(name, units)
    text = ", ".join(part for part in (f"[{unit}]" if unit else "", words) if part)
    return f"    {kind} {name};" + (f" /* {text} */" if text else "")


def _comment(text: str) -> str:
    lines = [part for line in text.splitlines() for part in (textwrap.wrap(line, 100) or [""])]
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in lines), " */"]).strip()


def _header(law: Law, name: str, units: Units, origin: str, libm: Sequence[str]) -> str:
    kind = C_TYPES[np.dtype(law.dtype).name]
    controller, observer = type(law.loop.controller).__name__, type(law.loop.observer).__name__
    calls = f"calls {', '.join(libm)} of <math.h>" if libm else "calls nothing of <math.h>"
    about = _comment(
        f"{name}_control: {controller} with {observer}, written by fpjax {__version__} from {origin}.\n\n"
        f"Call {name}_reset once, then {name}_step every {law.dt:.9g} s: it reads the inputs, fills the output and "
        f"updates the state. It computes in {kind}, allocates no memory, keeps nothing outside of the state, {calls}, "
        f"and may be called from an interrupt. The torque holds until the next call. Limits of the controller act "
        f"here, with its anti-windup as simulated; a limit of the actuator is the drive's own.\n\n"
        f"Compile as C99 without -ffast-math and with -ffp-contract=off (the default of -std=c99): then it equals the "
        f"simulation up to rounding. This file is generated: change the model and export it again."
    )
    states = [
        f"    {C_TYPES[v.kind]} {word};"
        for v, word in zip(law.program.inputs[len(law.inputs) :], law.states, strict=True)
    ]
    inputs = [_member(kind, word, units, _WORDS.get(word, "")) for word in law.inputs]
    outputs = [_member(kind, word, units, _WORDS.get(word, "")) for word in law.outputs]
    guard = f"{name.upper()}_CONTROL_H"
    needs_integers = any(v.kind not in ("float32", "float64", "bool") for v in law.program.inputs)
    return "\n".join(
        [
            about,
            f"#ifndef {guard}\n#define {guard}\n",
            *(["#include <stdint.h>\n"] if needs_integers else []),
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif\n",
            f"#define {name.upper()}_PERIOD {number(np.dtype(law.dtype).type(law.dt))} /* [s] */\n",
            f"typedef struct {{\n{chr(10).join(inputs)}\n}} {name}_input;\n",
            f"typedef struct {{\n{chr(10).join(outputs)}\n}} {name}_output;\n",
            "/* What one step keeps for the next; every member is a state of the observer or the controller. */",
            f"typedef struct {{\n{chr(10).join(states) or '    char none; /* this law has no memory */'}\n"
            f"}} {name}_state;\n",
            f"void {name}_reset({name}_state *state);",
            f"void {name}_step({name}_state *state, const {name}_input *in, {name}_output *out);\n",
            "#ifdef __cplusplus",
            "}",
            "#endif",
            f"#endif /* {guard} */\n",
        ]
    )


def _source(law: Law, name: str, units: Units, body: _Body) -> str:
    kind = C_TYPES[np.dtype(law.dtype).name]
    start = [
        f"    state->{word} = {number(np.dtype(each).type(value))};"
        for word, value, each in zip(law.states, law.start, body.state_kinds, strict=True)
    ]
    parameters = []
    for word, constant in sorted(body.parameters.items()):
        text = _described(law, word, units)
        parameters.append(
            f"static const {C_TYPES[constant.kind]} {word} = {_bare(number(constant.value))};"
            + (f" /* {text} */" if text else "")
        )
    # The members of the state are written one after the other. A member whose new value reads another member's old
    # value is computed first, before any is written.
    held, writes = [], []
    for place, (word, text) in enumerate(zip(law.states, body.next_state, strict=True)):
        reads = any(f"state->{other}" in text for other in law.states[:place])
        if reads:
            held.append(f"    const {C_TYPES[body.state_kinds[place]]} next_{word} = {_bare(text)};")
        writes.append(f"    state->{word} = {f'next_{word}' if reads else _bare(text)};")
    outputs = [f"    out->{word} = {_bare(text)};" for word, text in zip(law.outputs, body.outputs, strict=True)]
    read = " ".join((*body.lines, *held, *writes, *outputs))
    unused = [f"    (void){word};" for word in ("state", "in") if f"{word}->" not in read]
    empty = [] if law.states else ["    state->none = 0;"]
    include = ["<math.h>"] if body.libm or re.search(r"\b(NAN|INFINITY|isfinite)\b", read) else []
    helpers = helper_text(body.helpers, kind)
    if "int32_t" in read + helpers or "int64_t" in read + helpers:
        include.append("<stdint.h>")
    if "memcpy" in helpers:
        include.append("<string.h>")
    about = _comment(
        f"Written by fpjax {__version__}. The names below are the model's parameters. A number without a name belongs "
        f"to a polynomial, or was computed from parameters: to change such a gain, export the code again."
    )
    return "\n".join(
        [
            about,
            f'#include "{name}_control.h"\n',
            *(f"#include {each}" for each in sorted(include)),
            *([""] if include else []),
            *parameters,
            *([""] if parameters else []),
            *([helpers] if helpers else []),
            f"void {name}_reset({name}_state *state)\n{{",
            *(start or empty),
            "}\n",
            f"void {name}_step({name}_state *state, const {name}_input *in, {name}_output *out)\n{{",
            *unused,
            *(f"    {line}" for line in body.lines),
            *held,
            *outputs,
            *writes,
            "}\n",
        ]
    )


def _described(law: Law, word: str, units: Units) -> str:
    """The comment of a parameter, with the machine's own units; an element of an array has its array's comment."""
    text = law.parameters.get(word) or law.parameters.get(re.sub(r"(_\d+)+$", "", word), "")
    return re.sub(r"\[([^\]]*)\]", lambda match: f"[{units.name(match.group(1))}]", text).replace("*/", "* /")
