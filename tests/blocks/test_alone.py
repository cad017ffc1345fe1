"""The common suite, each block alone: everything it computes, at rest, in its steep part, and far away."""

import dataclasses
import importlib
import inspect
import pkgutil

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest
import tolerances
from catalogue import CASES, first_of_each_kind, one_of_each_kind
from catalogue_case import moving
from compiling import quick

import fpjax
import fpjax as fp

pytestmark = pytest.mark.each_block

ids = pytest.mark.parametrize("case", CASES, ids=str)
compiled = pytest.mark.parametrize("case", one_of_each_kind(), ids=str)  # what compiles several programs a case


def flat(tree):
    """All outputs as one vector."""
    leaves = jax.tree.leaves(tree)
    return jnp.concatenate([jnp.reshape(leaf, (-1,)) for leaf in leaves]) if leaves else jnp.zeros(0)


def evaluate(case, block, inputs):
    return flat(case.evaluate(block, inputs))


def close(actual, expected, tolerance, size=None):
    """Entry by entry, relative to the larger of the entry's own size and `size`."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    scale = np.abs(expected) if size is None else np.maximum(np.abs(expected), np.asarray(size))
    np.testing.assert_array_less(np.abs(actual - expected), tolerance * scale + 1e-300)


def scaled(case, block):
    """(y(xi, point), number of variables): parameters and inputs moved by xi times their own scale."""
    moved, count = moving(block)
    keys = list(case.scales)

    def outputs(xi, point):
        inputs = {key: point[i] + case.scales[key] * xi[count + i] for i, key in enumerate(keys)}
        return evaluate(case, moved(xi), inputs)

    return outputs, count + len(keys)


def points(case):
    return [jnp.stack([case.inputs(point)[key] for key in case.scales]) for point in case.points]


def test_every_block_of_the_package_is_in_the_catalogue():
    """A block that nobody lists would never meet this suite."""
    for module in pkgutil.walk_packages(fpjax.__path__, "fpjax."):
        if not module.name.startswith(("fpjax.cli", "fpjax.__main__")):
            importlib.import_module(module.name)
    tried = set()

    def walk(tree):
        if isinstance(tree, fp.Block):
            tried.add(type(tree))
            for field in dataclasses.fields(tree):
                walk(getattr(tree, field.name, None))
        elif isinstance(tree, tuple):
            for part in tree:
                walk(part)

    for case in CASES:
        walk(case.build())

    def concrete(kind):
        for child in kind.__subclasses__():
            if not inspect.isabstract(child):
                yield child
            yield from concrete(child)

    # Measures are no part of the loop's dynamics; tests/simulation/test_metrics.py has them.
    blocks = {kind for kind in concrete(fp.Block) if kind.__module__.startswith("fpjax.")}
    missing = {kind.__name__ for kind in blocks - tried if not issubclass(kind, fp.AbstractMeasure)}
    missing = {name for name in missing if not name.startswith("_")}  # a part of one function
    missing -= {"Disturbed", "Missing"}  # what a linearisation and a prediction put into a loop, and no model holds
    assert not missing, f"not in tests/catalogue.py: {sorted(missing)}"


@pytest.mark.parametrize("case", first_of_each_kind(), ids=str)  # the gradients below compile every kind of block
def test_jit_is_eager_and_vmap_is_a_loop(case):
    block = case.build()
    outputs, count = scaled(case, block)
    traces = 0

    def counted(xi, point):
        nonlocal traces
        traces += 1
        return outputs(xi, point)

    compiled = jax.jit(counted)
    generator = np.random.default_rng(1)
    xis = jnp.asarray(0.05 * generator.uniform(-1, 1, (len(case.points), count)))
    places = jnp.stack(points(case))
    rows = [compiled(xi, place) for xi, place in zip(xis, places, strict=True)]
    assert traces == 1, "another parameter or input value traced the block again"
    size = max([1e-30, *(float(jnp.max(jnp.abs(row), initial=0.0)) for row in rows)])
    eager = [outputs(xi, place) for xi, place in zip(xis, places, strict=True)]
    for row, plain in zip(rows, eager, strict=True):
        assert np.all(np.isfinite(row))
        close(row, plain, tolerances.JIT_IS_EAGER, size)
    batch = quick(jax.vmap(outputs))(xis, places)
    close(batch, jnp.stack(rows), tolerances.VMAP_IS_LOOP, size)


@compiled
def test_gradients_are_finite_and_reverse_is_forward_is_finite_differences(case):
    block = case.build()
    outputs, count = scaled(case, block)
    slopes = quick(lambda xi, place: (jax.jacfwd(outputs)(xi, place), jax.jacrev(outputs)(xi, place)))
    value = quick(outputs)
    zero = np.zeros(count)
    step = tolerances.DIFFERENCE_STEP
    moves = step * np.eye(count)  # of numpy: an index set in a jax array compiles once a length
    places = points(case)
    both = [slopes(zero, place) for place in places]
    jacobians, reverses = ([np.asarray(found[which]) for found in both] for which in (0, 1))
    if jacobians[0].size == 0:
        return
    # An output's own size is the largest that it or its slope has at any point: far out some are exp(-300).
    rows = np.max(np.abs(jacobians), axis=(0, 2))
    sizes = np.maximum(rows, np.max(np.abs([value(zero, place) for place in places]), axis=0))[:, None]
    names = fp.parameter_names(block)
    kept = [i for i in range(count) if i >= len(names) or names[i] not in case.jumps]
    for number, (place, jacobian) in enumerate(zip(places, jacobians, strict=True)):
        assert np.all(np.isfinite(jacobian)), f"not finite at point {number}"
        close(reverses[number], jacobian, tolerances.REVERSE_IS_FORWARD, rows[:, None])
        if case.rough or not differentiable_at(case, number):
            continue
        columns = [(value(moves[i], place) - value(-moves[i], place)) / (2.0 * step) for i in kept]
        close(np.stack(columns, axis=1), jacobian[:, kept], tolerances.FINITE_DIFFERENCE, sizes)


def differentiable_at(case, number):
    """Whether both sides of the point have the same derivative: a kink (sign, |w|, |w|^delta, a jump) has not."""
    point = case.points[number]
    if case.kind == "reference":
        return point["time"] != 0.0
    if point.get("velocity", 1.0) != 0.0 and point.get("torque", 1.0) != 0.0:
        return True
    kinked = ("sign", "coulomb", "stribeck", "stiction", "dahl", "lugre", "asymmetric", "g2", "dead_zone")
    smooth = ("smooth", "stribeck_gauss")
    return any(word in case.name for word in smooth) or not any(word in case.name for word in kinked)


@ids
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64], ids=["f32", "f64"])
def test_dtype_is_kept(case, dtype):
    block = fp.astype(case.build(), dtype)
    for point in case.points:
        outputs = case.evaluate(block, case.inputs(point, dtype))
        assert {leaf.dtype for leaf in jax.tree.leaves(outputs)} <= {jnp.dtype(dtype)}
        assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(outputs))


@ids
def test_pytree_round_trip(case):
    block = case.build()
    leaves, structure = jax.tree.flatten(block)
    assert all(eqx.is_inexact_array(leaf) for leaf in leaves), "a parameter is not a floating array leaf"
    again = jax.tree.unflatten(structure, leaves)
    assert eqx.tree_equal(block, again)
    assert hash(structure) == hash(jax.tree.structure(case.build()))
    assert len(fp.parameter_names(block)) == len(leaves), "a leaf has no name"
    names = dict.fromkeys(fp.parameter_names(block))
    values = {name: fp.get_parameter(block, name) for name in names}
    assert eqx.tree_equal(fp.set_parameters(block, values), block)
    abstract = eqx.filter_eval_shape(lambda b: b, block)
    assert jax.tree.structure(abstract) == structure
