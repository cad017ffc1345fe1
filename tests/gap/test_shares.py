"""What each cause takes of the missing torque, of models whose energies are given."""

import itertools
from types import SimpleNamespace

import pytest
from weighed_models import judged, weighed

from fpjax.gap.select.shares import lost_of, shares_of


def shares(energies, held=None, whole=None, given=None, of=lambda found: found.energy):
    """Shares of the causes of a set, the largest if none is named, from the missing energy [1] of every set of causes.

    Args:
        energies: by set.
        held: names of the nominal numbers that an effect holds, by effect.
        whole: the set.
        given: nominal numbers by name.
        of: which shares of what was found.
    """
    energies = {frozenset(names): energy for names, energy in energies.items()}
    whole = frozenset(whole or max(energies, key=len))

    def fit(names):
        effects = tuple(
            SimpleNamespace(name=n, parameters=tuple(SimpleNamespace(name=p) for p in (held or {}).get(n, ())))
            for n in sorted(names)
            if not n.endswith("_error")
        )
        wide = frozenset(n.removesuffix("_error") for n in names if n.endswith("_error"))
        structural = tuple(effect.name for effect in effects)
        candidate = SimpleNamespace(effects=effects, wide=wide, structural=structural, values=lambda: given or {})
        return SimpleNamespace(
            names=frozenset(names), evidence=-energies[names], undrowned=-energies[names], candidate=candidate
        )

    def fitted(starts):
        return [fit(frozenset({e.name for e in s.effects} | {f"{n}_error" for n in s.wide})) for s in starts]

    exact = SimpleNamespace(fit=fit(frozenset()), left=lambda one: energies[one.names] ** 0.5)
    found = shares_of(SimpleNamespace(fitted=fitted), exact, fit(whole), [])
    return of(found), {name: others for name, others in found.alike.items() if others}


def test_of_a_nominal_model_that_misses_nothing_no_cause_takes_a_share():
    found, alike = shares({(): 0.0, ("stribeck",): 0.0, ("stribeck", "viscous_error"): 0.01})
    assert found == {"stribeck": 0.0, "viscous_error": 0.0}
    energies = {(): 0.0, ("stribeck",): 0.0, ("stribeck", "viscous_error"): 0.01}
    assert shares(energies, of=lambda found: found.evidence)[0] == {"stribeck": 0.0, "viscous_error": 0.0}
    assert alike == {}


def test_a_cause_takes_what_comes_back_without_it():
    found, alike = shares({(): 1.0, ("unbalance",): 0.4, ("inertia_error",): 0.7, ("unbalance", "inertia_error"): 0.1})
    assert found == pytest.approx({"unbalance": 0.6, "inertia_error": 0.3})
    assert list(found) == ["unbalance", "inertia_error"]
    assert not alike


def test_evidence_lost_is_a_share_of_what_the_model_brings():
    """The stand-in's evidence is minus its energy: 0.9 over the nominal model, of which 0.6 and 0.3 go with a cause."""
    energies = {(): 1.0, ("unbalance",): 0.4, ("cogging",): 0.7, ("unbalance", "cogging"): 0.1}
    found, _ = shares(energies, of=lambda found: found.evidence)
    assert found == pytest.approx({"unbalance": 0.6 / 0.9, "cogging": 0.3 / 0.9})


def test_evidence_in_what_is_mostly_noise_makes_no_cause():
    """A third of all evidence, but hardly any of that in what holds more torque than noise."""

    def of(evidence, undrowned):
        return SimpleNamespace(evidence=evidence, undrowned=undrowned)

    given, chosen = of(0.0, 0.0), of(900.0, 500.0)
    assert lost_of(given, chosen, of(600.0, 490.0)) == pytest.approx(10.0 / 500.0)
    assert lost_of(given, chosen, of(600.0, 100.0)) == pytest.approx(300.0 / 900.0)
    assert lost_of(given, chosen, of(950.0, 400.0)) == 0.0  # found without it, and likelier
    assert lost_of(given, of(900.0, -1.0), of(600.0, -2.0)) == 0.0


@pytest.mark.parametrize(
    ("told", "second", "left", "expected"),
    [
        # Numbers: the one that takes most, though by little.
        (("coulomb_error", 0.33), ("viscous_error", 0.34), 0.3, {"coulomb_error": 0.67, "viscous_error": 0.03}),
        # A weight on a winch that mostly lowers it is a Coulomb level too: the effect, though a number takes as much.
        (
            ("constant_torque", 0.022),
            ("coulomb_error", 0.018),
            0.004,
            {"constant_torque": 0.978, "coulomb_error": 0.018},
        ),
    ],
)
def test_of_causes_that_make_up_for_each_other_one_takes_what_both_do_and_names_the_other(told, second, left, expected):
    (name, with_it), (other, with_other) = told, second
    found, alike = shares({(): 1.0, (name,): with_it, (other,): with_other, (name, other): left})
    assert found == pytest.approx(expected)
    assert alike == {name: (other,)}


def test_friction_that_the_nominal_model_has_none_of_comes_before_what_would_vary_it():
    """A motor simulated without Coulomb friction: a friction by position that passes through zero does as well."""
    ripple, coulomb = "position_dependent_friction", "coulomb_error"
    energies = {(): 1.0, (ripple,): 0.3, (coulomb,): 0.31, (ripple, coulomb): 0.28}
    found, alike = shares(energies, given={"coulomb": 0.0})
    assert found == pytest.approx({coulomb: 0.69, ripple: 0.03})
    assert alike == {coulomb: (ripple,)}
    found, _ = shares(energies, given={"coulomb": 0.5})
    assert found == pytest.approx({ripple: 0.7, coulomb: 0.02})


def test_numbers_that_matter_little_even_together_are_details():
    effect, coulomb, viscous = "cogging", "coulomb_error", "viscous_error"
    found, alike = shares({
        (): 1.0, (effect,): 0.12, (effect, coulomb): 0.1, (effect, viscous): 0.11, (coulomb, viscous): 0.9,
        (effect, coulomb, viscous): 0.09,
    })  # fmt: skip
    assert not alike
    assert found == pytest.approx({effect: 0.81, coulomb: 0.02, viscous: 0.01})


def test_three_numbers_are_taken_on_one_by_one_until_little_is_left():
    a, b, c = "inertia_error", "coulomb_error", "viscous_error"
    found, alike = shares({
        (): 1.0, (a,): 0.5, (b,): 0.4, (c,): 0.46, (a, b): 0.27, (b, c): 0.29, (a, c): 0.28, (a, b, c): 0.25,
    })  # fmt: skip
    # Without the third a detail is left; its share stays what comes back without it alone.
    assert found == pytest.approx({b: 0.6, a: 0.13, c: 0.02})
    assert alike == {a: (c,)}


def test_details_that_add_up_stay_details():
    """Three of 3 % each that have nothing to do with each other: together they matter, but none of them does."""
    names = ("cogging", "constant_torque", "viscous_error")
    energies = {some: 1.0 - 0.03 * len(some) for size in range(4) for some in itertools.combinations(names, size)}
    found, alike = shares(energies)
    assert found == pytest.approx(dict.fromkeys(names, 0.03))
    assert not alike


BY_DIRECTION = {"asymmetric_friction": ("coulomb", "viscous")}


def test_a_friction_by_direction_takes_what_no_friction_equal_in_both_directions_does():
    drift, sides, coulomb, viscous = "friction_drift", "asymmetric_friction", "coulomb_error", "viscous_error"
    found, _ = shares({
        (): 1.0, (sides,): 0.4, (drift, sides): 0.1, (drift, coulomb, viscous): 0.13, (drift,): 0.9,
    }, BY_DIRECTION, (drift, sides))  # fmt: skip
    assert found == pytest.approx({"friction_drift": 0.3, "asymmetric_friction": 0.03})


def test_the_most_likely_fit_without_a_friction_by_direction_starts_from_its_mean_levels():
    """From the nominal numbers alone it ended in a wrong valley, and a doubled Coulomb friction was an asymmetry."""
    seen = []
    held = tuple(SimpleNamespace(name=name) for name in ("coulomb", "coulomb_difference", "viscous"))
    effect = SimpleNamespace(name="asymmetric_friction", parameters=held)
    values = {"inertia": 2.0, "coulomb": 0.6, "coulomb_difference": 0.1, "viscous": 0.03}
    candidate = SimpleNamespace(
        effects=(effect,), wide=frozenset({"inertia"}), structural=(effect.name,), values=lambda: values
    )
    fit = SimpleNamespace(candidate=candidate, evidence=0.0, undrowned=0.0)

    def fitted(starts):
        seen.extend(starts)
        return [SimpleNamespace(candidate=candidate, evidence=0.0, undrowned=0.0) for _ in starts]

    exact = SimpleNamespace(fit=fit, left=lambda one: 1.0)
    shares_of(SimpleNamespace(fitted=fitted), exact, fit, [])
    first, second, *_ = [start for start in seen if not start.effects]
    assert set(first.wide) == {"inertia", "coulomb", "viscous"}
    assert first.values == {"inertia": 2.0, "coulomb": 0.6, "viscous": 0.03}
    assert second.values == {}


def test_a_number_leads_a_part_by_the_evidence_that_is_lost_without_it():
    """Of no friction at all Coulomb and viscous friction each make up for most of the other's torque."""
    chosen, sizes = weighed("", 500.0, wide=("coulomb", "viscous")), {"viscous_error": 0.25, "coulomb_error": 0.02}
    for lost, word in ((0.6, "partly_explained"), (0.3, "unexplained")):
        both = {"viscous_error": lost, "coulomb_error": 0.15}
        assert judged(chosen, [], shares=sizes, lost=both, left=0.35).word == word
    # An effect does not.
    effect = weighed("stribeck", 500.0)
    rivals = [weighed("presliding", 400.0)]
    assert judged(effect, rivals, lost={"stribeck": 0.6}, left=0.35).word == "unexplained"
