"""Family: one compiled loop that holds many effects, each neutral by its value, and the lanes that run through it.

A model with two effects is the family's machine with the other effects at their neutral values, so that sets of
effects need no compilation of their own: `fpjax diagnose` compiles a loop for a structure and a set of features only.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ...blocks.actuators import AbstractActuator
from ...blocks.plants import AbstractPlant
from ...blocks.sensors import AbstractSensor
from ...compiled.batch import cores
from ...compiled.threads import on_threads, settings, under
from ...logs.arrays import Values
from ...simulation.precision import double_precision
from ..data.record import LONGEST, Record
from ..data.setting import Setting
from ..data.tables import TAPS, Tables
from ..effects.always import LATE_TORQUE, LOAD_ERROR, NOMINAL_VALUES
from ..effects.effect import Effect, EffectParameter, free, leaf
from ..effects.parameters import ACTUATOR_DELAY, NOMINAL, SHAPES
from ..effects.shaft import shaft_values
from ..machine import FEATURES, Feature, Machine, Structure, nominal_machine, structure_of, with_structure
from .lane_kernel import LANES
from .replay import STATES, residual_kernel
from .windows import as_rows

Key = tuple[Structure, tuple[str, ...]]
CHUNKS = 2  # least chunks of lanes for a thread: starting one costs about a tenth of a chunk


@dataclass(frozen=True)
class Nominal:
    """The blocks of the nominal model, which the log is compared with.

    Attributes:
        plant: of the model.
        actuator: of the model, or None.
        sensor: of the model, or None.
    """

    plant: AbstractPlant
    actuator: AbstractActuator | None = None
    sensor: AbstractSensor | None = None


@dataclass(frozen=True)
class Family:
    """All effects that one structure with one set of features can hold.

    Attributes:
        key: structure and features.
        machine: the nominal machine with every effect neutral.
        effects: those that it can hold, after those that hold the nominal values and the error of a known load.
        parameters: of these effects, each once, in their order: that of every vector.
        known: values of the effects that the nominal model has already, by parameter name.
    """

    key: Key
    machine: Machine
    effects: tuple[Effect, ...]
    parameters: tuple[EffectParameter, ...]
    known: dict[str, float]

    @property
    def states(self) -> int:
        """Number of start values of a window."""
        return STATES[self.key[0]]

    def index(self, name: str) -> int:
        """Index of a parameter in the vector."""
        return [p.name for p in self.parameters].index(name)

    def neutral_values(self, setting: Setting) -> dict[str, float]:
        """The nominal model's parameters by name."""
        return {p.name: float(v) for p, v in zip(self.parameters, self.neutral(setting), strict=True)}

    def neutral(self, setting: Setting) -> np.ndarray:
        """The nominal model's vector, shape (parameters,): its own values, and neutral ones for effects it lacks."""
        known = {**setting.nominal, **self.known}
        return np.array([known.get(p.name, p.neutral(setting)) for p in self.parameters])


def make_family(key: Key, nominal: Nominal, effects: tuple[Effect, ...], setting: Setting) -> Family:
    """The family of a structure and features; effects that need another structure or feature are left out."""
    structure = key[0]
    features: tuple[Feature, ...] = tuple(feature for feature in FEATURES if feature in key[1])
    machine = nominal_machine(nominal.plant, nominal.actuator, nominal.sensor, features)
    # The deflection is the neutral value of `bristle_deflection` (2 ms of travel at top speed), with which `_known`
    # compares it. The resonance, a tenth of the sampling frequency, is replaced by the value of every candidate.
    has_shaft = structure_of(machine) == "transmission"
    machine = with_structure(machine, structure, 0.1 / setting.dt, 2e-3 * setting.speed)
    structure = structure_of(machine)
    fitting = tuple(e for e in effects if e.structure in ("rigid", structure) and set(e.features) <= set(features))
    if not any(p in e.parameters for e in fitting for p in (ACTUATOR_DELAY, *LATE_TORQUE.parameters)):
        fitting = (*fitting, LATE_TORQUE)  # an error of the log, whichever causes are asked for
    always = (NOMINAL_VALUES, LOAD_ERROR) if setting.turning_load and "torque" in features else (NOMINAL_VALUES,)
    named: dict[str, EffectParameter] = {}
    for parameter in free((*always, *fitting)):
        named.setdefault(parameter.name, parameter)
    known: dict[str, float] = {}
    for effect in fitting:
        known |= _known(effect, machine, setting)
    if has_shaft:
        known |= shaft_values(machine)
    return Family((structure, features), machine, (*always, *fitting), tuple(named.values()), known)


def _known(effect: Effect, machine: Machine, setting: Setting) -> dict[str, float]:
    """Values of an effect's parameters in a machine that has the effect; {} in one that does not."""
    leaves = {p: value for p in effect.parameters if p.path and (value := leaf(machine, p.path)) is not None}
    # A parameter of shape does not show that the machine has the effect.
    switches = {p: value for p, value in leaves.items() if p.name not in SHAPES}
    if all(value == p.neutral(setting) for p, value in switches.items() if p not in NOMINAL):
        return {}
    return {p.name: value for p, value in leaves.items() if p not in NOMINAL}


def key_for(effects: tuple[Effect, ...], setting: Setting) -> Key:
    """The least structure and features that hold these effects together; further terms would only cost time.

    Args:
        effects: in the model.
        setting: sizes: a known load that turns has its error beside any effect.
    """
    structures = {e.structure for e in effects} - {"rigid"}
    structure: Structure = "transmission" if "transmission" in structures else "bristles" if structures else "rigid"
    wanted = {feature for e in effects for feature in e.features} | ({"torque"} if setting.turning_load else set())
    return structure, tuple(f for f in FEATURES if f in wanted)


class Runner:
    """Runs lanes through a family's compiled loop.

    The loop is compiled once for each family and set of channels (rate, position or both).

    Args:
        family: that the loop simulates.
        records: the logs.
        tables: the records as the loop reads them.
        fine: with shorter steps, to measure the integration error of the usual ones.
    """

    def __init__(self, family: Family, records: list[Record], tables: list[Tables], *, fine: bool = False):
        self.family, self.records, self.tables = family, records, tables
        first = records[0]
        self.samples, self.channels = first.samples, sum(first.channels)
        with double_precision():
            nominal = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), family.machine)
        self.fixed = [jax.tree.leaves((nominal, table)) for table in tables]
        structure = jax.tree.structure((nominal, tables[0]))
        room = max(LONGEST[first.velocity is None], self.samples)
        self.length = np.int32(self.samples)
        self.kernel = residual_kernel(family.effects, family.parameters, room, first.channels, fine, structure)

    def run(
        self,
        which: int,
        vector: Float[Values, "parameters lanes"],
        states: Float[Values, "states lanes"],
        windows: dict[str, Values],
    ) -> tuple[Float[Values, "channels samples lanes"], Float[Values, "2 lanes"]]:
        """Residuals (simulated less measured) of windows, and the hidden states at their ends.

        Args:
            which: index of the record.
            vector: values of the family's parameters, shape (parameters, lanes).
            states: deviations of the start values, shape (states, lanes); see `initial`.
            windows: the fields of `Windows`, each of shape (lanes,) (`hidden` (2, lanes)).

        Returns:
            (residuals in standard deviations, shape (channels, samples, lanes); hidden states, (2, lanes)).
        """
        count = vector.shape[1]
        chunks = -(-count // LANES)
        # Shape (chunks, LANES): a kernel takes exactly LANES, so copies of the last lane fill up the last chunk.
        padded = np.minimum(np.arange(chunks * LANES), count - 1).reshape(chunks, LANES)
        # Shape (chunks, rows, LANES), copied so that each chunk lies in one piece of memory.
        rows = np.moveaxis(as_rows(vector, states, windows)[:, padded], 1, 0).copy()
        starts = windows["start"][padded]
        result, ends = np.empty((self.channels, self.samples, count)), np.zeros((2, count))
        # JAX's settings (precision, default device) belong to a thread: every thread is given this one's.
        own, fixed = settings(), self.fixed[which]
        (device,) = self.tables[which].torque.devices()
        # On a GPU one thread: its chunks queue on the device anyway.
        threads = max(1, min(cores(), chunks // CHUNKS)) if device.platform == "cpu" else 1

        def part(number: int) -> None:
            with under(own), double_precision(), jax.default_device(device):
                for chunk in range(number, chunks, threads):
                    _store(result, ends, chunk * LANES, self.kernel(fixed, rows[chunk], starts[chunk], self.length))

        on_threads(part, threads)
        return result, ends


def _store(result: np.ndarray, ends: np.ndarray, first: int, out: tuple[jax.Array, jax.Array]) -> None:
    last = min(first + LANES, result.shape[2])
    result[:, :, first:last] = np.asarray(out[0])[:, : result.shape[1], : last - first]
    ends[:, first:last] = np.asarray(out[1])[:, : last - first]


def window_fields(
    record: Record, windows: Int[Values, " windows"], hidden: Float[Values, "2 all"]
) -> dict[str, Values]:
    """The fields of `Windows` for some windows of a record, each of shape (windows,), `hidden` (2, windows).

    Args:
        record: the log.
        windows: indices into its `starts`.
        hidden: estimates of the hidden states at the windows' starts, shape (2, all windows).
    """
    starts = record.starts[windows]
    return {
        "start": (starts + TAPS).astype(np.int32),
        "time": record.elapsed[starts],
        "velocity": record.speed[starts],
        "slope": record.acceleration[starts],
        "position": record.angle[starts],
        "hidden": hidden[:, windows],
        "integrated": np.full(len(starts), 1.0 if record.integrated else 0.0),
    }
