"""An observer run over a recorded log: torque and measured motion in, estimates over time out, beside least squares.

It does not matter whether the logged torque contained a compensation. An observer needs the control before its own
compensation, u = torque - load - compensation(estimates), and this is computed here from the logged torque at every
sample.

Timing: the torque logged at t_k is held until t_k+1, so it belongs to the velocity in the middle of that period and to
the difference of the velocities at its ends. Both the observer and the least squares use these pairs. Pairing the
torque with the motion at t_k would be half a period wrong, and this error would look like friction (and like a delay).
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..blocks.loads import AbstractLoad, NoLoad
from ..blocks.observers import AbstractObserver
from ..blocks.signals import Motion
from ..compiled.native import scan_loop
from ..compiled.programs import jit_by
from ..errors import InputError
from ..logs import Log
from ..logs.dynamics.derivative import Differentiator, measured_velocity, travel
from ..logs.dynamics.friction_curve import FrictionCurve, friction_curve
from ..logs.dynamics.nominal import fit_nominal
from ..logs.dynamics.regression import fit_pairs
from ..output.drawable import Drawable
from ..output.json_object import JsonObject
from .excitation import Excitation, assess_excitation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNITS = {
    True: {"coulomb": "N", "viscous": "N s/m", "steepness": "s/m", "inertia": "kg", "offset": "N"},
    False: {"coulomb": "N m", "viscous": "N m s/rad", "steepness": "s/rad", "inertia": "kg m^2", "offset": "N m"},
}


@dataclasses.dataclass(frozen=True)
class Estimated(Drawable):
    """An observer's estimates from a log.

    `plot` draws the velocity and every estimate against time with the least-squares value, and friction against
    velocity.

    Attributes:
        time: time of each estimate, the end of its control period [s], shape (samples - 1,).
        estimates: by name, each in its own unit, shape (samples - 1,).
        final: mean of each estimate over the last `average` seconds.
        spread: standard deviation of each estimate over the same seconds.
        average: length of that averaging window at the end of the log [s].
        least_squares: coulomb, viscous and offset fitted to the same pairs with the inertia as given; and "free
            inertia", the inertia where it is fitted too.
        velocity: the velocity that the observer used [rad/s], in the middle of each period, shape (samples - 1,).
        excitation: the error dynamics along this motion at the least-squares values; None where an observer estimates
            a parameter that least squares does not give.
        differentiated: how the velocity was obtained, in words.
        name: the log's name.
        linear: whether the machine is linear, with units N and m.
        passes: how often the observer went over the log; the traces are those of the last pass.
        friction: torque less inertia and loads in bins of velocity; None where the motion does not determine it.
    """

    time: Float[np.ndarray, " periods"]
    estimates: dict[str, Float[np.ndarray, " periods"]]
    final: dict[str, float]
    spread: dict[str, float]
    average: float
    least_squares: dict[str, float]
    velocity: Float[np.ndarray, " periods"]
    excitation: Excitation | None
    differentiated: str
    name: str = "log"
    linear: bool = False
    passes: int = 1
    friction: FrictionCurve | None = None

    @property
    def sentences(self) -> tuple[str, ...]:
        """Warnings: one sentence for each estimate that cannot converge on this motion."""
        return () if self.excitation is None else self.excitation.sentences

    @property
    def _pass(self) -> str:
        return "" if self.passes == 1 else f" (pass {self.passes} of {self.passes})"

    def unit(self, name: str) -> str:
        """Unit of a quantity by its name."""
        return UNITS[self.linear].get(name, "")

    def to_dataframe(self) -> Any:
        """The estimates and the velocity they were made from as a `pandas.DataFrame`, the time [s] as its index.

        Raises:
            InputError: where pandas is not installed.
        """
        from ..output.data_frames import to_frame

        return to_frame({**self.estimates, "velocity": self.velocity}, self.time)

    def to_dict(self) -> JsonObject:
        """Numbers for a JSON file (without the traces)."""
        excitation = None
        if self.excitation is not None:
            excitation = {
                "slow_mode_s": _number(self.excitation.slow_mode),
                "smallest_eigenvalue": self.excitation.smallest_eigenvalue,
                "remaining": dict(zip(self.excitation.names, map(float, self.excitation.remaining), strict=True)),
            }
        return {
            "log": self.name,
            "estimates": self.final,
            "spread": self.spread,
            "average_s": self.average,
            "passes": self.passes,
            "least_squares": self.least_squares,
            "excitation": excitation,
            "velocity": self.differentiated,
            "warnings": list(self.sentences),
        }

    def __str__(self) -> str:
        head = f"{self.name}{self._pass}: mean over the last {self.average:.3g} s; velocity {self.differentiated}"
        rows = [f"  {'':<10}{'observer':>12}{'spread':>12}{'least squares':>16}"]
        for name, value in self.final.items():
            fitted = self.least_squares.get(name)
            other = "" if fitted is None else f"{fitted:16.5g}"
            rows.append(f"  {name:<10}{value:12.5g}{self.spread[name]:12.2g}{other} {self.unit(name)}")
        return "\n".join([head, *rows, *self.sentences])

    __repr__ = __str__

    def _figure(self) -> "Figure":
        from ..logs.dynamics.friction_picture import Law, draw_friction
        from ..output.plotting import BLUE, GREEN, GREY, RED, new_figure, style, thin

        laws = [
            Law(label, colour, values["coulomb"], values["viscous"], values.get("offset", 0.0), label != "observer")
            for label, colour, values in (("observer", GREEN, self.final), ("least squares", RED, self.least_squares))
            if {"coulomb", "viscous"} <= set(values)
        ]
        over_time = 1 + len(self.estimates)
        rows = over_time + (self.friction is not None)
        figure, axes = new_figure(
            rows, title=f"Friction estimated from {self.name}{self._pass}",
            height_ratios=[*(1.0,) * over_time, *(1.4,) * (rows - over_time)],
        )  # fmt: skip
        beside = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0}
        with style():
            time, velocity = thin(self.time, self.velocity)
            axes[0, 0].plot(time, velocity, color=GREY)
            axes[0, 0].set_ylabel("velocity [m/s]" if self.linear else "velocity [rad/s]")
            for panel, (name, values) in zip(axes[1:over_time, 0], self.estimates.items(), strict=True):
                panel.sharex(axes[0, 0])
                panel.plot(*thin(self.time, values), color=BLUE, label=f"{name}, observer")
                panel.axvspan(self.time[-1] - self.average, self.time[-1], color=BLUE, alpha=0.08, lw=0)
                if name in self.least_squares:
                    panel.axhline(self.least_squares[name], color=RED, ls="--", label="least squares")
                panel.set_ylabel(f"{name} [{self.unit(name)}]")
                panel.legend(ncols=2, **beside)
            for panel in axes[: over_time - 1, 0]:
                panel.tick_params(labelbottom=False)
            axes[over_time - 1, 0].set_xlabel("time [s]")
            if self.friction is not None:
                panel = axes[-1, 0]
                draw_friction(panel, self.friction, laws, linear=self.linear)
                panel.set_ylabel(f"torque [{self.unit('coulomb')}],\ninertia and load taken off")
                panel.legend(ncols=4, **beside)
        return figure


def estimate(
    log: Log,
    observer: AbstractObserver,
    *,
    load: AbstractLoad | None = None,
    average: float | None = None,
    differentiator: Differentiator = "zero_phase",
    cutoff: float | None = None,
    passes: int = 1,
) -> Estimated:
    """Run an observer over a log, both given as objects; `fpjax.estimate` reads files too, and describes the arguments.

    Raises:
        InputError: for a log that is too short, an observer without estimates, or estimates that left the finite range.
    """
    if not observer.estimated:
        raise InputError(f"{type(observer).__name__} estimates nothing: give the model an [observer], such as efp.")
    if log.samples < 16:
        raise InputError(f"{log.name} has {log.samples} samples: estimating needs at least 16.")
    velocity, how = measured_velocity(log, differentiator=differentiator, cutoff=cutoff)
    # Arrays of periods (samples - 1) from here on: see the module's text for the pairing.
    middle = 0.5 * (velocity[1:] + velocity[:-1])
    torque = log.torque[:-1] - _load(load or NoLoad(), log, velocity)
    if passes < 1:
        raise InputError(f"passes must be at least 1, got {passes}: the observer goes over the log once.")
    traces = _observe_jit(observer, jnp.asarray(torque), jnp.asarray(velocity), jnp.asarray(log.dt), passes)
    estimates = {name: np.asarray(trace) for name, trace in traces.items()}
    for name, trace in estimates.items():
        if not np.all(np.isfinite(trace)):
            when = log.dt * int(np.argmin(np.isfinite(trace)))
            raise InputError(f"{name} left the finite range at {when:.3g} s: use smaller gains for this log.")
    # By default the last quarter: the estimates have had three quarters of the log to settle.
    span = 0.25 * log.duration if average is None else float(average)
    if not 0.0 < span <= log.duration:
        raise InputError(f"average must be positive and at most the log's {log.duration:g} s, got {span:g} s.")
    last = slice(-max(round(span / log.dt), 1), None)
    # the limit of an observer with slow gains, from the same pairs: where the two differ, the observer has not
    # converged
    fitted = fit_pairs(torque, velocity, log.dt, float(observer.inertia))
    return Estimated(
        time=np.asarray(log.time[1:]),
        estimates=estimates,
        final={name: float(np.mean(trace[last])) for name, trace in estimates.items()},
        spread={name: float(np.std(trace[last])) for name, trace in estimates.items()},
        average=span,
        least_squares=fitted,
        velocity=middle,
        excitation=_excitation(observer, middle, log.dt, fitted, passes * log.duration),
        differentiated=how,
        name=log.name,
        linear=log.linear,
        passes=passes,
        friction=_friction(log, torque, float(observer.inertia)),
    )


def observe(
    observer: AbstractObserver,
    torque: Float[Array, " periods"],
    velocity: Float[Array, " periods+1"],
    dt: Float[Array, ""],
    passes: int = 1,
) -> dict[str, Float[Array, " periods"]]:
    """An observer over arrays. It is a pure function: it can be vmapped over gains or logs, jitted and differentiated.

    Each period is one `AbstractObserver.moved`. The sampled loop itself skips the periods in which the speed changes
    its sign. In a log with a filtered velocity the reversal is spread over several periods, and skipping one of them
    makes the viscous friction of the EMPS log 5.2 % wrong instead of 4.6 %, so none is skipped here.

    Args:
        observer: with its gains.
        torque: held over each period, known loads subtracted [N m].
        velocity: at the start of each period, and at the last one's end [rad/s].
        dt: control period [s].
        passes: passes over the arrays, each starting from the estimates of the one before (static).

    Returns:
        Estimates by name at the end of each period, of the last pass; the first pass starts with all estimates at zero.
    """
    periods = (torque, velocity[:-1], velocity[1:])

    def step(state: PyTree, period: tuple[Array, Array, Array]) -> tuple[PyTree, dict[str, Array]]:
        commanded, before, after = period
        state = observer.moved(state, commanded, before, after, dt)
        return state, observer.readout(state, after)[1]

    # z = estimate + g(w): the state that has zero estimates at rest is carried to the first velocity, else the first
    # estimate would be -g(w). Likewise from the end of one pass to the start of the next.
    state = observer.carried(observer.init(), jnp.zeros_like(velocity[0]), velocity[0])
    traces: dict[str, Array] = {}
    for _ in range(passes):
        state, traces = scan_loop(step, state, periods)
        state = observer.carried(state, velocity[-1], velocity[0])
    return traces


_observe_jit = jit_by(lambda observer, torque, velocity, dt, passes: (torque.shape, passes))(observe)


def _friction(log: Log, torque: np.ndarray, inertia: float) -> FrictionCurve | None:
    """The friction of a log in bins of velocity, for a given inertia; the torque is without the known load."""
    # `torque` has one value per period; the last is repeated, so that there is one per sample again.
    unloaded = dataclasses.replace(log, torque=np.append(torque, torque[-1]))
    fitted = fit_nominal(unloaded)  # only for the length of the smoothing window, which follows from the log's noise
    if fitted is None:
        return None
    curve = friction_curve(unloaded, dataclasses.replace(fitted, inertia=inertia, sine=0.0, cosine=0.0))
    return curve if curve.velocity.size else None


def _load(load: AbstractLoad, log: Log, velocity: np.ndarray) -> np.ndarray:
    """The known load's torque [N m] in the middle of each period, shape (samples - 1,)."""
    position = travel(velocity, log.dt) if log.position is None else np.asarray(log.position, dtype=float)

    def middle(values: np.ndarray) -> Array:
        return jnp.asarray(0.5 * (values[1:] + values[:-1]))

    # A held torque: the value at a sample acts until the next one.
    held = jnp.asarray(np.asarray(log.torque, dtype=float)[:-1])
    motion = Motion(middle(velocity), middle(position), middle(np.asarray(log.time)), held)
    return np.asarray(jax.vmap(load.readout)(motion), dtype=float)


def _excitation(
    observer: AbstractObserver, velocity: np.ndarray, dt: float, fitted: Mapping[str, float], duration: float
) -> Excitation | None:
    values = {name: fitted.get(name, math.nan) for name in observer.estimated}
    if not all(math.isfinite(value) for value in values.values()):
        return None
    return assess_excitation(observer, velocity, dt, values, duration=duration)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
