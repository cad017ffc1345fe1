"""Decision: which causes, from fits that no longer change, and the order in which they were tried."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...logs.arrays import Values
from ..effects.effect import Effect
from ..fit.candidate import Fit, Start, nominal_sizes
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .detectability import blurs, resolved
from .dominant import Curve
from .late_place import late_elsewhere
from .nominal_errors import wrong_numbers
from .shares import Shares, lost_of, numbers_of, shares_of, without_effect
from .simpler import ONE_FOR_MANY, alike_factor, simpler
from .starts import alone, bases_beside, bases_of, beside, nominal_for
from .weighed import (
    Exact,
    Weighed,
    first_settled,
    gap_share,
    judged_windows,
    moving_windows,
    settled,
    weigh,
    weighed_fit,
    whole_gap,
)  # fmt: skip
from .wild_numbers import STRIBECK, far_off, mends_numbers, plausible, with_right_numbers

LIKELY = 6  # effects that are tried as a third cause: those that did best as a second one
PAIR_KEEP = (16, 8, 5, 4)  # sets of causes that go on to each stage where causes are added


@dataclass(frozen=True)
class Decision:
    """What the fits led to.

    Attributes:
        exact: the nominal model as given.
        nominal: the nominal model with the numbers that are wrong.
        singles: every effect alone, the most likely first.
        chosen: the model that is reported.
        rivals: models with as many effects as the chosen one, the most likely first.
        path: the ladder from `exact` to `chosen`.
        shares: of the missing energy that counts as all (`whole`), what would come back without each cause of `chosen`
            [1], the largest first; of what moves the machine alone where `by_numbers` was asked so.
        judged: windows on which models were compared, one array of indices a record.
        alike: by cause, those that would do as well in its place.
        whole: missing torque that counts as all beside `chosen` (`whole_gap`), of the nominal model's [1].
        lost: of the evidence that `chosen` has over `exact`, what would be lost without each of its causes [1].
        factor: `chosen` with one factor that does as well as all its wrong numbers (`fpjax.gap.select.simpler`).
    """

    exact: Fit
    nominal: Weighed
    singles: tuple[Weighed, ...]
    chosen: Weighed
    rivals: tuple[Weighed, ...]
    path: tuple[Fit, ...]
    shares: dict[str, float]
    judged: tuple[Values, ...]
    alike: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    whole: float = 1.0
    lost: Mapping[str, float] = field(default_factory=dict)
    factor: Weighed | None = None


@dataclass(frozen=True)
class Alone:
    """What is fitted before anything is chosen.

    Attributes:
        given: the nominal model as given.
        fits: its numbers freed, and every effect beside them.
    """

    given: Fit
    fits: tuple[Fit, ...]


def fit_alone(search: Search, stage: Callable[[str, float], None]) -> Alone:
    """Fit the nominal numbers and every effect alone; the arguments are those of `decide`."""
    search.tick = lambda share: stage("effects alone", share)
    stage("effects alone", 0.0)
    given = search.finish([search.exact])[0]
    return Alone(given, tuple(search.explore(alone(search))))


def decide(
    search: Search,
    stage: Callable[[str, float], None],
    curves: Mapping[str, Curve] | None = None,
    first: Alone | None = None,
) -> Decision:
    """Fit effects alone, then together while more than one is needed, then details beside them.

    Args:
        search: of the logs.
        stage: called with (name of the stage, share of the stage that is done [1]).
        curves: what a table of each recorded variable holds.
        first: what `fit_alone` gave of this search; None to fit it here.
    """

    def begin(name: str) -> None:
        search.tick = lambda share: stage(name, share)
        stage(name, 0.0)

    first = fit_alone(search, stage) if first is None else first
    given, fits = first.given, first.fits
    exact = Exact(given, judged_windows(given, fits, moving_windows(search.records)), curves or {})
    weighed = weigh(search, exact, fits)
    nominal = next(w for w in weighed if not w.structural)
    singles = [w for w in weighed if w.structural]
    chosen, numbers = first_settled(search, exact, weighed), settled(search, exact, nominal)
    if not _better(search, exact, numbers, chosen):
        chosen = numbers  # an effect alone that hardly takes more torque than wrong numbers do is a detail beside them
    tried = list(weighed)
    rivals, path, likely = weighed, [exact.fit], [effect.name for effect in search.effects]
    # Without a gap nothing will be told of causes, nor of details beside them.
    gap = gap_share(search, given) >= THRESHOLDS.nothing
    most = THRESHOLDS.most_causes if gap else 1
    for size in range(2, most + 1):
        missing = exact.left(chosen.fit) / _whole_left(search, exact, chosen.fit, nominal)
        # Where the causes explain the gap, what more there is are details beside them; beside numbers alone every
        # effect was tried already.
        explained = missing <= THRESHOLDS.closes
        if missing <= (THRESHOLDS.no_better if chosen.structural else THRESHOLDS.closes):
            break
        begin(f"effects together ({size})")
        bases = bases_of(singles) if size == 2 and not explained else bases_beside(chosen, rivals)
        found = weigh(search, exact, search.explore(beside(search, bases, likely), PAIR_KEEP, white=False))
        tried += found
        best = _further(search, exact, chosen, found, nominal)
        if best is None:
            break
        path.append(chosen.fit)
        chosen, rivals = best, found
        # What was no use beside one cause is hardly any beside two.
        likely = list(dict.fromkeys(name for w in found for name in w.structural))[: LIKELY + size]
    search.tick = lambda share: None  # what follows has no share of its own

    def with_law(one: Weighed) -> Weighed:
        """`plausible` of a model, written down where it is another one."""
        nonlocal rivals
        instead, found = plausible(search, exact, with_right_numbers(search, exact, one, tried), singles)
        if instead is not one:
            path.append(one.fit)
            tried.extend(found)
            rivals = found or rivals
        return instead

    chosen = with_law(_pruned(search, exact, chosen))
    stage("simpler causes", 0.0)
    # Before anything simpler is tried: without a Stribeck friction the Coulomb and viscous numbers stand for it too,
    # and are no more wrong by one factor. Beside what is simpler it may be sure where beside the rest it was not.
    if gap:
        chosen, found = _with_stribeck(search, exact, chosen, nominal)
        tried += found
        chosen, found = late_elsewhere(search, exact, chosen)
        tried += found
        rivals = sorted((*rivals, *found), key=lambda one: -one.worth)
    plain = simpler(search, exact, chosen)
    if gap and plain is not chosen:
        plain, found = _with_stribeck(search, exact, plain, nominal)
        tried += found
        plain = with_law(plain)  # what is simpler has numbers of its own, where a friction by direction held them
    chosen = plain
    stage("what each cause takes", 0.0)
    chosen, shares = _with_numbers(search, exact, chosen, [w.fit for w in tried])
    all_of_it = exact.left(exact.fit)
    whole = whole_gap(search, exact, chosen.fit) / all_of_it if all_of_it > 0.0 else 1.0
    return Decision(
        exact.fit, nominal, tuple(singles), chosen, tuple(rivals), (*path, chosen.fit), shares.energy, exact.judged,
        shares.alike, whole, shares.evidence, alike_factor(search, exact, chosen) if gap else None,
    )  # fmt: skip


def near_models(decision: Decision) -> list[Weighed]:
    """Models that lack less of the chosen one's worth than what makes a cause sure (`clear`), the most worth first.

    Args:
        decision: on the fits.
    """
    enough = (1.0 - THRESHOLDS.clear) * decision.chosen.worth
    tried = (decision.nominal, *decision.singles, *decision.rivals)
    return sorted((w for w in tried if w.worth > max(enough, 0.0)), key=lambda w: -w.worth)


def by_numbers(search: Search, decision: Decision, *, moving: bool = False) -> Decision:
    """The same decision without an effect: what the nominal numbers alone are to blame for.

    Args:
        search: of the logs.
        decision: with effects.
        moving: whether missing torque counts as far as it moves the machine alone.
    """
    exact = Exact(decision.exact, decision.judged, moving=moving)
    nominal = weighed_fit(search, exact, decision.nominal.fit, decision.nominal.evidence)
    numbers, singles = settled(search, exact, nominal), decision.singles
    if moving:  # what competes is weighed alike
        found = [weighed_fit(search, exact, w.fit, w.evidence) for w in singles]
        singles = tuple(sorted(found, key=lambda w: -w.worth))
    shares = shares_of(search, exact, numbers.fit, [w.fit for w in (nominal, *singles)])
    path = (decision.exact, numbers.fit)
    return replace(
        decision, nominal=nominal, singles=singles, chosen=numbers, rivals=singles, path=path,
        shares=shares.energy, alike=shares.alike, whole=1.0, lost=shares.evidence,
        factor=alike_factor(search, exact, numbers),
    )  # fmt: skip


def _whole_left(search: Search, exact: Exact, fit: Fit, nominal: Weighed) -> float:
    """What a further cause is a share of [N m]: the whole gap, or what guessed numbers leave of it.

    With numbers that are guesses most of the gap is theirs, and what is sought stands beside them.
    """
    left, whole = exact.left(fit), whole_gap(search, exact, fit)
    if len(wrong_numbers(nominal.fit, nominal_sizes(search.setting))[1]) > 1 and _is_gap(search, left):
        whole *= min(nominal.left, 1.0)
    return max(whole, 1e-300)


def _is_gap(search: Search, missing: float) -> bool:
    """Whether a missing torque [N m] is one that counts, beside the commanded torque of the logs."""
    torque = np.concatenate([record.torque for record in search.records])
    return missing > THRESHOLDS.nothing * float(np.sqrt(np.mean(torque**2)))


def _better(search: Search, exact: Exact, chosen: Weighed, best: Weighed) -> bool:
    """Whether a further cause is sure, and takes a share of what is left that matters, or some and is worth much more.

    One that leaves more torque than before follows details (a resonance, a sensor's timing) at the others' cost.
    """
    before, after = exact.left(chosen.fit), exact.left(best.fit)
    removed = 1.0 - (after / before) ** 2 if before > 0.0 else 0.0
    more = best.worth / max(chosen.worth, 1e-300) - 1.0
    return best.evidence - chosen.evidence > THRESHOLDS.decisive and (
        removed > THRESHOLDS.removes or (removed > 0.0 and more > THRESHOLDS.adds)
    )


def _further(
    search: Search, exact: Exact, chosen: Weighed, found: Sequence[Weighed], nominal: Weighed
) -> Weighed | None:
    """The likeliest model with a further cause that is worth it, its numbers settled; None for none."""
    for weighed in found:
        best = settled(search, exact, weighed)
        if best is not weighed and not resolved(search, best.fit):
            continue
        if not _better(search, exact, chosen, best):
            return None
        whole = _whole_left(search, exact, best.fit, nominal)
        if mends_numbers(search, exact, chosen.fit, best.fit) or not _only_blurs(exact, chosen, best, whole):
            return best
    return None


def _only_blurs(exact: Exact, chosen: Weighed, best: Weighed, whole: float) -> bool:
    """Whether a further cause is a detail beside which the parameters of those that are there are known less well.

    One that brings a fifth of the evidence (`weighs`) is no detail, however little torque it takes.

    Args:
        exact: what models are weighed against.
        chosen: without the cause.
        best: with it.
        whole: what a cause is a share of [N m].
    """
    if not set(chosen.structural) < set(best.structural):
        return False
    if lost_of(exact.fit, best.fit, chosen.fit) > THRESHOLDS.weighs:
        return False
    takes = exact.left(chosen.fit) ** 2 - exact.left(best.fit) ** 2
    return takes < THRESHOLDS.matters * whole**2 and blurs(chosen.fit, best.fit)


def _pruned(search: Search, exact: Exact, chosen: Weighed) -> Weighed:
    """Without the effects that the rest of a larger model can do without."""
    while len(chosen.structural) > 1:
        options = [_without(chosen.fit, effect) for effect in chosen.fit.candidate.effects]
        found = weigh(search, exact, search.explore(options, white=False))
        best = settled(search, exact, found[0])
        if _better(search, exact, best, chosen):
            return chosen
        chosen = best
    return chosen


def _without(fit: Fit, effect: Effect) -> Start:
    """A fitted model without one of its effects, the nominal numbers free that are so beside the rest."""
    c = fit.candidate
    rest = tuple(e for e in c.effects if e is not effect)
    return Start(rest, nominal_for(*rest)[0], without_effect(c.values(), effect, rest), c)


def _with_stribeck(
    search: Search, exact: Exact, chosen: Weighed, nominal: Weighed
) -> tuple[Weighed, Sequence[Weighed]]:
    """(the chosen model, with a Stribeck friction if that is sure beside it; what was tried).

    However little torque it takes, but not where it only blurs the causes: hardly a bearing has none, and without it
    the Coulomb and viscous numbers stand for it, 8 % too large and 34 % too small to leave a hundredth of the torque
    more. (A drag beside it followed the form of its law, to their cost.)
    """
    starts = beside(search, [chosen], [STRIBECK])
    if not starts:
        return chosen, []
    found = weigh(search, exact, search.explore(starts, PAIR_KEEP, white=False))
    best = settled(search, exact, found[0])
    sure = best.evidence - chosen.evidence > THRESHOLDS.decisive and exact.left(best.fit) < exact.left(chosen.fit)
    # One of no torque is none, though a better valley of the other parameters was found beside it.
    none = "stribeck_torque" in best.fit.candidate.at_bound()
    if none or not (sure and resolved(search, best.fit)):
        return chosen, found
    blurs_them = _only_blurs(exact, chosen, best, _whole_left(search, exact, best.fit, nominal))
    return chosen if blurs_them else best, found


def _with_numbers(search: Search, exact: Exact, chosen: Weighed, known: Sequence[Fit]) -> tuple[Weighed, Shares]:
    """(the chosen model with wrong numbers in the place of every effect that they make up for, its causes' shares).

    One after the other: each is a detail beside what is left, though all together may take more than one may.
    """
    while True:
        shares = shares_of(search, exact, chosen.fit, known)
        instead = _numbers_instead(search, exact, chosen, shares)
        if instead is chosen:
            return chosen, shares
        chosen = instead


def _numbers_instead(search: Search, exact: Exact, chosen: Weighed, shares: Shares) -> Weighed:
    """The chosen model with wrong numbers in the place of one effect that they make up for, and that is a detail.

    A friction by direction holds numbers of its own, a factor makes several wrong in proportion, and a law of the speed
    beside numbers that are further off than a guess may stand for the very numbers: a drag with fifteen times the
    Coulomb friction and no viscous one, in one direction; a soft spring that takes half of a double inertia off. What
    is no cause is first of all a number that was guessed: it then stands corrected in the model, which holds no effect
    for it.

    Args:
        search: of the logs.
        exact: what models are weighed against.
        chosen: with the effect.
        shares: of its causes.
    """
    whole, off = whole_gap(search, exact, chosen.fit), far_off(search, exact, chosen.fit)
    for effect in chosen.fit.candidate.effects:
        held = bool(numbers_of(effect))
        for_them = bool(off & {name.removesuffix("_error") for name in shares.alike.get(effect.name, ())})
        small = shares.energy[effect.name] <= THRESHOLDS.matters
        if not (for_them or (small and (held or effect.name in ONE_FOR_MANY))):
            continue
        (fit,) = search.fitted([_without(chosen.fit, effect)])
        # Of what holds numbers the evidence is that they are wrong, unless these leave a gap of their own.
        weighs = shares.evidence[effect.name] > THRESHOLDS.weighs and (not held or _is_gap(search, exact.left(fit)))
        if weighs and fit.evidence < chosen.fit.evidence:
            continue  # a cause by its evidence, and the likelier of the two
        back = exact.left(fit) ** 2 - exact.left(chosen.fit) ** 2
        if back < THRESHOLDS.matters * whole**2 and resolved(search, fit):
            evidence = wrong_numbers(fit, nominal_sizes(search.setting))[0]
            return settled(search, exact, weighed_fit(search, exact, fit, evidence))
    return chosen
