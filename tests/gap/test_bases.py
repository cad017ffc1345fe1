"""Beside which causes further ones are tried."""

from weighed_models import weighed

from fpjax.gap.select.starts import bases_beside, bases_of


def test_effects_that_are_worth_as_much_as_the_second_are_bases_too():
    singles = [weighed(name, evidence) for name, evidence in (("stribeck", 900.0), ("cogging", 500.0))]
    near = [weighed("backlash", 495.0), weighed("presliding", 492.0), weighed("compliance", 491.0)]
    assert bases_of([*singles, weighed("backlash", 400.0)]) == singles
    assert bases_of([*singles, *near]) == [*singles, *near[:2]]
    assert bases_of(singles[:1]) == singles[:1]
    nothing = [weighed(name, 3.0) for name in ("stribeck", "cogging", "backlash")]
    assert bases_of(nothing) == nothing[:2]


def test_a_further_cause_is_tried_beside_what_does_nearly_as_well_as_the_chosen_ones():
    chosen, near = weighed("cogging+stribeck", 500.0, left=0.2), weighed("cogging+quadratic_drag", 480.0, left=0.2)
    far = weighed("cogging+friction_drift", 300.0, left=0.2)
    assert bases_beside(chosen, [near, chosen, far]) == [chosen, near]
    assert bases_beside(chosen, [chosen, far]) == [chosen]
    # The same causes with other wrong numbers are no others.
    assert bases_beside(chosen, [weighed("stribeck+cogging", 499.0, wide=("inertia",), left=0.2)]) == [chosen]
    # What is likelier leaves more torque here: the chosen causes may be the more flexible ones.
    likelier = weighed("cogging+constant_torque", 520.0, left=0.5)
    assert bases_beside(chosen, [chosen, far, likelier]) == [chosen, likelier]
