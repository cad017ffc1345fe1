"""Search: fits every set of causes from all its starts: screened on a few windows, the best finished on all."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...logs.arrays import Values
from ...simulation.precision import double_precision
from ..data.record import Record, with_noise
from ..data.replay_tables import guide_of, tables_of
from ..data.setting import Setting
from ..data.split import fairer_split
from ..data.tables import Tables
from ..effects.effect import Effect
from ..simulate.family import Family, Key, Nominal, Runner, key_for, make_family
from ..simulate.hidden_states import HiddenStates
from .band import highest_of_speed, level_with_bursts, real_noise, unanswered, unfelt
from .candidate import NOMINAL, Candidate, Fit, Start, make_candidate
from .course_starts import longest_log, with_course_starts, without_numbers
from .guide import guide_bandwidth
from .hidden_starts import estimate_hidden_states, fit_hidden_states
from .imposed_motion import ImposedMotion
from .leading import FIRST, THEN, compared, leading, new_shaft
from .least_squares import Fitter
from .make_modes import make_modes
from .measure import Measure
from .modes import Modes
from .score import scores
from .screen import few_windows, from_bases, screened
from .shaft_starts import contact_starts, spring_starts

# Successive halving: after screening ever fewer sets get ever more steps.
STAGES = ((3, 40), (4, 14), (8, 8), (25, 6))  # (steps on all fitted windows, number of sets that get them)
AFTER = (0.56, 0.62, 0.67, 0.78)  # share of the run time that is over after each [1]; for the progress display alone
COLOURED = 25  # most steps with a level of the missing torque for each octave (coloured, not white)
ANEW = 4  # steps of the start states alone, from each that a window's hidden states may be
BAND = 0.25  # of the Nyquist frequency: above it residuals show the drive's sampling and rounding, not a cause of a gap


class Search:
    """The fits on one machine's logs, with the compiled loops and the modes that they share.

    Args:
        records: the logs.
        nominal: the blocks of the nominal model.
        effects: the vocabulary, the user's own effects included.
        setting: sizes.
        tick: called with the share done [1] of the present exploration.
    """

    def __init__(
        self, records: list[Record], nominal: Nominal, effects: tuple[Effect, ...], setting: Setting,
        tick: Callable[[float], None] | None = None,
    ):  # fmt: skip
        self.nominal, self.effects, self.setting = nominal, effects, setting
        self.tick = tick or (lambda share: None)
        self.real_noise = 1.0
        """Measured over assumed variance of the sensors' noise [1], at most 1 (`fpjax.gap.fit.band.real_noise`)."""
        self.guide = 0.0
        """Bandwidth of the guide [Hz] (`fpjax.gap.fit.guide`); 0 for free simulations."""
        # The order: noise and guide need a fit of the nominal model, and change the residuals of every fit after them.
        self._prepare(records, 0)
        base = self._base(wide=NOMINAL)
        scale = self._noise_scale(base)
        self.guide = self._needed_guide(records, base)
        if abs(np.log(scale)) > 0.1:  # more than one step of `NOISES`
            records = with_noise(records, scale)
        self._prepare(records, self._material_modes())
        base = self._base(wide=NOMINAL)
        # Of a machine that can go either way at a reversal one fit stays near the motion and the next does not.
        if (firmer := self._needed_guide(records, base)) > self.guide:
            self.guide = firmer
            self._prepare(records, self._material_modes())
            base = self._base(wide=NOMINAL)
        # What the readings hold beyond noise that is no torque, beside a fit of the nominal model.
        fitter = self.fitters[base.family.key]
        noisy = unanswered(self.modes, base.level, fitter.commanded + fitter.inertial)
        if np.any(noisy := np.hypot(noisy, unfelt(self.modes, setting.torque_noise))):
            self._begin(replace(self.modes, unanswered=noisy))
            base = self._base(wide=NOMINAL)
        self.moves = 1.0 / (1.0 + (self.modes.frequency / highest_of_speed(records)) ** 2)
        """Weight of a torque's energy by its influence on the motion [1], shape (modes,): above the frequencies of the
        log's speed a torque moves the machine less and less, and noise looks like more and more torque."""
        self.exact = self._base(wide=None)
        """The nominal model as it was given."""
        self.measure = self._measure()
        """How the missing torque of every model is weighed by frequency and window."""
        if self._split_fairly():
            self.exact = self._base(wide=None)
            self.measure = self._measure()
            base = self._base(wide=NOMINAL)
        self.base = base
        """The nominal model with its values free."""
        self._look_for_starts()
        self.real_noise = real_noise(self.modes, self.base.level, self._coefficients(self.base))

    def _prepare(self, records: list[Record], most: int) -> None:
        self.records = records
        with double_precision():
            self.tables: list[Tables] = [tables_of(record, self.guide) for record in records]
        self._divide()
        first = records[0]
        rate = 0.0 if first.velocity is None else first.velocity.noise
        angle = 0.0 if first.position is None else first.position.noise
        self._window = (first.samples, first.dt, self.setting.inertia, rate, angle)
        self._held = self.setting.damping, guide_of(first, self.guide)
        self._begin(make_modes(*self._window, most, *self._held))

    def _begin(self, modes: Modes) -> None:
        self.modes = modes
        self.fitters: dict[Key, Fitter] = {}
        self._coarse: dict[tuple[Key, int], Fitter] = {}
        self.hidden_states: dict[Key, HiddenStates] = {}

    def _divide(self) -> None:
        self.train = [np.flatnonzero(~record.withheld) for record in self.records]
        self.withheld = [np.flatnonzero(record.withheld) for record in self.records]
        self._screen: list[Values] = []

    def _measure(self) -> Measure:
        """From the nominal model's level with bursts, else a log with a few pushes would have none."""
        level = level_with_bursts(self.modes, self.exact.level, self._coefficients(self.exact))
        return Measure.of(self.fitters[self.exact.family.key], level)

    def _split_fairly(self) -> bool:
        """Withhold other windows where those that are withheld, or those that are not, hold hardly any of the gap.

        Returns:
            Whether other windows are withheld now.
        """
        if any(np.all(record.withheld) for record in self.records):
            return False  # whole logs are withheld, as the user chose
        fairer = fairer_split(scores(self, [self.exact])[0].missing)
        if fairer is None:
            return False
        self.records = [replace(r, withheld=own) for r, own in zip(self.records, fairer, strict=True)]
        self._divide()
        return True

    # --- families

    def fitter(self, key: Key) -> Fitter:
        """The fitter of a family, made at its first use: each compiles a loop of its own."""
        if key not in self.fitters:
            family = make_family(key, self.nominal, self.effects, self.setting)
            if family.key not in self.fitters:
                runner = Runner(family, self.records, self.tables)
                self.fitters[family.key] = Fitter(runner, self.setting, self.modes)
                if family.key[0] != "rigid":
                    self.hidden_states[family.key] = HiddenStates(family, self.records, self.tables)
            self.fitters[key] = self.fitters[family.key]
        return self.fitters[key]

    def _coarse_fitter(self, key: Key, modes: int) -> Fitter:
        """The fitter of a family on the lowest modes of each window alone, on all where a window has no more."""
        if modes >= np.sum(~self.modes.sensor):
            return self.fitters[key]
        if (key, modes) not in self._coarse:
            few = make_modes(*self._window, modes, *self._held)
            known = self.modes.unanswered
            own = np.append(known[: few.bands - 1], known[-1]) if np.any(few.sensor) else known[: few.bands]
            self._coarse[key, modes] = Fitter(self.fitters[key].runner, self.setting, replace(few, unanswered=own))
        return self._coarse[key, modes]

    def family(self, effects: Sequence[Effect]) -> Family:
        """The smallest family that holds the effects."""
        return self.fitter(key_for(tuple(effects), self.setting)).family

    def candidate(self, start: Start, *, exact: bool = False) -> Candidate:
        """A candidate at its start."""
        family = self.family(start.effects)
        c = make_candidate(start.effects, start.wide, family, self.setting, self.records, start.values, exact=exact)
        if start.like is not None:
            same = start.like.family.key[0] == family.key[0]
            for own, other in zip(c.states, start.like.states, strict=True):
                rows = min(len(own), len(other)) if same else 2  # rate and angle; hidden states mean other things
                own[:rows] = other[:rows]
            if same:
                c.hidden = [h.copy() for h in start.like.hidden]
        return c

    # --- the nominal model

    def _base(self, wide: tuple[str, ...] | None) -> Candidate:
        """The nominal model with some of its values free; None for exactly as it was given."""
        base = self.candidate(Start((), wide or (), {}), exact=wide is None)
        # White first: far from the fit, a level for each octave would take up the model's own errors.
        self.go_on([base], self.train, 25, white=True)
        base.converged = False
        self.go_on([base], self.train, COLOURED, white=False)
        return base

    def _look_for_starts(self) -> None:
        """Start values: contacts and springs from the log with most fitted windows, and those of courses."""
        contacts, springs = None, None
        backlash = [effect for effect in self.effects if effect.name == "backlash"]
        if backlash:
            which = longest_log(self.train)
            hidden_states = self.hidden_states[self.fitter(key_for(tuple(backlash), self.setting)).family.key]
            fitted, as_given = ({name: c.values()[name] for name in NOMINAL} for c in (self.base, self.exact))
            course = self.missing_course(self.base, noisy=True)[which]
            log = ImposedMotion(hidden_states, which, self.records[which], course, fitted, as_given, self.setting)
            contacts = contact_starts(log)
            # Through the same loop, at no clearance. Without a backlash in the vocabulary springs have plain starts.
            springs = spring_starts(log) if any(effect.name == "compliance" for effect in self.effects) else None
        # Periods and contacts beside fitted nominal values; an unbalance beside the given ones, since a free inertia
        # takes up much of a pendulum's torque.
        free, given, values = self.missing_course(self.base), self.missing_course(self.exact), self.base.values()
        self.setting = replace(
            with_course_starts(self.setting, self.records, self.train, free, values, given),
            contacts=contacts, springs=springs,
            # A nominal model without friction is no scale for a Stribeck torque or a dead zone.
            friction=max(self.setting.friction, values["coulomb"]),
        )  # fmt: skip

    def setting_beside(self, c: Candidate) -> Setting:
        """Sizes with periods, unbalance and rise of a candidate's missing torque: start values of a further cause.

        In the nominal model's missing torque the first cause hides them.
        """
        contacts, springs = without_numbers(self.setting.contacts), without_numbers(self.setting.springs)
        beside = with_course_starts(self.setting, self.records, self.train, self.missing_course(c), c.values())
        return replace(beside, contacts=contacts, springs=springs)

    def _needed_guide(self, records: list[Record], base: Candidate) -> float:
        """Bandwidth of the guide [Hz] that a fit of the nominal model needs, whatever guide it was fitted under."""
        return guide_bandwidth(records, self.modes, self._coefficients(base), self.setting, self.guide)

    def _noise_scale(self, base: Candidate) -> float:
        """Noise standard deviation of the sensors over its estimate from differences of successive samples [1]."""
        return self.fitters[base.family.key].best_noise(self._parts(base))

    def _coefficients(self, c: Candidate) -> list[tuple[Values, Values]]:
        """(noise, plain coefficients) of a candidate on the fitted windows, one entry a record with any."""
        fitter = self.fitters[c.family.key]
        return [(fitter.noise[w][chosen], self.modes.plain(found)) for w, chosen, found in self._parts(c)]

    def _parts(self, c: Candidate) -> list[tuple[int, Values, Values]]:
        """(record, its fitted windows, a candidate's coefficients there), one entry a record with any."""
        coefficients = self.fitters[c.family.key].coefficients
        return [(w, own, coefficients([c], w, own)[0]) for w, own in enumerate(self.train) if len(own)]

    def _material_modes(self) -> int:
        """Number of modes with torque below `BAND` of the Nyquist frequency, 16 at the least."""
        return max(16, int(np.sum(~self.modes.sensor & (self.modes.frequency < BAND * 0.5 / self.setting.dt))))

    def missing_course(self, c: Candidate, *, noisy: bool = False) -> list[Values]:
        """The most likely missing torque [N m] along each record, shape (samples,); NaN outside the fitted windows.

        Args:
            c: a candidate.
            noisy: the torque that makes all of the residual instead, the readings' noise included.
        """
        fitter, found = self.fitters[c.family.key], [np.full(len(record.time), np.nan) for record in self.records]
        # The posterior mean V diag(w / sqrt(lambda)) c with the Wiener filter w. The residual is simulated less
        # measured, so that a torque that the simulation lacks has the opposite sign.
        reach = np.where(self.modes.sensor, 0.0, 1.0 / np.sqrt(np.where(self.modes.sensor, 1.0, self.modes.gain)))
        trusted = 1.0 if noisy else self.measure.trusted
        reach = reach * trusted * fitter.torque_scale(c) ** self.measure.imposed
        for which, chosen, own in self._parts(c):
            record = self.records[which]
            share = 1.0 if noisy else self.modes.wiener(c.level, fitter.noise[which][chosen])
            out = -(share * self.modes.plain(own) * reach) @ self.modes.torque.T
            for row, window in zip(out, chosen, strict=True):
                found[which][record.starts[window] : record.starts[window] + record.samples] = row
        return found

    # --- fitting

    def go_on(
        self, candidates: Sequence[Candidate], windows: Sequence[Values], steps: int, *, white: bool, modes: int = 0
    ) -> None:
        """More steps for candidates of any families; hidden states are estimated again before every third step.

        Args:
            candidates: they are changed in place.
            windows: indices, one array a record.
            steps: at most.
            white: one level of the missing torque for all octaves.
            modes: the lowest modes of a window that are fitted; 0 for all.
        """
        for key in dict.fromkeys(c.family.key for c in candidates):
            group = [c for c in candidates if c.family.key == key]
            fitter = self._coarse_fitter(key, modes) if modes else self.fitters[key]
            if key not in self.hidden_states:
                fitter.go_on(group, windows, steps, white=white)
                continue
            done = 0
            while done < steps and (active := [c for c in group if not c.converged]):
                hidden = self.hidden_states[key]
                estimate_hidden_states(fitter, hidden, self.records, active, windows, afresh=done == 0)
                fitter.go_on(active, windows, min(3, steps - done), white=white)
                done += 3

    def screening(self) -> list[Values]:
        """The few fitted windows on which starts are screened, one array a record."""
        if not self._screen:
            self._screen = few_windows(self)
        return self._screen

    def explore(self, starts: Sequence[Start], keep: Sequence[int] = (), *, white: bool = True) -> list[Fit]:
        """Fit every set of causes from all its starts: the best starts of each set, the leading sets finished.

        Args:
            starts: sets and their start values.
            keep: number of sets that go on to each stage, in place of those in `STAGES`.
            white: one level of the missing torque for all octaves until the last steps. Far from the solution a level
                for each leads to wrong minima; starts from a finished fit can do without.
        """
        started = self._started(starts, white=white)
        begun = {id(c): start for c, start in zip(started, starts, strict=True)}
        fresh = [c for c in started if new_shaft(c, begun[id(c)])]
        candidates = screened(self, started, keep[0] if keep else 0, fresh, white=white)
        going = leading(candidates, FIRST)
        left: dict[tuple[str, ...], Candidate] = {}  # sets dropped after some steps on all windows; scored as they are
        for stage, (steps, most) in enumerate(STAGES):
            most = keep[stage] if stage < len(keep) else most
            going = sorted(going, key=lambda c: c.cost)
            sets = list(dict.fromkeys(c.names for c in going))
            # Sets of nominal errors alone always stay: the answer compares every cause with them.
            sets = [
                *sets[:most],
                *(names for names in sets[most:] if not any(n.removesuffix("_error") not in NOMINAL for n in names)),
            ]
            if stage == 0:
                going = [c for c in going if c.names in sets]
                going += from_bases(self, going, begun)
                for c in going:
                    # From a few windows to all of them: the level is estimated anew.
                    c.converged, c.damping, c.level = False, min(c.damping, 1.0), np.zeros(0)
            for c in going:
                if c.names not in sets:
                    left.setdefault(c.names, c)
            going = [c for c in going if c.names in sets]
            if stage > 0:  # until then costs are those of a few windows
                going = leading(going, THEN)
                compared(going)
            self.go_on(going, self.train, steps, white=white)
            self.tick(AFTER[stage])
        finished: dict[tuple[str, ...], Candidate] = {}
        for c in sorted(going, key=lambda c: c.cost):
            finished.setdefault(c.names, c)
        compared(finished.values())
        found = self.finish(list(finished.values())) + self.finish(list(left.values()), 0)
        self.tick(1.0)
        return found

    def _started(self, starts: Sequence[Start], *, white: bool) -> list[Candidate]:
        """A candidate at each start; of a start that may be from the values as given, the likelier of the two."""
        found = [self.candidate(start) for start in starts]
        # Those with hidden states are not likely or unlikely before these are estimated, which costs as much as a step.
        tried = [i for i, s in enumerate(starts) if s.or_given and found[i].family.key not in self.hidden_states]
        given = {i: self.candidate(starts[i].as_given()) for i in tried}
        both = [*(found[i] for i in tried), *given.values()]
        for key in dict.fromkeys(c.family.key for c in both):
            self.fitters[key].assess([c for c in both if c.family.key == key], self.screening(), white=white)
        return [given[i] if i in given and given[i].cost < c.cost else c for i, c in enumerate(found)]

    def fitted(self, starts: Sequence[Start], *, alone: bool = False) -> list[Fit]:
        """Each start fitted on all windows for a dozen steps and the last ones, in the order of `starts`.

        Args:
            starts: sets and their start values.
            alone: whether each goes to its own end, also one that is far behind the fit that it starts like.
        """
        candidates = [self.candidate(start) for start in starts]
        alone = alone or all(start.like is None for start in starts)
        for c, start in zip(candidates, starts, strict=True):
            c.beside = np.inf if alone or start.like is None else start.like.cost
        self.go_on(candidates, self.train, 12, white=alone)
        return self.finish(candidates)

    def refit(self, fit: Fit, wide: Sequence[str]) -> Fit:
        """The same effects with other nominal values free, fitted on from a finished fit."""
        old = fit.candidate
        c = self.candidate(Start(old.effects, tuple(wide), old.values(), old))
        return self.finish([c])[0]

    def finish(self, candidates: Sequence[Candidate], steps: int = COLOURED) -> list[Fit]:
        """Last steps with a level for each octave, then the scores: evidence and missing torque of every window."""
        for c in candidates:
            c.converged, c.damping = False, min(c.damping, 1.0)
        self.go_on(candidates, self.train, steps, white=False)
        if steps:
            self._start_anew(candidates)
        return scores(self, candidates)

    def _start_anew(self, candidates: Sequence[Candidate]) -> None:
        """Fit the start states of the fitted windows from all that they may be, then everything for some steps."""
        # A backlash may start from the faces of its gap, what has none may not.
        kinds = [(c.family.key, any(p.name == "gap" for e in c.effects for p in e.parameters)) for c in candidates]
        for kind in dict.fromkeys(kind for kind in kinds if kind[0] in self.hidden_states):
            key, group = kind[0], [c for c, own in zip(candidates, kinds, strict=True) if own == kind]
            fit_hidden_states(self.fitters[key], self.hidden_states[key], self.records, group, self.train, ANEW)
            for c in group:
                c.converged, c.damping = False, min(c.damping, 1.0)
            self.go_on(group, self.train, COLOURED // 2, white=False)
