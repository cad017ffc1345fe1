"""Whether a loop is differentiable, or holds a sign() or |.| whose derivative carries no information."""

import dataclasses

import equinox as eqx
import jax
from jaxtyping import PyTree

from fpjax.blocks.friction import Coulomb, Viscous
from fpjax.blocks.observers import Absolute
from fpjax.simulation.loop import ClosedLoop
from fpjax.simulation.solvers import AbstractPlantSolver


def set_valued(tree: PyTree) -> str:
    """The class name of the first block with sign() or |.|, whose derivative is zero almost everywhere; "" if none."""
    if isinstance(tree, (Coulomb, Absolute)):
        return type(tree).__name__
    if not isinstance(tree, eqx.Module):
        parts = tree.values() if isinstance(tree, dict) else tree if isinstance(tree, (tuple, list)) else ()
        return next((found for part in parts if (found := set_valued(part))), "")
    # steepness = None is the word of every friction law for sign() in place of tanh.
    # Viscous friction has the field but no Coulomb level that a sign could switch.
    if getattr(tree, "steepness", 0.0) is None and not isinstance(tree, Viscous):
        return type(tree).__name__
    fields = [getattr(tree, field.name, None) for field in dataclasses.fields(tree)]
    return next((found for part in fields if not isinstance(part, jax.Array) and (found := set_valued(part))), "")


def not_smooth(loop: ClosedLoop, solver: AbstractPlantSolver) -> str:
    """`set_valued` of a loop under a solver.

    The exact solver handles the plant's sticking as an event, with a derivative almost everywhere: only observer and
    controller are looked at.
    """
    if solver.name != "exact":
        return set_valued(loop)
    return next((found for part in (loop.observer, loop.controller) if (found := set_valued(part))), "")
