"""One run of a closed loop, from its settings to a `Run`; `fpjax.simulate` (in `verbs`) also takes models and files."""

import os
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from ..blocks.controllers import TransferFunction
from ..blocks.references import AbstractReference
from ..compiled.native import native
from ..compiled.programs import jit_by
from ..errors import DivergedError, InputError
from ..output.drawable import Drawable
from ..output.json_object import JsonObject
from ..output.run_picture import About
from .divergence import LARGEST, in_proportion
from .histories import with_histories
from .input_checks import check_frequency, check_one_run, checked_initial, shown
from .loop import ClosedLoop, LoopState
from .metrics import AbstractMeasure
from .scan import Stepper, Stepping, make_inputs, make_stepper, roll
from .solvers import AbstractPlantSolver
from .stability import warn_if_stiff

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Bytes of a number, and the number of tables in every run: the time, and the reference at up to three solver nodes.
BYTES, INPUTS = 8, 4


class Status(IntEnum):
    """How a run ended."""

    COMPLETED = 0
    DIVERGED = 1


SENTENCES = {
    Status.COMPLETED: "completed",
    Status.DIVERGED: "diverged: a signal left the range of finite numbers, or grew out of all proportion to torque and "
    "reference; use smaller gains or a smaller step",
}


class Run(Drawable, eqx.Module):
    """The result of a simulation.

    `plot` draws the recorded signals: reference and motion, error, torques, estimates with their true values.

    Attributes:
        time: [s], shape (samples,). All arrays are numpy's where a model was simulated, jax' where blocks were.
        signals: recorded signals by name, each of shape (samples,).
        measures: measures by name.
        status: a `Status` as an integer.
        final_state: state one step after the last sample.
        about: units and true values for the picture (static).
    """

    time: Float[Array | np.ndarray, " samples"]
    signals: dict[str, Float[Array | np.ndarray, " samples"]]
    measures: dict[str, Float[Array | np.ndarray, "..."]]
    status: Int[Array, ""]
    final_state: LoopState
    about: About | None = eqx.field(static=True, default=None)

    @property
    def diverged(self) -> bool:
        """Whether the run left the range of finite numbers, or all proportion to its torque and reference."""
        return int(self.status) == Status.DIVERGED

    @property
    def message(self) -> str:
        """The status as a sentence."""
        return SENTENCES[Status(int(self.status))]

    @property
    def settled(self) -> dict[str, float]:
        """Mean over the last quarter of every estimate that was recorded, by name."""
        return {name: float(np.mean(values)) for name, values in self._last_quarter.items()}

    @property
    def scatter(self) -> dict[str, float]:
        """Standard deviation over the last quarter of every estimate that was recorded, by name."""
        return {name: float(np.std(values)) for name, values in self._last_quarter.items()}

    @property
    def _last_quarter(self) -> dict[str, np.ndarray]:
        # the last quarter, as `estimate` has it by default: the estimates have had three quarters of the run to
        # settle
        quarter = max(len(self.time) // 4, 1)
        return {
            name.removeprefix("estimates."): np.asarray(values, float)[-quarter:]
            for name, values in self.signals.items()
            if name.startswith("estimates.")
        }

    def __str__(self) -> str:
        if np.ndim(self.status) or isinstance(self.status, Tracer):
            return f"Run of a batch, signals {', '.join(self.signals) or 'none'}, measures {', '.join(self.measures)}"
        step = float(self.time[1] - self.time[0]) if len(self.time) > 1 else 0.0
        lines = [f"{self.message}: {len(self.time)} samples of {step:.4g} s, {self.time.dtype}"]
        lines += [f"  {name:<32} {float(np.asarray(value)):.6g}" for name, value in self.measures.items()]
        for name, values in self.signals.items():
            row = np.asarray(values, dtype=float)
            rms = float(np.sqrt(np.mean(row**2)))
            lines.append(f"  {name:<32} rms {rms:<11.5g} from {row.min():.5g} to {row.max():.5g}, last {row[-1]:.5g}")
        truths, scatter = dict(self.about.truths) if self.about else {}, self.scatter
        for name, value in self.settled.items():
            true = f" (true {truths[name]:.5g})" if truths.get(name) else ""
            lines.append(f"  {name + ', mean of the last quarter':<32} {value:.5g} +- {scatter[name]:.2g}{true}")
        return "\n".join(lines)

    __repr__ = __str__

    def _figure(self) -> "Figure":
        if not self.signals:
            raise InputError(
                'Nothing was recorded: give simulate record=("reference", "velocity", "torque"), or a model, which '
                "records all."
            )
        from ..output.run_picture import run_figure

        signals = {name: np.asarray(values) for name, values in self.signals.items()}
        return run_figure(np.asarray(self.time), signals, self.about or About())

    def to_dataframe(self) -> Any:
        """The recorded signals as a `pandas.DataFrame`, the time [s] as its index.

        Raises:
            InputError: where pandas is not installed.
        """
        from ..output.data_frames import to_frame

        return to_frame(self.signals, self.time)


def simulate(
    loop: ClosedLoop,
    reference: AbstractReference,
    *,
    dt: Any,
    duration: float | None = None,
    samples: int | None = None,
    solver: str | AbstractPlantSolver = "rk4",
    stepping: Stepping = "continuous",
    substeps: int = 1,
    measures: dict[str, AbstractMeasure] | None = None,
    record: str | tuple[str, ...] = (),
    initial: LoopState | None = None,
    key: Array | None = None,
    throw: bool = False,
) -> Run:
    """Simulate a closed loop of blocks; see `fpjax.simulate`.

    Args:
        loop: the closed loop.
        reference: reference of the loop [rad/s], or [rad] for a position loop.
        dt: step, or control period when sampled [s].
        duration: [s]; samples run from 0 to duration, both included.
        samples: number of samples, instead of `duration`.
        solver: "euler", "heun", "ode3" or "rk4"; "exact" resolves sticking exactly (sampled stepping).
        stepping: "continuous" or "sampled".
        substeps: solver steps per control period when sampled.
        measures: measures to accumulate along the run, by names of your choice.
        record: signals to store, by the names of `Signals`; an estimate as "estimates.coulomb".
        initial: state to start from, at t = 0 of the reference; None for rest.
        key: `jax.random` key of the sensor's noise; None for no noise.
        throw: raise an error where the run diverges, instead of reporting it in `status`.

    Returns:
        A `Run`.

    Raises:
        InputError: for invalid settings.
        DivergedError: with `throw`, for a run that diverged.
    """
    stepper = make_stepper(
        dt=dt, duration=duration, samples=samples, solver=solver, stepping=stepping, substeps=substeps
    )
    names = (record,) if isinstance(record, str) else tuple(record)
    _check_memory(stepper.samples, len(names))
    if not isinstance(key, jax.Array | None):
        raise InputError(f"key is {shown(key)}: give a jax.random key, as jax.random.key(0).")
    if not isinstance(dt, Tracer):
        check_frequency(reference, float(dt), ("The reference's", "dt"))
        if stepping == "sampled":
            _check_periods(loop, float(dt))
            loop = with_histories(loop, float(dt))
        warn_if_stiff(loop, float(dt) / (substeps if stepping == "sampled" else 1), stepper.solver)
    check_one_run(loop, reference, stepper)
    initial = None if initial is None else checked_initial(initial, loop, stepping)
    run = _run(loop, reference, stepper, measures or {}, names, initial, key)
    if throw and run.diverged:
        raise DivergedError(f"The run {run.message}.")
    return run


def _check_memory(samples: int, recorded: int) -> None:
    """Refuse a run whose signals do not fit into the memory.

    Systems that overcommit memory would grant the request, and end the process later.
    """
    try:
        there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not every system reports its memory
        return
    needed = BYTES * samples * (INPUTS + recorded)
    if needed > there:
        raise InputError(
            f"{samples} samples with {recorded} signals recorded need {needed / 1e9:.3g} GB, but this machine has "
            f"{there / 1e9:.3g} GB: shorten the run, take a larger dt, or record less."
        )


def _check_periods(loop: ClosedLoop, dt: float) -> None:
    """Refuse a transfer function that was discretised for another control period: it would be another controller."""
    for part in jax.tree.leaves(loop, is_leaf=lambda leaf: isinstance(leaf, TransferFunction)):
        period = part.period if isinstance(part, TransferFunction) else None
        if period is not None and abs(dt / period - 1.0) > 1e-6:
            raise InputError(
                f"The TransferFunction was discretised for a period of {period:g} s, but dt = {dt:g} s: build it with "
                f"period={dt:g}."
            )


def _shape_of_run(
    loop: ClosedLoop, reference: AbstractReference, stepper: Stepper, measures: JsonObject, record: tuple[str, ...],
    initial: LoopState | None, key: Array | None,
) -> tuple[Any, ...]:  # fmt: skip
    """What a run is compiled for, as a key for `jit_by`."""
    del loop, reference, initial, key
    return stepper.samples, stepper.stepping, stepper.substeps, type(stepper.solver), record, tuple(sorted(measures))


@jit_by(_shape_of_run)
def _run(
    loop: ClosedLoop,
    reference: AbstractReference,
    stepper: Stepper,
    measures: dict[str, AbstractMeasure],
    record: tuple[str, ...],
    initial: LoopState | None,
    key: Array | None,
) -> Run:
    inputs = make_inputs(loop, reference, stepper, key)
    # `native` takes arrays only, so all else (functions, names, settings) is split off and put back inside.
    dynamic, static = eqx.partition((loop, inputs, stepper, measures, initial), eqx.is_array)

    def scan(arrays: Any) -> Any:
        loop, inputs, stepper, measures, initial = eqx.combine(arrays, static)
        return roll(loop, inputs, stepper, measures, record, initial)

    finals, recorded, state = native(scan)(dynamic)
    status = run_status(finals, state, in_proportion(loop.controller, recorded))
    return Run(inputs.time, recorded, finals, status, state)


def run_status(finals: dict[str, Array], state: LoopState, whole: Bool[Array, "..."]) -> Int[Array, ""]:
    """`Status` of a run: diverged where a final state is not finite or beyond 1e15, a measure is NaN, or by proportion.

    Args:
        finals: measures by name.
        state: one step after the last sample.
        whole: by sample, from `in_proportion`.
    """
    leaves = [leaf for leaf in jax.tree.leaves(state) if eqx.is_inexact_array(leaf)]  # integers cannot diverge
    healthy = jnp.all(whole)
    for leaf in leaves:
        healthy = healthy & jnp.all(jnp.abs(leaf) < LARGEST)
    for value in finals.values():
        healthy = healthy & jnp.all(~jnp.isnan(value))  # a measure may be infinite: a time of something that never was
    return jnp.where(healthy, int(Status.COMPLETED), int(Status.DIVERGED))
