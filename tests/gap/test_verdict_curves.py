"""The verdict beside tables of one recorded variable: what they outdo, and what follows the dominant one."""

import pytest
from weighed_models import judged, weighed

from fpjax.gap.select.dominant import Curve, believed, dominant
from fpjax.gap.thresholds import THRESHOLDS

VELOCITY = {"velocity": Curve(0.9, 200.0), "position": Curve(0.1, 20.0), "torque": Curve(0.2, -5.0)}
FOLLOWS = {"asymmetric_friction": ("velocity",), "unbalance": ("position",), "load_dependent_friction": ("torque",)}


def test_a_curve_of_its_own_variable_stands_for_a_cause_that_leaves_much():
    def said(curves, named, name="asymmetric_friction", rival=100.0):
        chosen = weighed(name, 500.0)
        return judged(chosen, [weighed("cogging", rival)], left=0.95, curves=curves, named=named, follows=FOLLOWS)

    assert said(VELOCITY, 0.8).word == "partly_explained"
    assert said(VELOCITY, 0.8).causes == ("asymmetric_friction",)
    assert said({}, 0.8).word == "unexplained"
    # The law with the name is not nearly the curve, the curve is of something else, or another effect does as well.
    assert said(VELOCITY, 0.5).word == "unexplained"
    assert said(VELOCITY, 0.8, name="unbalance").word == "unexplained"
    assert said(VELOCITY, 0.8, rival=450.0).word == "unexplained"
    assert said(VELOCITY, 0.8).main["asymmetric_friction"] == pytest.approx(THRESHOLDS.right_dominant)
    # A model that leaves more than there was is not asserted for its variable.
    worse = judged(weighed("asymmetric_friction", 500.0), [], left=1.1, curves=VELOCITY, named=0.8, follows=FOLLOWS)
    assert worse.word == "unexplained"
    # No variable stands out, or its curve holds little, or on windows left out nothing.
    assert said(VELOCITY | {"position": Curve(0.8, 150.0)}, 0.9).word == "unexplained"
    assert said({"velocity": Curve(0.3, 200.0)}, 0.3).word == "unexplained"
    assert said({"velocity": Curve(0.9, 3.0)}, 0.9).word == "unexplained"


def test_a_cause_that_a_curve_outdoes_only_bends_after_it():
    chosen, rivals = weighed("torque_saturation", 500.0), [weighed("presliding", 200.0)]
    assert judged(chosen, rivals, left=0.5, named=0.6).word == "partly_explained"
    outdone = judged(chosen, rivals, left=0.5, named=0.3, curves={"torque": Curve(0.44, 28.0)})
    assert (outdone.word, outdone.causes) == ("unexplained", ())
    numbers = judged(
        weighed("asymmetric_friction", 500.0, wide=("inertia",)), [], left=0.5, named=0.0,
        shares={"inertia_error": 0.6, "asymmetric_friction": 0.01}, curves={"torque": Curve(0.44, 28.0)},
    )  # fmt: skip
    assert (numbers.word, numbers.causes) == ("partly_explained", ("inertia_error",))
    # A simulation in which they take three quarters of what moves the machine says more than the curves' measure.
    shown = judged(chosen, rivals, left=0.5, moved=0.5, named=-0.01, curves={"torque": Curve(0.44, 28.0)})
    assert (shown.word, shown.causes) == ("partly_explained", ("torque_saturation",))
    # Unless wrong numbers take as much without them: a belt at 60 Hz beside Coulomb friction that is missing.
    beside = judged(
        chosen, rivals, left=0.5, moved=0.5, moved_by_numbers=0.51, named=-0.01, curves={"torque": Curve(0.44, 28.0)}
    )
    assert beside.word == "unexplained"
    # Where nothing is left of what moves the machine, no table could hold it instead; unless the numbers see to that.
    for numbers, word in ((0.3, "partly_explained"), (0.15, "unexplained")):
        sizes = {"moved": 0.1, "moved_by_numbers": numbers, "named": 0.3}
        assert judged(chosen, rivals, left=0.5, **sizes, curves={"torque": Curve(0.44, 28.0)}).word == word
    by_chance = judged(chosen, rivals, left=0.5, named=0.3, curves={"torque": Curve(0.44, 5.0)})
    assert by_chance.word == "partly_explained"


def test_no_cause_is_asserted_that_leaves_more_than_there_was():
    chosen, rivals = weighed("torque_saturation", 500.0), [weighed("presliding", 200.0)]
    assert judged(chosen, rivals, left=0.9, moved=0.5).word == "partly_explained"
    assert judged(chosen, rivals, left=1.1, moved=0.5).word == "unexplained"


def test_of_several_effects_the_one_that_follows_the_dominant_variable_comes_first():
    chosen = weighed("asymmetric_friction+load_dependent_friction", 500.0)
    shares = {"asymmetric_friction": 0.9, "load_dependent_friction": 0.4}
    torque = {"torque": Curve(0.85, 97.0), "velocity": Curve(0.0, 40.0)}
    found = judged(chosen, [], shares=shares, curves=torque, named=0.9, follows=FOLLOWS)
    assert found.causes == ("load_dependent_friction", "asymmetric_friction")
    assert judged(chosen, [], shares=shares, named=0.9, follows=FOLLOWS).causes[0] == "asymmetric_friction"
    # bristles follow none: they come behind it, however much would come back without them, and before nothing else
    chosen = weighed("presliding+load_dependent_friction", 500.0)
    shares = {"presliding": 0.6, "load_dependent_friction": 0.4, "inertia_error": 0.5}
    found = judged(chosen, [], shares=shares, curves=torque, named=0.9, follows=FOLLOWS)
    assert found.causes == ("load_dependent_friction", "inertia_error", "presliding")
    assert judged(chosen, [], shares=shares, named=0.9, follows=FOLLOWS).causes[0] == "presliding"


def test_a_constant_torque_is_part_of_every_curve():
    """One of nineteen twentieths of the gap came after a Stribeck friction of a sixtieth that follows the velocity."""
    chosen = weighed("constant_torque+asymmetric_friction", 500.0)
    for constant, first in ((0.9, "constant_torque"), (0.1, "asymmetric_friction")):
        shares = {"constant_torque": constant, "asymmetric_friction": 0.2}
        found = judged(chosen, [], shares=shares, curves=VELOCITY, named=0.9, follows=FOLLOWS)
        assert found.causes[0] == first


def test_what_hardly_moves_the_machine_makes_no_part_unexplained():
    """Vibration is most of the missing torque of many real machines, and hardly any of what moves them."""
    chosen, rivals = weighed("unbalance", 500.0), [weighed("presliding", 200.0)]
    assert judged(chosen, rivals, left=0.8).word == "unexplained"
    found = judged(chosen, rivals, left=0.8, moved=0.6)
    assert (found.word, found.causes) == ("partly_explained", ("unbalance",))
    assert found.probability <= THRESHOLDS.right_dominant  # less sure than where most of it is gone
    assert judged(chosen, rivals, left=0.8, moved=0.75).word == "unexplained"
    # without a cause that is sure it makes none
    assert judged(chosen, [weighed("presliding", 499.0)], left=0.8, moved=0.6).word == "unexplained"


def test_a_factor_keeps_its_place_beside_effects_that_follow_the_dominant_variable():
    """A curve is fitted beside free numbers, which make up for a factor on the torque: it says nothing of it."""
    chosen = weighed("torque_gain_error+unbalance", 500.0)
    for gain, first in ((0.6, "torque_gain_error"), (0.06, "unbalance")):
        shares = {"torque_gain_error": gain, "unbalance": 0.1}
        curves = {"position": Curve(0.9, 200.0), "velocity": Curve(0.1, 20.0)}
        assert judged(chosen, [], shares=shares, curves=curves, follows=FOLLOWS).causes[0] == first


def test_a_name_keeps_of_its_worth_what_its_variable_holds_beside_the_dominant_one():
    found = dominant(VELOCITY)
    assert found is not None
    assert (found.of, found.share, found.next) == ("velocity", 0.9, 0.2)
    assert believed(VELOCITY, ("velocity", "position")) == 1.0
    assert believed(VELOCITY, ("position",)) == pytest.approx(0.1 / 0.9)
    assert believed(VELOCITY, ("torque",)) == pytest.approx(0.2 / 0.9)
    # What says nothing of its variables, or follows one that no table was made of, is not spoken against.
    assert believed(VELOCITY, ()) == 1.0
    assert believed({"velocity": Curve(0.9, 200.0)}, ("position",)) == 1.0
    assert dominant({}) is None
    assert believed({}, ()) == 1.0
