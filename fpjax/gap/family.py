# pyright: reportArgumentType=false
"""Family: one compiled super-model, and the batches of lanes that run through it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..blocks.plants import AbstractPlant
from ..compiled.batch import cores
from ..compiled.threads import on_threads, settings, under
from .effect import Effect, Parameter, Setting, free, neutral_vector
from .freed import NOMINAL
from .imposed import imposed_kernel, imposed_motion
from .machine import FEATURES, Machine, Structure, nominal_machine, structure_of, with_structure
from .precision import double_precision
from .record import Record, stride_of
from .replay import LANES, STATES, TAPS, as_rows, residual_kernel

Key = tuple[Structure, tuple[str, ...]]
CHUNKS = 2  # of lanes that a thread should have at least: to ask it takes about a tenth of one
FINE = "fine"  # in the place of a feature: the same family in shorter steps

# What a lane's period takes on one core of 2024 [s]: a budget in these does not depend on what else the machine does.
COSTS: dict[Structure, float] = {"rigid": 7e-8, "bristles": 18e-8, "transmission": 6e-8}


@dataclass(frozen=True)
class Nominal:
    """The model that the log is compared with.

    Attributes:
        plant: of the model.
        actuator: of the model, or None.
        sensor: of the model, or None.
    """

    plant: AbstractPlant
    actuator: Any = None
    sensor: Any = None


@dataclass(frozen=True)
class Family:
    """All effects that one structure and one set of terms can hold.

    Attributes:
        key: structure and features.
        machine: the nominal machine with every effect neutral.
        effects: those that it can hold.
        parameters: theirs, the nominal ones first.
    """

    key: Key
    machine: Machine
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...]

    @property
    def states(self) -> int:
        """Number of start values of a window."""
        return STATES[self.key[0]]

    def index(self, name: str) -> int:
        """Place of a parameter in the vector."""
        return [p.name for p in self.parameters].index(name)

    def neutral_values(self, setting: Setting) -> dict[str, float]:
        """The nominal model's parameters by name."""
        return {p.name: float(v) for p, v in zip(self.parameters, self.neutral(setting), strict=True)}

    def neutral(self, setting: Setting) -> np.ndarray:
        """The nominal model's vector, shape (parameters,)."""
        return neutral_vector(self.parameters, setting)


def make_family(key: Key, nominal: Nominal, effects: tuple[Effect, ...], setting: Setting) -> Family:
    """The family of a structure and features; effects that need more are left out."""
    structure, features = key[0], tuple(feature for feature in FEATURES if feature in key[1])
    machine = nominal_machine(nominal.plant, nominal.actuator, nominal.sensor, features)
    machine = with_structure(machine, structure, 0.1 / setting.dt, 2e-3 * setting.speed)
    structure = structure_of(machine)
    fitting = tuple(e for e in effects if e.structure in ("rigid", structure) and set(e.features) <= set(features))
    named = {p.name: p for p in NOMINAL}
    for parameter in free(fitting):
        named.setdefault(parameter.name, parameter)
    return Family((structure, features), machine, (_BASE, *fitting), tuple(named.values()))


_BASE = Effect("nominal", NOMINAL, features=())


def key_for(effects: tuple[Effect, ...]) -> Key:
    """What a machine must have to hold these effects together, and no more: what is left out costs no time."""
    structures = {e.structure for e in effects} - {"rigid"}
    structure: Structure = "transmission" if "transmission" in structures else "bristles" if structures else "rigid"
    wanted = {feature for e in effects for feature in e.features}
    return structure, tuple(f for f in FEATURES if f in wanted)


class Runner:
    """Runs lanes through a family's compiled loop; compiled once for a family, a window length and the log's
    channels.
    """

    def __init__(self, family: Family, records: list[Record], tables: list[Any]):
        self.family = family
        self.records = records
        self.tables = tables
        first = records[0]
        self.spent = 0.0  # what was simulated so far, as `COSTS` counts it [s]
        self.imposed = first.velocity is None
        self.half, self.stride = first.half, 1
        if self.imposed:
            self.stride = stride_of(first.half)
            inertia = float(np.asarray(family.machine.plant.inertia))
            with double_precision():
                self.motions = [
                    imposed_motion(record, inertia, len(at.torque)) for record, at in zip(records, tables, strict=True)
                ]
        channels = (first.velocity is not None, first.position is not None)
        self.length = first.samples
        self.samples = first.samples // self.stride
        self.channels = sum(channels)
        with double_precision():
            nominal = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), family.machine)
        fixed = list(zip([nominal] * len(records), tables, *([self.motions] if self.imposed else ()), strict=True))
        self.fixed = [jax.tree.leaves(each) for each in fixed]
        self.structure = jax.tree.structure(fixed[0])
        if not self.imposed:
            fine = FINE in family.key[1]
            self.kernel = residual_kernel(
                family.effects, family.parameters, first.samples, channels, fine, self.structure
            )

    def run(
        self, which: int, vector: np.ndarray, states: np.ndarray, windows: dict[str, np.ndarray], stride: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """(residuals in standard deviations, shape (channels, samples, lanes), of the torque where motion is imposed;
        hidden states at the windows' ends, (2, lanes)).

        Args:
            which: index of the record.
            vector: (parameters, lanes).
            states: (states, lanes).
            windows: the fields of `Windows`, each of shape (lanes,) (`hidden` (2, lanes)).
            stride: samples from one value to the next where motion is imposed; 0 for the usual.
        """
        count, stride = vector.shape[1], stride or self.stride
        chunks = -(-count // LANES)
        self.spent += chunks * LANES * self.length * COSTS[self.family.key[0]]
        padded = np.minimum(np.arange(chunks * LANES), count - 1).reshape(chunks, LANES)
        rows = np.moveaxis(as_rows(vector, states, windows)[:, padded], 1, 0).copy()
        starts = windows["start"][padded]
        result, ends = np.empty((self.channels, self.length // stride, count)), np.zeros((2, count))
        kernel, own = self._kernel(which, stride), settings()
        (device,) = jnp.zeros(()).devices()
        threads = max(1, min(cores(), chunks // CHUNKS)) if device.platform == "cpu" else 1

        def part(number: int) -> None:
            with under(own), double_precision(), jax.default_device(device):
                for chunk in range(number, chunks, threads):
                    _store(result, ends, chunk * LANES, kernel(rows[chunk], starts[chunk]))

        on_threads(part, threads)
        return result, ends

    def _kernel(self, which: int, stride: int) -> Callable[[np.ndarray, np.ndarray], tuple[Any, Any]]:
        fixed = self.fixed[which]
        if not self.imposed:
            return lambda rows, start: self.kernel(fixed, rows, start)
        family, nothing = self.family, np.zeros((2, LANES))
        kernel = imposed_kernel(family.effects, family.parameters, self.length, self.half, stride, self.structure)
        return lambda rows, start: (kernel(fixed, rows, start), nothing)


def _store(result: np.ndarray, ends: np.ndarray, first: int, out: Any) -> None:
    last = min(first + LANES, result.shape[2])
    result[:, :, first:last] = np.asarray(out[0])[:, :, : last - first]
    ends[:, first:last] = np.asarray(out[1])[:, : last - first]


def window_fields(record: Record, windows: np.ndarray, hidden: np.ndarray) -> dict[str, Any]:
    """The fields of `Windows` for some windows of a record, each of shape (windows,).

    Args:
        record: the log.
        windows: indices into its `starts`.
        hidden: centre of the hidden states, shape (2, all windows).
    """
    starts = record.starts[windows]
    return {
        "start": (starts + TAPS).astype(np.int32),
        "time": record.time[starts] - record.time[0],
        "velocity": record.speed[starts],
        "slope": record.acceleration[starts],
        "position": record.angle[starts],
        "hidden": hidden[:, windows],
        "integrated": np.full(len(starts), 1.0 if record.position is None else 0.0),
    }
