"""The expected evidence of a run, computed as the diagnosis computes it, and differentiable.

The readings of one machine on the run are replayed, window by window, through another machine, in the same simulation
that the diagnosis fits with (`fpjax.gap.simulate.replay`). The part of the misfit that small changes of the other
machine's parameters, of the nominal numbers and of a window's initial state could remove is projected out, under the
priors of the diagnosis. The rest, relative to sensor noise and missing torque, is the evidence that separates the two
machines. The diagnosis estimates the level of the missing torque for every model by octaves, so a squared misfit r^2 in
an octave of n modes counts n/2 log(1 + r^2/n), not r^2/2.

Evidence alone decides nothing there. The diagnosis measures the gap on windows that are not fitted, so the effect has
to show in several windows. And a missing torque below a share of the commanded torque counts as no gap, however large
its evidence is. Both are computed too.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..gap.data.split import every_fourth
from ..gap.data.tables import TAPS, Guide, Tables
from ..gap.effects.shaft import stiffness_of
from ..gap.simulate.replay import advance, assembled, begin, residuals
from ..gap.simulate.windows import Windows
from .lanes import RivalLanes
from .machines import Shop
from .measurement_model import MeasurementModel

RIDGE = 1e-9  # added to a matrix whose prior has unit precision, to keep it regular
SIZES = 10.0  # prior deviation of an effect's size, over its detectable one, beside another effect [1]


class Readings(NamedTuple):
    """The columns of several runs' logs, each of shape (runs, samples).

    Attributes:
        torque: commanded [N m].
        rate: velocity reading [rad/s].
        angle: position reading [rad].
    """

    torque: Float[Array, "runs samples"]
    rate: Float[Array, "runs samples"]
    angle: Float[Array, "runs samples"]


def coefficients(
    shop: Shop, measurement: MeasurementModel, lanes: RivalLanes, readings: Readings
) -> Float[Array, "modes lanes runs windows"]:
    """The residuals of the readings under each lane, as coefficients of the modes of the diagnosis."""
    tables, starts = _tables(measurement, readings)
    runs, windows, count = starts.shape[0], starts.shape[1], lanes.vectors.shape[1]
    spots = starts.reshape(-1)
    fields = _fields(measurement, readings, spots.shape[0])
    hidden = _hidden(shop, lanes, fields)  # (2, lanes, spots)
    many = spots.shape[0]

    def spread(each: Array) -> Array:  # of a window, to all lanes
        return jnp.tile(each, count)

    at = Windows(
        start=jnp.asarray(np.tile(spots, count), jnp.int32),
        time=spread(jnp.asarray(np.tile(measurement.starts * measurement.dt, runs))),
        velocity=spread(fields["velocity"]),
        slope=spread(fields["slope"]),
        position=spread(fields["position"]),
        hidden=(hidden[0].reshape(-1), hidden[1].reshape(-1)),
        integrated=jnp.full(count * many, 0.0 if measurement.channels[1] else 1.0),
    )
    family = lanes.family
    machine = assembled(family.machine, family.effects, family.parameters, jnp.repeat(lanes.vectors, many, axis=1))
    # All lanes x runs x windows run side by side as one batch: lane by lane, within it run by run, within it window
    # by window.
    states = jnp.repeat(jnp.asarray(lanes.states), many, axis=1)

    def step(carry: object, index: Array) -> tuple[object, Array]:
        following, predicted = advance(machine, carry, at, tables, index)  # pyright: ignore[reportArgumentType]
        both = residuals(predicted, machine, at, tables, index)
        return following, jnp.stack([r for r, there in zip(both, measurement.channels, strict=True) if there])

    carry = begin(machine, at, states, tables)
    # Checkpointed, because the gradient would otherwise keep every intermediate of every step of the whole batch.
    _, out = jax.lax.scan(jax.checkpoint(step), carry, jnp.arange(measurement.samples, dtype=jnp.int32))
    flat = jnp.moveaxis(out, 1, 0).reshape(-1, count * many)  # (channels x samples, lanes x spots)
    return (jnp.asarray(measurement.modes.basis.T) @ flat).reshape(-1, count, runs, windows)


def _tables(measurement: MeasurementModel, readings: Readings) -> tuple[Tables, np.ndarray]:
    """(all runs in one table one after the other, the windows' first rows in it of shape (runs, windows))."""
    # Before each run its first row is repeated TAPS times: a dead time at the first window reaches back into them.
    runs, samples = readings.torque.shape
    length = TAPS + samples

    def line(values: Array) -> Array:
        return jnp.concatenate([jnp.repeat(values[:, :1], TAPS, axis=1), values], axis=1).reshape(-1)

    def weight(there: bool, noise: float) -> Array:
        return jnp.full(runs * length, 1.0 / noise if there else 0.0)

    # The replay is left to itself: the diagnosis guides one only where the log leaves the nominal motion.
    free = Guide(line(readings.rate), line(readings.angle), jnp.zeros(()), jnp.zeros(()))
    tables = Tables(
        line(readings.torque), line(readings.rate), weight(measurement.channels[0], measurement.rate_noise),
        line(readings.angle), weight(measurement.channels[1], measurement.angle_noise),
        jnp.asarray(measurement.dt), free, jnp.zeros(runs * length), jnp.asarray(float(measurement.channels[1])),
    )  # fmt: skip
    return tables, measurement.starts[None, :] + TAPS + length * np.arange(runs)[:, None]


def _fields(measurement: MeasurementModel, readings: Readings, count: int) -> dict[str, Array]:
    """Measured motion at the windows' starts, each of shape (runs x windows,)."""
    rate = (
        readings.rate if measurement.channels[0] else jnp.asarray(jnp.gradient(readings.angle, measurement.dt, axis=1))
    )
    slope = jnp.asarray(jnp.gradient(rate, measurement.dt, axis=1))
    angle = readings.angle
    if not measurement.channels[1]:
        # By trapezoids, from zero: a plain sum is half a period of motion ahead of the torques of the position.
        angle = measurement.dt * (jnp.cumsum(rate, axis=1) - 0.5 * (rate + rate[:, :1]))
    at = {"velocity": rate, "slope": slope, "position": angle}
    found = {name: values[:, measurement.starts].reshape(-1) for name, values in at.items()}
    assert found["velocity"].shape[0] == count
    return found


def _hidden(shop: Shop, lanes: RivalLanes, fields: dict[str, Array]) -> Float[Array, "2 lanes spots"]:
    """States that no sensor measures at the windows' starts, at their values in a steady motion."""
    # tanh in place of sign, so that the evidence is differentiable by the motion.
    setting, family = shop.setting, lanes.family
    speed, slope = fields["velocity"][None, :], fields["slope"][None, :]
    side = jnp.tanh(speed / (0.02 * setting.speed))
    nothing = jnp.zeros((lanes.vectors.shape[1], speed.shape[1]))
    if family.key[0] == "bristles":
        return jnp.stack([nothing + side, nothing])
    if family.key[0] != "transmission":
        return jnp.stack([nothing, nothing])

    def of(name: str) -> Array:
        return jnp.asarray(lanes.vectors[family.index(name)])[:, None]

    # The twist is that of the spring under the shaft's torque, plus half the backlash on the side that it presses.
    share = of("load_share")
    friction = of("friction_share") * of("coulomb") * side + of("viscous_share") * of("viscous") * speed
    shaft = share * of("inertia") * slope + friction
    stiffness = stiffness_of({name: of(name) for name in ("inertia", "load_share", "frequency", "shaft_inertia")})
    face = 0.5 * of("gap") * jnp.tanh(shaft / (0.1 * setting.friction))
    return jnp.stack([shaft / stiffness + face, nothing])


class Evidence(NamedTuple):
    """Expected evidence against a model.

    Attributes:
        nats: log evidence by which the model is behind the one that made the log: with every fourth window withheld,
            the smaller of the withheld and the fitted part, scaled to the whole run, for the best choice of windows.
            An effect that shows in one window alone is not seen in the others.
        left: misfit that no change of its parameters removes, in standard deviations, shape (modes, windows).
        missing: torque that the model lacks without a change of its parameters, rms, without what noise hides [N m].
        effect: what tells the effect of this model from those of others, without the windows' initial states, in
            standard deviations: its misfit, then the change of it by the effect's own parameters, shape (directions,
            modes, windows).
        free: likewise, the change by the parameters that may move.
    """

    nats: Float[Array, ""]
    left: Float[Array, "modes windows"]
    missing: Float[Array, ""]
    effect: Float[Array, "directions modes windows"]
    free: Float[Array, "parameters modes windows"]


def evidence_against(
    measurement: MeasurementModel,
    misfit: Float[Array, "modes windows"],
    tangents: Float[Array, "parameters modes windows"],
    shifts: Float[Array, "states modes windows"],
    own: Float[Array, "own modes windows"] | None = None,
) -> Evidence:
    """The evidence against a model, from its misfit after the best change of everything that may change.

    Args:
        measurement: noise and missing torque.
        misfit: of the model.
        tangents: change of the misfit for one prior deviation of each parameter.
        shifts: change of the misfit for one prior deviation of each initial state, window by window.
        own: change of the misfit for one prior deviation of each of the effect's own parameters, for `apart` alone.
    """
    missing = _missing_torque(measurement, misfit, shifts)
    weight = 1.0 / jnp.sqrt(jnp.asarray(measurement.variance))[:, None]
    c, t, x = misfit * weight, tangents * weight[None], shifts * weight[None]
    # Least squares under unit priors in two stages. First the initial states, which are each window's own. Then the
    # parameters, which all windows share.
    projected = _without_states(x)
    c, free = projected(c), projected(t)
    effect = c[None] if own is None else jnp.concatenate([c[None], projected(own * weight[None])])
    left = _without(measurement, c, free)
    return Evidence(_poorer_part(measurement, left), left, missing, effect, free)


def apart(
    measurement: MeasurementModel,
    misfit: Float[Array, "modes windows"],
    free: Float[Array, "parameters modes windows"],
    other: Float[Array, "directions modes windows"],
) -> Float[Array, ""]:
    """The evidence by which a model with another effect would be behind, if this one were true [nats].

    What the other effect at any size, and with any of its own parameters, makes alike is projected out, linearised at
    its own size. Over a short travel, for example, an unbalance and a cogging bend the torque alike.

    Args:
        measurement: noise and missing torque.
        misfit: of the effect that is true, as `Evidence.effect[0]`.
        free: the change by the parameters that may move beside it, as `Evidence.free`.
        other: `Evidence.effect` of the other.
    """
    span = jnp.concatenate([free, SIZES * other[:1], other[1:]])
    return _poorer_part(measurement, _without(measurement, misfit, span))


def _without(
    measurement: MeasurementModel,
    c: Float[Array, "modes windows"],
    free: Float[Array, "parameters modes windows"],
) -> Float[Array, "modes windows"]:
    """What is left of a misfit after the best change of the parameters, under unit priors."""
    if not free.shape[0]:
        return c
    # Each simulated window stands for `weight` windows of the run, so the prior counts 1 / weight beside them.
    normal = jnp.einsum("pmw,qmw->pq", free, free) + (1.0 / measurement.weight + RIDGE) * jnp.eye(free.shape[0])
    move = jnp.linalg.solve(normal, jnp.einsum("pmw,mw->p", free, c))
    return c - jnp.einsum("p,pmw->mw", move, free)


def _poorer_part(measurement: MeasurementModel, c: Float[Array, "modes windows"]) -> Float[Array, ""]:
    """The evidence of a misfit: of fitted and withheld windows the poorer, for the best choice of windows [nats]."""
    modes = measurement.modes
    bands = (modes.band[None, :] == np.arange(modes.bands)[:, None]).astype(float)
    # Sums by matrices, not by loops over bands and choices: this stands in every comparison, and is compiled there.
    parts = _splits(c.shape[1])
    count = np.sum(bands, axis=1)[:, None] * np.sum(parts, axis=1)[None, :]
    squares = jnp.asarray(bands) @ c**2 @ jnp.asarray(parts.T)  # (bands, parts)
    nats = jnp.sum(0.5 * count * jnp.log1p(squares / np.maximum(count, 1.0)), axis=0)
    nats = nats * (c.shape[1] / np.sum(parts, axis=1))
    return measurement.weight * jnp.max(jnp.min(nats.reshape(-1, 2), axis=1))


def _splits(windows: int) -> np.ndarray:
    """Withheld and fitted windows, in turn, as the diagnosis may choose them: 1 for one of it, (parts, windows)."""
    found = []
    for shift in range(4):
        withheld = every_fourth(windows, shift)
        if not withheld.all():
            found += [withheld, ~withheld]
    return np.array(found or [np.ones(windows, bool)] * 2, float)


def _without_states(x: Float[Array, "states modes windows"]) -> Callable[[Array], Array]:
    """The map that takes out of (..., modes, windows) what a change of the windows' initial states could remove.

    Args:
        x: change for one prior deviation of each initial state, in standard deviations.
    """
    # A small system for every window, (windows, states, states).
    inverse = jnp.linalg.inv(jnp.einsum("smw,rmw->wsr", x, x) + jnp.eye(x.shape[0])[None])

    def projected(each: Array) -> Array:
        along = jnp.einsum("smw,...mw->...ws", x, each)
        return each - jnp.einsum("smw,wsr,...wr->...mw", x, inverse, along)

    return projected


def _missing_torque(
    measurement: MeasurementModel,
    misfit: Float[Array, "modes windows"],
    shifts: Float[Array, "states modes windows"],
) -> Float[Array, ""]:
    """Rms of the torque that makes a misfit, as the diagnosis measures it, without what noise hides [N m].

    The diagnosis fits the windows' initial states under a level of the missing torque in each octave that it estimates
    from this very misfit. Under the small level that is assumed of the true model, initial states would be moved to
    explain the slow modes, and the little that this leaves in the fast modes, where a torque hardly moves the machine,
    would be a large torque: ten times the true one on a gimbal with an encoder.

    Args:
        measurement: modes, noise and missing torque.
        misfit: in standard deviations of the sensors.
        shifts: of the misfit by one prior deviation of each initial state, likewise.
    """
    modes = measurement.modes
    holds = ~modes.sensor & (modes.gain > 0.0)
    gain = jnp.asarray(np.where(holds, modes.gain, 1.0))
    turn = jnp.asarray(modes.turn)
    # In plain modes, each of which has one gain. Of an octave: the energy of its torque over its modes and windows.
    c, x = turn @ misfit, jnp.einsum("nm,smw->snw", turn, shifts)
    found = jnp.mean(c**2, axis=1) / gain
    level = jnp.full(len(holds), measurement.missing**2)
    for number in range(modes.bands):
        own = (modes.band == number) & holds
        if own.any():
            energy = jnp.mean(found[np.flatnonzero(own)])
            level = level + jnp.where(jnp.asarray(own), energy, 0.0)
    signal = jnp.where(jnp.asarray(holds), level * gain, 0.0)
    weight = 1.0 / jnp.sqrt(1.0 + signal)[:, None]
    left = _without_states(x * weight[None])(c * weight) / weight
    # The Wiener filter of the level, as the diagnosis weighs its coefficients.
    torque = (signal / (1.0 + signal) / jnp.sqrt(gain))[:, None] * left
    return jnp.sqrt(jnp.sum(torque**2) / (measurement.samples * misfit.shape[1]) + 1e-30)
