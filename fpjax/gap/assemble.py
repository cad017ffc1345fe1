"""Assemble: from what the search found to the numbers, intervals and curves of a `Diagnosis`."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .attribute import Fitted, Search
from .corners import corner_torque
from .diagnosis import Comparison, Estimate, Identifiability
from .effect import Effect
from .family import Family
from .fit import Candidate
from .imposed import noise_torque, torque_floor
from .machine import Machine
from .measure import NoiseFloor
from .precision import double_precision
from .record import Record, band_weights
from .replay import assembled

if TYPE_CHECKING:
    from .decision import Decision

NINETY = 1.645  # standard deviations of a 90 % interval
WIDER = 1.15  # standard deviations are widened by this; fitted on development seeds
BLURRED = 0.5  # of what shorter steps moved a parameter by that even shorter ones may move it again


def covariance(search: Search, fitted: Fitted) -> np.ndarray:
    """Of the free parameters, in their own units, shape (free, free); parameters at a bound count as known.

    The curvature's, widened: every interval of a diagnosis, of a cause's parameters and of the whole fit's, is 1.645 of
    these standard deviations to either side.
    """
    c = fitted.candidate
    fitter = search.fitters[c.family.key]
    parts = fitter.linearise([c], search.train)[0]
    used = [(which, chosen) for which, chosen in enumerate(search.train) if len(chosen)]
    fitter.steps(c, parts, used, np.array([1e-12]))
    assert c.normal is not None
    value = c.vector[c.free]
    edge = 1e-6 * c.scale
    inside = (value > c.low + edge) & (value < c.high - edge)
    found = np.zeros_like(c.normal)
    index = np.flatnonzero(inside)
    if len(index):
        block = c.normal[np.ix_(index, index)]
        size = np.sqrt(np.maximum(np.diag(block), 1e-30))
        inverse = np.linalg.pinv(block / size[:, None] / size, rcond=1e-12, hermitian=True) / size[:, None] / size
        found[np.ix_(index, index)] = inverse
    count = search.per_window * sum(len(chosen) for chosen in search.train)
    excess = max(c.chi_square / count, 0.5)
    if c.robust:
        # Windows off track count for little in the fit, and so they do here.
        excess = max(float(np.median(np.concatenate(c.window_cost))) / search.per_window, 0.5)
    found = found * c.scale[:, None] * c.scale * excess * WIDER**2
    if len(c.blur):
        found = found + np.diag((BLURRED * c.blur / NINETY) ** 2)
    return found


def estimates(search: Search, fitted: Fitted, effect: Effect, spread: np.ndarray | None = None) -> dict[str, Estimate]:
    """The contract's parameters of one effect with 90 % intervals (delta method)."""
    c = fitted.candidate
    spread = covariance(search, fitted) if spread is None else spread
    values = c.values()
    names = [c.family.parameters[i].name for i in c.free]
    center = effect.describe(values, search.setting)
    gradients = {name: np.zeros(len(names)) for name in center}
    for j, name in enumerate(names):
        h = 1e-4 * c.scale[j]
        moved = effect.describe(values | {name: values[name] + h}, search.setting)
        for key in center:
            gradients[key][j] = (moved[key][0] - center[key][0]) / h
    bounded = {
        names[j]
        for j in range(len(names))
        if not c.low[j] + 1e-6 * c.scale[j] < c.vector[c.free[j]] < c.high[j] - 1e-6 * c.scale[j]
    }
    result = {}
    for key, (value, unit) in center.items():
        half = NINETY * float(np.sqrt(max(gradients[key] @ spread @ gradients[key], 0.0)))
        touches = any(names[j] in bounded and gradients[key][j] != 0.0 for j in range(len(names)))
        result[key] = Estimate(value, value - half, value + half, linear_unit(unit, search.records[0].linear), touches)
    return result


def linear_unit(unit: str, linear: bool) -> str:
    """The unit of a linear axis: metres and newtons in place of radians and newton metres."""
    if not linear:
        return unit
    return unit.replace("kg m^2", "kg").replace("N m", "N").replace("rad", "m").replace("1/rev", "rad/m")


def identifiability(search: Search, fitted: Fitted, spread: np.ndarray) -> tuple[Identifiability, ...]:
    """What the fit knows about each free parameter."""
    c = fitted.candidate
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    safe = np.where(deviation > 0, deviation, 1.0)
    correlation = spread / safe[:, None] / safe
    found = []
    for j, index in enumerate(c.free):
        parameter = c.family.parameters[index]
        value = float(c.vector[index])
        if deviation[j] == 0.0:
            verdict = "at a bound"
        elif deviation[j] > c.scale[j]:
            verdict = "flat"
        else:
            others = np.abs(correlation[j]).copy()
            others[j] = 0.0
            other = int(np.argmax(others))
            traded = others[other] > 0.95
            verdict = f"traded off with {c.family.parameters[c.free[other]].name}" if traded else "pinned"
        unit = linear_unit(parameter.unit, search.records[0].linear)
        found.append(Identifiability(parameter.name, value, float(deviation[j]), unit, verdict))
    return tuple(found)


def machine_of(candidate: Candidate) -> Machine:
    """The fitted machine, every leaf a number."""
    return machine_at(candidate.family, candidate.vector)


def machine_at(family: Family, vector: np.ndarray) -> Machine:
    """The machine of a family at a vector of shape (parameters,), every leaf a number."""
    with double_precision():
        machine = assembled(family.machine, family.effects, family.parameters, jnp.asarray(vector[:, None]))
        return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[0]) if eqx.is_array(leaf) else leaf, machine)


def residual_trace(search: Search, fitted: Fitted, which: int) -> np.ndarray:
    """Simulated less measured of the channel that the gap is told in, in its unit, shape (samples,); NaN outside
    windows. In torque: what the model says the measured motion needed, less what was commanded.
    """
    record = search.records[which]
    fitter = search.fitters[fitted.candidate.family.key]
    if search.imposed:
        left = fitter.residuals(fitted.candidate, which, np.arange(len(record.starts)), 1)[0]
        found = np.full(len(record.time), np.nan)
        found[record.starts[0] : record.starts[-1] + record.samples] = left.T.ravel()
        return -found * noise_torque(record, search.setting.inertia)
    out = fitter.residuals(fitted.candidate, which, np.arange(len(record.starts)))[0] * record.channel.noise
    found = np.full(len(record.time), np.nan)
    late = 0
    if record.velocity is not None:
        late = int(fitted.candidate.values().get("velocity_delay", 0.0) / record.dt)
    for window, start in enumerate(record.starts):
        place = np.arange(start + late, start + late + record.samples)
        keep = place < len(found)
        found[place[keep]] = out[keep, window]
    return found


def window_of(search: Search, which: int) -> tuple[np.ndarray, np.ndarray]:
    """(index of the window of each sample, -1 for none; whether it is withheld), each of shape (samples,)."""
    record = search.records[which]
    index = np.full(len(record.time), -1)
    withheld = np.zeros(len(record.time), bool)
    for window, start in enumerate(record.starts):
        index[start : start + record.samples] = window
        withheld[start : start + record.samples] = record.withheld[window]
    return index, withheld


def comparisons(search: Search, decision: "Decision") -> tuple[Comparison, ...]:
    """Measured against simulated, before and after, one entry a log."""
    found = []
    for which, record in enumerate(search.records):
        index, withheld = window_of(search, which)
        measured = commanded(record) if search.imposed else record.channel.values
        found.append(
            Comparison(
                name=record.name,
                signal="torque" if search.imposed else "velocity",
                unit=signal_unit(record),
                time=record.time,
                measured=measured,
                before=measured + residual_trace(search, decision.exact, which),
                after=measured + residual_trace(search, decision.chosen, which),
                withheld=withheld,
                torque=record.torque,
                window=index,
            )
        )
    return tuple(found)


def signal_unit(record: Any) -> str:
    """Unit of the channel that the gap is told in."""
    if record.velocity is None:
        return "N" if record.linear else "N m"
    return "m/s" if record.linear else "rad/s"


def commanded(record: Record) -> np.ndarray:
    """The commanded torque [N m] at the starts of the periods and in the band of the acceleration; NaN at the ends."""
    weights = band_weights(record.half)
    edge = 1 + len(weights) // 2
    found = np.full(len(record.torque), np.nan)
    found[edge : 1 - edge] = np.convolve(0.5 * (record.torque[1:] + record.torque[:-1]), weights, "valid")
    return found


def torque_floor_of(search: Search, fitted: Fitted) -> NoiseFloor:
    """What a perfect model would leave of the torque in the first log: noise, and the corners of the motion."""
    floor = torque_floor(search.records[0], residual_trace(search, fitted, 0), search.setting.inertia)
    corners = corner_torque(search)
    return floor if corners <= floor.value else NoiseFloor(corners, (0.9 * corners, 1.1 * corners), "made")
