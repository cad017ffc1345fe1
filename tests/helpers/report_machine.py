"""The log of a small servo and the numbers that a diagnosis computes from it: for the report's tests."""

import dataclasses
import functools

import numpy as np
import numpy_machine

from fpjax.gap import Comparison, Gap, Share, Where

DT = 1e-3


def run(model, torque, velocity, position):
    """Torque-driven motion of a machine from one start: velocity and position at each sample."""
    torque = np.concatenate([np.full(model.delay, torque[0]), torque])[: len(torque)]
    velocities, positions = np.empty(len(torque)), np.empty(len(torque))
    for k, applied in enumerate(torque.tolist()):
        velocities[k], positions[k] = velocity, position
        velocity, position = model.advanced(velocity, position, applied, DT)
    return velocities, positions


@functools.cache
def record(truth, seconds, disturbance=None):
    """A closed-loop record under PI control: time, torque, velocity, position (true)."""
    time = np.arange(round(seconds / DT)) * DT
    log = numpy_machine.record(
        dataclasses.replace(truth, kp=2.0, ki=12.0),
        seconds=seconds,
        dt=DT,
        extra=numpy_machine.nothing if disturbance is None else lambda time, *at: disturbance(time),
        velocity_noise=0.0,
        position_noise=0.0,
        reference=1.6 * np.sin(1.3 * time) + 0.9 * np.sin(4.1 * time + 0.7) + 0.3 * np.sin(17.0 * time),
        substeps=1,
    )
    return log.time, log.torque, log.velocity, log.position


def compare(name, truth, before, after, *, seconds=8.0, signal="velocity", noise=2e-3, disturbance=None, scale=1.0):
    """A record and what two models say, of any signal: a report draws it as torque."""
    time, torque, velocity, position = record(truth, seconds, disturbance)
    random = np.random.default_rng(7)
    true = velocity if signal == "velocity" else position
    measured = true + noise * random.standard_normal(len(time))
    window = (np.arange(len(time)) // 250).astype(int)
    simulated = []
    for model in (before, after):
        found = np.full(len(time), np.nan)
        if model is not None:
            for w in np.unique(window):
                at = np.flatnonzero(window == w)
                v, p = run(model, torque[at], velocity[at[0]], position[at[0]])
                found[at] = v if signal == "velocity" else p
        simulated.append(found)
    withheld = (time % 4.0) >= 2.75
    return Comparison(name, time, measured * scale, simulated[0] * scale, simulated[1] * scale, withheld, window)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def interval(errors, blocks=20, seed=1):
    """Block bootstrap of the rms: 5 and 95 %."""
    parts = np.array_split(np.square(errors), blocks)
    random = np.random.default_rng(seed)
    draws = [rms(np.sqrt(np.concatenate([parts[i] for i in random.integers(0, blocks, blocks)]))) for _ in range(300)]
    return tuple(float(q) for q in np.quantile(draws, [0.05, 0.95]))


def gap_of(comparison, floor):
    measured = comparison.torque[comparison.withheld]
    before, after = measured - comparison.before[comparison.withheld], measured - comparison.after[comparison.withheld]
    if not np.isfinite(after).any():
        after = before
    low, high = interval(before)
    low_after, high_after = interval(after)
    closable = rms(before) - floor
    closed = [(rms(before) - x) / closable for x in (rms(after), high_after, low_after)]
    return Gap(
        "N m",
        rms(before),
        rms(after),
        floor,
        closed[0],
        (low, high),
        (low_after, high_after),
        (0.97 * floor, 1.03 * floor),
        (closed[1], closed[2]),
    )


def shares(axis, energy, bins):
    edges = np.linspace(axis.min(), axis.max(), bins + 1)
    index = np.clip(np.digitize(axis, edges) - 1, 0, bins - 1)
    total = energy.sum()
    return tuple(
        Share(float(edges[i]), float(edges[i + 1]), float(energy[index == i].sum() / total), float(np.mean(index == i)))
        for i in range(bins)
    )


def where_of(comparison, velocity, position, torque, nominal, *, with_position=True, scale=1.0):
    acceleration = np.gradient(velocity, DT)
    held = 0.5 * (torque + np.concatenate([torque[:1], torque[:-1]]))
    moving = np.abs(velocity) > 0.02
    needed = nominal.inertia * acceleration + nominal.viscous * velocity + nominal.coulomb * np.sign(velocity)
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(torque))
    residual = np.where(moving, held - needed, 0.0) + noise
    energy = residual**2
    maps = {"time": shares(comparison.time, energy, 48), "velocity": shares(scale * velocity, energy, 25)}
    axes = {"time": comparison.time, "velocity": scale * velocity}
    if with_position:
        maps["position"] = shares(scale * position, energy, 25)
        axes["position"] = scale * position
    spectrum = np.abs(np.fft.rfft(residual)[1:400]) ** 2
    frequency = np.fft.rfftfreq(len(residual), DT)[1:400]
    bands = []
    for low, high in zip(*(lambda e: (e[:-1], e[1:]))(np.geomspace(frequency[0], frequency[-1], 18)), strict=True):
        inside = (frequency >= low) & (frequency < high)
        bands.append(
            Share(float(low), float(high), float(spectrum[inside].sum() / spectrum.sum()), float(inside.mean()))
        )
    maps["frequency"] = tuple(bands)
    regime = {
        "reversal": float(energy[np.abs(velocity) < 0.1].sum() / energy.sum()),
        "low_speed": float(energy[(np.abs(velocity) >= 0.1) & (np.abs(velocity) < 0.4)].sum() / energy.sum()),
        "acceleration": float(energy[(np.abs(velocity) >= 0.4) & (np.abs(acceleration) > 3)].sum() / energy.sum()),
        "cruise": float(energy[(np.abs(velocity) >= 0.4) & (np.abs(acceleration) <= 3)].sum() / energy.sum()),
        "limit": 0.0,
    }
    out = {
        axis: tuple(s for s in sorted(bins, key=lambda s: -s.share)[:3] if s.share > 2.0 * s.expected)
        for axis, bins in maps.items()
    }
    return Where(regime=regime, residual=residual, axes=axes, maps=maps, **out)
