"""The gap of a log without a rate sensor: told in torque, by the measured motion and the model's own step."""

import dataclasses
import pathlib

import numpy as np
import pytest
from gap_machine import Machine, record
from gap_search import MODEL, search_of

from fpjax.gap import EFFECTS, diagnose
from fpjax.gap.assemble import machine_of, residual_trace
from fpjax.gap.corners import corner_torque
from fpjax.gap.fit import make_candidate
from fpjax.gap.imposed import noise_torque, torque_floor
from fpjax.gap.judging import too_quiet, weigh
from fpjax.gap.measure import rms
from fpjax.gap.record import (
    PAST,
    band_weights,
    make_record,
    smoothed,
    stride_of,
    with_common_noise,
)
from fpjax.gap.vocabulary import on_rate_sensor
from fpjax.logs import read_log

NOISE = 1e-6
EMPS = pathlib.Path(__file__).parents[3] / "shared" / "data" / "emps"
# the published symmetric fit: kg, N, N s/m, N
REAL_MODEL = """[units]
motion = "linear"
reference = "position"
sensors = "position"
[plant]
type = "one_mass"
inertia = 95.11
[friction]
type = "coulomb_viscous"
coulomb = 20.39
viscous = 203.5
offset = -3.165
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""


def position_log(extra=lambda time, velocity, position, command: 0.0, **words):
    return record(Machine(), extra=extra, sensors=("position",), position_noise=NOISE, **words)


def finished(search, names=(), start=None, nominal="fixed"):
    effects = [effect for effect in search.effects if effect.name in names]
    candidate = search.candidate(effects, start or {}, nominal)
    search.fit([candidate], search.train, 8)
    return search.finish([candidate])[0]


def test_the_true_model_leaves_the_encoders_noise():
    search = search_of(position_log())
    left = residual_trace(search, finished(search), 0)
    level = noise_torque(search.records[0], 0.05)
    moving = np.abs(search.records[0].speed) > 0.5  # the corners of the friction at a reversal are smoothed
    assert rms(left[moving]) == pytest.approx(level, rel=0.25)
    assert level < 0.05 * 0.4


def test_a_known_torque_is_what_is_left():
    def pull(time, velocity, position, command):
        return 0.1 * np.sin(2.0 * np.pi * 1.3 * time)

    search = search_of(position_log(pull))
    left = residual_trace(search, finished(search), 0)
    time, speed = search.records[0].time, search.records[0].speed
    moving = np.isfinite(left) & (np.abs(speed) > 0.5)
    # needed less commanded: the model needs the torque that it does not know of
    assert np.polyfit(np.sin(2.0 * np.pi * 1.3 * time[moving]), left[moving], 1)[0] == pytest.approx(0.1, rel=0.02)


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("compliance", {"stiffness": 5e4, "damping_ratio": 0.3, "load_share": 0.4, "friction_share": 0.5}),
        ("presliding", {"bristle_deflection": 1e-4, "bristle_exponent": 1.0}),
    ],
)
def test_a_hidden_state_that_hardly_moves_changes_nothing(name, start):
    log = position_log()
    search = search_of(log)
    rigid = residual_trace(search, finished(search), 0)
    effect = next(effect for effect in search.effects if effect.name == name)
    candidate = search.candidate([effect], start, "fixed")
    stiff = search.finish([dataclasses.replace(candidate, window_cost=[np.zeros(0)])])[0]
    moving = np.abs(search.records[0].speed) > 0.5
    assert rms((residual_trace(search, stiff, 0) - rigid)[moving]) < 0.02 * 0.4


def test_nothing_but_parameters_is_free():
    search = search_of(position_log())
    for names in ((), ("compliance",), ("presliding",)):
        effects = [effect for effect in search.effects if effect.name in names]
        family = search.family(effects)
        assert not np.any(search.fitters[family.key].scales[0][0])
    assert not search.observers
    starts = search.records[0].starts
    assert starts[0] >= PAST
    assert starts[-1] + search.records[0].samples < len(search.records[0].time)


def test_the_band_is_that_of_the_acceleration():
    random = np.random.default_rng(0)
    position = np.cumsum(np.cumsum(random.standard_normal(400)))
    for half in (6, 13):
        weights = band_weights(half)
        assert np.sum(weights) == pytest.approx(1.0)
        twice = smoothed(smoothed(position, half)[1], half)[1]
        edge = 1 + len(weights) // 2
        averaged = np.convolve(np.diff(position, 2), weights, "valid")
        np.testing.assert_allclose(twice[edge:-edge], averaged, atol=1e-9 * np.ptp(position))
        power = np.abs(np.fft.rfft(weights, 4096)) ** 2
        above = power[np.fft.rfftfreq(4096) > 0.5 / stride_of(half)]
        assert np.sum(above) < 0.35 * np.sum(power)


def test_laps_tell_the_floor_where_the_reference_repeats():
    random = np.random.default_rng(1)
    count, lap = 6000, 1500
    reference = np.tile(np.sin(2.0 * np.pi * np.arange(lap) / lap), 4)
    log = position_log(seconds=6.0)
    record = dataclasses.replace(make_record(log, window=0.5), reference=reference)
    level = noise_torque(record, 0.05)
    left = 5.0 * level * random.standard_normal(count) + np.tile(50.0 * level * random.standard_normal(lap), 4)
    floor = torque_floor(record, left, 0.05)
    assert floor.source == "repeats"
    assert floor.value == pytest.approx(5.0 * level, rel=0.05)
    assert torque_floor(dataclasses.replace(record, reference=None), left, 0.05).source == "sensor"


def test_one_sensor_has_one_noise():
    loud, quiet = position_log(seconds=6.0), position_log(seconds=6.0)
    quiet = dataclasses.replace(quiet, position=smoothed(quiet.position, 8)[0])
    records = [make_record(log, window=0.5) for log in (quiet, loud)]
    assert records[0].position.noise < 0.3 * records[1].position.noise
    assert {r.position.noise for r in with_common_noise(records)} == {records[1].position.noise}


def test_a_coarse_encoder_is_differentiated_over_a_longer_stretch():
    log = position_log(seconds=6.0)
    coarse = dataclasses.replace(log, position=1e-3 * np.round(log.position / 1e-3))
    assert make_record(coarse, window=0.5).position.step == pytest.approx(1e-3, rel=1e-3)
    assert make_record(coarse, window=0.5).half > make_record(log, window=0.5).half


def test_a_contact_is_not_overdamped():
    search = search_of(position_log(seconds=6.0))
    for name in ("compliance", "backlash"):
        effect = next(effect for effect in search.effects if effect.name == name)
        start = effect.starts(search.setting)[0]
        family = search.family([effect])
        candidate = make_candidate([effect], family, search.setting, search.records, start | {"damping_ratio": 40.0})
        values = candidate.values()
        assert values["damping_ratio"] == 1.5
        share = values["load_share"]
        reduced = 0.05 * share * (1.0 - share)
        found = float(machine_of(candidate).plant.damping)
        assert found == pytest.approx(2.0 * 1.5 * np.sqrt(values["stiffness"] * reduced), rel=1e-6)


def test_effects_of_a_rate_sensor_are_nothing_without_one():
    names = {effect.name for effect in EFFECTS if on_rate_sensor(effect)}
    assert names == {"velocity_bias", "velocity_scale_error", "velocity_lag", "velocity_delay"}


def test_a_cause_is_found_from_positions_alone():
    def drag(time, velocity, position, command):
        return -0.01 * velocity * np.abs(velocity)

    tried = {"quadratic_drag", "viscous_error", "asymmetric_friction", "inertia_error"}
    effects = tuple(effect for effect in EFFECTS if effect.name in tried)
    answer = diagnose(position_log(drag, seconds=10.0), MODEL, effects=effects)
    assert answer.verdict == "explained"
    assert answer.causes == ("quadratic_drag",)
    assert answer.gap.signal == "torque"
    assert answer.gap.unit == "N m"
    assert answer.ranking[0].effect == "quadratic_drag"
    assert answer.ranking[0].parameters["coefficient"].value == pytest.approx(0.01, rel=0.01)


def test_corners_are_what_a_perfect_model_leaves():
    """Of a log without a gap: the model that made it leaves no more than one that is made along its motion."""
    search = search_of(position_log())
    left = residual_trace(search, finished(search), 0)
    corners = corner_torque(search)
    assert corners > 1.02 * noise_torque(search.records[0], 0.05)  # friction reverses here ten times
    assert rms(left[np.isfinite(left)]) == pytest.approx(corners, rel=0.2)
    assert search.corners == corners


def test_a_model_that_leaves_less_than_a_perfect_one_is_not_believed():
    """A small mass beside the encoder passes on less of its noise, whatever the machine is."""
    search = search_of(position_log())
    exact = finished(search)
    assert not too_quiet(search, exact)
    bought = dataclasses.replace(exact, train=0.3 * exact.train, withheld=0.3 * exact.withheld)
    assert too_quiet(search, bought)
    weigh(search, [exact, bought])
    assert exact.evidence > bought.evidence == -np.inf


@pytest.mark.parametrize(("extra", "causes"), [(0.0, ()), (0.1, ("constant_torque",))])
def test_no_compliance_is_named_beside_what_is_there(extra, causes):
    tried = {"compliance", "constant_torque", "inertia_error"}
    effects = tuple(effect for effect in EFFECTS if effect.name in tried)
    answer = diagnose(position_log(lambda *at: extra, seconds=10.0), MODEL, effects=effects)
    assert answer.causes == causes
    assert answer.verdict == ("explained" if causes else "no_gap")


@pytest.mark.slow
@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS records are not here")
def test_a_real_axis_is_asymmetric_and_its_other_record_says_how_much_is_left():
    logs = [read_log(EMPS / name, columns="emps") for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")]
    answer = diagnose(logs[0], REAL_MODEL, holdout=logs[1])
    assert answer.ranking[0].effect == "asymmetric_friction"
    parameters = answer.ranking[0].parameters
    assert parameters["viscous_positive"].value == pytest.approx(166.7, rel=0.1)
    assert parameters["viscous_negative"].value == pytest.approx(240.4, rel=0.1)
    gap = answer.gap
    assert gap.unit == "N"
    assert gap.before == pytest.approx(2.54, rel=0.05)
    assert gap.noise_floor == pytest.approx(0.29, rel=0.25)
    assert gap.after < 1.9  # 1.83 when this was written; the goal of 1.56 asks for a law outside the vocabulary
    assert answer.verdict == "unexplained"
    assert answer.causes == ()
    assert any("is structure and not noise" in warning for warning in answer.warnings)
    assert answer.residual_where is not None
    assert answer.residual_where.velocity
    torques = [e.parameters["stribeck_torque"].value for e in answer.ranking if e.effect == "stribeck"]
    assert all(torque >= 0.0 for torque in torques)
