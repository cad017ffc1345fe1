"""Every block once (and each variant that takes another path through its code), with points to try it at."""

import jax
import pytest
from catalogue_case import Case
from catalogue_drive import CONTROLLERS, OBSERVERS, REFERENCES
from catalogue_machine import ACTUATORS, FRICTION, LOADS, PLANTS, SENSORS

import fpjax as fp

# One of each block and of each path through it.
CASES = [*FRICTION, *LOADS, *PLANTS, *OBSERVERS, *CONTROLLERS, *ACTUATORS, *SENSORS, *REFERENCES]


def one_of_each_kind(cases=CASES):
    """All cases for `parametrize`; one that holds no kind of block that an earlier one has not held is `long`."""
    seen, tried = set(), []
    for case in cases:
        kind = (case.kind, case.stepping, frozenset(type(part) for part in _parts(case.build())))
        tried.append(pytest.param(case, marks=pytest.mark.long) if kind in seen else case)
        seen.add(kind)
    return tried


def first_of_each_kind():
    """Cases for what the kind does, whichever block it is: the first of each kind and stepping; `long` the others."""
    seen, tried = set(), []
    for case in CASES:
        kind = (case.kind, case.stepping)
        tried.append(pytest.param(case, marks=pytest.mark.long) if kind in seen or case.name in NEUTRAL else case)
        if case.name not in NEUTRAL:
            seen.add(kind)
    return tried


NEUTRAL = ("none", "ideal")  # blocks that do nothing: the loops of all other cases hold them


def in_a_loop():
    """Cases for what compiles several whole loops: the first of each kind and stepping that does something; `long` the
    other blocks; `slow` the variants, which `one_of_each_kind` tries alone."""
    seen, tried = set(), []
    for case in one_of_each_kind():
        if not isinstance(case, Case):  # a variant
            tried.append(pytest.param(*case.values, marks=pytest.mark.slow))
        elif (case.kind, case.stepping) in seen or case.name in NEUTRAL:
            tried.append(pytest.param(case, marks=pytest.mark.long))
        else:
            tried.append(case)
            seen.add((case.kind, case.stepping))
    return tried


def _parts(tree):
    """The block and every block within it."""
    is_block = lambda at: isinstance(at, fp.Block) and at is not tree  # noqa: E731
    for part in jax.tree.leaves(tree, is_leaf=is_block):
        if isinstance(part, fp.Block):
            yield from _parts(part)
    yield tree
