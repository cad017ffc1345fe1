"""The one measure of the missing torque: what counts as noise, which windows count, where models are compared."""

from dataclasses import replace
from types import SimpleNamespace

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import load_model
from fpjax.gap import EFFECTS
from fpjax.gap.answer.gap_size import noise_floor
from fpjax.gap.answer.rounded import rounding_of
from fpjax.gap.answer.warning_texts import not_answered, rounding_left
from fpjax.gap.data.setting import Setting
from fpjax.gap.fit.candidate import Start
from fpjax.gap.select.weighed import judged_windows
from fpjax.gap.thresholds import THRESHOLDS
from fpjax.gap.verb import make_search


@pytest.fixture(scope="module")
def log():
    return numpy_machine.record(seconds=6.0, dt=2e-3, sensors=("position",))


def missing(search):
    return search.finish([search.exact], 0)[0].missing_rms([np.arange(len(r.starts)) for r in search.records])


def test_a_vibration_of_the_sensor_is_no_torque(log):
    """1 mrad rms above 20 Hz would take some 0.05 kg m^2 (2 pi 50)^2 1e-3 rad = 5 N m; the loop commands none."""
    count, dt = len(log.time), log.dt
    spectrum = np.fft.rfft(np.random.default_rng(1).standard_normal(count))
    spectrum[np.abs(np.fft.rfftfreq(count, dt) - 50.0) > 30.0] = 0.0
    shaking = np.fft.irfft(spectrum, count)
    shaken = replace(log, position=log.position + 1e-3 * shaking / np.std(shaking))
    search, still = gap_search.search_of(shaken), gap_search.search_of(log)
    octave = np.array([np.median(search.modes.frequency[search.modes.band == b]) for b in range(search.modes.bands)])
    assert np.max(search.modes.unanswered[octave > 30.0]) > 1.0
    assert np.all(search.modes.unanswered[octave < 15.0] == 0.0)
    assert np.all(still.modes.unanswered == 0.0)
    assert missing(search) < 0.2 * 5.0


def test_where_an_octave_is_noise_a_burst_of_it_is_none_of_the_machine_either(log):
    """An encoder's steps that pass at nearly the sampling rate beat for a while: ten times the shaking of the rest."""
    count, random = len(log.time), np.random.default_rng(1)
    spectrum = np.fft.rfft(random.standard_normal(count))
    spectrum[np.abs(np.fft.rfftfreq(count, log.dt) - 75.0) > 35.0] = 0.0
    shaking = np.fft.irfft(spectrum, count)
    beat = np.where(np.abs(log.time - 3.0) < 0.1, 10.0, 1.0)
    search = gap_search.search_of(replace(log, position=log.position + 2e-4 * beat * shaking / np.std(shaking)))
    noisy = search.modes.unanswered[search.modes.band] > search.measure.level[search.modes.band]
    assert np.any(noisy)
    told = search.measure.filter(np.ones(2))
    share = search.modes.wiener(search.measure.level, np.ones(2))
    # A share of `faint` where the readings hold twice as much noise as torque, half of it where they hold as much.
    assert np.all(told[:, noisy] < 0.5 * share[:, noisy])
    assert np.all(told[:, noisy] >= THRESHOLDS.faint * share[:, noisy])
    assert np.all(told[:, ~noisy & ~search.modes.sensor] > 0.0)
    # 2 mrad at 75 Hz for a fifth of a second are 22 N m.
    assert missing(search) < 0.1 * 22.0 * np.sqrt(0.2 / 6.0)


def test_a_torque_that_the_motion_shows_is_none_of_the_sensor(log):
    """A push that nobody recorded, three times the command: the motion has it."""
    pushed = numpy_machine.record(
        seconds=6.0, dt=2e-3, sensors=("position",), extra=lambda time, speed, angle, command: 3.0 * np.sin(9.0 * time)
    )
    search = gap_search.search_of(pushed)
    assert np.all(search.modes.unanswered == 0.0)
    assert missing(search) > 1.5


def test_the_steps_of_an_encoder_are_no_torque_of_a_right_model(log):
    search = gap_search.search_of(replace(log, position=np.round(log.position / 0.04) * 0.04))
    assert missing(search) < 1e-3
    pushed = numpy_machine.record(
        seconds=6.0, dt=2e-3, sensors=("position",), extra=lambda time, speed, angle, command: 0.5 * np.sin(9.0 * time)
    )
    search = gap_search.search_of(replace(pushed, position=np.round(pushed.position / 0.04) * 0.04))
    assert missing(search) == pytest.approx(0.5 / 2.0**0.5, rel=0.2)


@pytest.mark.parametrize(("sensor", "step"), [("velocity", 0.05), ("velocity", 0.1)])
def test_what_rounding_makes_of_the_missing_torque_is_what_a_right_model_leaves(sensor, step):
    """Rounded readings jump where a motion is slow, and noise that is white does not show how much torque that is."""
    pushed = numpy_machine.record(
        seconds=6.0, sensors=(sensor,), extra=lambda time, speed, angle, command: 0.5 * np.sin(9.0 * time)
    )
    for log, least, most in ((numpy_machine.record(seconds=6.0, sensors=(sensor,)), 0.9, 1.0), (pushed, 0.0, 0.5)):
        search = gap_search.search_of(replace(log, **{sensor: np.round(getattr(log, sensor) / step) * step}))
        (fit,), windows = search.finish([search.exact], 0), [np.arange(len(search.records[0].starts))]
        beyond, of_velocity = rounding_of(search, fit, windows)
        said = rounding_left(beyond, SimpleNamespace(after=fit.missing_rms(windows), noise_floor=0.0, unit="N m"))
        assert bool(said) == (least > 0.0)
        left = fit.missing_rms(windows)
        assert left > noise_floor(search, windows)
        assert least * left <= beyond <= most * left
        assert of_velocity > beyond
    unrounded = gap_search.search_of(log)
    assert rounding_of(unrounded, unrounded.finish([unrounded.exact], 0)[0]) == (0.0, 0.0)


def test_what_counts_as_noise_beside_the_nominal_model_hides_no_torque_where_a_model_explains_it():
    """A load that rattles vibrates at rates that no loop answers; with its backlash in the model nothing is left."""
    pushed = numpy_machine.record(
        seconds=6.0, dt=2e-3, sensors=("position",), extra=lambda time, speed, angle, command: 3.0 * np.sin(9.0 * time)
    )
    search = gap_search.search_of(pushed)
    before = missing(search)
    fast = np.array(
        [np.median(search.modes.frequency[search.modes.band == b]) > 30.0 for b in range(search.modes.bands)]
    )
    search.modes = replace(search.modes, unanswered=np.where(fast, 100.0, 0.0))  # as it would be without the cause
    assert missing(search) == pytest.approx(before, rel=0.02)


@pytest.mark.parametrize("rate", [45.0, 60.0])
def test_a_fast_vibration_of_the_machine_is_told_as_a_torque_or_as_what_counts_as_noise(rate):
    """3 N m that really shake the mass: one encoder does not tell them from a shaking encoder, so both are said."""
    shaken = numpy_machine.record(
        seconds=6.0, dt=2e-3, sensors=("position",), substeps=40,
        extra=lambda time, speed, angle, command: 3.0 * np.sin(2.0 * np.pi * rate * time),
    )  # fmt: skip
    search = gap_search.search_of(shaken)
    held = np.sqrt(np.sum(search.modes.unanswered[search.modes.band] ** 2) / search.records[0].samples)
    assert np.hypot(missing(search), held) > 0.5 * 3.0 / np.sqrt(2.0)
    torque = float(np.sqrt(np.mean(shaken.torque**2)))
    if held > missing(search):
        (said,) = not_answered(search.modes, np.zeros(search.modes.bands), search.setting.units, torque)
        assert "counts as noise and not as missing torque" in said
        assert f"{held:.3g} N m rms" in said


def test_a_window_of_equal_readings_counts_as_far_as_it_tells(log):
    measure = gap_search.search_of(log).measure
    usual, hardly = measure.weight(np.array([1.0, 100.0]), np.ones(len(measure.modes.gain)))
    assert np.all(hardly <= usual)
    # Where the noise of a single reading is nearly as large as the torque, a hundred times as much takes all but a
    # thousandth off.
    near = measure.filter(np.ones(1))[0] < 0.7
    assert np.any(near & (usual > 0.0))
    assert np.all(hardly[near] <= 1e-3 * usual[near])


def test_noise_above_what_was_assumed_is_hardly_a_torque(log):
    """8 % more variance than assumed in an octave of noise, as an encoder's errors within a line are."""
    search = gap_search.search_of(log)
    modes, measure = search.modes, search.measure
    last = ~modes.sensor & (modes.band == modes.band[~modes.sensor].max())
    level = np.where(np.arange(modes.bands) == modes.band[last][0], np.sqrt(0.08 / modes.gain[last].mean()), 0.0)
    noisy = replace(measure, level=level)
    told = noisy.filter(np.ones(1))[0]
    np.testing.assert_allclose(told[last], THRESHOLDS.faint * modes.wiener(level, np.ones(1))[0][last])
    loud = replace(measure, level=1e3 * level)  # a torque: Wiener's share of it
    np.testing.assert_allclose(loud.filter(np.ones(1)), modes.wiener(loud.level, np.ones(1)))


def test_what_is_told_grows_with_the_torque_without_a_jump(log):
    measure = gap_search.search_of(log).measure
    weights = [
        float(np.sum(replace(measure, level=factor * measure.level).weight(np.ones(1), np.ones(len(measure.imposed)))))
        for factor in np.geomspace(1e-3, 1e3, 1201)  # steps of 1.2 %
    ]
    assert np.all(np.diff(weights) >= 0.0)
    assert np.max(np.diff(np.log(weights))) < 0.2


def test_all_of_half_an_octave_is_drowned_or_none_of_it(log):
    """Tiles lie side by side in time: a cause in the second half of a window counts as one in the first."""
    measure = gap_search.search_of(log).measure
    modes = measure.modes
    for factor in np.geomspace(1e-4, 1e2, 40):
        drowned = replace(measure, level=factor * measure.level).drowned
        by_flat = {}
        for flat, own in zip(modes.by_tile(modes.flat), drowned, strict=True):
            by_flat.setdefault(round(float(np.log(flat + 1e-300)), 6), set()).add(bool(own))
        assert all(len(own) == 1 for own in by_flat.values())
        assert not np.all(drowned)
    assert np.any(measure.drowned)


def test_models_are_not_compared_on_a_push_that_none_of_them_takes():
    rest = [1.0] * 15
    exact = SimpleNamespace(missing=(np.array([1.0, 1.2, 40.0, 0.8, 30.0, *rest]),))
    # One model takes the fifth window, none the third.
    left = [0.1, 0.1, 39.0, 0.1, 29.0, *rest], [1, 1, 41.0, 1, 2.0, *rest]
    fits = [SimpleNamespace(missing=(np.array(own),)) for own in left]
    moving = [np.ones(20, bool)]
    assert judged_windows(exact, fits, moving)[0].tolist() == [i for i in range(20) if i != 2]
    even = SimpleNamespace(missing=(np.array([1.0, 1.2, 3.0, 0.8, 2.0] * 4),))
    assert judged_windows(even, [even], moving)[0].tolist() == list(range(20))
    # Two causes of which none takes half alone: what each leaves is alike in all windows.
    both = SimpleNamespace(missing=(np.array([1.0] * 12 + [40.0] * 8),))
    alone = SimpleNamespace(missing=(np.array([0.6] * 12 + [25.0] * 8),))
    assert len(judged_windows(both, [alone], [np.arange(20) >= 8])[0]) == 20
    # Six pushes among twenty windows are no few.
    often = SimpleNamespace(missing=(np.array([1.0] * 14 + [40.0] * 6),))
    assert len(judged_windows(often, [often], moving)[0]) == 20


def test_motion_is_no_push_in_a_log_that_mostly_rests():
    exact = SimpleNamespace(missing=(np.array([1e-4] * 28 + [1.0, 1.3]),))
    fits = [SimpleNamespace(missing=(np.array([1e-4] * 28 + [0.6, 0.8]),))]
    moving = [np.arange(30) >= 28]
    assert len(judged_windows(exact, fits, moving)[0]) == 30


def test_a_weight_beside_a_known_one_is_told_as_a_whole():
    unbalance = next(effect for effect in EFFECTS if effect.name == "unbalance")
    sizes = Setting(1.0, 0.1, 0.1, 0.1, 1.0, 1.0, 1.0, 1.0, 1e-3)
    added = {"unbalance_sine": 0.3, "unbalance_cosine": 0.4}
    assert unbalance.describe(added, sizes)["amplitude"][0] == pytest.approx(0.5)
    # A sin(position + phase) has the sine A cos(phase) and the cosine A sin(phase).
    known = replace(sizes, turning_load=1.7 + 0.1j)
    told = unbalance.describe(added, known)
    assert told["amplitude"][0] == pytest.approx(np.hypot(2.0, 0.5))
    assert told["phase"][0] == pytest.approx(np.arctan2(0.5, 2.0))
    assert "phase" not in unbalance.describe(added, sizes)


def test_a_law_of_the_torque_stands_beside_a_shaft(log):
    """A learned law in the nominal model, and a shaft's hidden states: it acts on the simulated mass."""
    learned = '[[learned]]\nof = "torque"\nat = [-5.0, 5.0]\ntorque = [-0.5, 0.5]\n'
    shaft = tuple(effect for effect in EFFECTS if effect.name == "compliance")
    search = make_search([log], [], load_model(gap_search.MODEL + learned), shaft)
    c = search.candidate(Start(shaft, (), shaft[0].starts(search.setting)[0]))
    search.go_on([c], search.screening(), 1, white=True)
    assert np.isfinite(c.cost)
