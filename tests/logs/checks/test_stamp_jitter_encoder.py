"""The jitter of the stamps beside an encoder: its steps are no jitter, and rest does not make them one."""

import dataclasses

import numpy as np
import pytest
from numpy_machine import record

from fpjax.logs.checks.stamp_jitter import stamp_jitter
from fpjax.logs.checks.suspicions import Numbers, suspicions

BODY = Numbers(0.05, 0.4, 0.03)
DT = 1e-3  # control period [s]


def _log(rest: float, counts: int, jitter: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and encoder position of 10 s of reversals up to 10 rad/s after a share `rest` of standstill."""
    rng = np.random.default_rng(0)
    clock = np.maximum(DT * np.arange(10_000) - 10.0 * rest, 0.0)
    moving = clock > 0.0
    fast, slow = 2.0 * np.pi * 1.3, 2.0 * np.pi * 0.31
    late = clock + jitter * moving * rng.normal(size=clock.size)
    position = 10.0 / fast * (1.0 - np.cos(fast * late)) + 0.3 * np.sin(slow * late)
    velocity = 10.0 * np.sin(fast * clock) + 0.3 * slow * np.cos(slow * clock) * moving
    step = 2.0 * np.pi / counts
    return velocity + 1e-3 * rng.normal(size=clock.size), step * np.round(position / step)


@pytest.mark.parametrize("counts", [1000, 4096, 65536])
@pytest.mark.parametrize("rest", [0.0, 0.1, 0.2, 0.5, 0.8])
def test_exact_stamps_are_not_jittered_at_any_rest_and_resolution(rest: float, counts: int) -> None:
    assert stamp_jitter(*_log(rest, counts, 0.0), DT) is None


@pytest.mark.parametrize(("counts", "jitter"), [(1000, 1e-3), (4096, 5e-4), (65536, 1e-4)])
@pytest.mark.parametrize("rest", [0.0, 0.2, 0.5])
def test_a_jitter_above_the_encoders_steps_is_found_with_its_size(rest: float, counts: int, jitter: float) -> None:
    found = stamp_jitter(*_log(rest, counts, jitter), DT)
    assert found is not None
    assert abs(found / jitter - 1.0) < 0.1


def test_a_position_that_wraps_at_a_turn_is_not_jittered_more_than_one_that_does_not() -> None:
    rng = np.random.default_rng(1)
    time = DT * np.arange(20_000)
    late = time + 2e-5 * rng.normal(size=time.size)
    velocity = 60.0 + 40.0 * np.sin(2.0 * np.pi * 0.2 * time)
    position = 60.0 * late - 40.0 / (2.0 * np.pi * 0.2) * np.cos(2.0 * np.pi * 0.2 * late)
    whole, wrapped = (stamp_jitter(velocity, each, DT) for each in (position, position % (2.0 * np.pi)))
    assert whole is not None
    assert wrapped is not None
    assert abs(whole / 2e-5 - 1.0) < 0.1
    assert abs(wrapped / whole - 1.0) < 0.05


@pytest.fixture(scope="module")
def log():
    return record()


@pytest.mark.parametrize("late", [0.05, 0.3])
def test_readings_off_their_stamps_are_told_with_their_size(log, late):
    rng = np.random.default_rng(5)
    tau = late * log.dt * rng.standard_normal(log.time.size)
    off = dataclasses.replace(log, position=np.interp(log.time + tau, log.time, log.position))
    (found,) = [s for s in suspicions(off, BODY) if s.kind == "stamps"]
    assert float(found.sentence.split("about ")[1].split(" ms")[0]) == pytest.approx(1e3 * late * log.dt, rel=0.3)


def test_a_coarse_or_noisy_encoder_is_not_off_its_stamps(log):
    rng = np.random.default_rng(6)
    coarse = dataclasses.replace(log, position=np.round(log.position / 1e-3) * 1e-3)
    noisy = dataclasses.replace(log, position=log.position + 1e-3 * rng.standard_normal(log.time.size))
    late = dataclasses.replace(log, velocity=np.roll(log.velocity, 5))
    for each in (coarse, noisy, late):
        assert "stamps" not in [s.kind for s in suspicions(each, BODY)]
