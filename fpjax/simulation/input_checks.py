"""What a user gives for a loop and a reference: blocks of the right kinds, or a sentence on what is not."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from ..blocks.actuators import AbstractActuator
from ..blocks.block import with_arrays
from ..blocks.controllers import AbstractController, TransferFunction
from ..blocks.friction import AbstractFriction
from ..blocks.observers import AbstractObserver
from ..blocks.parameters import get_parameters, parameter_names
from ..blocks.plants import AbstractPlant
from ..blocks.references import AbstractReference, Constant
from ..blocks.sensors import AbstractSensor
from ..errors import InputError
from .histories import with_history
from .loop import ClosedLoop, LoopState
from .scan import Stepper, Stepping, advance, make_inputs

# The blocks of a loop: (name, class, an example for the error message).
_BLOCKS = (
    ("plant", AbstractPlant, "OneMass(10.0, fp.CoulombViscous(20.0, 2.0))"),
    ("controller", AbstractController, "ProportionalIntegral(150.0, 200.0)"),
    ("observer", AbstractObserver, "ExtendedFriedlandPark(10.0, 100.0, 100.0, steepness=500.0)"),
    ("actuator", AbstractActuator, "IdealActuator()"),
    ("sensor", AbstractSensor, "IdealSensor()"),
)


def checked_loop(loop: Any, verb: str) -> ClosedLoop:
    """The loop, with plain numbers as arrays, after checking the type of each block.

    Raises:
        InputError: for anything but a `ClosedLoop` of blocks.
    """
    if not isinstance(loop, ClosedLoop):
        raise InputError(f"{verb} got {shown(loop)}: give a ClosedLoop, a Model or the path of a servo.toml.")
    for name, kind, example in _BLOCKS:
        block = getattr(loop, name)
        if not isinstance(block, kind):
            raise InputError(f"The loop's {name} is {shown(block)}: give a block for it, as fp.{example}.")
    law = getattr(loop.plant, "friction", None)
    if law is not None and not isinstance(law, AbstractFriction):
        raise InputError(f"The plant's friction is {shown(law)}: give a law, as fp.CoulombViscous(20.0, 2.0).")
    return with_arrays(loop)


def checked_reference(reference: Any) -> AbstractReference:
    """The reference, with plain numbers as arrays.

    Raises:
        InputError: for anything but a reference block.
    """
    if not isinstance(reference, AbstractReference):
        hint = "fp.Constant(...)" if isinstance(reference, int | float) else "fp.Sine(amplitude=1.0, frequency=1.0)"
        raise InputError(f"The reference is {shown(reference)}: give one of the blocks, for instance {hint}.")
    return with_arrays(reference)


def check_one_run(loop: ClosedLoop, reference: AbstractReference, stepper: Stepper) -> None:
    """Refuse arrays in place of single numbers, of which a run would make a batch, or fail within jax.

    A user's own block may hold arrays as a `TransferFunction` does: they count only if a step makes arrays of them.

    Args:
        loop: the closed loop.
        reference: of the loop.
        stepper: the time steps.

    Raises:
        InputError: for such arrays.
    """

    def step() -> tuple[PyTree, PyTree, PyTree]:
        now = jax.tree.map(lambda table: table[0], make_inputs(loop, Constant(0.0), stepper))
        before = loop.sampled(loop.init()) if stepper.stepping == "sampled" else loop.init()
        return before, *advance(loop, before, now, now.time, stepper)  # a time as dt: only shapes count

    def value() -> tuple[PyTree, PyTree, PyTree]:
        return (), (), reference.readout(jnp.zeros_like(stepper.dt))

    is_function = lambda part: isinstance(part, TransferFunction)  # noqa: E731
    others = jax.tree.map(lambda part: None if is_function(part) else part, loop, is_leaf=is_function)
    for blocks, traced in ((others, step), ({"reference": reference}, value)):
        parameters = get_parameters(blocks, parameter_names(blocks))
        arrays = ", ".join(f"{name} of the shape {one.shape}" for name, one in parameters.items() if one.ndim)
        if not arrays:
            continue
        why = None
        try:
            before, after, signals = jax.eval_shape(traced)
            single = _form(before) == _form(after) and not any(leaf.ndim for leaf in jax.tree.leaves(signals))
        except InputError:
            raise
        except (TypeError, ValueError) as error:  # arrays that do not fit each other
            single, why = False, error
        if not single:
            raise InputError(
                f"A run takes one number for each parameter, got {arrays}: give one number, or call simulate for each "
                "(jax.vmap), or tuning.sweep."
            ) from why


def checked_initial(initial: Any, loop: ClosedLoop, stepping: Stepping, name: str = "initial") -> LoopState:
    """A state to start from, its histories as long as the loop's.

    Args:
        initial: the state.
        loop: the closed loop.
        stepping: of the run; a sampled one makes the memory of its period by itself.
        name: of the argument, for the message.

    Raises:
        InputError: for another kind of object, and for a state of other blocks or shapes.
    """
    advice = "give loop.init() with your numbers in it, or the final_state of such a run of this loop."
    if not isinstance(initial, LoopState):
        raise InputError(f"{name} is {shown(initial)}: {advice}")
    initial, rest = with_history(initial, loop), loop.init()
    for part in [*(part for part, _, _ in _BLOCKS), *(["period"] if stepping == "continuous" else [])]:
        if _form(getattr(initial, part)) != _form(getattr(rest, part)):
            raise InputError(
                f"{name}.{part} has other parts than loop.init().{part}, or parts of other shapes: {advice}"
            )
    return initial


def _form(state: PyTree) -> tuple[Any, list[tuple[int, ...]]]:
    """The structure of a state and the shapes of its numbers."""
    return jax.tree.structure(state), [np.shape(leaf) for leaf in jax.tree.leaves(state)]


NYQUIST = 0.5  # share of the sample rate from which on a sampled sine is aliased to a lower frequency


def check_frequency(reference: AbstractReference, dt: float, words: tuple[str, str]) -> float:
    """The highest frequency of a reference [Hz], below half the sample rate; 0 where it is traced or has none.

    Args:
        reference: of the loop.
        dt: step, or control period when sampled [s].
        words: what the reference and the step are called, for the message.

    Raises:
        InputError: for a frequency at or above half the sample rate.
    """
    frequency = max((_highest(getattr(reference, name)) for name in reference.hertz), default=0.0)
    if frequency * dt >= NYQUIST:
        raise InputError(
            f"{words[0]} {frequency:g} Hz cannot be followed at {words[1]} = {dt:g} s: a sampled signal must stay "
            f"below {NYQUIST / dt:g} Hz; lower the frequency, or write a smaller dt."
        )
    return frequency


def _highest(values: Any) -> float:
    concrete = isinstance(values, jax.Array | np.ndarray) and not isinstance(values, Tracer)
    return float(np.max(np.abs(np.asarray(values)), initial=0.0)) if concrete else 0.0


def shown(value: Any) -> str:
    """What was given, for a message: a block with its first parameters, or a type with its value."""
    kind = type(value).__name__
    if isinstance(value, eqx.Module):
        return f"a {kind} with {', '.join(parameter_names(value)[:3]) or 'no parameters'}"
    return f"{kind} {str(value)[:40]!r}" if value is not None else "nothing (None)"
