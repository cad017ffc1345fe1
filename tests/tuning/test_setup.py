"""One setup for `tune`, `tune_each` and `sweep`: the same as its fields given as keywords."""

import numpy as np
import pytest
from tuning_loops import DEGREE, GAINS, SHORT, SINE, THESIS, efp

import tuning
from fpjax import InputError
from tuning import Axis, Setup

AXES = (Axis("observer.gain_1", DEGREE, 100.0 * DEGREE, 3),)
SETUP = Setup(**SHORT, objective=THESIS)


def test_a_setup_is_its_fields_as_keywords():
    by_setup = tuning.sweep(efp(150.0), SINE, axes=AXES, setup=SETUP)
    by_words = tuning.sweep(efp(150.0), SINE, axes=AXES, objective=THESIS, **SHORT)
    np.testing.assert_array_equal(by_setup.costs, by_words.costs)


def test_a_keyword_stands_in_place_of_the_setups_field():
    long = Setup(**{**SHORT, "duration": 10.0 * SHORT["duration"]}, objective=THESIS)
    shortened = tuning.sweep(efp(150.0), SINE, axes=AXES, setup=long, duration=SHORT["duration"])
    np.testing.assert_array_equal(shortened.costs, tuning.sweep(efp(150.0), SINE, axes=AXES, setup=SETUP).costs)


@pytest.mark.long  # two tunings; `sweep` above takes the same setup
def test_tune_and_tune_each_take_it_too():
    common = {"parameters": GAINS, "setup": SETUP, "method": "grid", "max_simulations": 6}
    alone = tuning.tune(efp(150.0), SINE, **common)
    each = tuning.tune_each(efp(150.0), {"sine": SINE}, **common)
    assert alone.gains == each["sine"].gains
    assert alone.cost == each["sine"].cost


@pytest.mark.parametrize(
    "call",
    [
        lambda **words: tuning.tune(efp(150.0), SINE, parameters=GAINS, **words),
        lambda **words: tuning.tune_each(efp(150.0), SINE, parameters=GAINS, **words),
        lambda **words: tuning.sweep(efp(150.0), SINE, axes=AXES, **words),
    ],
    ids=["tune", "tune_each", "sweep"],
)
def test_what_is_no_setting_is_named_with_the_nearest_one(call):
    with pytest.raises(InputError, match=r"agregate is not a setting .* did you mean 'aggregate'\?"):
        call(agregate="mean", **SHORT)
    with pytest.raises(InputError, match=r"dt, the step \[s\]"):
        call(duration=1.0)
