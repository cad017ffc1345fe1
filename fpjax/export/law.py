"""The control law of a loop as a `Program`, traced from the same `ClosedLoop.control_law` that is simulated."""

import dataclasses
import inspect
import re
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..blocks.controllers import AbstractController
from ..blocks.observers import AbstractObserver
from ..blocks.signals import Measurement
from ..errors import InputError
from ..simulation.loop import ClosedLoop, Command
from ..simulation.precision import double_precision
from ..simulation.scan import astype
from .flatten import constants, flatten
from .program import Program

Precision = Literal["double", "float"]
DTYPES: dict[str, type] = {"double": np.float64, "float": np.float32}
INPUTS = ("reference", "velocity", "position")
NEXT = "next_reference"  # a fourth input of a law that looks ahead


@dataclasses.dataclass(frozen=True)
class Law:
    """The control law that a drive runs once per period.

    Attributes:
        loop: the loop, its blocks in the law's precision.
        dt: control period [s].
        precision: "double" or "float".
        program: inputs are `inputs`, then the state; outputs are `outputs`, then the next state.
        states: a name for each number of the state.
        start: the state at rest, shape (states,).
        outputs: "torque", "control", "compensation", then the estimates.
        parameters: by name, a description with the unit, from the block's docstring.
    """

    loop: ClosedLoop
    dt: float
    precision: Precision
    program: Program
    states: tuple[str, ...]
    start: np.ndarray
    outputs: tuple[str, ...]
    parameters: dict[str, str]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return inputs_of(self.loop)

    @property
    def dtype(self) -> type:
        """The numpy dtype of the precision."""
        return DTYPES[self.precision]


def trace_law(loop: ClosedLoop, dt: float, precision: Precision = "double") -> Law:
    """The control law of a loop.

    Args:
        loop: its controller and observer.
        dt: control period [s].
        precision: "double" or "float", the precision of the drive.

    Raises:
        InputError: for a period that is not positive, or a law that cannot be written in C.
    """
    if precision not in DTYPES:
        raise InputError(f'precision = {precision!r} is not known: choose "double" or "float".')
    if not dt > 0.0:
        raise InputError(f"dt must be positive, got {dt:g} s; 1e-3 s is usual for a drive.")
    with double_precision():
        loop = astype(loop, DTYPES[precision])
        # The parameters are arguments of the traced function, not constants in it: so each keeps its name.
        leaves, names, rebuild = _parameters(loop.controller, loop.observer)
        state = memory_at_rest(loop)
        period = jnp.asarray(dt, DTYPES[precision])

        def step(leaves: PyTree, dt: PyTree, inputs: PyTree, state: PyTree) -> PyTree:
            controller, observer = rebuild(leaves)
            return run(ClosedLoop(loop.plant, controller, observer), inputs, state, dt)

        zero = jnp.zeros((), DTYPES[precision])
        closed, shapes = jax.make_jaxpr(step, return_shape=True)(leaves, period, (zero,) * len(inputs_of(loop)), state)
        # parameters and period are constants of the program from here on, each with its name; inputs and state stay
        # free
        known = [constants(leaf, name) for leaf, name in zip(leaves, names, strict=True)]
        known.append(constants(period, "period"))
        free: list[PyTree] = [None] * (len(closed.jaxpr.invars) - len(known))
        program = flatten(closed, [*known, *free])
        states, start = _state(state)
        descriptions = {"period": "control period [s]"} | _described(loop.controller, "controller")
        descriptions |= _described(loop.observer, "observer")
    outputs = ("torque", "control", "compensation", *(f"{name}_estimate" for name in sorted(shapes[0][3])))
    return Law(loop, dt, precision, program, states, start, outputs, descriptions)


def inputs_of(loop: ClosedLoop) -> tuple[str, ...]:
    """Names of the inputs that the control law of a loop reads every period."""
    return (*INPUTS, NEXT) if loop.controller.looks_ahead else INPUTS


def run(loop: ClosedLoop, inputs: PyTree, state: PyTree, dt: PyTree) -> tuple[PyTree, PyTree]:
    """((torque, control, compensation, estimates), next state) of one period, for inputs in `inputs_of` order."""
    reference, velocity, position, *following = inputs
    made: Command = loop.control_law(state, reference, Measurement(velocity, position), dt, *following)
    return (made.torque, made.control, made.compensation, made.estimates), made.memory


def memory_at_rest(loop: ClosedLoop) -> PyTree:
    """The law's memory between two samples (controller, observer, period), at rest before the first sample."""
    # the continuous state has no `Period`: a drive is always sampled
    state = loop.sampled(loop.init())
    return state.controller, state.observer, state.period


def _parameters(controller: AbstractController, observer: AbstractObserver) -> tuple[list[PyTree], list[str], PyTree]:
    """(the array leaves of both blocks, a C name for each, a function that rebuilds both from such leaves)."""
    dynamic, static = eqx.partition((controller, observer), eqx.is_array)
    found, structure = jax.tree_util.tree_flatten_with_path(dynamic)
    names = [_word(("controller", "observer")[path[0].idx], path[1:]) for path, _ in found]

    def rebuild(leaves: PyTree) -> PyTree:
        return eqx.combine(jax.tree_util.tree_unflatten(structure, leaves), static)

    return [leaf for _, leaf in found], names, rebuild


def _state(state: PyTree) -> tuple[tuple[str, ...], np.ndarray]:
    """(a C name for each number of the state, their values at rest), in the order of jax's leaves."""
    found, _ = jax.tree_util.tree_flatten_with_path(state)
    names, values = [], []
    for path, leaf in found:
        array = np.asarray(leaf)
        base = _word(("controller", "observer", "period")[path[0].idx], path[1:])
        for place in np.ndindex(*array.shape):
            names.append(base + "".join(f"_{index}" for index in place))
            values.append(array[place])
    return tuple(names), np.array(values, dtype=np.float64)


def _word(first: str, path: PyTree) -> str:
    parts = [first]
    for entry in path:
        part = getattr(entry, "name", getattr(entry, "idx", getattr(entry, "key", entry)))
        parts.append(re.sub(r"\W", "_", str(part), flags=re.ASCII))
    return "_".join(parts)


def _described(block: object, name: str) -> dict[str, str]:
    """{"controller_kp": "proportional gain [N m s/rad]"}, from the docstrings of a block and of those inside it."""
    if not isinstance(block, eqx.Module):  # a parameter of a block: its text is in the docstring of the block
        return {}
    found = {}
    lines = (inspect.getdoc(type(block)) or "").partition("Attributes:")[2]
    for match in re.finditer(r"^\s+(\w+): (.*(?:\n {8,}.*)*)", lines, flags=re.MULTILINE):
        text = " ".join(match.group(2).split())
        unit = re.search(r"\[[^\]]*\]", text)
        found[f"{name}_{match.group(1)}"] = text[: unit.end()] if unit else text.partition(";")[0].rstrip(".")
    for field in dataclasses.fields(block):
        found |= _described(getattr(block, field.name, None), f"{name}_{field.name}")
    return found
