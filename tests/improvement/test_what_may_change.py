"""Which gains `improve` may change, and what it refuses before anything is computed."""

import dataclasses

import improve_case as case
import numpy as np
import pytest

import fpjax as fp
from fpjax.improvement.gains import freed

MACHINE = {"inertia": 0.05, "coulomb": 0.4, "viscous": 0.03}


def test_the_controller_is_the_users_and_the_feedforward_is_free():
    model = case.model(case.FORWARD)
    reference = case.log().reference
    words = [gain.word for gain in freed(model, MACHINE, reference).gains]
    assert words == ["feedforward.inertia", "feedforward.coulomb", "feedforward.viscous"]
    words = [gain.word for gain in freed(model, MACHINE, reference, ["controller.kp=1:5"]).gains]
    assert words[-1] == "controller.kp"
    bounded = case.model(case.FORWARD + "[bounds]\ncontroller.ki = [2.0, 30.0]\n")
    gain = freed(bounded, MACHINE, reference).gains[-1]
    assert (gain.word, gain.low, gain.high, gain.written) == ("controller.ki", 2.0, 30.0, True)


def test_a_feedforward_is_added_where_it_is_asked_for():
    gains = freed(case.model(), MACHINE, case.log().reference, ["feedforward"])
    assert gains.added == ("feedforward",)
    assert isinstance(gains.model.loop.controller, fp.Feedforward)
    assert np.all(gains.now == 0.0)
    text = fp.dump_model(gains.apply(case.model(), np.array([0.05, 0.3, 0.02])))
    again = fp.load_model(text)
    assert float(again.loop.controller.coulomb) == pytest.approx(0.3)
    assert float(again.loop.controller.controller.kp) == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("more", "free", "words"),
    [
        ("", [], "Nothing may change"),
        ("", ["observer"], "no observer"),
        ("", ["controller.kd"], "not a gain"),
        ("", ["controller.kp=5:1"], "is not an interval"),
        ("", ["controller.kp=a:b"], "NAME=LOW:HIGH"),
        ("[bounds]\ncontroller.kp = [2.0, 5.0]\n", [], "outside its own bounds"),
    ],
)
def test_what_cannot_change_is_said_in_one_sentence(more, free, words):
    with pytest.raises(fp.InputError, match=words):
        freed(case.model(more), MACHINE, case.log().reference, free)


def test_a_controller_that_is_not_known_is_refused_before_anything_is_computed():
    text = case.text()
    unknown = text.replace('type = "pi"\nkp = 1.5\nki = 8.0', 'type = "unknown"')
    with pytest.raises(fp.InputError, match="unknown"):
        fp.improve(case.log(), unknown)


def test_a_log_without_a_reference_is_refused():
    log = dataclasses.replace(case.log(), reference=None)
    with pytest.raises(fp.InputError, match="no reference"):
        fp.improve(log, case.model(), free=["controller"])
    with pytest.raises(fp.InputError, match="reference is constant"):
        fp.improve(dataclasses.replace(log, reference=np.zeros(1500)), case.model(), free=["controller"])
