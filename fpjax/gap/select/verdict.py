"""Verdict: what is asserted, and how probable it is; a pure function of a decision, of sizes and of thresholds."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..thresholds import THRESHOLDS, Thresholds
from .decision import Decision
from .dominant import believed, dominant
from .misread import told_readings, with_readings
from .nominal_errors import wrong_numbers
from .simpler import CONSTANT, FACTORS, ONE_FOR_MANY
from .statement import Seen, Verdict, Word, is_number
from .weighed import CONTAINED, Weighed


@dataclass(frozen=True)
class _Set:
    names: tuple[str, ...]  # the leading cause first
    worth: float  # in nats: of the chosen model, its evidence over the nominal model as given


def verdict(decision: Decision, seen: Seen, thresholds: Thresholds = THRESHOLDS) -> Verdict:
    """The word, the causes and the probabilities.

    Args:
        decision: of the fits.
        seen: sizes.
        thresholds: every number that decides.
    """
    told = _chosen_names(decision, seen, thresholds)
    case = _case(decision, seen, told, thresholds)
    if case.word == "unexplained":
        case = _led_by_another(decision, seen, told, thresholds) or case
    asserted = (case.sure or case.chosen.names) if case.word in ("explained", "partly_explained") else ()
    top = _top(case, seen, decision, thresholds)
    shares = _shares(case.sets, top, thresholds.temper)
    main, among = _by_effect(shares)
    right = _right(asserted, shares, main)
    found = Verdict(case.word, asserted, right, main, among, case.margin, case.lead)
    sizes = _sizes(decision, seen, thresholds)
    readings = tuple(name for name in told_readings(found, seen, thresholds) if name not in found.causes)
    # Beside a position that cannot be right nothing is known of the velocity column.
    if readings and not (seen.contradicted and found.word == "unexplained"):
        # As an effect is: beside several wrong numbers by what these leave of the gap.
        found = with_readings(found, readings, sizes.energy, sizes.whole, seen, thresholds)
    undecided = tuple(name for name in told if name not in found.causes) if case.sure else ()
    return replace(found, undecided=undecided)


@dataclass(frozen=True)
class _Case:
    """What speaks for causes of which the first leads."""

    chosen: _Set
    sets: list[_Set]  # that were tried
    margin: float  # as in `Verdict`
    lead: float  # `Verdict.ahead`
    word: Word
    sure: tuple[str, ...] = ()  # of the causes, where not all of them can be asserted


def _case(decision: Decision, seen: Seen, names: tuple[str, ...], t: Thresholds) -> _Case:
    chosen = _Set(names, decision.chosen.gain)
    sets = _sets(decision, chosen, seen, t)
    others = _others(sets, chosen, seen)
    margin = chosen.worth - max([0.0, *(s.worth for s in others)]) if names else 0.0
    lead = _lead(decision, chosen, margin, t)
    near = len({s.names[0] for s in others if chosen.worth - s.worth <= t.sure})
    return _Case(chosen, sets, margin, lead, _word(decision, seen, chosen, near, lead, t))


def _led_by_another(decision: Decision, seen: Seen, told: tuple[str, ...], t: Thresholds) -> _Case | None:
    """A part led by a cause that is nearly as large as the largest, in whose place others may stand; None for none.

    Of the other causes those are asserted that no set which holds it and does nearly as well can do without. Not where
    the causes together take no part of the whole gap, nor where the largest may be none.
    """
    if not told or told[0] in seen.unshown or not _left(seen, decision.whole, t) < t.part:
        return None
    for name in told[1:]:
        if is_number(name) or decision.shares[name] < t.leads * decision.shares[told[0]]:
            continue
        case = _case(decision, seen, (name, *(other for other in told if other != name)), t)
        if case.word != "partly_explained":
            continue
        enough = (1.0 - t.contested) * case.chosen.worth
        near = [one for one in case.sets if one.names[0] == name and one.worth >= enough]
        sure = tuple(n for n in case.chosen.names if all(n in one.names for one in near))
        return replace(case, sure=sure)
    return None


@dataclass(frozen=True)
class _Sizes:
    """How large each cause of the chosen model is.

    Attributes:
        order: by which causes are sorted.
        beside: of what no choice of the nominal numbers would have closed, an effect's share; a number's of the gap.
        energy: that it takes of the gap's, a number beside others as a guess.
        whole: energy of which an effect's size is a share, of the gap's.
    """

    order: dict[str, float]
    beside: dict[str, float]
    energy: dict[str, float]
    whole: float


def _sizes(decision: Decision, seen: Seen, t: Thresholds) -> _Sizes:
    """How large each cause is.

    A nominal number is measured by the whole gap, an effect by what no choice of the numbers would have closed: with
    numbers that are guesses, most of a gap is theirs, and what is sought stands beside them, unless it is slight beside
    the torque too. One number whose error matters is no guess: it comes where its share of the gap puts it. Of several
    effects, the one that follows the dominant variable comes before what mends its details.
    """
    left = float(np.clip(decision.nominal.left**2, 1e-12, 1.0))
    energy = {n: s * decision.whole**2 for n, s in decision.shares.items()}  # of the nominal model's
    guessed = sum(is_number(n) and share > t.matters for n, share in energy.items()) > 1
    whole = left if guessed else 1.0
    small = {n for n, s in energy.items() if not np.sqrt(s) * seen.share > t.slight}
    taken = {n: s if is_number(n) else s * believed(seen.curves, seen.follows.get(n, ()), t) for n, s in energy.items()}
    return _Sizes(
        {n: e if is_number(n) or n in small else e / whole for n, e in taken.items()},
        {n: e if is_number(n) else e / left for n, e in taken.items()},
        {n: e * whole if is_number(n) else e for n, e in taken.items()},
        whole,
    )


def _chosen_names(decision: Decision, seen: Seen, t: Thresholds) -> tuple[str, ...]:
    """The causes of the chosen model without which a share that matters would come back, the largest first.

    What takes less of the gap is told too if it brings a good part of the evidence; an effect also if it takes half of
    what no choice of the numbers would have closed; where evidence takes one number alone for wrong (however little the
    errors of others matter), only if it explains what that leaves.
    """
    sizes = _sizes(decision, seen, t)
    shown = decision.nominal.left * seen.share > t.nothing
    enough = t.beside if sum(map(is_number, decision.shares)) != 1 else 1.0 - t.closes**2
    weighs = {n for n, lost in decision.lost.items() if lost > t.weighs}
    names = [
        n
        for n in _in_order(sizes.order, seen, t)
        if decision.shares[n] > t.matters
        or (n in weighs and (shown or is_number(n)))
        or (shown and not is_number(n) and sizes.beside[n] > enough)
    ]
    if not names and not _counts_as_right(decision, t):
        names = list(decision.chosen.structural[:1])
    names = [n for n in names if n == names[0] or n not in seen.unshown]
    return tuple(n for n in names if not seen.allowed or n in seen.allowed)


def _counts_as_right(decision: Decision, t: Thresholds) -> bool:
    """Whether what the nominal model may be off by closes the gap: no number and no effect is missing that matters."""
    return decision.nominal.left < t.closes and max(decision.shares.values(), default=0.0) <= t.matters


def _in_order(size: Mapping[str, float], seen: Seen, t: Thresholds) -> list[str]:
    """Causes by their size, the largest first; effects that follow the dominant variable before the other effects.

    What follows no recorded variable (bristles, a spring) mends details beside a law of the one that dominates; a
    constant torque is part of every such law. Nominal numbers, and factors that stand for several of them, are free
    beside every curve and keep their places.
    """
    variable, order = dominant(seen.curves, t), sorted(size, key=lambda n: -size[n])
    effects = [n for n in order if not is_number(n) and n not in FACTORS]
    if variable is not None:
        effects = sorted(effects, key=lambda n: n != CONSTANT and variable.of not in seen.follows.get(n, ()))
    effect = iter(effects)
    placed = set(effects)
    return [next(effect) if n in placed else n for n in order]


def _sets(decision: Decision, chosen: _Set, seen: Seen, t: Thresholds) -> list[_Set]:
    """Every set of causes that was tried, once, with its greatest worth; the chosen one as it is asserted."""
    best: dict[tuple[str, ...], _Set] = {}
    told = set(decision.chosen.structural)
    shared = told | set(chosen.names)
    for w in (decision.nominal, *decision.singles, *decision.rivals):
        # The chosen causes with more beside them are the chosen ones with details, which were not worth a cause.
        if set(w.structural) == told or (told and set(w.structural) > told) or _adds_to(w, chosen, seen, decision, t):
            continue
        names = tuple(dict.fromkeys(seen.meaning.get(name, name) for name in _names(w, seen)))
        # It stands beside what leads, or else what it has in its place leads.
        names = tuple(sorted(names, key=lambda name: (name not in chosen.names[:1], name in shared)))
        own = _Set(names, decision.chosen.gain - max(w.behind(decision.chosen), 0.0))
        if own.names and (own.names not in best or best[own.names].worth < own.worth):
            best[own.names] = own
    return ([chosen] if chosen.names else []) + list(best.values())


def _adds_to(w: Weighed, chosen: _Set, seen: Seen, decision: Decision, t: Thresholds) -> bool:
    """Whether a model with an effect says no other thing, since its wrong nominal numbers say what leads.

    Where a wrong number leads, the model has the same number wrong; where a factor leads, it has several wrong in one
    direction, as the factor makes them together; so it has, and all too large, where a friction by load leads beside
    which every number is right.
    """
    if not chosen.names or not w.structural:
        return False
    lead = chosen.names[0]
    values, given = w.fit.candidate.values(), decision.exact.candidate.values()
    if (factors := set(w.structural) & set(FACTORS)) and not _beyond(lead, values, given, factors, t):
        return False
    by_load = lead in ONE_FOR_MANY and lead not in FACTORS
    if lead in FACTORS or (by_load and not decision.chosen.fit.candidate.wide):
        wrong = wrong_numbers(w.fit, seen.sizes)[1] if len(w.fit.candidate.wide) > 1 else ()
        ways = {values[name] > given[name] for name in wrong}
        return len(wrong) > 1 and len(ways) == 1 and (True in ways or not by_load)
    number = lead.removesuffix("_error")
    return is_number(lead) and number in w.fit.candidate.wide and number in wrong_numbers(w.fit, seen.sizes)[1]


def _beyond(
    lead: str, values: Mapping[str, float], given: Mapping[str, float], factors: Iterable[str], t: Thresholds
) -> bool:
    """Whether what leads is a wrong number that is far further off than factors beside it could make it."""
    number = lead.removesuffix("_error")
    if not is_number(lead) or not min(values[number], given[number]) > 0.0:
        return False
    made = sum(abs(np.log(values[FACTORS[name]])) for name in factors)
    return bool(abs(np.log(values[number] / given[number])) > t.beyond_factor * made)


def _names(w: Weighed, seen: Seen) -> tuple[str, ...]:
    if w.structural:
        return w.structural
    return tuple(f"{n}_error" for n in wrong_numbers(w.fit, seen.sizes)[1])


def _others(sets: Sequence[_Set], chosen: _Set, seen: Seen) -> list[_Set]:
    """Sets of causes without the leading one, nor what makes the same log in its place.

    A backlash holds a compliance as a special case, and makes the same log by being it.
    """
    if not chosen.names:
        return []
    lead = chosen.names[0]
    alike = {lead, *seen.twins.get(lead, ()), *(name for name, special in CONTAINED.items() if lead == special)}
    return [s for s in sets if not alike & set(s.names)]


def _word(decision: Decision, seen: Seen, chosen: _Set, near: int, lead: float, t: Thresholds) -> Word:
    # Beside a limit of the torque, of what the drive gives.
    left = _left(seen, decision.whole, t)
    # A gap below the noise floor may still be explained: evidence sums over all windows, the rms does not.
    hidden = (seen.before < seen.floor or seen.share < t.slight) and decision.chosen.gain < t.chance
    if seen.share < t.nothing or hidden or _counts_as_right(decision, t):
        return "no_gap"
    # Of a slight one that they do not close, causes are no more than details of a machine that is right.
    if seen.share < t.slight and not left < t.closes and not seen.contradicted:
        return "no_gap"
    if seen.contradicted or (chosen.names and chosen.names[0] in seen.unshown):
        return "unexplained"
    missing = seen.share * decision.whole * left  # of the commanded torque, hardly more than it is
    # A cause is reported with what this log cannot distinguish from it; a class of everything says nothing.
    few = bool(chosen.names) and (near <= t.alike or is_number(chosen.names[0]))
    if few and (left < t.closes or missing < t.nothing):
        return "explained"
    sure = few and (near == 0 or is_number(chosen.names[0]))
    if chosen.names and is_number(chosen.names[0]):
        # Coulomb and viscous friction make up for much of each other's torque: one is needed where its evidence is.
        lead = max(lead, decision.lost.get(chosen.names[0], 0.0))
    # Where much is left, a cause that is not far ahead may be the one that bends best: pushes pass for a soft spring.
    if not (sure and lead >= t.clear) or (_bends(seen, chosen, t) and not is_number(chosen.names[0])):
        return "unexplained"
    return (
        "partly_explained"
        if seen.after < seen.before
        and (min(left, seen.moved / decision.whole) < t.part or (left < 1.0 and _follows_dominant(seen, chosen, t)))
        else "unexplained"
    )


def _left(seen: Seen, whole: float, t: Thresholds) -> float:
    """What the causes leave of the missing torque [1], beyond what noise alone shows, as the share closed is told.

    What rounding makes in a log's own motion is none of it: energies, since it has nothing to do with the torque.
    """
    before, after = (
        float(np.sqrt(max(each**2 - seen.of_rounding**2, 0.0))) for each in (seen.before * whole, seen.after)
    )
    if before > t.above_noise * seen.floor:
        return max(after - seen.floor, 0.0) / (before - seen.floor)
    return after / before if before > 0.0 else 1.0


def _bends(seen: Seen, chosen: _Set, t: Thresholds) -> bool:
    """Whether a table of one variable holds more than all the named causes do: they only bend after it.

    A law with a name may hold a little less than the table of its own variable. Where the causes close the gap as far
    as it moves the machine, and the numbers alone do not, nothing is left that a table could hold instead.
    """
    if seen.moved < t.closes <= seen.moved_by_numbers:
        return False
    followed = {variable for name in chosen.names for variable in seen.follows.get(name, ())}
    # Where simulations show that the effects take more of what moves the machine than the curves' measure says, that
    # counts: what they take beyond the nominal numbers, which no effect is to be credited with.
    held = max(seen.named, seen.moved_by_numbers**2 - seen.moved**2)
    return any(
        curve.evidence > t.decisive and (t.curve_named if variable in followed else 1.0) * curve.share > held
        for variable, curve in seen.curves.items()
    )


def _follows_dominant(seen: Seen, chosen: _Set, t: Thresholds) -> bool:
    """Whether the missing torque is a law of the variable that the leading cause follows, and nearly that law.

    Then the machine shows that it lacks such a law, however much else it lacks.
    """
    found = dominant(seen.curves, t)
    if found is None or found.of not in seen.follows.get(chosen.names[0], ()):
        return False
    return seen.named > t.curve_named * found.share


def _lead(decision: Decision, chosen: _Set, margin: float, t: Thresholds) -> float:
    """How far the leading cause is beyond the others' reach [1].

    Of what the chosen model is worth, what no model without the cause is. Every model frees the nominal numbers, so
    that a wrong one is beside any effect: it leads by what would come back without it, of what all causes take, or of
    half of the gap where they take less.
    """
    if not chosen.names:
        return 0.0
    if is_number(chosen.names[0]):
        taken = max(1.0 - min(decision.chosen.left, 1.0) ** 2, 1.0 - t.part**2)
        return float(np.clip(decision.shares.get(chosen.names[0], 0.0) * decision.whole**2 / taken, 0.0, 1.0))
    return float(np.clip(margin / decision.chosen.gain, 0.0, 1.0)) if decision.chosen.gain > 0.0 else 0.0


def _top(case: _Case, seen: Seen, decision: Decision, t: Thresholds) -> float:
    """Probability that any of the sets tried is right."""
    if case.word == "no_gap":
        # A slight gap that is not closed, though effects bring evidence: one of them may be the cause of it.
        slight = seen.share >= t.nothing and seen.before >= seen.floor and decision.chosen.gain >= t.chance
        return t.right_unexplained[0] if slight and not _counts_as_right(decision, t) else t.right_no_gap
    if case.word == "partly_explained" and is_number(case.chosen.names[0]):
        return t.right_partly_number
    if case.word == "partly_explained" and not _left(seen, decision.whole, t) < t.part:
        return t.right_dominant
    table = {
        "explained": t.right_explained, "partly_explained": t.right_partly, "unexplained": t.right_unexplained,
    }  # fmt: skip
    return table[case.word][0 if case.lead >= t.clear else 2 if case.lead < t.contested else 1]


def _shares(sets: Sequence[_Set], top: float, temper: float) -> list[tuple[_Set, float]]:
    if not sets:
        return []
    worth = np.array([s.worth if np.isfinite(s.worth) else -1e30 for s in sets])
    # Relative to the best, so that no exponential overflows; below exp(-700) lies what double precision cannot hold.
    odds = np.exp(np.maximum((worth - np.max(worth)) / temper, -700.0))
    return list(zip(sets, (top * odds / np.sum(odds)).tolist(), strict=True))


def _by_effect(shares: Sequence[tuple[_Set, float]]) -> tuple[dict[str, float], dict[str, float]]:
    main: dict[str, float] = {}
    among: dict[str, float] = {}
    for found, share in shares:
        main[found.names[0]] = main.get(found.names[0], 0.0) + share
        for name in found.names:
            among[name] = among.get(name, 0.0) + share
    return main, among


def _right(asserted: Sequence[str], shares: Sequence[tuple[_Set, float]], main: Mapping[str, float]) -> float:
    """Probability that the asserted causes are right [1], whatever else is; without any, that no set tried is."""
    if not asserted:
        return max(1.0 - sum(main.values()), 0.0)
    return sum(share for found, share in shares if set(asserted) <= set(found.names))
