"""The posterior distribution of the diagnosed machine's parameters, from which `improve` and `plan` draw machines."""

import dataclasses
import io
import json
import math
import os
import pathlib
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...errors import InputError
from ...logs.arrays import Values
from ...model_file import Model
from ...output.runfile import write_whole
from ...simulation.precision import double_precision
from ..data.record import Record
from ..data.setting import make_setting
from ..effects.effect import Effect
from ..effects.vocabulary import EFFECTS, on_rate_sensor
from ..fit.candidate import Fit
from ..fit.search import Search
from ..machine import Machine
from ..select.decision import Decision
from ..select.readings import Reading
from ..select.weighed import Weighed
from ..simulate.family import Key, Nominal, make_family
from ..simulate.replay import assembled
from ..thresholds import THRESHOLDS
from .course import course_of
from .intervals import covariance

FILE = "posterior.npz"
VERSION = 3  # of the file format
MOST = 3  # most other explanations
# From the parameters of an error of the velocity reading to the fields of the sensor block.
READ = {"time_constant": "lag", "delay": "delay", "scale": "scale", "bias": "bias"}


@dataclass(frozen=True)
class Posterior:
    """A normal distribution of the fitted parameters, clipped at their bounds, and the torque that the fit leaves.

    Attributes:
        key: structure and features of the machine.
        names: all parameters of the machine.
        values: of all parameters, in SI units, shape (parameters,).
        free: names of the fitted parameters.
        covariance: of the free parameters, shape (free, free); zero rows for those that ended at a bound.
        low: lower bounds of the free parameters, shape (free,).
        high: upper bounds, likewise.
        sensor: errors of the rate sensor that the encoder shows: (value, standard deviation) by field of the sensor.
        step: rounding step of the rate reading [rad/s], where it is seen; else 0.
        noise: standard deviation of one reading of (rate [rad/s], position [rad]); 0 without that column.
        missing: torque that the real machine has and the model lacks along each log [N m], each of shape (samples,);
            NaN where the log was not used.
        causes: effects and wrong nominal numbers in the machine.
        gap: rms of `missing` over withheld windows, noise's share taken out [N m]; NaN where the diagnosis has it.
        rivals: other explanations that the log leaves open: (probability [1], posterior of that machine).
    """

    key: Key
    names: tuple[str, ...]
    values: Values
    free: tuple[str, ...]
    covariance: Values
    low: Values
    high: Values
    sensor: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    step: float = 0.0
    noise: tuple[float, float] = (0.0, 0.0)
    missing: tuple[Values, ...] = ()
    causes: tuple[str, ...] = ()
    gap: float = math.nan
    rivals: tuple[tuple[float, "Posterior"], ...] = ()

    def draw(self, count: int, seed: int) -> tuple[Values, dict[str, Values]]:
        """(parameters of shape (parameters, count), the sensor's fields, each of shape (count,)); the first is the fit.

        Args:
            count: number of draws.
            seed: of the draws.
        """
        random = np.random.default_rng(seed)
        vectors = np.repeat(self.values[:, None], count, axis=1)
        if self.free:
            # By eigenvalues, not Cholesky: the covariance is singular where a parameter is at a bound.
            size, basis = np.linalg.eigh(self.covariance)
            root = basis * np.sqrt(np.maximum(size, 0.0))
            index = [self.names.index(name) for name in self.free]
            moved = vectors[index] + root @ random.standard_normal((len(self.free), count))
            moved[:, 0] = self.values[index]  # the first machine is the fit itself
            vectors[index] = np.clip(moved, self.low[:, None], self.high[:, None])
        sensor = {}
        for name, (value, deviation) in self.sensor.items():
            drawn = value + deviation * random.standard_normal(count)
            drawn[0] = value
            # Lag and delay are not negative, and a scale does not change sign; a bias may be anything.
            floor = -np.inf if name == "bias" else 0.0 if name in ("lag", "delay") else 0.01 * abs(value)
            sensor[name] = np.maximum(drawn, floor)
        return vectors, sensor

    def machines(self, model: Model, records: Sequence[Record], count: int, seed: int = 0) -> Machine:
        """Machines drawn from the posterior: one whose arrays have a leading axis of `count`; the first is the fit.

        Args:
            model: the nominal one, as it was diagnosed.
            records: the logs that were diagnosed.
            count: number of machines.
            seed: of the draws.

        Raises:
            InputError: where this version of fpjax has other parameters.
        """
        family = make_family(
            self.key, Nominal(model.loop.plant, model.loop.actuator, model.loop.sensor), EFFECTS,
            make_setting(list(records), model),
        )  # fmt: skip
        known = [parameter.name for parameter in family.parameters]
        vectors, sensor = self.draw(count, seed)
        here = [name for name in known if name in self.names]
        unknown = [name for name in self.names if name not in known and name in self.free]
        if unknown or family.key != self.key:
            raise InputError(
                f"The diagnosis has parameters that fpjax does not know ({', '.join(unknown) or family.key}): effects "
                f"of your own cannot be drawn from yet; diagnose with the usual vocabulary."
            )
        with double_precision():
            full = np.repeat(family.neutral(make_setting(list(records), model))[:, None], count, axis=1)
            # Parameters that are not in the file stay neutral: effects added to the vocabulary since.
            full[[known.index(name) for name in here]] = vectors[[self.names.index(name) for name in here]]
            machine = assembled(family.machine, family.effects, family.parameters, jnp.asarray(full))
            shape = (count,)
            machine = jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, float), shape), machine)
            changes = {name: jnp.asarray(values) for name, values in sensor.items()}
            if self.step > 0.0:
                changes["step_size"] = jnp.full(shape, self.step)
            return _with_sensor(machine, changes)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `posterior.npz` atomically.

        Args:
            path: of the file.

        Raises:
            InputError: where it cannot be written.
        """
        words, arrays = self._parts("")
        for place, (share, rival) in enumerate(self.rivals):
            own, more = rival._parts(f"rival_{place}_")
            words["rivals"].append(own | {"share": share})
            arrays |= more
        stream = io.BytesIO()
        stored: dict[str, Any] = arrays | {"words": np.array(json.dumps(words))}
        np.savez_compressed(stream, **stored)
        write_whole(pathlib.Path(path), stream.getvalue())

    def _parts(self, prefix: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """(what is stored as JSON, arrays by name with the prefix) of this posterior without its rivals."""
        words = {
            "version": VERSION, "structure": self.key[0], "features": list(self.key[1]), "names": list(self.names),
            "free": list(self.free), "sensor": {name: list(pair) for name, pair in self.sensor.items()},
            "step": self.step, "noise": list(self.noise), "logs": len(self.missing),
            "gap": self.gap if math.isfinite(self.gap) else None, "rivals": [],
            "causes": list(self.causes),
        }  # fmt: skip
        arrays = {"values": self.values, "covariance": self.covariance, "low": self.low, "high": self.high}
        arrays |= {f"missing_{place}": one for place, one in enumerate(self.missing)}
        return words, {prefix + name: one for name, one in arrays.items()}


def load_posterior(path: str | os.PathLike[str]) -> Posterior:
    """Read `posterior.npz`.

    Args:
        path: of the file.

    Raises:
        InputError: for a file that is missing, damaged or of another version.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            words: dict[str, Any] = json.loads(str(file["words"]))
            if words["version"] != VERSION:
                raise ValueError("version")
            rivals = tuple(
                (float(own["share"]), _of_parts(own, file, f"rival_{place}_"))
                for place, own in enumerate(words["rivals"])
            )
            return dataclasses.replace(_of_parts(words, file, ""), rivals=rivals)
    except FileNotFoundError:
        raise InputError(
            f"{path} does not exist: give the --out of a `fpjax diagnose` that has finished, or leave the option out "
            f"and diagnose now."
        ) from None
    except (OSError, ValueError, LookupError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
        raise InputError(f"{path} is not a posterior of this version of fpjax: diagnose the log again.") from None


def _of_parts(words: Mapping[str, Any], file: Mapping[str, Any], prefix: str) -> Posterior:
    """The inverse of `Posterior._parts`."""
    return Posterior(
        key=(words["structure"], tuple(words["features"])),
        names=tuple(words["names"]),
        values=file[f"{prefix}values"],
        free=tuple(words["free"]),
        covariance=file[f"{prefix}covariance"],
        low=file[f"{prefix}low"],
        high=file[f"{prefix}high"],
        sensor={name: (float(a), float(b)) for name, (a, b) in words["sensor"].items()},
        step=float(words["step"]),
        noise=(float(words["noise"][0]), float(words["noise"][1])),
        missing=tuple(file[f"{prefix}missing_{place}"] for place in range(int(words["logs"]))),
        causes=tuple(words["causes"]),
        gap=math.nan if words["gap"] is None else float(words["gap"]),
    )


def left_open(decision: Decision, causes: Sequence[str], likely: Mapping[str, float]) -> list[tuple[float, Fit]]:
    """Other explanations that the log leaves open: (probability [1], fit), the likeliest first.

    An exact twin of a cause is among them: it makes the same log, but may behave differently under other gains. So is
    what does as well in the place of a detail of the chosen model (a lag of the sensor for a delay of the actuator),
    and the machine whose sensor is right, where that detail is an error of the rate reading: to the gap a scale is
    nearly a wrong inertia, to the tracking it is an error of its own.

    Args:
        decision: on the fits.
        causes: the asserted ones, errors of the reading among them.
        likely: probability that an effect is among the causes [1], by name.
    """
    included = {*decision.chosen.fit.candidate.names, *causes}
    tried = sorted((*decision.rivals, *decision.singles), key=lambda one: -one.worth)
    tried = [*([] if decision.factor is None else [decision.factor]), *tried]
    found: list[tuple[float, Fit]] = []
    for effect in decision.chosen.fit.candidate.effects:
        if causes and effect.name not in causes:
            same = _in_its_place(decision, effect, tried)
            found += [(1.0 / (1.0 + len(same)), fit) for fit in same]
    for name, share in sorted(likely.items(), key=lambda one: -one[1]):
        if name in included or not share >= THRESHOLDS.open:
            continue
        # The best model with the effect in; a wrong nominal number is in the model of nominal numbers alone.
        fits = [one.fit for one in tried if name in one.structural]
        if name.removesuffix("_error") in decision.nominal.fit.candidate.wide:
            fits.append(decision.nominal.fit)
        if fits and all(fits[0] is not other for _, other in found):
            found.append((share, fits[0]))
    return sorted(found, key=lambda one: -one[0])[:MOST]


def _in_its_place(decision: Decision, detail: Effect, tried: Sequence[Weighed]) -> list[Fit]:
    """What the log leaves open of a detail of the chosen model, that model not included."""
    rest = set(decision.chosen.structural) - {detail.name}
    same = [
        one.fit for one in tried
        if rest < set(one.structural) and len(one.structural) == len(rest) + 1 and detail.name not in one.structural
        and one.behind(decision.chosen) < THRESHOLDS.close
    ]  # fmt: skip
    return same + [one.fit for one in tried if rest and on_rate_sensor(detail) and set(one.structural) == rest][:1]


def make_posterior(
    search: Search, fit: Fit, spread: Values, readings: Sequence[Reading], step: float, missing: Sequence[Values],
    rivals: Sequence[tuple[float, Fit]] = (),
) -> Posterior:  # fmt: skip
    """The posterior of a finished fit.

    Args:
        search: of the logs.
        fit: whose posterior is made.
        spread: covariance of its free parameters.
        readings: errors of the rate sensor that the encoder shows.
        step: rounding step of the rate reading [rad/s], where it is seen; else 0.
        missing: course of the missing torque along each log [N m].
        rivals: other fits that the log leaves open, with their probability.
    """
    others = tuple((share, _rival(search, other, readings, step)) for share, other in rivals)
    c, record = fit.candidate, search.records[0]
    names = tuple(parameter.name for parameter in c.family.parameters)
    sensor = {
        READ[name]: (float(value), float(deviation))
        for one in readings
        for name, (value, deviation, _) in one.values.items()
    }
    noise = tuple(0.0 if channel is None else float(channel.noise) for channel in (record.reading, record.position))
    return Posterior(
        key=c.family.key,
        names=names,
        values=np.array(c.vector, float),
        free=tuple(names[index] for index in c.free),
        covariance=np.array(spread, float),
        low=np.array(c.low, float),
        high=np.array(c.high, float),
        sensor=sensor,
        step=float(step),
        noise=(noise[0], noise[1]),
        missing=tuple(np.array(one, float) for one in missing),
        causes=c.names,
        rivals=others,
    )


def _rival(search: Search, fit: Fit, readings: Sequence[Reading], step: float) -> Posterior:
    """The posterior of another explanation, with its own missing torque."""
    courses = [course_of(search, fit, which).torque for which in range(len(search.records))]
    made = make_posterior(search, fit, covariance(search, fit), readings, step, courses)
    return dataclasses.replace(made, gap=float(fit.missing_rms(search.withheld)))


def _with_sensor(machine: Machine, changes: Mapping[str, Any]) -> Machine:
    return dataclasses.replace(machine, sensor=dataclasses.replace(machine.sensor, **changes)) if changes else machine
