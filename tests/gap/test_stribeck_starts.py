"""The rise of a friction towards rest, from the missing torque at the measured speeds."""

import dataclasses

import gap_search
import jax
import numpy as np
import numpy_machine
import pytest

import fpjax as fp
from fpjax.gap import EFFECTS
from fpjax.gap.fit.candidate import NOMINAL
from fpjax.gap.fit.stribeck_starts import stribeck_rise
from fpjax.gap.select.starts import alone
from fpjax.gap.verb import make_search, read_logs

STRIBECK = next(effect for effect in EFFECTS if effect.name == "stribeck")


@pytest.fixture(scope="module")
def search():
    return gap_search.search_of(numpy_machine.record(seconds=5.0))


def missing(record, torque, width, exponent, *, coulomb=0.0, viscous=0.0, inertia=0.0):
    """What a model of too little of each does not give [N m]."""
    friction = (coulomb + torque * np.exp(-((np.abs(record.speed) / width) ** exponent))) * np.sign(record.speed)
    return -(friction + viscous * record.speed + inertia * record.acceleration)


@pytest.mark.parametrize(("share", "exponent"), [(0.01, 1.0), (0.05, 2.0), (0.15, 2.0)])
def test_the_rise_is_found_beside_wrong_numbers_and_an_offset(search, share, exponent):
    record, setting = search.records[0], search.setting
    course = missing(record, 0.7, share * setting.speed, exponent, coulomb=-0.1, viscous=0.01, inertia=0.02) + 0.3
    course[::3] = np.nan
    found = stribeck_rise(course, record, {"coulomb": 0.5, "viscous": 0.02}, setting)
    assert found["stribeck_exponent"] == exponent
    assert found["stribeck_velocity"] == pytest.approx(share * setting.speed, rel=0.15)
    assert found["stribeck_torque"] == pytest.approx(0.7, rel=0.2)
    assert found["coulomb"] == pytest.approx(0.4, rel=0.1)
    assert found["viscous"] == pytest.approx(0.03, rel=0.25)


def test_where_friction_falls_towards_rest_or_hardly_anything_is_known_there_is_none(search):
    record, setting, numbers = search.records[0], search.setting, {"coulomb": 0.5, "viscous": 0.02}
    falling = missing(record, -0.4, 0.05 * setting.speed, 2.0)
    assert stribeck_rise(falling, record, numbers, setting) == {}
    assert stribeck_rise(np.where(np.arange(len(falling)) < 40, -falling, np.nan), record, numbers, setting) == {}


def test_noise_has_no_rise(search):
    record, setting = search.records[0], search.setting
    rng = np.random.default_rng(4)
    for _ in range(20):
        noise = rng.standard_normal(len(record.speed))
        assert stribeck_rise(noise, record, {"coulomb": 0.5, "viscous": 0.02}, setting) == {}


def test_in_one_direction_an_offset_is_coulomb_friction(search):
    time, setting = 1e-3 * np.arange(5000), search.setting
    speed = 4.05 - 4.0 * np.cos(3.0 * time)
    record = dataclasses.replace(search.records[0], speed=speed, acceleration=12.0 * np.sin(3.0 * time))
    found = stribeck_rise(
        missing(record, 0.5, 0.6, 2.0, coulomb=0.1), record, {"coulomb": 0.5, "viscous": 0.02}, setting
    )
    assert found["stribeck_torque"] == pytest.approx(0.5, rel=0.2)
    assert found["coulomb"] == pytest.approx(0.6, rel=0.1)
    for still in (
        dataclasses.replace(record, acceleration=0.0 * time),
        dataclasses.replace(record, speed=0.0 * time + 3.0),
    ):
        stribeck_rise(missing(record, 0.5, 0.6, 2.0), still, {"coulomb": 0.5, "viscous": 0.02}, setting)


def test_a_start_with_numbers_of_its_own_is_not_tried_beside_others():
    search = gap_search.search_of(numpy_machine.record(numpy_machine.Machine(stribeck=0.4), seconds=5.0))
    with_numbers, without = {}, {}
    for start in alone(search):
        if start.effects == (STRIBECK,):
            own = start.values["stribeck_torque"], start.values["stribeck_velocity"], start.values["stribeck_exponent"]
            (with_numbers if start.like is None else without).setdefault(own, []).append(start)
    assert len(with_numbers) == 3  # two valleys, and the rise
    rise = search.setting.rise
    (alone_with_its_numbers,) = with_numbers[
        rise["stribeck_torque"], rise["stribeck_velocity"], rise["stribeck_exponent"]
    ]
    assert alone_with_its_numbers.values.items() >= rise.items()
    assert without.keys() == with_numbers.keys() - {tuple(rise[n] for n in list(rise)[:3])}


# Static friction of twice the Coulomb level: the machine of a model without it slides where this one sticks.
STICKS = """
[units]
sensors = "velocity"
[plant]
type = "one_mass"
inertia = 0.1867152676896857
[friction]
type = "coulomb_viscous"
coulomb = 3.8841418969307275
viscous = 1.7901269827847848
[controller]
type = "pi"
kp = 17.900964225737
ki = 170.55725623009303
[reference]
type = "multisine"
amplitudes = [1.0433829193464113, 0.22761785130250664]
frequencies = [0.46961395774096326, 1.474884176313262]
[sensor]
noise = 0.0010433829193464113
[simulation]
dt = 0.001
duration = 5
stepping = "sampled"
solver = "exact"
"""


@pytest.mark.long
def test_a_machine_that_sticks_and_breaks_away_has_the_friction_that_it_has():
    rubs = STICKS.replace("[controller]", "stribeck_torque = 3.9108\nstribeck_velocity = 0.2094\n[controller]")
    machine, columns = fp.load_model(rubs), {"torque": "torque", "velocity": "measured_velocity"}
    run = fp.simulate(machine, record=tuple(columns.values()), key=jax.random.key(6))
    log = {name: np.asarray(run.signals[signal]) for name, signal in columns.items()} | {"time": np.asarray(run.time)}
    search = make_search(read_logs(log)[0], [], fp.load_model(STICKS))
    # Beside all other effects: with a start that is far off it is left behind before it has come near.
    fits = [fit for fit in search.explore(alone(search)) if fit.candidate.effects == (STRIBECK,)]
    found = max(fits, key=lambda fit: fit.evidence).candidate.values()
    assert found["stribeck_torque"] == pytest.approx(3.91, rel=0.05)
    assert found["stribeck_velocity"] == pytest.approx(0.2094, rel=0.05)
    assert {name: found[name] for name in NOMINAL} == pytest.approx(
        {"inertia": 0.187, "coulomb": 3.88, "viscous": 1.79}, rel=0.02
    )
