"""Response: how far a family's machines answer a torque with motion, against the nominal mass.

The missing torque is inferred from residuals through the nominal model (`fpjax.gap.fit.modes`). What a model with other
numbers lacks at the command, and the likelihood of torques instead of motions, follow from the ratio of the two
frequency responses.
"""

from collections.abc import Sequence

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record, joints
from ..data.setting import Setting
from ..effects.shaft import resonance_of
from ..simulate.family import Runner
from .band import unfelt
from .candidate import Candidate
from .modes import Modes

# Parameters by which a model's frequency response, and so `torque_scale`, depends smoothly on the vector.
RESPONSE = (
    "inertia", "viscous", "viscous_difference", "gain", "scale", "velocity_lag", "actuator_lag", "drag_coefficient",
    "load_coefficient",
)  # fmt: skip
SHAFT = ("frequency", "damping_ratio", "load_share")  # by which the noise of a measured torque is passed, too
LEAST_PASSED = 0.05  # least share of a torque that is taken to pass a limit, dead zone or loaded gear: never none [1]

Windows = Sequence[Values]


class Response:
    """Frequency responses of a family's machines to a missing torque.

    Args:
        runner: of the family.
        setting: sizes.
        modes: of a window.
    """

    def __init__(self, runner: Runner, setting: Setting, modes: Modes):
        self.family, self.setting, self.modes = runner.family, setting, modes
        self.records: list[Record] = runner.records
        speed = np.concatenate([record.speed for record in self.records])
        torque = np.concatenate([record.torque for record in self.records])
        self.speed, self.effort = float(np.sqrt(np.mean(speed**2))), np.sort(np.abs(torque))
        # Share of the log in which the torque drives, less that in which it brakes: a gear's losses then help it.
        self.driving = float(np.clip(np.mean(np.sign(torque) * np.sign(speed)), 0.0, 1.0))
        # Share of the travel that is forwards, less that backwards: a log of one direction has one side's damping.
        self.forwards = float(np.sum(speed) / max(np.sum(np.abs(speed)), 1e-300))
        self.inertial = self._mean_squares([self.setting.inertia * record.acceleration for record in self.records])
        self.commanded = self._mean_squares([record.torque for record in self.records])
        self.changes = [self._changes(record) for record in self.records]
        self.answering = np.mean(np.concatenate(self.changes), axis=0)
        # A reading's scale and lag change the response where the rate reading alone shows the motion.
        self.rate_alone = self.records[0].position is None
        guide = runner.tables[0].guide
        self.guide = float(guide.stiffness), float(guide.damping)
        # Noise of a measured torque, which drives the simulations alone [N^2 m^2], by mode.
        self.unfelt = np.where(modes.sensor, 0.0, unfelt(modes, setting.torque_noise)[modes.band] ** 2)
        self._places = {p.name: index for index, p in enumerate(self.family.parameters)}
        self._nominal = self._response(self.family.neutral(setting)[None])[0]
        # s^2 of each window: windows with repeated readings have more noise. Rounded to powers of two, so that many
        # windows share their weights.
        self.noise = [2.0 ** np.round(np.log2(record.runs)) for record in self.records]

    def _mean_squares(self, torques: Sequence[Values]) -> Values:
        """Mean square in each mode [N^2 m^2], averaged by octave, of a torque along each record; shape (modes,).

        Without a taper, as the missing torque is measured that it is compared with: both leak alike.
        """
        modes, squares = self.modes, []
        for record, torque in zip(self.records, torques, strict=True):
            squares.append((torque[record.rows()] @ modes.torque) ** 2)
        each = np.mean(np.concatenate(squares), axis=0)
        found = np.zeros(len(each))
        for band in np.unique(modes.band[~modes.sensor]):
            own = (modes.band == band) & ~modes.sensor
            found[own] = np.mean(each[own])
        return found

    def _changes(self, record: Record) -> Values:
        """Mean square by octave [N^2 m^2] of how the command changes about each window, shape (windows, modes).

        Under a Hann taper: a part of a slow sine, or a ramp, would leak into every octave by its jump from the window's
        end to its beginning, and pass for a loop's answer there. Averaged over windows half a window apart (Welch, "The
        use of fast Fourier transform for the estimation of power spectra", 1967), since a taper hides what a command
        does at a window's ends, where a reference may have its steps.
        """
        rows, edges = record.rows(), joints(record)
        taper = np.hanning(record.samples + 2)[1:-1]
        taper /= np.sqrt(np.mean(taper**2))
        squares = np.zeros((len(rows), len(self.modes.gain)))
        for shift, share in ((-(record.samples // 2), 0.25), (0, 0.5), (record.samples // 2, 0.25)):
            first, last = (np.searchsorted(edges, rows[:, end] + shift, "right") for end in (0, -1))
            # The window itself where a shifted one is not within one stretch of the record.
            torque = record.torque[np.where((first == last)[:, None], rows + shift, rows)]
            torque = (torque - np.mean(torque, axis=1, keepdims=True)) * taper
            squares += share * (torque @ self.modes.torque) ** 2
        for band in np.unique(self.modes.band):
            own = self.modes.band == band
            squares[:, own] = np.mean(squares[:, own], axis=1, keepdims=True)
        return squares

    def torques(self, c: Candidate, windows: Windows) -> Values:
        """Effective number of coefficients of each mode that count as torques, for `log_volume`.

        Where the torque makes the motion, the likelihood of motions regresses the acceleration on the torque, and that
        of torques the torque on the acceleration. What is missing biases the first towards a heavy mass if it is in the
        command (a current that was measured, chatter that the drive filtered) and the second towards a light one if it
        acts on the mass. Which of both it does is not known: half of the coefficients count, and the mass is that of
        the geometric mean regression (Ricker, "Linear regressions in fishery research", 1973). Where a loop imposes the
        motion, all count. A coefficient counts by its share of missing torque against noise.

        Returns:
            Shape (3, modes) [1]: of motions that the torque makes, of those that are imposed, and of those that the
            noise of a measured torque makes in the simulation of the nominal mass, by its share of their variance.
        """
        noise = np.concatenate([self.noise[which][chosen] for which, chosen in enumerate(windows)])
        changes = np.concatenate([self.changes[which][chosen] for which, chosen in enumerate(windows)])
        missing = np.maximum(c.level[self.modes.band] ** 2, 1e-300)
        seen = np.sum(self.modes.wiener(c.level, noise) * changes / (changes + missing), axis=0)
        made = self.inertial / (self.inertial + missing)
        variance = self.modes.variance(noise) + np.where(self.modes.sensor, 0.0, missing * self.modes.gain)
        unfelt = np.sum(self.unfelt * self.modes.gain / variance, axis=0)
        return np.stack([seen * 0.5 * made, seen * (1.0 - made), unfelt])

    def imposed(self, level: Values) -> Values:
        """Share of the motion that is imposed by a loop, which answers a missing torque with the command [1], (modes,).

        Not where the inertial torque is the larger one: there the torque makes the motion. And not where the command
        hardly changes within a window, beside the missing torque: it does not answer.

        Args:
            level: of the missing torque by octave [N m], shape (bands,).
        """
        missing = np.maximum(level[self.modes.band] ** 2, 1e-300)
        answered = np.where(self.modes.sensor, 0.0, self.answering / (self.answering + missing))
        return missing / (missing + self.inertial) * answered

    def torque_scale(self, c: Candidate) -> Values:
        """Factor of a candidate's missing torque at the command over that which `Modes` infers from its residual.

        `Modes` infers it through the nominal model, so the factor is the ratio of that model's frequency response to
        the candidate's, at least 1. Under a stiff position loop the motion is imposed and the torque follows from
        it. A model that hardly responds to torque (a heavy mass, much damping, a limit) then has small residuals
        however wrong its torque is, and this factor corrects for it. It is at least 1, since otherwise a light mass or
        a large gain could make the missing torque of its own model small.

        Returns:
            Shape (modes,) [1]; 1 for modes without torque.
        """
        return np.maximum(self.lost_response(c), 1.0)

    def lost_response(self, c: Candidate) -> Values:
        """Ratio of the nominal model's frequency response to a candidate's [1], shape (modes,)."""
        return self._lost(c.vector[None])[0]

    def _lost(self, vectors: Values) -> Values:
        """`lost_response` of parameter vectors, (vectors, parameters), shape (vectors, modes)."""
        return np.where(self.modes.sensor, 1.0, self._nominal / self._response(vectors))

    def _lost_of_command(self, vectors: Values) -> Values:
        """`_lost` of a loop's answer, which passes the actuator's lag before it moves the mass, (vectors, modes)."""
        lost, at = self._lost(vectors), self._places.get("actuator_lag")
        if at is None:
            return lost
        square = (2.0 * np.pi * self.modes.frequency) ** 2
        known = self.family.neutral(self.setting)[at]
        return lost * np.sqrt((1.0 + square * vectors[:, at, None] ** 2) / (1.0 + square * known**2))

    def _response(self, vectors: Values) -> Values:
        """`Modes.response` of parameter vectors, (vectors, parameters), shape (vectors, modes)."""

        def of(name: str, neutral: float) -> Values:
            at = self._places.get(name)
            return np.full(len(vectors), neutral) if at is None else vectors[:, at]

        # Quadratic drag and the limits, linearised: the slope at the rms speed, and the share of the log's samples in
        # which the command is neither within the dead zone nor above the limit.
        inertia, viscous = (vectors[:, self._places[name]] for name in ("inertia", "viscous"))
        viscous = viscous + of("viscous_difference", 0.0) * self.forwards
        viscous = viscous + 2.0 * of("drag_coefficient", 0.0) * self.speed
        count = np.searchsorted(self.effort, of("limit", np.inf), "right")
        count = count - np.searchsorted(self.effort, of("dead_zone", 0.0), "left")
        passed = np.maximum(count / len(self.effort), LEAST_PASSED)
        gain = of("gain", 1.0) * np.maximum(1.0 - of("load_coefficient", 0.0) * self.driving, LEAST_PASSED)
        if not self.rate_alone:
            return self.modes.response(inertia, np.maximum(viscous, 0.0), gain * passed, self.guide)
        turned = 2.0 * np.pi * self.modes.frequency * of("velocity_lag", 0.0)[:, None]
        motion = self.modes.response(inertia, np.maximum(viscous, 0.0), gain * of("scale", 1.0) * passed, self.guide)
        return motion / np.sqrt(1.0 + turned**2)

    def log_volume(self, c: Candidate, torques: Values) -> float:
        """Twice the negative log of the Jacobian from torques to motion, over the `torques` counted in each mode.

        A likelihood of torques instead of motions: without it, a model that responds less is favoured. Where the motion
        is imposed, one that responds more than the nominal model is not favoured either: that tells nothing of a mass;
        and the command is a loop's answer, of which an actuator that lags lets less through.
        """
        return float(self.log_volumes(c.vector[None], torques)[0])

    def log_volumes(self, vectors: Values, torques: Values) -> Values:
        """`log_volume` of parameter vectors, (vectors, parameters), shape (vectors,)."""
        if not np.any(torques > 0.0):
            return np.zeros(len(vectors))
        lost, answer = np.log(self._lost(vectors)), np.log(self._lost_of_command(vectors))
        found = 2.0 * (lost @ torques[0] + np.maximum(answer, 0.0) @ torques[1])
        if np.any(torques[2] > 0.0):
            found += (1.0 - self._noise_passed(vectors)) @ torques[2]
        return found

    def _noise_passed(self, vectors: Values) -> Values:
        """Energy of the motion that the noise of a measured torque makes in simulations, over that of the nominal mass
        [1], shape (vectors, modes).

        By what a model keeps of it out of the motion its residuals are smaller, and by that alone it must not be
        likelier: what it is expected to keep out is added again (Nakamura, "Corrected score function for
        errors-in-variables models", 1990).
        """
        square = (2.0 * np.pi * self.modes.frequency) ** 2
        passed = self._response(vectors) ** 2
        if (at := self._places.get("actuator_lag")) is not None:
            passed = passed / (1.0 + square * vectors[:, at, None] ** 2)
        if "frequency" not in self._places:
            return passed
        # Two masses: of the motor's mass (1 - s) J or the load's s J, over the rigid one, at a torque on the motor.
        # What resonates is not taken off: a clearance, or friction on the load, keeps small noise from it.
        values = {name: vectors[:, at, None] for name, at in self._places.items()}
        ratio, share, side = (values[name] for name in ("damping_ratio", "load_share", "load_side"))
        resonance = 2.0 * np.pi * resonance_of(values)
        spring = share * (1.0 - share) * (resonance**2 + 2j * ratio * resonance * np.sqrt(square))
        load = spring - (1.0 - side) * share * square
        return passed * np.minimum(np.abs(load / (spring - share * (1.0 - share) * square)) ** 2, 1.0)

    def log_volume_slope(self, c: Candidate, torques: Values) -> Values:
        """Half the gradient of `log_volume` by the free parameters in units of their scale, shape (free,)."""
        found = np.zeros(len(c.free))
        names = (*RESPONSE, *SHAFT) if np.any(torques[2] > 0.0) else RESPONSE
        places = [k for k, index in enumerate(c.free) if c.family.parameters[index].name in names]
        if places:
            vectors = np.repeat(c.vector[None], len(places) + 1, 0)
            vectors[np.arange(len(places)), c.free[places]] += 1e-4 * c.scale[places]
            volumes = self.log_volumes(vectors, torques)
            found[places] = 0.5 * (volumes[:-1] - volumes[-1]) / 1e-4
        return found
