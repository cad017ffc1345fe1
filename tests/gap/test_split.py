"""Which windows are withheld: a gap that shows in some windows only is both fitted and told."""

import numpy as np
import pytest

from fpjax.gap.data.split import every_fourth, fairer_split


@pytest.mark.parametrize("windows", [4, 9, 19, 64])
@pytest.mark.parametrize("shift", range(4))
def test_some_windows_are_withheld_and_more_are_fitted(windows, shift):
    withheld = every_fourth(windows, shift)
    assert 0 < withheld.sum() <= windows / 2


def test_a_gap_that_all_windows_show_needs_no_other_split():
    assert fairer_split([np.full(20, 3.0)]) is None
    assert fairer_split([np.zeros(20)]) is None


def test_a_gap_in_two_blocks_is_fitted_in_one_and_told_on_the_other():
    missing = np.zeros(24)
    missing[[1, 10]] = 5.0
    assert not missing[every_fourth(24)].any()
    (withheld,) = fairer_split([missing])
    assert missing[withheld].any()
    assert missing[~withheld].any()


def test_a_gap_in_one_block_stays_where_it_can_be_fitted():
    missing = np.zeros(24)
    missing[0] = 5.0
    assert fairer_split([missing]) is None
