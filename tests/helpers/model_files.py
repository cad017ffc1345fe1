"""Models compared."""

import equinox as eqx


def same(first, second):
    return bool(eqx.tree_equal((first.loop, first.reference), (second.loop, second.reference)))
