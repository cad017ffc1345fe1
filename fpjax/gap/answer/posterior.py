"""Posterior: what a diagnosis knows of its machine, with all correlations, so that others can draw machines from it."""

import dataclasses
import io
import json
import os
import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...errors import InputError
from ...model_file import Model
from ...output.runfile import write_whole
from ..data.record import Record
from ..data.setting import make_setting
from ..effects.vocabulary import EFFECTS
from ..fit.candidate import Fit
from ..fit.search import Search
from ..machine import Machine
from ..precision import double_precision
from ..select.readings import Reading
from ..simulate.family import Key, Nominal, make_family
from ..simulate.replay import assembled

FILE = "posterior.npz"
VERSION = 1
READ = {"time_constant": "lag", "delay": "delay", "scale": "scale", "bias": "bias"}  # of a reading, in the sensor

Values = np.ndarray


@dataclass(frozen=True)
class Posterior:
    """A normal distribution of the fitted parameters, cut at their bounds, and what the fit leaves of the torque.

    Attributes:
        key: structure and features of the machine.
        names: all parameters of the machine.
        values: theirs, in SI units, shape (parameters,).
        free: those that were fitted.
        covariance: of the free ones, shape (free, free); zero where one ended at a bound.
        low: bounds of the free ones, shape (free,).
        high: likewise.
        sensor: what the encoder tells of the rate sensor: (value, standard deviation) by field of the sensor.
        step: that the rate reading is rounded to [rad/s], where that is a cause; else 0.
        noise: standard deviation of one reading of (rate [rad/s], position [rad]); 0 without that column.
        missing: torque that the real machine has and the model lacks along each log [N m], each of shape (samples,);
            NaN where the log was not used.
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

    def draw(self, count: int, seed: int) -> tuple[Values, dict[str, Values]]:
        """(parameters of shape (parameters, count), the sensor's fields, each of shape (count,)); the first is the fit.

        Args:
            count: how many.
            seed: of the draws.
        """
        random = np.random.default_rng(seed)
        vectors = np.repeat(self.values[:, None], count, axis=1)
        if self.free:
            size, basis = np.linalg.eigh(self.covariance)
            root = basis * np.sqrt(np.maximum(size, 0.0))
            index = [self.names.index(name) for name in self.free]
            moved = vectors[index] + root @ random.standard_normal((len(self.free), count))
            moved[:, 0] = self.values[index]
            vectors[index] = np.clip(moved, self.low[:, None], self.high[:, None])
        sensor = {}
        for name, (value, deviation) in self.sensor.items():
            drawn = value + deviation * random.standard_normal(count)
            drawn[0] = value
            # A negative lag is no lag; a scale turns no sign.
            floor = -np.inf if name == "bias" else 0.0 if name in ("lag", "delay") else 0.01 * abs(value)
            sensor[name] = np.maximum(drawn, floor)
        return vectors, sensor

    def machines(self, model: Model, records: Sequence[Record], count: int, seed: int = 0) -> Machine:
        """Machines drawn from it: one whose every array has a leading axis of `count`; the first is the fit.

        Args:
            model: the nominal one, as it was diagnosed.
            records: the logs that were diagnosed.
            count: how many.
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
        strange = [name for name in self.names if name not in known and name in self.free]
        if strange or family.key != self.key:
            raise InputError(
                f"The diagnosis has parameters that fpjax does not know ({', '.join(strange) or family.key}): effects "
                f"of your own cannot be drawn from yet; diagnose with the usual vocabulary."
            )
        with double_precision():
            full = np.repeat(family.neutral(make_setting(list(records), model))[:, None], count, axis=1)
            full[[known.index(name) for name in here]] = vectors[[self.names.index(name) for name in here]]
            machine = assembled(family.machine, family.effects, family.parameters, jnp.asarray(full))
            shape = (count,)
            machine = jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, float), shape), machine)
            changes = {name: jnp.asarray(values) for name, values in sensor.items()}
            if self.step > 0.0:
                changes["step_size"] = jnp.full(shape, self.step)
            return _with_sensor(machine, changes)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `posterior.npz`, whole or not at all.

        Args:
            path: of the file.

        Raises:
            InputError: where it cannot be written.
        """
        words = {
            "version": VERSION, "structure": self.key[0], "features": list(self.key[1]), "names": list(self.names),
            "free": list(self.free), "sensor": {name: list(pair) for name, pair in self.sensor.items()},
            "step": self.step, "noise": list(self.noise), "logs": len(self.missing),
        }  # fmt: skip
        arrays: dict[str, Any] = {
            "values": self.values,
            "covariance": self.covariance,
            "low": self.low,
            "high": self.high,
        }
        arrays |= {f"missing_{place}": one for place, one in enumerate(self.missing)}
        stream = io.BytesIO()
        np.savez_compressed(stream, words=np.array(json.dumps(words)), **arrays)
        write_whole(pathlib.Path(path), stream.getvalue())


def load_posterior(path: str | os.PathLike[str]) -> Posterior:
    """Read `posterior.npz`.

    Args:
        path: of the file.

    Raises:
        InputError: for a file that is not there or is none.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            words: dict[str, Any] = json.loads(str(file["words"]))
            if words["version"] != VERSION:
                raise ValueError("version")
            return Posterior(
                key=(words["structure"], tuple(words["features"])),
                names=tuple(words["names"]),
                values=file["values"],
                free=tuple(words["free"]),
                covariance=file["covariance"],
                low=file["low"],
                high=file["high"],
                sensor={name: (float(a), float(b)) for name, (a, b) in words["sensor"].items()},
                step=float(words["step"]),
                noise=(float(words["noise"][0]), float(words["noise"][1])),
                missing=tuple(file[f"missing_{place}"] for place in range(int(words["logs"]))),
            )
    except FileNotFoundError:
        raise InputError(
            f"{path} does not exist: give the --out of a `fpjax diagnose` that has finished, or leave the option out "
            f"and diagnose now."
        ) from None
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        raise InputError(f"{path} is no posterior of this version of fpjax: diagnose the log again.") from None


def make_posterior(
    search: Search, fit: Fit, spread: Values, readings: Sequence[Reading], step: float, missing: Sequence[Values]
) -> Posterior:
    """The posterior of a finished fit.

    Args:
        search: of the logs.
        fit: the chosen one.
        spread: covariance of its free parameters.
        readings: what the encoder tells of the rate sensor, where that is a cause.
        step: that the rate reading is rounded to, where that is a cause [rad/s].
        missing: course of the missing torque along each log [N m].
    """
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
    )


def _with_sensor(machine: Machine, changes: Mapping[str, Any]) -> Machine:
    return dataclasses.replace(machine, sensor=dataclasses.replace(machine.sensor, **changes)) if changes else machine
