"""Decide: alone, then together; forward with a swap of what came first; when to stop, and what is left."""

from dataclasses import dataclass, field, replace

import numpy as np

from . import assemble
from .attribute import Fitted, Progress, Search
from .effect import Effect
from .fit import Candidate
from .hints import known_torque, position_hints
from .imposed import noise_torque
from .measure import correlation_time, sure_gain

MOST_CAUSES = 3
PATIENCE = 12.0  # s of simulation (`Search.spent`) after which no further cause is looked for
MATERIAL = (
    0.01  # share of the residual energy that a cause must remove to be one; rounding is no noise: five times as much
)
DECISIVE = 8.0  # log evidence by which a cause must beat its absence
WHITE = 1.04  # residual energy over what its own differences say is noise; above it there is structure
EXPLAINED_SHARE = 0.97  # of the gap's rms above the noise that must be closed where some structure is left
TOLERANCE = 1.1  # to which the noise of a torque is known that was told from positions
NEARLY = 15.0  # and residual energy over the noise's up to which it may: a law that is another one of its kind
REMOVES = 0.5  # a further cause must remove this share of the energy that is left above the noise
BARELY = 0.1  # of the noise's energy that a cause must close beyond a simpler one that it contains
SIMPLER = {
    "asymmetric_friction": (
        ("coulomb_error",),
        ("viscous_error",),
        ("constant_torque",),
        ("viscous_error", "constant_torque"),
    ),
    "backlash": (("compliance",),),
}  # what a cause holds as a special case, with fewer parameters
WHITE_ROUNDED = 1.5  # the same of a rounded reading, whose error has up to three times the energy of even rounding
WHITE_WITH_PLAY = 1.3  # the same of a play, whose contacts a step of finite length blurs
LEAST_TURN = 0.02  # rad that a position at the log's start must move to be another one
RATTLES = 0.2  # share of the windows, best and worst, that the energy of hidden states is judged without
WEAK = 0.02  # of the withheld energy that is left: a further cause that removes less is not worth a name
MORE = (14, 10, 5, 2)
FEW = (8, 6, 4, 2)  # sets of causes that go on after the screening and after each stage
IMPOSSIBLE = ({"presliding", "compliance"}, {"presliding", "backlash"}, {"compliance", "backlash"})


@dataclass
class Decision:
    """What the search found.

    Attributes:
        exact: the nominal model as given.
        null: the nominal model with its three numbers free under the prior.
        singles: every effect alone, best first.
        path: the model after each cause, the nominal one first.
        chosen: the last of the path.
        rivals: sets of effects that compete with the chosen one, itself included, best first.
        floor: residual energy per sample that is noise [1, in the estimated noise's variance].
        structure: residual energy of the chosen model over the floor [1].
        explained: the causes close the gap.
        gap: the nominal model is rejected.
        weak: how many causes at the path's end withheld data want although they leave most of the gap.
    """

    exact: Fitted
    null: Fitted
    singles: list[Fitted]
    path: list[Fitted]
    rivals: list[Fitted] = field(default_factory=list)
    floor: float = 1.0
    structure: float = 1.0
    explained: bool = False
    gap: bool = False
    weak: int = 0

    @property
    def chosen(self) -> Fitted:
        """The model with all causes in."""
        return self.path[-1]

    @property
    def leading(self) -> Fitted:
        """The model with the causes that each remove a good part of what is left."""
        return self.path[-1 - self.weak]


def decide(search: Search, progress: Progress) -> Decision:
    """The whole search on one machine's logs."""
    progress("nominal model", 0.02)
    if search.setting.unknown_origin:
        _set_origin(search, min(_turned(search, (), {}, "fixed"), key=lambda c: c.cost))
    exact_candidate, null_candidate = search.candidate((), {}, "fixed"), search.candidate((), {})
    search.fit([exact_candidate, null_candidate], search.train, 10)
    exact, null = search.finish([exact_candidate, null_candidate])
    screen = search.screening(exact.train)
    progress("every effect alone", 0.1)
    options = [((effect,), start) for effect in search.effects for start in effect.starts(search.setting)]
    singles = _alone(search, options, screen, [exact, null])
    if search.setting.unknown_origin and _turn_again(search, singles[:2]):
        # The gap itself had turned the origin: with the right one, everything again.
        exact_candidate, null_candidate = search.candidate((), {}, "fixed"), search.candidate((), {})
        search.fit([exact_candidate, null_candidate], search.train, 10)
        exact, null = search.finish([exact_candidate, null_candidate])
        singles = _alone(search, options, screen, [exact, null])
    best = singles[0]
    decision = Decision(exact, null, singles, [exact])
    _judge(search, decision, best)
    # Where the reading is rounded that is a cause already: beside it nothing is asserted that small errors of the
    # nominal values do as well.
    least = null if search.records[0].channel.step > 0 else exact
    if (best.evidence - least.evidence) * search.colour < DECISIVE or not _material(search, least, best):
        decision.path = [least]
        _judge(search, decision, least)
        decision.rivals = singles
        decision.explained = decision.structure < _white(search, least)
        return decision
    decision.gap = True
    decision.path.append(best)
    decision.rivals = singles
    while len(decision.path) <= MOST_CAUSES:
        if decision.structure < _white(search, decision.chosen):
            break
        if search.spent > PATIENCE:
            break
        progress(f"a cause beside {' + '.join(decision.chosen.names)}", 0.3 + 0.2 * len(decision.path))
        if not _one_more(search, decision, screen):
            break
    while len(decision.path) > 2 and not decision.weak and _one_less(search, decision):
        pass
    if not decision.weak:
        _simpler(search, decision)
    if decision.chosen.candidate.family.key[0] == "transmission" and not search.imposed:
        decision.path[-1] = search.refined(decision.chosen)
    _judge(search, decision, decision.chosen)
    before, after = energy(search, exact), energy(search, decision.chosen)
    closed = 1.0 - (np.sqrt(after) - np.sqrt(decision.floor)) / max(np.sqrt(before) - np.sqrt(decision.floor), 1e-12)
    nearly = closed > EXPLAINED_SHARE and decision.structure < (1.5 if search.imposed else NEARLY) and not decision.weak
    decision.explained = decision.structure < _white(search, decision.chosen) or nearly
    return decision


def _white(search: Search, fitted: Fitted) -> float:
    """Residual energy over the noise's up to which nothing is left to find."""
    if search.records[0].channel.step > 0:
        return WHITE_ROUNDED
    return WHITE_WITH_PLAY if search.has_play(fitted.candidate) else WHITE


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


def weigh(search: Search, fitted: list[Fitted]) -> None:
    """Log evidence of every model on one scale: fitted and withheld windows, priors, and BIC's price for a
    parameter; divided by the autocorrelation time of the best model's residual, because neighbours are one witness.
    """
    best = min((f for f in fitted if np.isfinite(f.total)), key=lambda f: f.total)
    scale = best.total / search.count
    search.colour = colour(search, best)
    for f in fitted:
        own = {p.name for effect in f.candidate.effects for p in effect.parameters}
        f.evidence = -0.5 * f.total / max(scale, 0.3) - 0.5 * len(own) * np.log(search.count) - f.candidate.occam
        f.evidence /= search.colour
        if not np.isfinite(f.evidence):
            f.evidence = -np.inf


def colour(search: Search, fitted: Fitted) -> float:
    """Integrated autocorrelation time of a model's residual [samples]."""
    if not fitted.colour:
        fitter = search.fitters[fitted.candidate.family.key]
        rows = [
            fitter.residuals(fitted.candidate, which, np.arange(len(record.starts)))[0]
            for which, record in enumerate(search.records)
        ]
        fitted.colour = correlation_time(np.concatenate(rows, axis=1))
    return fitted.colour


def energy(search: Search, fitted: Fitted) -> float:
    """Residual energy per sample [1], over all windows."""
    return float(np.sum(fitted.train) + np.sum(fitted.withheld)) / search.count


def noise_share(search: Search, fitted: Fitted) -> float:
    """Residual energy per sample that is white: half the mean square of the residual's differences, the quieter
    half of the windows. Of a torque it is what laps or the encoder's noise leave: its band holds nothing white.
    """
    if search.imposed:
        floor = assemble.torque_floor_of(search, fitted).value / noise_torque(search.records[0], search.setting.inertia)
        return (TOLERANCE * floor) ** 2
    fitter = search.fitters[fitted.candidate.family.key]
    found = []
    for which, record in enumerate(search.records):
        residual = fitter.residuals(fitted.candidate, which, np.arange(len(record.starts)))
        # The rate channel where there is one: an encoder's rounding is not white.
        difference = np.diff(residual[0], axis=0)
        found.append(0.5 * np.mean(difference**2, axis=0))
    return float(np.median(np.concatenate(found)))


def _judge(search: Search, decision: Decision, fitted: Fitted) -> None:
    decision.floor = noise_share(search, fitted)
    decision.structure = channel_energy(search, fitted) / max(decision.floor, 1e-12)
    first = search.records[0].channel
    if first.step > 0 and not search.imposed:
        # A rounded reading's error is not white: only the size of the step can be held against it.
        decision.floor = max(decision.floor, min(1.0, channel_energy(search, fitted)))
        decision.structure = channel_energy(search, fitted) / decision.floor


def _material(search: Search, before: Fitted, after: Fitted) -> bool:
    """Whether a cause removes enough of what is left to be one."""
    least = MATERIAL * (5.0 if search.records[0].channel.step > 0 else 1.0)
    old, new = energy(search, before), energy(search, after)
    return old - new > least * old


def channel_energy(search: Search, fitted: Fitted) -> float:
    """Residual energy per sample [1] of the channel that the gap is told in."""
    fitter = search.fitters[fitted.candidate.family.key]
    windows = []
    for which, record in enumerate(search.records):
        residual = fitter.residuals(fitted.candidate, which, np.arange(len(record.starts)))[0]
        windows.append(np.mean(residual**2, axis=0))
    found = np.sort(np.concatenate(windows))
    if fitted.candidate.family.key[0] == "bristles" or search.has_play(fitted.candidate):
        # A load that rattles is chaotic, and bristles may remember more than one state holds: a few windows stay off
        # track however good the model is.
        cut = int(RATTLES * len(found))
        found = found[cut : len(found) - cut]
    return float(np.mean(found))


def _one_more(search: Search, decision: Decision, screen: list[np.ndarray]) -> bool:
    """Add the best further cause, then try to replace what was there; False if none is worth it."""
    base = decision.chosen
    bases = [base]
    if len(base.names) == 1 and not search.imposed:
        # What leads alone may be no more than flexible: the best rigid effects are bases as well.
        rigid = [f for f in decision.singles if f.candidate.family.key[0] == "rigid" and f.names != base.names]
        bases += rigid[:2]
    options = [option for one in bases for option in _additions(search, one)]
    found = search.best_of(options, screen, FEW if len(bases) == 1 else MORE)
    if not found:
        return False
    weigh(search, [*found, base, decision.exact, decision.null, *decision.singles])
    best = max(found, key=lambda f: f.evidence)
    everything = list(found)
    # Backward: with the new cause in, is what came first still the right companion?
    if len(bases) > 1 and channel_energy(search, best) > WHITE * noise_share(search, best):
        newcomer = [f for f in decision.singles if f.names == (best.candidate.effects[-1].name,)]
        if newcomer:
            others = search.best_of(_replacements(search, best, newcomer[0]), screen, FEW)
            weigh(search, [*others, *found, base, decision.exact, decision.null, *decision.singles])
            swapped = max(others, key=lambda f: f.evidence)
            everything += others
            if swapped.evidence > best.evidence + 2.0 and set(swapped.names) != set(best.names):
                best = swapped
    before = decision.structure * decision.floor
    floor = noise_share(search, best)
    after = channel_energy(search, best)
    removed = (before - after) / max(before - floor, 1e-12)
    if best.evidence - base.evidence < DECISIVE or removed < REMOVES:
        return _weak_step(search, decision, found)
    if np.sum(best.withheld) > np.sum(base.withheld):
        return False
    if set(base.names) <= set(best.names):
        decision.path.append(best)
    else:
        first = next(f for f in decision.singles if f.names == best.names[:1])
        decision.path[-1:] = [first, best]
    decision.rivals = sorted([*everything, *decision.singles], key=lambda f: -f.evidence)
    _judge(search, decision, best)
    return True


def _one_less(search: Search, decision: Decision) -> bool:
    """Take out a cause that the others do without, once they are fitted from where all of them stand."""
    chosen = decision.chosen
    values, family = chosen.candidate.values(), chosen.candidate.family
    neutral = dict(zip([p.name for p in family.parameters], family.neutral(search.setting), strict=True))
    fewer = []
    for effect in chosen.candidate.effects:
        others = tuple(other for other in chosen.candidate.effects if other is not effect)
        kept = {p.name for other in others for p in other.parameters}
        start = values | {p.name: neutral[p.name] for p in effect.parameters if p.name not in kept}
        fewer.append(search.candidate(others, start))
    search.fit(fewer, search.train, 12)
    for c in fewer:
        if search.has_play(c) and not search.imposed:
            search.polish(c)
    found = search.finish(fewer)
    weigh(search, [*found, *decision.rivals, chosen, decision.exact, decision.null, *decision.singles])
    best = max(found, key=lambda f: f.evidence)
    needed = channel_energy(search, best) - channel_energy(search, chosen) > MATERIAL * decision.floor
    if needed and chosen.evidence - best.evidence > DECISIVE:
        return False
    if len(best.names) == 1:
        decision.singles = [best, *(f for f in decision.singles if f.names != best.names)]
        decision.rivals = decision.singles
        decision.path = [decision.exact, best]
    else:
        first = next(f for f in decision.singles if f.names[0] in best.names)
        decision.path = [decision.exact, first, best]
        decision.rivals = [best, *(f for f in decision.rivals if set(f.names) != set(best.names))]
    return True


def _simpler(search: Search, decision: Decision) -> None:
    """Put what is simpler in the place of a cause that contains it, where the data want no more."""
    chosen = decision.chosen
    by_name = {effect.name: effect for effect in search.effects}
    family = chosen.candidate.family
    neutral = dict(zip([p.name for p in family.parameters], family.neutral(search.setting), strict=True))
    options = []
    for effect in chosen.candidate.effects:
        for names in SIMPLER.get(effect.name, ()):
            if not set(names) <= set(by_name) or set(names) & set(chosen.names):
                continue
            instead = tuple(by_name[name] for name in names)
            kept = {p.name for new in instead for p in new.parameters}
            dropped = {p.name: neutral[p.name] for p in effect.parameters if p.name not in kept}
            others = tuple(
                new for other in chosen.candidate.effects for new in (instead if other is effect else (other,))
            )
            options.append(search.candidate(others, chosen.candidate.values() | dropped))
    if not options:
        return
    search.fit(options, search.train, 12)
    sets = [set(c.names) for c in options]
    found = [*search.finish(options), *(f for f in decision.rivals if set(f.names) in sets)]
    weigh(search, [*found, *decision.rivals, chosen, decision.exact, decision.null, *decision.singles])
    best = max(found, key=lambda f: f.evidence)
    lost = channel_energy(search, best) - channel_energy(search, chosen)
    if best.evidence > chosen.evidence or lost < BARELY * decision.floor:
        decision.path[-1] = best
        decision.rivals = [best, *decision.rivals]
        if len(best.names) > 1 and decision.path[1] is not best and decision.path[1].names[0] in best.names:
            return
        first = next((f for f in decision.singles if f.names[0] in best.names), None)
        if len(best.names) > 1 and first is not None:
            decision.path = [decision.exact, first, best]


def _weak_step(search: Search, decision: Decision, found: list[Fitted]) -> bool:
    """Go on with the best cause beside those that are there if withheld data are sure of it, and say that it is weak.

    Only where motion is imposed: there a step costs little, and real logs ask for it.
    """
    base = decision.chosen
    if not search.imposed:
        return False
    beside = [f for f in found if set(base.names) < set(f.names)]
    best = max(beside, key=lambda f: f.evidence, default=base)
    removed = 1.0 - np.sum(best.withheld) / np.sum(base.withheld)
    if best.evidence - base.evidence < DECISIVE or removed < WEAK or not sure_gain(base.withheld, best.withheld):
        return False
    decision.weak += 1
    decision.path.append(best)
    _judge(search, decision, best)
    return True


def _replacements(search: Search, best: Fitted, newcomer: Fitted) -> list[tuple[tuple[Effect, ...], dict[str, float]]]:
    """Every companion of the newcomer, from the pair's fit with what came first taken out again; timing from its
    timing.
    """
    replaced = best.candidate.effects[0]
    values = best.candidate.values()
    family = best.candidate.family
    neutral = dict(zip([p.name for p in family.parameters], family.neutral(search.setting), strict=True))
    kept = {p.name for p in newcomer.candidate.effects[0].parameters}
    values |= {p.name: neutral[p.name] for p in replaced.parameters if p.name not in kept}
    options = _additions(search, newcomer, values)
    times = [best.candidate.values()[p.name] for p in replaced.parameters if p.unit == "s"]
    for effect in search.effects:
        own = [p for p in effect.parameters if p.unit == "s"]
        if times and len(own) == len(effect.parameters) == 1 and effect.name not in newcomer.names:
            options.append(((*newcomer.candidate.effects, effect), values | {own[0].name: times[0]}))
    return options


def _additions(
    search: Search, base: Fitted, values: dict[str, float] | None = None
) -> list[tuple[tuple[Effect, ...], dict[str, float]]]:
    """Every effect beside those of the base, from its own starts and the base's fit."""
    values = base.candidate.values() if values is None else values
    options = []
    for effect in search.effects:
        names = {*base.names, effect.name}
        if effect.name in base.names or any(pair <= names for pair in IMPOSSIBLE):
            continue
        held = {p.name for p in effect.parameters}
        if held <= {p.name for e in base.candidate.effects for p in e.parameters}:
            continue  # a part of what is there already
        for start in effect.starts(search.setting):
            options.append(((*base.candidate.effects, effect), values | start))
    return options
