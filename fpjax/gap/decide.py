"""Decide: alone, then together; forward with a swap of what came first; when to stop, and what is left."""

from dataclasses import replace

import numpy as np

from .attribute import Fitted, Progress, Search
from .causes import one_less, one_more, simpler
from .decision import Decision
from .effect import Effect
from .fit import Candidate
from .hints import known_torque, position_hints
from .judging import DECISIVE, energy, judge, material, quantised_reading, weigh, white

MOST_CAUSES = 3
PATIENCE = 12.0  # s of simulation (`Search.spent`) after which no further cause is looked for
EXPLAINED_SHARE = 0.97  # of the gap's rms above the noise that must be closed where some structure is left
NEARLY = 15.0  # and residual energy over the noise's up to which it may: one law that is another one of its kind
NEARLY_TOGETHER = 2.0  # the same of several causes: a flexible machine with a second cause nearly explains very much
NEARLY_IN_TORQUE = 2.5  # the same where the gap is told in torque; below it no further cause is looked for either
CORNERS = 0.4  # of a torque's floor that the corners of one made log may be off: a gap must stand out of that
LEAST_TURN = 0.02  # rad that a position at the log's start must move to be another one


def decide(search: Search, progress: Progress) -> Decision:
    """The whole search on one machine's logs."""
    progress("nominal model", 0.02)
    if search.setting.unknown_origin:
        _set_origin(search, min(_turned(search, (), {}, "fixed"), key=lambda c: c.cost))
    exact, null = _without_effects(search)
    screen = search.screening(exact.train)
    progress("every effect alone", 0.1)
    options = [((effect,), start) for effect in search.effects for start in effect.starts(search.setting)]
    singles = _alone(search, options, screen, [exact, null])
    if search.setting.unknown_origin and _turn_again(search, singles[:2]):
        # The gap itself had turned the origin: with the right one, everything again.
        exact, null = _without_effects(search)
        singles = _alone(search, options, screen, [exact, null])
    best = singles[0]
    decision = Decision(exact, null, singles, [exact])
    # Where the reading is rounded that is a cause already: beside it nothing is asserted that small errors of the
    # nominal values do as well.
    least = null if quantised_reading(search) else exact
    surely = (best.evidence - least.evidence) * search.colour > DECISIVE and material(search, least, best)
    judge(search, decision, least)
    if not surely or (search.imposed and decision.structure < white(search, least) + CORNERS):
        decision.path = [least]
        decision.rivals = singles
        decision.explained = decision.structure < white(search, least) + (CORNERS if search.imposed else 0.0)
        return decision
    decision.gap = True
    decision.path.append(best)
    judge(search, decision, best)
    decision.rivals = singles
    while len(decision.path) <= MOST_CAUSES:
        # In torque, what is left near the floor may be the corners of reversals, which a compliance smooths as well.
        if decision.structure < (NEARLY_IN_TORQUE if search.imposed else white(search, decision.chosen)):
            break
        if search.spent > PATIENCE:
            break
        progress(f"a cause beside {' + '.join(decision.chosen.names)}", 0.3 + 0.2 * len(decision.path))
        if not one_more(search, decision, screen):
            break
    while len(decision.path) > 2 and not decision.weak and one_less(search, decision):
        pass
    if not decision.weak:
        simpler(search, decision)
    if decision.chosen.candidate.family.key[0] == "transmission" and not search.imposed:
        decision.path[-1] = search.refined(decision.chosen)
    judge(search, decision, decision.chosen)
    before, after = energy(search, exact), energy(search, decision.chosen)
    closed = 1.0 - (np.sqrt(after) - np.sqrt(decision.floor)) / max(np.sqrt(before) - np.sqrt(decision.floor), 1e-12)
    together = NEARLY_TOGETHER if len(decision.chosen.names) > 1 else NEARLY
    most = NEARLY_IN_TORQUE if search.imposed else together
    nearly = closed > EXPLAINED_SHARE and decision.structure < most and not decision.weak
    decision.explained = decision.structure < white(search, decision.chosen) or nearly
    return decision


def _without_effects(search: Search) -> list[Fitted]:
    """The nominal model as given, and with its three numbers free under the prior."""
    candidates = [search.candidate((), {}, "fixed"), search.candidate((), {})]
    search.fit(candidates, search.train, 10)
    return search.finish(candidates)


def _alone(
    search: Search, options: list[tuple[tuple[Effect, ...], dict[str, float]]], screen: list[np.ndarray], more: list
) -> list[Fitted]:
    """Every effect alone, best first."""
    singles = search.best_of(options, screen)
    weigh(search, [*more, *singles])
    return sorted(singles, key=lambda f: -f.evidence)


def _turned(search: Search, effects: tuple[Effect, ...], values: dict[str, float], nominal: str) -> list[Candidate]:
    """A model from twelve positions at the log's start, fitted."""
    turns = [search.candidate(effects, values | {"origin": angle}, nominal) for angle in np.arange(12) * np.pi / 6]
    search.fit(turns, search.train, 6)
    return turns


def _set_origin(search: Search, candidate: Candidate) -> None:
    """Every model starts from the position that this one found."""
    found = candidate.values()["origin"]
    record = max(search.records, key=lambda record: len(record.time))
    hints = position_hints(record, search.setting, known_torque(record, search.nominal.plant.load, found))
    nominal = {**search.setting.nominal, "origin": found}
    search.setting = replace(search.setting, nominal=nominal, hints=hints)


def _turn_again(search: Search, leading: list[Fitted]) -> bool:
    """Whether another position at the log's start fits far better once the leading effects are in; then it is set."""
    for fitted in leading:
        c = fitted.candidate
        best = min(_turned(search, c.effects, c.values(), "prior"), key=lambda turn: turn.cost)
        turned = np.angle(np.exp(1j * (best.values()["origin"] - c.values()["origin"])))
        if abs(turned) > LEAST_TURN and best.chi_square < 0.5 * c.chi_square:
            _set_origin(search, best)
            return True
    return False
