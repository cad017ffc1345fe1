"""A case of the catalogue: a block, how to evaluate it alone, and a closed loop that holds it.

A case evaluates everything a block computes as one tuple of arrays, so that one suite serves all kinds.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

import fpjax as fp

DT = 1e-3


@dataclasses.dataclass(frozen=True)
class Case:
    """A block, how to evaluate it alone, and a closed loop that holds it.

    Attributes:
        kind: friction, plant, ...
        name: unique.
        build: makes the block (under the precision of the moment).
        evaluate: (block, inputs) -> pytree of everything it computes.
        scales: by input, the size at which the block's behaviour changes: the law's own scale.
        points: inputs in units of their scale.
        loop: puts the block in a loop: (loop, reference).
        stepping: of that loop.
        rough: True where a rounding is straight-through by design, so that no finite difference can agree.
        jumps: parameters at a value where the block jumps (a step size of 0 means no rounding), likewise.
    """

    kind: str
    name: str
    build: Callable[[], Any]
    evaluate: Callable[[Any, dict[str, jax.Array]], Any]
    scales: dict[str, float]
    points: tuple[dict[str, float], ...]
    loop: Callable[[Any], tuple[fp.ClosedLoop, fp.AbstractReference]]
    stepping: str = "continuous"
    rough: bool = False
    jumps: tuple[str, ...] = ()

    def __str__(self):
        return f"{self.kind}-{self.name}"

    def inputs(self, point, dtype=jnp.float64):
        """The inputs at a point, as scalars."""
        return {key: jnp.asarray(self.scales[key] * point.get(key, 0.37), dtype) for key in self.scales}


# At rest (v = 0), in the steep part, on the other side, and saturated.
VELOCITIES = tuple({"velocity": at} for at in (0.0, 0.7, -1.3, 400.0))
SINE = fp.Sine


def smooth_body(**_):
    return fp.OneMass(10.0, fp.CoulombViscous(20.0, 2.0, 40.0))


def controller():
    return fp.ProportionalIntegral(150.0, 200.0)


def remembered(block, memory):
    """A state of the block away from its first: each entry moved by `memory`, no two alike."""
    leaves, structure = jax.tree.flatten(block.init())
    return jax.tree.unflatten(structure, [leaf + memory * (1.0 + 0.1 * i) for i, leaf in enumerate(leaves)])


def moving(tree):
    """(moved(xi): the tree with parameter i moved by xi_i times its own size, or xi_i where it is 0, their number)."""
    leaves, structure = jax.tree.flatten(tree)
    sizes = [leaf.size for leaf in leaves]

    def moved(xi):
        start, parts = 0, []
        for leaf, size in zip(leaves, sizes, strict=True):
            scale = jnp.where(leaf == 0.0, 1.0, jnp.abs(leaf))
            parts.append(leaf + scale * xi[start : start + size].reshape(leaf.shape))
            start += size
        return jax.tree.unflatten(structure, parts)

    return moved, sum(sizes)
