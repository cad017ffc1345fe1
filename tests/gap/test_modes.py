"""The likelihood of an unknown torque: levels are found, events stay events, and a weighted step lowers the cost."""

from dataclasses import replace

import numpy as np
import pytest

from fpjax.gap.fit.bursts import bursts
from fpjax.gap.fit.make_modes import make_modes
from fpjax.gap.fit.modes import COMPARED, FITTED

SAMPLES, DT, INERTIA, ANGLE_NOISE, RATE_NOISE = 200, 1e-3, 0.05, 2e-5, 3e-3


@pytest.fixture(params=["encoder", "rate", "both"])
def modes(request):
    rate = 0.0 if request.param == "encoder" else RATE_NOISE
    angle = 0.0 if request.param == "rate" else ANGLE_NOISE
    return make_modes(SAMPLES, DT, INERTIA, rate, angle)


def residuals(torque, rng, modes):
    """What the sensors of `modes` show of a torque held over each period, in standard deviations, with their noise."""
    speed = np.concatenate([np.zeros((1, torque.shape[1])), np.cumsum(torque * DT / INERTIA, axis=0)])
    angle = np.cumsum((speed[:-1] + speed[1:]) / 2 * DT, axis=0)
    angle = np.concatenate([np.zeros((1, torque.shape[1])), angle])[:-1]
    rows = {"rate": [speed[:-1] / RATE_NOISE], "encoder": [angle / ANGLE_NOISE]}
    rows["both"] = rows["rate"] + rows["encoder"]
    count = modes.basis.shape[0] // SAMPLES
    kind = (
        "both" if count == 2 else ("rate" if modes is make_modes(SAMPLES, DT, INERTIA, RATE_NOISE, 0.0) else "encoder")
    )
    clean = np.stack(rows[kind])
    return clean + rng.standard_normal(clean.shape)


def coefficients(modes, torque, rng):
    return modes.coefficients(residuals(torque, rng, modes)).T


def test_the_turn_loses_nothing(modes):
    rng = np.random.default_rng(0)
    c = coefficients(modes, rng.standard_normal((SAMPLES, 5)), rng)
    np.testing.assert_allclose(modes.turn @ modes.turn.T, np.eye(len(modes.gain)), atol=1e-12)
    np.testing.assert_allclose(np.sum(modes.plain(c) ** 2, axis=1), np.sum(c**2, axis=1))


def test_turned_coefficients_of_a_push_are_local(modes):
    """A push lights a few tiles of each octave, while every plain mode sees it."""
    push = np.zeros((SAMPLES, 1))
    push[120:124] = 1e9  # noise does not count
    c = modes.coefficients(residuals(push, np.random.default_rng(0), modes))[:, 0]
    high = (~modes.sensor) & ((modes.band == 4) | (modes.band == 5))

    def share(values):
        energy = np.sort(values[high] ** 2)[::-1]
        return np.sum(energy[: len(energy) // 5]) / np.sum(energy)

    assert share(c / np.sqrt(modes.flat)) > share(modes.plain(c[None])[0] / np.sqrt(modes.gain)) + 0.15


def test_without_a_torque_the_cost_is_that_of_white_noise(modes):
    c = np.random.default_rng(1).standard_normal((4, len(modes.gain)))
    noise = np.array([1.0, 1.0, 2.0, 4.0])
    expected = np.sum(c**2, axis=1) / noise + c.shape[1] * np.log(noise)
    for white in (True, False):
        found = modes.cost(np.zeros(modes.bands), noise, c, white=white)
        np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize("white", [True, False])
@pytest.mark.parametrize("level", [0.2, 3.0])
def test_the_level_of_a_white_torque_is_found(modes, level, white):
    rng = np.random.default_rng(2)
    c = coefficients(modes, level * rng.standard_normal((SAMPLES, 40)), rng)
    found = modes.best_level(np.ones(40), c, white=white)[: np.max(modes.band[~modes.sensor])]
    seen = 0.3 * level**2 * modes.gain[0] > 1.0  # the lowest octaves at least are above the noise
    assert seen
    np.testing.assert_allclose(found[0], level, rtol=0.45)


def test_no_torque_has_a_level_of_no_importance(modes):
    rng = np.random.default_rng(3)
    c = coefficients(modes, np.zeros((SAMPLES, 40)), rng)
    level = modes.best_level(np.ones(40), c, white=True)
    assert np.all(level[modes.band[~modes.sensor]] ** 2 * modes.gain[~modes.sensor] < 0.2)


def test_a_few_pushes_do_not_raise_the_level_of_the_rest(modes):
    rng = np.random.default_rng(4)
    torque = rng.standard_normal((SAMPLES, 40))
    before = modes.best_level(np.ones(40), coefficients(modes, torque, rng), white=False)
    torque[100:110, :4] += 200.0
    c = coefficients(modes, torque, rng)
    after = modes.best_level(np.ones(40), c, white=False)
    assert np.all(after[:4] <= 2.0 * before[:4])  # octaves in which a torque is above the noise
    weight = modes.precision(after, np.ones(40), c, white=False)[:, ~modes.sensor]
    assert np.mean(weight[:4]) < np.mean(weight[4:])


@pytest.mark.parametrize("white", [True, False])
def test_a_weighted_least_squares_step_lowers_the_cost(modes, white):
    rng = np.random.default_rng(5)
    torque = rng.standard_normal((SAMPLES, 30)) * np.exp(rng.standard_normal(30))
    c, noise = coefficients(modes, torque, rng), np.ones(30)
    known = coefficients(modes, np.sin(np.linspace(0, 6, SAMPLES))[:, None] + np.zeros((1, 30)), rng)
    c = c + 3.0 * known
    level, step = modes.best_level(noise, c, white=white), 0.0
    costs = [np.sum(modes.cost(level, noise, c, white=white))]
    for _ in range(6):
        weight = modes.precision(level, noise, c - step * known, white=white)
        step = float(np.sum(weight * known * c) / np.sum(weight * known**2))
        costs.append(np.sum(modes.cost(level, noise, c - step * known, white=white)))
    assert np.all(np.diff(costs) <= 1e-6)
    assert costs[-1] < costs[0] - 1.0
    assert step == pytest.approx(3.0, rel=0.3)


def test_the_sensors_noise_is_told_from_a_torque():
    modes = make_modes(SAMPLES, DT, INERTIA, 0.0, ANGLE_NOISE)
    rng = np.random.default_rng(6)
    torque = 0.5 * rng.standard_normal((SAMPLES, 40))
    c = coefficients(modes, torque, rng)
    noisy = c + np.sqrt(8.0) * rng.standard_normal(c.shape)  # three times the noise in all
    assert modes.best_noise(np.ones(40), c) == pytest.approx(1.0, rel=0.1)
    assert modes.best_noise(np.ones(40), noisy) == pytest.approx(3.0, rel=0.1)


def test_light_tails_have_no_bursts_below_the_level():
    for tails, least in ((COMPARED, -5.0), (FITTED, 0.0)):
        factors, law = bursts(tails)
        assert factors[0] == least
        assert factors[-1] == 20.0
        assert np.sum(law) == pytest.approx(1.0)
        # Each factor of two costs log(2) / tails; the grid's spacing is one there.
        assert law[factors == 2.0] == pytest.approx(law[factors == 1.0] * 2.0 ** (-1.0 / tails))


@pytest.mark.parametrize("white", [True, False])
@pytest.mark.parametrize("tails", [FITTED, COMPARED])
@pytest.mark.parametrize("rate_noise", [0.0, 2e-3])
@pytest.mark.parametrize("most", [0, 16])  # of 16 modes every tile has four atoms
def test_the_cost_is_that_of_every_coefficient_with_its_tiles_burst_integrated_out(most, rate_noise, tails, white):
    modes = make_modes(SAMPLES, DT, INERTIA, rate_noise, ANGLE_NOISE, most)
    modes = replace(modes, tails=tails, unanswered=np.where(np.arange(modes.bands) == 2, 0.3, 0.0))
    rng = np.random.default_rng(7)
    level, noise = modes.levels[rng.integers(20, 40, modes.bands), np.arange(modes.bands)], np.array([1.0, 4.0, 1.0])
    still = noise[:, None] + modes.unanswered[modes.band] ** 2 * modes.flat
    c = rng.standard_normal((3, len(modes.flat))) * np.sqrt(still + level[modes.band] ** 2 * modes.flat)
    group = modes.sensor.astype(int) if white else modes.tile
    factors, law = bursts(tails)
    variance = still[:, :, None] + (level[modes.band] ** 2 * modes.flat)[:, None] * 4.0**factors
    each = c[:, :, None] ** 2 / variance + np.log(variance)
    cost, precision = np.zeros(3), np.empty_like(c)
    for one in np.unique(group):
        own = group == one
        together = np.sum(each[:, own], axis=1)
        least = np.min(together, axis=1, keepdims=True)
        likely = law * np.exp(-0.5 * (together - least))
        cost += least[:, 0] - 2.0 * np.log(np.sum(likely, axis=1))
        share = likely / np.sum(likely, axis=1, keepdims=True)
        precision[:, own] = np.sum(share[:, None] / variance[:, own], axis=2)
    np.testing.assert_allclose(modes.cost(level, noise, c, white=white), cost, rtol=1e-10)
    np.testing.assert_allclose(modes.precision(level, noise, c, white=white), precision, rtol=1e-9)


@pytest.mark.parametrize("guide", [(0.0, 0.0), (90.0, 13.0)])
@pytest.mark.parametrize("damping", [0.0, 30.0])
def test_a_torque_reaches_the_readings_as_a_simulation_of_the_damped_and_guided_mass_says(damping, guide):
    """The residual of a guided mass is without what the guide added; its friction brakes what the guide left of it."""
    modes = make_modes(SAMPLES, DT, INERTIA, RATE_NOISE, ANGLE_NOISE, damping=damping, guide=guide)
    torque = np.sin(0.07 * np.arange(SAMPLES)) + 0.4
    fine, rows = 50, []
    speed = angle = added = travelled = 0.0
    for held in torque:
        rows.append((speed - added, angle - travelled))
        for _ in range(fine):
            held_back = -guide[0] * angle - guide[1] * speed
            change = (held / INERTIA - damping * speed + held_back, held_back)
            angle, travelled = angle + DT / fine * speed, travelled + DT / fine * added
            speed, added = speed + DT / fine * change[0], added + DT / fine * change[1]
    rate, position = np.array(rows).T
    found = modes.coefficients(np.stack([rate / RATE_NOISE, position / ANGLE_NOISE])[:, :, None])[:, 0]
    plain = modes.plain(found[None])[0]
    inferred = modes.torque @ np.where(modes.sensor, 0.0, plain / np.sqrt(modes.gain))
    # The last torque reaches no reading.
    np.testing.assert_allclose(inferred[:-20], torque[:-20], atol=0.03)
    assert np.max(np.abs(plain[modes.sensor])) < 0.01 * np.max(np.abs(plain))
