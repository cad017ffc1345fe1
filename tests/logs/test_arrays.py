"""What is done with arrays of numpy everywhere."""

import numpy as np
import pytest

from fpjax.logs.arrays import runs_of


@pytest.mark.parametrize(
    ("mask", "runs"),
    [([], []), ([0, 0], []), ([1], [(0, 1)]), ([1, 1, 0, 1], [(0, 2), (3, 4)]), ([0, 1, 0, 0, 1, 1], [(1, 2), (4, 6)])],
)
def test_runs_of(mask, runs):
    assert [tuple(run) for run in runs_of(np.array(mask, bool))] == runs
